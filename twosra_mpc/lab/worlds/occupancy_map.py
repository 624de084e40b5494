"""Maps of ROS (``map.yaml`` beside an image) as polygons that hold every occupied cell.

https://docs.ros.org/en/rolling/p/nav2_map_server, http://wiki.ros.org/map_server
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import InputError, Obstacle, obstacles_of
from twosra_mpc.errors import doubt
from twosra_mpc.files import is_device, read_text, reading
from twosra_mpc.keys import near_key
from twosra_mpc.lab.image_file import open_image
from twosra_mpc.robot.coordinates import Array, rotation
from twosra_mpc.validation import ArrayValue, Metres, NonNegative, Number, Positive, Value, plain

_SAME = 1e-6  # cells: a tolerance or an area of whole ones is it, whatever rounding makes of it
_BRIDGE = 1 / 64  # of a cell, by which cells that share a corner are joined
_MOST_CORNERS = 64  # that one straight side may stand for
_MOST_OF_MAP = 20_000  # corners: twenty seconds, and more than can be planned around
_OPAQUE, _PERCENT = 255, 100  # of a pixel
_DIGITS = 5  # thresholds that are a level but for rounding are it
_TURN_RAD, _ROUGH_M = math.tau, 0.5  # no map of a robot that is turned more, or has larger cells
_SAVED_UNKNOWN = 205  # grey that map_saver writes for unknown; share 0.196
_UPRIGHT, _ORIENTATION = 1, 0x0112  # EXIF
_INTEGER, _NUMBER, _MERGE = (f"tag:yaml.org,2002:{each}" for each in ("int", "float", "merge"))
_WRITTEN = re.compile(r"[-+]?(\.?\d+|\d+\.\d*)([eE][-+]?\d+)?$")  # finite numbers of YAML 1.2
_MODES = ("1", "L", "LA", "P", "PA", "RGB", "RGBA")  # 8 bits a channel, as Pillow calls them


class _MapFile(Value):
    image: str
    resolution: Positive
    origin: tuple[Metres, Metres, Number]
    negate: Literal[0, 1] = 0
    occupied_thresh: NonNegative = 0.65
    free_thresh: NonNegative = 0.25
    mode: Literal["trinary", "scale", "raw"] = "trinary"


@dataclass(frozen=True, eq=False, repr=False)
class OccupancyMap(ArrayValue):
    """Cells in the plane.

    Attributes:
        occupied: Whether a cell is an obstacle, (rows, columns); row 0 is the lowest.
        unknown: Cells of which the map does not say it, whatever ``occupied`` takes them for.
        cell_m: Side of a cell.
        origin: Pose (x [m], y [m], yaw [rad]) of the lower left corner of the lower left cell.
    """

    occupied: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    cell_m: float
    origin: tuple[float, float, float]

    def in_plane(self, cells: Array) -> Array:
        """Points [m] of points (..., 2) in cells, to the nanometre."""
        turned = self.cell_m * cells @ rotation(self.origin[2])
        return np.round(np.array(self.origin[:2]) + turned, 9)


def read_map(path: str | Path, *, unknown_is_free: bool = False) -> OccupancyMap:
    """Read a map of ROS.

    Args:
        path: The YAML file; its image is taken from the same folder.
        unknown_is_free: What to take cells for of which the map does not say it.

    Warns:
        InputWarning: If keys are left out, the angle may be in degrees, the image is stored turned,
            inexactly or with others, or free cells have the grey of unknown ones and are taken as
            unknown.

    Raises:
        InputError: If file or image cannot be read, or say something that is not understood.
    """
    with reading(str(path), "map"):
        return _map(Path(path), unknown_is_free)


def _map(path: Path, unknown_is_free: bool) -> OccupancyMap:
    source = str(path)
    document = _document(read_text(path, source), source)
    doubts = []
    for key in [each for each in document if each not in _MapFile.model_fields]:
        value, known = document.pop(key), list(_MapFile.model_fields)
        if hint := near_key(key, value, known):
            raise InputError(key, value, f"known keys are {', '.join(known)}", source, hint=hint)
        doubts.append(f"{key} is not known here, and left out")
    said = _MapFile.parse(document, source)
    if not said.free_thresh <= said.occupied_thresh <= 1:
        allowed = f"from free_thresh = {said.free_thresh:zg} to 1"
        raise InputError("occupied_thresh", said.occupied_thresh, allowed, source)
    if said.negate and said.mode == "raw":  # ROS 1 negates it, and ROS 2 does not
        raise InputError("negate", 1, "0 where mode is raw: its levels are per cent", source)
    if said.resolution > _ROUGH_M:
        doubts.append(f"each cell is {said.resolution:zg} m wide (are these centimetres?)")
    if abs(yaw := said.origin[2]) > _TURN_RAD:
        doubts.append(f"origin turns the map by {yaw:zg} rad, more than once (are these degrees?)")
    folder = Path() if is_device(path) else path.parent  # a pipe's map is one of where it is read
    channels, of_image = _pixels(folder, said.image, source)
    doubts += of_image
    sums, seen = channels[..., :3].sum(axis=2, dtype=np.int32), channels[..., 3] == _OPAQUE
    lightness = np.arange(3.0 * _OPAQUE + 1.0)  # three times the mean of the colours, as ROS has it
    darkness = lightness if said.negate else lightness[::-1]
    if said.mode == "raw":  # per cent, and levels above say nothing
        darkness = np.where(lightness <= 3 * _PERCENT, lightness * (_OPAQUE / _PERCENT), math.nan)
    thresholds = np.array([said.occupied_thresh, said.free_thresh])
    most, least = np.round(3 * _OPAQUE * thresholds, _DIGITS).tolist()
    occupied, free = (darkness > most)[sums], (darkness < least)[sums]
    saved = (channels[..., :3] == _SAVED_UNKNOWN).all(axis=2) & free & seen & (not said.negate)
    if count := int(saved.sum()):
        grey = f"{count} cells of grey {_SAVED_UNKNOWN}, which map_saver writes for unknown"
        doubts.append(f"{grey}, are free by free_thresh = {said.free_thresh:zg}; taken as unknown")
    doubt(doubts, source)
    occupied, free = occupied & seen, free & seen & ~saved
    unknown = ~(occupied | free)
    taken = occupied if unknown_is_free else ~free
    return OccupancyMap(taken[::-1], unknown[::-1], said.resolution, said.origin)


def obstacles_on(
    cells: OccupancyMap, name: str, tolerance_m: float | None = None, least_area_m2: float = 0.0
) -> tuple[tuple[Obstacle, ...], int]:
    """Polygons that hold every occupied cell, and how many specks were left out.

    The outline of the cells is only ever moved outwards: stretches of it are replaced by straight
    lines beyond all their corners, and what lies between is added. So nothing that is occupied is
    lost, and nothing farther from it than the tolerance is added.

    Args:
        cells: The map.
        name: Of the obstacles, followed by their number.
        tolerance_m: How far the outline may be moved; by default, one cell.
        least_area_m2: Occupied places that are smaller and stand alone are left out.

    Raises:
        InputError: If the outline has so many corners that nothing could be planned around it.
    """
    import shapely

    tolerance = (1.0 if tolerance_m is None else tolerance_m / cells.cell_m) + _SAME
    occupied, specks = _without_specks(cells.occupied, least_area_m2 / cells.cell_m**2 - _SAME)
    if (corners := _corners(occupied)) > _MOST_OF_MAP:
        allowed = (
            f"at most {_MOST_OF_MAP}: leave out specks (--least-area), or scale the image down"
            " (half as wide and high, each cell as dark as its darkest; resolution is then double)"
        )
        raise InputError("corners of what is occupied", corners, allowed)
    large = shapely.get_parts(_union(occupied)).tolist()
    fills = [fill for part in large for fill in _fills(part, tolerance)]
    filled = shapely.union_all([*large, *fills])
    found = [_unpinched(part) for part in shapely.get_parts(filled.simplify(0.0)).tolist()]
    outlines = [shapely.transform(part, cells.in_plane) for part in found]
    return obstacles_of(outlines, [name] * len(outlines)), specks


def _without_specks(occupied: NDArray[np.bool_], least: float) -> tuple[NDArray[np.bool_], int]:
    """Occupied cells without places of fewer cells, and how many of these there are."""
    if least <= 1.0:
        return occupied, 0
    from scipy.ndimage import label

    place, _ = label(occupied, np.ones((3, 3)))
    small = np.bincount(place.ravel()) < least
    small[0] = False
    return occupied & ~small[place], int(small.sum())


def _corners(occupied: NDArray[np.bool_]) -> int:
    """Corners of the outline of what is occupied."""
    odd = np.diff(np.diff(np.pad(occupied, 1), axis=0), axis=1)  # of truths: whether they differ
    return int(odd.sum()) + 2 * int(_pinched(occupied).sum())


def _pinched(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True where two occupied cells share a corner alone, (rows - 1, columns - 1)."""
    lower, upper = occupied[:-1], occupied[1:]
    a, b, c, d = lower[:, :-1], lower[:, 1:], upper[:, :-1], upper[:, 1:]
    return (a & d & ~b & ~c) | (b & c & ~a & ~d)


def _union(occupied: NDArray[np.bool_]) -> Any:
    """The occupied cells as polygons, a cell of side 1; those that share a corner are joined."""
    import shapely

    edges = np.diff(np.pad(occupied, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, left = np.nonzero(edges == 1)
    _, right = np.nonzero(edges == -1)
    runs = shapely.box(left, rows, right, rows + 1)
    y, x = np.nonzero(_pinched(occupied))
    bridges = shapely.box(x + 1 - _BRIDGE, y + 1 - _BRIDGE, x + 1 + _BRIDGE, y + 1 + _BRIDGE)
    return shapely.union_all(np.concatenate([runs, bridges])).simplify(0.0)  # straight sides whole


def _fills(polygon: Any, tolerance: float) -> list[Any]:
    """Fillings between the outline of a polygon and straight lines beyond it."""
    import shapely

    inside = [shapely.Polygon(ring) for ring in polygon.interiors]
    fills: list[Any] = [hole for hole in inside if hole.buffer(-tolerance).is_empty]
    if polygon.area == polygon.envelope.area:  # a box: nothing is between it and lines beyond it
        return fills
    turned = shapely.orient_polygons(polygon)  # the polygon is on the left of its rings
    for ring in (turned.exterior, *turned.interiors):
        corners = np.array(ring.coords)[:-1]
        first = int(np.lexsort(corners.T)[0])
        corners = np.concatenate([corners[first:], corners[: first + 1]])
        i = 0
        while i < len(corners) - 1:
            j = i + _farthest(corners[i : i + _MOST_CORNERS + 1], tolerance)
            if j > i + 1:
                fills.append(shapely.make_valid(shapely.Polygon(corners[i : j + 1])))
            i = j
    return [fill for fill in fills if fill.area > 0]


def _farthest(chain: Array, tolerance: float) -> int:
    """Last corner to which a line from the first has all between on its left, within tolerance."""
    to = chain[1:] - chain[0]
    length2 = (to**2).sum(axis=1)
    left = np.outer(*to.T) - np.outer(*to.T[::-1])  # of line j: corner k, times the line's length
    along = np.clip((to @ to.T) / np.maximum(length2, 1e-300)[:, None], 0.0, 1.0)
    away2 = ((to[None] - along[..., None] * to[:, None]) ** 2).sum(axis=2)
    fine = (left >= 0) & (away2 <= tolerance**2)
    fine |= np.triu(np.ones_like(fine))  # corners after its end do not matter
    return int(np.flatnonzero(fine.all(axis=1) & (length2 > 0))[-1]) + 1


def _unpinched(polygon: Any) -> Any:
    """A polygon that touches itself in no corner: where it does, made thicker by a bridge."""
    rings = (polygon.exterior, *polygon.interiors)
    corners = np.concatenate([np.array(ring.coords)[:-1] for ring in rings])
    if len(np.unique(corners, axis=0)) == len(corners):
        return polygon
    return polygon.buffer(_BRIDGE, join_style="mitre")


def _pixels(folder: Path, named: str, source: str) -> tuple[NDArray[np.uint8], list[str]]:
    """Colours and opacity of each pixel, (rows, columns, 4), and doubts about the image."""
    path, name = folder / named, PureWindowsPath(named).name  # which takes / and \\ alike
    try:
        with open_image(path) as image:
            if image.mode not in _MODES:
                raise InputError("image", str(path), "grey or RGB, 8 bits a channel", source)
            doubts = {
                "its image says (EXIF) that it is stored turned; taken as it is stored": (
                    image.getexif().get(_ORIENTATION, _UPRIGHT) != _UPRIGHT
                ),
                "its image is a JPEG, which does not keep greys exactly": image.format == "JPEG",
            }
            pixels = np.asarray(image.convert("RGBA"))
            return pixels, [words for words, true in doubts.items() if true]
    except Exception as error:  # a spoilt image fails in many ways
        allowed = getattr(error, "allowed", f"an image file ({error})")
        beside = not path.exists() and (folder / name).is_file()
        hint = f"did you mean {name}, beside it?" * beside  # map_saver wrote the path it was given
        raise InputError("image", str(path), allowed, source, hint=hint) from None


def _document(text: str, source: str) -> dict[str, Any]:
    """Read a map's YAML file: a table of keys, each of them once; lists become tuples.

    Numbers are those of YAML 1.2, which ROS 2 reads: 010 is ten, and 1:30 is none.
    """
    import yaml  # maps alone need it

    class Loader(yaml.SafeLoader):
        """The safe loader, refusing a key that is there twice."""

        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            keys = [self.construct_object(k, deep=True) for k, _ in node.value if k.tag != _MERGE]
            if twice := [key for i, key in enumerate(keys) if key in keys[:i]]:
                raise InputError("keys", f"{twice[0]} twice", "each key once", source)
            return super().construct_mapping(node, deep)

    Loader.yaml_implicit_resolvers = {
        first: [(tag, words) for tag, words in known if tag not in (_INTEGER, _NUMBER)]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    Loader.add_implicit_resolver(_NUMBER, _WRITTEN, [*"-+.0123456789"])
    try:
        found = yaml.load(text, Loader)  # the safe one
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}" if mark else "file"
        raise InputError(where, f"{error.problem}", "valid YAML, without tags", source) from None
    if not isinstance(found, dict):
        raise InputError("file", source, "a map: lines such as resolution: 0.05")
    return {
        str(key): int(value) if isinstance(value, bool) else plain(value)
        for key, value in found.items()
    }


def feature_collection(obstacles: Iterable[Obstacle]) -> dict[str, Any]:
    """Return obstacles as a GeoJSON document that ``read_obstacles`` reads; discs as polygons."""
    features = []
    for obstacle in obstacles:
        corners = obstacle.corners_m.tolist()
        geometry = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
        named = {"name": obstacle.name}
        features.append({"type": "Feature", "properties": named, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}
