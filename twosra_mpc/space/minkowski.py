"""Convex polygons in bulk: pieces turning about b0, their Minkowski sums with obstacles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from twosra_mpc.effort import Cost, charge
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.convex import convex_parts

_SIDES = 8  # of polygons around pieces; with theirs among them
_FEW = 16  # corners of a convex polygon that is simple enough
_WITHIN_M = 5e-4  # what polygons within outlines leave out: much more than these are rough
_OFF_M2 = 1e-12  # by which a union may miss its hull and still count as convex


def parts_within(obstacles: Iterable[Obstacle]) -> list[Array]:
    """Few convex polygons that obstacles hold, `_WITHIN_M` from them at most where they have none.

    Counter-clockwise, each (m, 2) [m]; of discs, polygons within.
    """
    return [p for item in obstacles for p in _few_parts(item.inner_corners_m, -_WITHIN_M)]


def parts_around(obstacles: Iterable[Obstacle], within_m: float) -> list[Array]:
    """Few convex polygons that hold obstacles, no farther from them than a distance."""
    return [part for item in obstacles for part in _few_parts(item.corners_m, within_m)]


def _few_parts(corners: Array, by_m: float) -> list[Array]:
    """Convex parts of a polygon if it is simple; else of a simpler one around it, or within."""
    exact = convex_parts(corners)
    if len(exact) == 1 and len(exact[0]) <= _FEW:
        return exact
    own = shapely.Polygon(corners)
    return merged([part for simple in _simpler(own, by_m) for part in convex_parts(simple)])


def _simpler(own: shapely.Polygon, by_m: float) -> list[Array]:
    """Polygons (m, 2) around a polygon, or within it, no farther from it, of fewer corners.

    About its hull if that is as near, else about it; itself where that is no simpler.
    """
    for inner in (own.convex_hull, own):
        moved = shapely.buffer(inner, by_m / 2, join_style="mitre", mitre_limit=1.5)
        simple = shapely.simplify(moved, abs(by_m) / 3)
        parts = [part for part in shapely.get_parts(simple) if not part.is_empty]
        fewer = shapely.get_num_coordinates(simple) < shapely.get_num_coordinates(own)
        whole = by_m < 0 or (simple.covers(own) and own.buffer(by_m).covers(simple))
        held = by_m > 0 or own.covers(simple)
        if parts and fewer and whole and held and not any(part.interiors for part in parts):
            return [_corners([part])[0] for part in parts]
    return _corners([own])


def merged(pieces: Sequence[Array]) -> list[Array]:
    """The same union in fewer convex pieces: those whose union is convex become one."""
    found, boxes = list[Array](), np.zeros((0, 2, 2))
    for piece in pieces:
        while (other := _partner(piece, found, boxes)) is not None:
            piece = _corners([_hull(piece, found.pop(other))])[0]
            boxes = np.delete(boxes, other, axis=0)
        found.append(piece)
        boxes = np.concatenate([boxes, [[piece.min(axis=0), piece.max(axis=0)]]])
    return found


def _partner(piece: Array, others: Sequence[Array], boxes: Array) -> int | None:
    """The first that is near enough, by least and largest (x, y) of each, (m, 2, 2), and fits."""
    low, high = piece.min(axis=0), piece.max(axis=0)
    near = (low <= boxes[:, 1] + 1e-9) & (boxes[:, 0] <= high + 1e-9)
    for i in np.flatnonzero(near.all(axis=1)).tolist():
        charge(Cost.MERGE)
        union = shapely.union(shapely.polygons(piece), shapely.polygons(others[i]))
        if shapely.area(_hull(piece, others[i])) - shapely.area(union) < _OFF_M2:
            return i
    return None


def _hull(*pieces: Array) -> shapely.Geometry:
    return shapely.MultiPoint(np.concatenate(pieces)).convex_hull


def _corners(polygons: Iterable[shapely.Geometry]) -> list[Array]:
    oriented = [shapely.orient_polygons(polygon) for polygon in polygons]
    return [shapely.get_coordinates(shapely.simplify(p, 0.0))[:-1] for p in oriented]


def stacked(polygons: Sequence[Array]) -> Array:
    """Polygons as one array, (count, most corners, 2); the last corner is repeated."""
    most = max(map(len, polygons))
    return np.array([np.pad(p, ((0, most - len(p)), (0, 0)), mode="edge") for p in polygons])


def swept(pieces: Array, half_turn_rad: float, grown_m: float) -> Array:
    """Octagons that hold pieces turned about b0 by up to a half turn either way, and grown.

    An octagon with the first side of the piece among its normals holds what its supports hold: in
    direction n a corner a gets to |a| cos(max(0, angle between n and a - half_turn)).

    Args:
        pieces: Convex, (m, corners, 2) [m].
        half_turn_rad: By how much they turn either way.
        grown_m: What is added all around.

    Returns:
        Corners, counter-clockwise, (m, 8, 2) [m].
    """
    side = pieces[:, 1] - pieces[:, 0]
    angles = np.arctan2(side[:, 1], side[:, 0])[:, None] + np.arange(_SIDES) * np.pi * 2 / _SIDES
    support = reach(pieces[:, None], angles, half_turn_rad) + grown_m
    after = np.roll(support, -1, axis=1)
    turn = 2 * np.pi / _SIDES
    along = (after - support * np.cos(turn)) / np.sin(turn)
    normal = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    across = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
    return support[..., None] * normal + along[..., None] * across


def reach(pieces: Array, angles: Array, half_turn_rad: float) -> Array:
    """Farthest that pieces (..., corners, 2) get in directions [rad] as they turn either way [m].

    With a negative half turn, how far each gets at least, whichever way it is turned.
    """
    radius, own = np.hypot(*np.moveaxis(pieces, -1, 0)), np.arctan2(pieces[..., 1], pieces[..., 0])
    between = np.abs((angles[..., None] - own + np.pi) % (2 * np.pi) - np.pi)
    return (radius * np.cos(np.clip(between - half_turn_rad, 0, np.pi))).max(axis=-1)


def kept_by_all(pieces: Array, half_turn_rad: float, grown_m: float) -> list[Array]:
    """Cores that rectangles hold however they turn about b0 by up to a half turn, then grown.

    Turned by d, a point a gets n.a cos d + n'.a sin d in direction n, n' across. With T the most
    of |n'.a| in the rectangle this is at most b, its side there, if n.a <= b - T sin(half turn), or
    where that is negative, if n.a is at most as much over cos(half turn). Grown by an octagon
    within the disc.

    Args:
        pieces: Rectangles, counter-clockwise, (m, 4, 2) [m].
        half_turn_rad: By how much they turn either way.
        grown_m: What is added all around; may be negative.

    Returns:
        Corners, counter-clockwise, (4 or 8, 2) each [m]; what vanishes is left out.
    """
    found = []
    for piece in pieces:
        along = (piece[1] - piece[0]) / np.linalg.norm(piece[1] - piece[0])
        axes = np.array([along, [-along[1], along[0]]])
        inner = piece @ axes.T
        low, high = inner.min(axis=0), inner.max(axis=0)
        across = np.maximum(np.abs(low), np.abs(high))[::-1] * np.sin(half_turn_rad)
        high, low = _back(high - across, half_turn_rad), -_back(-low - across, half_turn_rad)
        if grown_m < 0:
            low, high = low - grown_m, high + grown_m
        if (low < high).all():
            found.append(_rounded(low, high, max(grown_m, 0.0)) @ axes)
    return found


def _back(side: Array, half_turn_rad: float) -> Array:
    return np.where(side < 0, side / np.cos(half_turn_rad), side)


def _rounded(low: Array, high: Array, radius_m: float) -> Array:
    """A box, grown by an octagon within the disc."""
    (x0, y0), (x1, y1) = low, high
    corners = np.array([(x1, y0), (x1, y1), (x0, y1), (x0, y0)])
    if radius_m == 0:
        return corners
    angles = (np.arange(_SIDES) - 1.5) * 2 * np.pi / _SIDES
    around = radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.repeat(corners, 2, axis=0) + around


def turned(pieces: Array, headings_rad: Array) -> Array:
    """Pieces (m, corners, 2) at each of k headings, (k, m, corners, 2)."""
    c, s = np.cos(headings_rad), np.sin(headings_rad)
    rotation = np.array([[c, -s], [s, c]])
    return np.einsum("ijk,acj->kaci", rotation, pieces)


def minkowski_sums(first: Array, second: Array) -> Array:
    """Minkowski sums of convex polygons, each with each: their sides in the order of direction.

    Args:
        first: Corners counter-clockwise, repeated ones allowed, (..., m, c, 2).
        second: The same, (n, d, 2).

    Returns:
        Corners counter-clockwise, (..., m, n, c + d, 2).
    """
    sides = [np.roll(p, -1, axis=-2) - p for p in (first, second)]
    shape = (*first.shape[:-2], len(second))
    both = np.concatenate(
        [
            np.broadcast_to(sides[0][..., None, :, :], (*shape, *first.shape[-2:])),
            np.broadcast_to(sides[1], (*shape, *second.shape[-2:])),
        ],
        axis=-2,
    )
    order = np.argsort(np.arctan2(both[..., 1], both[..., 0]), axis=-1)
    corners = np.take_along_axis(both, order[..., None], axis=-2).cumsum(axis=-2)
    low = first.min(axis=-2)[..., None, :] + second.min(axis=-2)
    return corners + (low - corners.min(axis=-2))[..., None, :]
