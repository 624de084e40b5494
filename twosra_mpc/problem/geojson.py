"""Obstacles from GeoJSON files, and from whatever describes itself so, e.g. shapely's polygons.

Coordinates are metres in the plane. A polygon with holes becomes several without, cut along lines
of constant y; nothing is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.files import read_document, reading
from twosra_mpc.problem.world import Obstacle, area_m2
from twosra_mpc.robot.coordinates import Array

_FAR_M = 100.0  # no robot of this kind goes there: another unit
_KINDS = "Polygon, MultiPolygon, GeometryCollection, Feature or FeatureCollection"
_HOLES = "holes within the outline that cross neither it nor each other"

Rings = list[Array]  # an outline counter-clockwise, holes clockwise, each (m, 2) [m]


def obstacles_of(geometries: Any, names: Sequence[str] | None = None) -> tuple[Obstacle, ...]:
    """Obstacles from polygons of shapely, GeoPandas or GeoJSON, in metres.

    Args:
        geometries: Something with a ``__geo_interface__``, a GeoJSON mapping, or several of them.
        names: One for each; by default those in the properties of features. A name that several
            obstacles would have, also as pieces of one geometry, is followed by their numbers.

    Raises:
        InputError: If one is no polygon, is not a proper one, or is farther than 100 m away.
    """
    single = isinstance(geometries, Mapping) or hasattr(geometries, "__geo_interface__")
    several = [geometries] if single else list(geometries)
    if names is not None and len(names) != len(several):
        raise InputError("names", len(names), f"one for each of {len(several)} geometries")
    found: list[tuple[str, Array]] = []
    for i, geometry in enumerate(several):
        given = None if names is None else names[i]
        where = "" if single else f"geometries.{i}"
        for name, field, rings in _polygons(_mapping(geometry, where), where):
            try:
                pieces = list(without_holes(_checked(rings)))
            except InputError as error:
                raise error.within(field) from None
            found += [(name if given is None else given, piece) for piece in pieces]
    return tuple(_named(found))


def read_obstacles(path: str | Path) -> tuple[Obstacle, ...]:
    """Obstacles in a GeoJSON file: its polygons, called by the name in their properties.

    Raises:
        InputError: If the file cannot be read, or holds something else than polygons in metres.
    """
    document = read_document(Path(path), str(path))
    with reading(str(path)):
        return obstacles_of(document)


def feature_collection(obstacles: Iterable[Obstacle]) -> dict[str, Any]:
    """Return obstacles as a GeoJSON document, which ``read_obstacles`` reads; discs as polygons."""
    features = []
    for obstacle in obstacles:
        corners = obstacle.corners_m.tolist()
        geometry = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
        properties = {"name": obstacle.name}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def without_holes(rings: Rings) -> Iterator[Array]:
    """Outlines, counter-clockwise, of pieces that together are a polygon with holes.

    Args:
        rings: The outline, counter-clockwise, then the holes, clockwise, each (m, 2).

    Raises:
        InputError: If the holes are not within the outline.
    """
    outline, *holes = rings
    if not holes:
        yield outline
        return
    level = _level(rings, holes[0])
    for side in (1.0, -1.0):
        parts = _beyond(rings, level, side)
        outlines = [part for part in parts if area_m2(part) > 0]
        inside: list[Rings] = [[] for _ in outlines]
        for part in parts:
            if area_m2(part) < 0:
                inside[_around(outlines, part[0])].append(part)
        for each, own in zip(outlines, inside, strict=True):
            yield from without_holes([each, *own])


def _polygons(document: Any, where: str) -> Iterator[tuple[str, str, Any]]:
    """Yield (name, field, rings as given) of every polygon."""
    kind, dot = document.get("type"), f"{where}." if where else ""
    match kind:
        case "FeatureCollection" | "GeometryCollection":
            key = "features" if kind == "FeatureCollection" else "geometries"
            for i, item in enumerate(_list(document.get(key), f"{dot}{key}")):
                field = f"{dot}{key}.{i}"
                yield from _polygons(_mapping(item, field), field)
        case "Feature":
            field = f"{dot}geometry"
            properties = document.get("properties")
            name = properties.get("name") if isinstance(properties, Mapping) else None
            for _, inner, rings in _polygons(_mapping(document.get("geometry"), field), field):
                yield "" if name is None else str(name), inner, rings
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
        raise InputError(field, value, f"a GeoJSON object: {_KINDS}")
    return described


def _list(value: Any, field: str) -> list[Any]:
    if not isinstance(value, list | tuple) or not value:
        raise InputError(field, value, "a list that is not empty")
    return list(value)


def _checked(rings: list[Any]) -> Rings:
    """Rings as arrays, open, and turning as ``without_holes`` wants them."""
    found: Rings = []
    for i, given in enumerate(rings):
        try:
            corners = np.array([tuple(point)[:2] for point in given], dtype=float)
        except (TypeError, ValueError):
            raise InputError(str(i), given, "a list of points [x, y] in metres") from None
        corners = corners.reshape(-1, 2)
        if np.abs(corners).max(initial=0.0) > _FAR_M:
            farthest = float(corners.flat[np.abs(corners).argmax()])
            allowed = f"metres, within {_FAR_M:zg} m of the origin (are these millimetres?)"
            raise InputError(str(i), farthest, allowed)
        corners = corners[(corners != np.roll(corners, -1, axis=0)).any(axis=1)]  # closed, repeated
        try:
            right = _obstacle("", corners).corners_m
        except InputError as error:
            raise InputError(str(i), error.value, error.allowed) from None
        found.append(right if i == 0 else right[::-1])
    return found


def _named(found: list[tuple[str, Array]]) -> Iterator[Obstacle]:
    """Obstacles whose names, where given, differ."""
    names, seen = [name for name, _ in found], dict[str, int]()
    for name, corners in found:
        seen[name] = seen.get(name, 0) + 1
        several = name and names.count(name) > 1
        yield _obstacle(f"{name} {seen[name]}" if several else name, corners)


def _obstacle(name: str, corners: Array) -> Obstacle:
    return Obstacle(name=name, polygon_m=tuple((x, y) for x, y in corners.tolist()))


def _level(rings: Rings, hole: Array) -> float:
    """The y at which to cut through a hole: as far from all corners as can be."""
    heights = np.unique(np.concatenate(rings)[:, 1])
    heights = heights[(heights >= hole[:, 1].min()) & (heights <= hole[:, 1].max())]
    widest = int(np.diff(heights).argmax())
    return float(heights[widest : widest + 2].mean())


def _beyond(rings: Rings, level: float, side: float) -> Rings:
    """The part of a polygon with y above ``level`` (side 1) or below it (-1), as rings.

    What of a ring is beyond is a chain from one point on the line to another. Between the first and
    the second of all these points, the third and the fourth and so on, the line is in the polygon;
    there, one chain's end is joined to another's beginning.
    """
    whole, chains = list[Array](), list[Array]()
    for ring in rings:
        out = side * (ring[:, 1] - level) > 0
        if out.all():
            whole.append(ring)
        else:
            chains += _chains(ring, out, level)
    ends = sorted((side * chain[at, 0], at, i) for i, chain in enumerate(chains) for at in (-1, 0))
    joined = {}
    for (_, left, i), (_, right, j) in zip(ends[::2], ends[1::2], strict=True):
        if (left, right) != (-1, 0):
            raise InputError("", "holes", _HOLES)
        joined[i] = j
    while joined:
        first, following = joined.popitem()
        loop = [chains[first]]
        while following != first:
            loop.append(chains[following])
            following = joined.pop(following)
        whole.append(np.concatenate(loop))
    return whole


def _chains(ring: Array, out: np.ndarray[Any, Any], level: float) -> Iterator[Array]:
    """Stretches of a ring that are beyond a line, with where they cross it at both ends."""
    before = np.roll(out, 1)
    for start in np.flatnonzero(out & ~before):
        turned, count = np.roll(ring, -start, axis=0), int(np.roll(~out, -start).argmax())
        crossings = [
            a + (level - a[1]) / (b[1] - a[1]) * (b - a)
            for a, b in ((turned[-1], turned[0]), (turned[count - 1], turned[count]))
        ]
        yield np.array([(crossings[0][0], level), *turned[:count], (crossings[1][0], level)])


def _around(outlines: Rings, point: Array) -> int:
    """Which of some outlines a point is in."""
    for i, ring in enumerate(outlines):
        a, b = ring, np.roll(ring, -1, axis=0)
        passed = (a[:, 1] > point[1]) != (b[:, 1] > point[1])
        a, b = a[passed], b[passed]
        x = a[:, 0] + (point[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
        if (x > point[0]).sum() % 2:
            return i
    raise InputError("", "holes", _HOLES)
