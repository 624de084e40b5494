"""Maps of ROS (``map.yaml`` beside an image) as polygons that hold every occupied cell.

https://docs.ros.org/en/rolling/p/nav2_map_server, http://wiki.ros.org/map_server
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.files import open_image, read_text, reading
from twosra_mpc.problem.geojson import obstacles_of
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import NonNegative, Number, Positive, Value

_BRIDGE = 1 / 64  # of a cell, by which cells that share a corner are joined
_MOST_CORNERS = 64  # that one straight side may stand for
_MOST_OF_MAP = 20_000  # corners: twenty seconds, and more than can be planned around
_LEVELS, _DIGITS = 255, 6  # of a pixel; thresholds that are a level but for rounding are it
_MODES = ("1", "L", "LA", "P", "PA", "RGB", "RGBA")  # 8 bits a channel, as Pillow calls them


class _MapFile(Value):
    image: str
    resolution: Positive
    origin: tuple[Number, Number, Number]
    negate: Literal[0, 1] = 0
    occupied_thresh: NonNegative = 0.65
    free_thresh: NonNegative = 0.25
    mode: Literal["trinary"] = "trinary"


@dataclass(frozen=True, eq=False)
class OccupancyMap:
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
        *corner, yaw = self.origin
        c, s = math.cos(yaw), math.sin(yaw)
        turned = self.cell_m * cells @ np.array([[c, s], [-s, c]])
        points: Array = np.round(np.array(corner) + turned, 9)
        return points


def read_map(path: str | Path, *, unknown_is_free: bool = False) -> OccupancyMap:
    """Read a map of ROS.

    Args:
        path: The YAML file; its image is taken from the same folder.
        unknown_is_free: What to take cells for of which the map does not say it.

    Raises:
        InputError: If file or image cannot be read, or say something that is not understood; modes
            other than trinary are not.
    """
    with reading(str(path), "map"):
        return _map(Path(path), unknown_is_free)


def _map(path: Path, unknown_is_free: bool) -> OccupancyMap:
    said = _MapFile.parse(_flat_yaml(read_text(path, str(path)), str(path)), str(path))
    if not said.free_thresh <= said.occupied_thresh <= 1:
        allowed = f"from free_thresh = {said.free_thresh:zg} to 1"
        raise InputError("occupied_thresh", said.occupied_thresh, allowed, str(path))
    light, seen = _pixels(path.parent / said.image, str(path))
    darkness = np.arange(256) if said.negate else np.arange(256)[::-1]
    levels = np.round(_LEVELS * np.array([said.occupied_thresh, said.free_thresh]), _DIGITS)
    occupied, free = (darkness > levels[0])[light], (darkness < levels[1])[light]
    occupied, free = occupied & seen, free & seen
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

    tolerance = 1.0 if tolerance_m is None else tolerance_m / cells.cell_m
    occupied, specks = _without_specks(cells.occupied, least_area_m2 / cells.cell_m**2)
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
    """What is occupied without places of fewer cells, and how many of these there are."""
    if least <= 1.0:
        return occupied, 0
    from scipy.ndimage import label

    place, _ = label(occupied, np.ones((3, 3)))
    small = np.bincount(place.ravel()) < least
    small[0] = False
    return occupied & ~small[place], int(small.sum())


def _corners(occupied: NDArray[np.bool_]) -> int:
    """Corners of the outline of what is occupied."""
    padded = np.pad(occupied, 1)
    lower, upper = padded[:-1], padded[1:]
    odd = (lower[:, :-1] ^ lower[:, 1:]) ^ (upper[:, :-1] ^ upper[:, 1:])
    return int(odd.sum()) + 2 * int(_pinched(occupied).sum())


def _pinched(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where two occupied cells share a corner alone, (rows - 1, columns - 1)."""
    lower, upper = occupied[:-1], occupied[1:]
    a, b, c, d = lower[:, :-1], lower[:, 1:], upper[:, :-1], upper[:, 1:]
    found: NDArray[np.bool_] = (a & d & ~b & ~c) | (b & c & ~a & ~d)
    return found


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
    """What lies between the outline of a polygon and straight lines beyond it."""
    import shapely

    inside = [shapely.Polygon(ring) for ring in polygon.interiors]
    fills: list[Any] = [hole for hole in inside if hole.buffer(-tolerance).is_empty]
    if polygon.area == polygon.envelope.area:  # a box: nothing is between it and lines beyond it
        return fills
    turned = shapely.orient_polygons(polygon)  # the polygon is on the left of its rings
    for ring in (turned.exterior, *turned.interiors):
        corners = np.array(ring.coords)[:-1]
        first = int(np.lexsort(corners.T)[0])
        corners = np.roll(corners, -first, axis=0)
        corners = np.concatenate([corners, corners[:1]])
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
    x, y = to.T
    left = np.outer(x, y) - np.outer(y, x)  # of line j: corner k, times the line's length
    along = np.clip((to @ to.T) / np.maximum(length2, 1e-300)[:, None], 0.0, 1.0)
    away2 = ((to[None] - along[..., None] * to[:, None]) ** 2).sum(axis=2)
    fine = (left >= 0) & (away2 <= tolerance**2)
    fine |= np.triu(np.ones_like(fine))  # corners after its end do not matter
    good = fine.all(axis=1) & (length2 > 0)
    return int(np.flatnonzero(good)[-1]) + 1


def _unpinched(polygon: Any) -> Any:
    """A polygon that touches itself in no corner: where it does, made thicker by a bridge."""
    rings = (polygon.exterior, *polygon.interiors)
    corners = np.concatenate([np.array(ring.coords)[:-1] for ring in rings])
    if len(np.unique(corners, axis=0)) == len(corners):
        return polygon
    return polygon.buffer(_BRIDGE, join_style="mitre")


def _pixels(path: Path, source: str) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """How light each pixel is, from 0 to 255, and whether it is opaque; (rows, columns)."""
    try:
        with open_image(path) as image:
            if image.mode not in _MODES:
                raise InputError("image", str(path), "an image of 8 bits a channel", source)
            pixels = np.asarray(image.convert("LA"))
    except InputError:
        raise
    except Exception as error:  # a spoilt image fails in many ways
        raise InputError("image", str(path), f"an image file ({error})", source) from None
    return pixels[..., 0], pixels[..., 1] == 255


def _flat_yaml(text: str, source: str) -> dict[str, Any]:
    """Read ``key: value`` lines, values being numbers, words or lists of numbers.

    That is all of YAML that maps need; anything else is refused, with the number of the line.
    """
    found: dict[str, Any] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        line = re.sub(r"(^|\s)#.*", "", line).rstrip()
        if not line or line == "---":
            continue
        item = re.fullmatch(r"\s*-\s+(\S+)", line)
        if item and found and isinstance(last := found[key := list(found)[-1]], tuple):
            found[key] = (*last, _scalar(item[1]))
            continue
        pair = re.fullmatch(r"(\w+):(?:\s+(.+))?", line)
        if pair is None or pair[1] in found:
            allowed = "lines such as resolution: 0.05 or origin: [0.0, 0.0, 0.0], each key once"
            raise InputError(f"line {number}", line, allowed, source)
        value = pair[2] or "[]"
        listed = re.fullmatch(r"\[(.*)\]", value)
        words = [word.strip() for word in listed[1].split(",") if word.strip()] if listed else []
        found[pair[1]] = tuple(map(_scalar, words)) if listed else _scalar(value)
    return found


def _scalar(word: str) -> object:
    if re.fullmatch(r"[-+]?[\d.]+([eE][-+]?\d+)?", word):
        try:
            return float(word) if re.search(r"[.eE]", word) else int(word)
        except ValueError:
            return word
    if word.lower() in ("true", "false"):
        return int(word.lower() == "true")
    return word[1:-1] if re.fullmatch(r"'.*'|\".*\"", word) else word
