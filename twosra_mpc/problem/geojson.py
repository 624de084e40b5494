"""Obstacles from GeoJSON files, and from whatever describes itself so, e.g. shapely's polygons.

Coordinates are metres in the plane of the robot; degrees are refused where a file names its frame,
and doubted where it does not. A polygon is proper if GEOS calls it valid. One with holes becomes
several without, cut along lines of constant y; nothing is lost.
"""

from __future__ import annotations

import functools
import itertools
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError, doubt
from twosra_mpc.files import read_document, reading
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array

_FAR_M = 100.0  # no robot of this kind goes there: another unit
_THIN_M = 1e-3  # nothing to drive round is as small: another unit
_TURN_DEG = 360.0
_REMOTE = 100.0  # times its size from the origin is a map of the Earth, not of a room
_KINDS = "Polygon, MultiPolygon, GeometryCollection, Feature or FeatureCollection"
_CODE = re.compile(r"(?:(?:EPSG|ESRI)\b.*?|^\D{0,9})\b(\d{4,6})\b", re.IGNORECASE)
_UNIT = re.compile(  # in WKT, in PROJJSON, in a string of PROJ
    r"""UNIT\["([^"]+)|'unit': (?:\{[^}]*'name': )?'([^']+)|\+units=([\w-]+)""", re.IGNORECASE
)
_UNITS = {  # what names say
    "feet": r"(\b|_)(us.?)?(ft(us)?|feet|foot)(\b|_)",
    "degrees": r"CRS:?(84|83|27)h?\b|^(WGS.?84|NAD.?(27|83)|ETRS.?89)$|lon.?lat|lat.?lon|degree",
    "metres": r"^m$|^met(re|er)$|(\b|_)UTM(\b|_)",
}
_CODES = 2000, 105_000  # of plane frames, below; metres where ``geojson.toml`` has no other unit
_PROJECT = "coordinates in metres, near the origin (project the map, and move it there)"


@public
def obstacles_of(geometries: Any, names: Sequence[str] | None = None) -> tuple[Obstacle, ...]:
    """Obstacles from polygons of shapely, GeoPandas or GeoJSON, in metres.

    Args:
        geometries: Something with a ``__geo_interface__``, a GeoJSON mapping, or several of them.
        names: One for each; by default those in the properties of features. A name that several
            obstacles would have, also as pieces of one geometry, is followed by their numbers.

    Warns:
        InputWarning: If features have no geometry and are left out, or lengths may be degrees.

    Raises:
        InputError: If one is no polygon, is not a proper one, or is farther than 100 m away; if its
            coordinate reference system is not in metres.
    """
    return _obstacles(geometries, names, "obstacles")


def _obstacles(geometries: Any, names: Sequence[str] | None, source: str) -> tuple[Obstacle, ...]:
    single = isinstance(geometries, Mapping) or hasattr(geometries, "__geo_interface__")
    frames = {str(frame): frame for frame in _frames_of(geometries) if frame is not None}
    doubts = [each for frame in frames.values() for each in _doubts_about_frame(frame)]
    if isinstance(geometries, str | Obstacle) or not (single or isinstance(geometries, Iterable)):
        hint = "read_obstacles(path) reads a file." * isinstance(geometries, str | Path)
        allowed = f"a GeoJSON object, or a list of them: {_KINDS}"
        raise InputError("geometries", geometries, allowed, hint=hint)
    several = [geometries] if single else list(geometries)
    if names is not None and len(names) != len(several):
        raise InputError("names", len(names), f"one for each of {len(several)} geometries")
    found: list[tuple[str, Any]] = []
    left_out: list[str] = []
    for i, geometry in enumerate(several):
        given = None if names is None else names[i]
        where = "" if single else f"geometries.{i}"
        for name, field, rings in _polygons(_mapping(geometry, where), where, left_out):
            found.append((name if given is None else given, _polygon(rings, field)))
    if left_out and not found:
        raise InputError("features", f"{len(left_out)} without a geometry", "at least one polygon")
    doubts += [f"features without a geometry are left out: {len(left_out)}"] * bool(left_out)
    doubts += _doubts_about_lengths([polygon.bounds for _, polygon in found])
    doubt(doubts, source)
    pieces = [(name, piece) for name, polygon in found for piece in without_holes(polygon)]
    return tuple(_named(pieces))


@public
def read_obstacles(path: str | Path) -> tuple[Obstacle, ...]:
    """Obstacles in a GeoJSON file: its polygons, called by the name in their properties.

    Warns:
        InputWarning: If features have no geometry and are left out, or lengths may be degrees.

    Raises:
        InputError: If the file cannot be read, or holds something else than polygons in metres.
    """
    document = read_document(Path(path), str(path))
    with reading(str(path)):
        return _obstacles(document, None, str(path))


def without_holes(polygon: Any) -> Iterator[Any]:
    """Polygons of shapely without holes that together are a polygon with holes.

    Each cut goes through a hole, as far from all corners as can be.
    """
    import shapely

    if not polygon.interiors:
        yield polygon
        return
    left, low, right, high = polygon.bounds
    _, bottom, _, top = polygon.interiors[0].bounds
    heights = np.unique(shapely.get_coordinates(polygon)[:, 1])
    heights = heights[(heights >= bottom) & (heights <= top)]
    widest = int(np.diff(heights).argmax())
    level = float(heights[widest : widest + 2].mean())
    for half in (shapely.box(left, low, right, level), shapely.box(left, level, right, high)):
        for part in shapely.get_parts(shapely.intersection(polygon, half)):
            if part.geom_type == "Polygon":  # a corner on the line leaves a point, too
                yield from without_holes(part)


def _frames_of(geometries: Any) -> Iterator[Any]:
    """Coordinate reference systems that GeoPandas' objects, or a document and its parts, name."""
    if not isinstance(geometries, Mapping):
        yield getattr(geometries, "crs", None)
        return
    yield from (geometries.get("crs"), geometries.get("coordRefSys"))  # the latter of JSON-FG
    for key in ("features", "geometries", "geometry"):
        parts = geometries.get(key)
        for part in parts if isinstance(parts, list | tuple) else [parts]:
            yield from _frames_of(part)


def _doubts_about_frame(frame: Any) -> Iterator[str]:
    """Refuse coordinates in another unit, and doubt frames that are not known to be in metres."""
    if axes := getattr(frame, "axis_info", None):  # of pyproj
        units = {axis.unit_name for axis in axes}
        if units - {"metre", "meter"}:
            raise InputError("crs", str(frame), f"{_PROJECT}, not {', '.join(sorted(units))}")
        return
    properties = frame.get("properties") if isinstance(frame, Mapping) else None
    named = frame
    if isinstance(properties, Mapping):
        named = properties.get("name", properties.get("code", properties))
    unit = _unit_of(str(named))
    if unit not in ("", "metres"):
        raise InputError("crs", str(named), f"{_PROJECT}; these are {unit}")
    if not unit:
        yield f"crs = {named!r} is not known here; its coordinates are taken as metres"


def _unit_of(frame: str) -> str:
    """Unit of a coordinate reference system; nothing if that is not known here.

    The last unit that a description has is the one of its own axes, after those of its parts.
    """
    own = "".join(("", *_UNIT.findall(frame))[-1])
    frame = own or frame
    code = int(found[1]) if (found := _CODE.search(frame)) else 0
    said = (unit for unit, words in _UNITS.items() if re.search(words, frame, re.IGNORECASE))
    unit = _units_of_codes().get(code) or next(said, "")
    return unit or ("metres" if code in range(*_CODES) else own)


@functools.cache
def _units_of_codes() -> dict[int, str]:
    """Units other than metres of the frames that EPSG and ESRI number."""
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return {
        code: unit
        for unit, codes in table.items()
        for first, last, step in re.findall(r"(\d+)(?:-(\d+))?(?:/(\d))?", codes)
        for code in range(int(first), int(last or first) + 1, int(step or 1))
    }


def _doubts_about_lengths(bounds: Sequence[tuple[float, float, float, float]]) -> Iterator[str]:
    """Doubt polygons (left, low, right, high) in degrees, as the standard of GeoJSON has it."""
    if not bounds:
        return
    low, high = np.split(np.array(bounds), 2, axis=1)
    size, away = float((high - low).max()), float(np.linalg.norm(low.min(axis=0)))
    whole = float((high.max(axis=0) - low.min(axis=0)).max())
    if size < _THIN_M:
        yield f"no polygon is wider than {1e3 * size:z.2g} mm (are these degrees?)"
    elif away > _REMOTE * whole:
        words = f"all polygons are within {whole:z.2g} m, {away:z.3g} m from the origin"
        yield f"{words} (are these degrees?)"


def _polygons(
    document: Any, where: str, left_out: list[str]
) -> Iterator[tuple[str, str, list[Any]]]:
    """Yield (name, field, rings as given) of every polygon; notes features without a geometry."""
    kind, dot = document.get("type"), f"{where}." if where else ""
    if document.get("coordinates", document.get("geometries")) == []:  # as RFC 7946 has it
        left_out.append(where)
        return
    match kind:
        case "FeatureCollection" | "GeometryCollection":
            key = "features" if kind == "FeatureCollection" else "geometries"
            for i, item in enumerate(_list(document.get(key), f"{dot}{key}")):
                field = f"{dot}{key}.{i}"
                yield from _polygons(_mapping(item, field), field, left_out)
        case "Feature":
            field = f"{dot}geometry"
            properties, geometry = document.get("properties"), document.get("geometry")
            name = properties.get("name") if isinstance(properties, Mapping) else None
            if geometry is None and "geometry" in document:  # unlocated, as RFC 7946 has it
                left_out.append(field)
                return
            for _, inner, rings in _polygons(_mapping(geometry, field), field, left_out):
                yield "" if name is None else " ".join(str(name).split()), inner, rings
        case "Polygon":
            field = f"{dot}coordinates"
            yield "", field, _list(document.get("coordinates"), field)
        case "MultiPolygon":
            field = f"{dot}coordinates"
            for i, rings in enumerate(_list(document.get("coordinates"), field)):
                yield "", f"{field}.{i}", _list(rings, f"{field}.{i}")
        case _:
            allowed = f"{_KINDS}: an obstacle is an area"
            raise InputError(f"{dot}type", kind, allowed)


def _mapping(value: Any, field: str) -> Mapping[str, Any]:
    described = getattr(value, "__geo_interface__", value)
    if not isinstance(described, Mapping):
        hint = "shapely.Polygon(corners) is one."
        raise InputError(field, value, f"a GeoJSON object: {_KINDS}", hint=hint)
    return described


def _list(value: Any, field: str) -> list[Any]:
    if not isinstance(value, list | tuple) or not value:
        raise InputError(field, value, "a list that is not empty")
    return list(value)


def _polygon(rings: list[Any], field: str) -> Any:
    """A polygon of shapely from its rings as given.

    Raises:
        InputError: If a ring has no three corners in metres, or GEOS calls the polygon invalid.
    """
    import shapely

    shell, *holes = [_corners(ring, f"{field}.{i}") for i, ring in enumerate(rings)]
    polygon = shapely.remove_repeated_points(shapely.Polygon(shell, holes))
    if not polygon.is_valid:
        reason = shapely.is_valid_reason(polygon)
        holes_too = "and holes within the outline that do not overlap"
        raise InputError(field, reason, f"an outline that does not cross itself, {holes_too}")
    return polygon


def _corners(ring: Any, field: str) -> Array:
    """Corners of a ring as given, (m, 2) [m]."""
    try:
        # No words, no truths.
        corners = np.array([tuple(point)[:2] for point in ring]).astype(float, casting="same_kind")
    except (TypeError, ValueError):
        raise InputError(field, ring, "a list of points [x, y] in metres") from None
    if corners.ndim != 2 or corners.shape[1] != 2 or len(np.unique(corners, axis=0)) < 3:
        raise InputError(field, ring, "at least three corners [x, y] in metres")
    if not np.isfinite(corners).all():
        raise InputError(field, ring, "finite numbers")
    farthest = float(corners.flat[np.abs(corners).argmax()])
    if abs(farthest) > _FAR_M:
        other = "degrees or millimetres" if abs(farthest) <= _TURN_DEG else "millimetres"
        hint = f"are these {other}, or places on a map of the Earth?"
        raise InputError(field, farthest, f"metres, within {_FAR_M:zg} m of the origin", hint=hint)
    return corners


def _named(pieces: list[tuple[str, Any]]) -> Iterator[Obstacle]:
    """Obstacles whose names, where given, differ from each other."""
    count = Counter(name for name, _ in pieces)
    taken = {name for name in count if count[name] == 1}
    for given, piece in pieces:
        name = given
        if name and name not in taken:
            numbered = (f"{name} {i}" for i in itertools.count(1))
            name = next(each for each in numbered if each not in taken)
            taken.add(name)
        corners = np.array(piece.exterior.coords)[:-1]
        yield Obstacle(name=name, polygon_m=tuple((x, y) for x, y in corners.tolist()))
