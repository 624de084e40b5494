r"""Whether something has a way out of convex pieces: components of a superset of what is free.

Poses at which it may be free are slices of headings, exact in the plane, as :math:`F^+` of
`space.slices`. From one component there is no way to another; a bounded one has no way out. What
moves is taken `UNSEEN_M` thinner than it is, so that touching is no obstacle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely

from twosra_mpc.problem.tolerances import UNSEEN_M
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.slices import AT_EDGE_M, box_around, component_around

HEADINGS = (72, 180, 360)
_QUADRANT = 32  # corners in a quarter of a disc
_AROUND_M = 0.1


class Enclosure(NamedTuple):
    """What is known of ways out.

    Attributes:
        proved: There is none.
        headings: Slices of headings that decided; 0 for a disc, 1 where it need not turn.
        room_m: How far its reference point may get, at most; infinite where not proved.
    """

    proved: bool
    headings: int
    room_m: float


def disc_enclosed(around: Array, radius_m: float, at: Array) -> Enclosure | None:
    """Whether a disc at a point (2,) has no way out of pieces (m, 4, 2); None: it overlaps them."""
    body = shapely.union_all(shapely.polygons(around))
    blocked = shapely.buffer(body, radius_m - UNSEEN_M, quad_segs=_QUADRANT)  # inscribed
    box = np.reshape(shapely.bounds(blocked), (2, 2)) + np.array([[-_AROUND_M], [_AROUND_M]])
    if _outside(at, box):
        return Enclosure(False, 0, np.inf)
    parts: Any = shapely.get_parts(shapely.difference(shapely.box(*box[0], *box[1]), blocked))
    held = parts[shapely.intersects(parts, shapely.Point(at))]
    at_edge = bool((np.abs(shapely.bounds(held).reshape(-1, 2, 2) - box) <= AT_EDGE_M).any())
    return _enclosure(held, at_edge, 0, at) if len(held) else None


def polygon_enclosed(around: Array, corners: Array, at: Array) -> Enclosure | None:
    """Whether a polygon has no way out of pieces (m, 4, 2); None: it overlaps them.

    Args:
        around: Convex pieces, counter-clockwise.
        corners: Of the polygon, counter-clockwise, from its reference point, (k, 2) [m].
        at: Where that is, (2,).
    """
    pieces = convex_parts(corners)
    for headings in (1, *HEADINGS):  # with one it does not turn
        thinner = _kept(pieces, 0.0 if headings == 1 else np.pi / headings)
        if _outside(at, box_around(thinner, list(around))):
            return Enclosure(False, headings, np.inf)
        component = component_around(thinner, list(around), headings, at)
        if component is None:
            return None
        found = _enclosure(*component, headings, at)
        if found.proved != (headings == 1):
            return found
    return found


def _outside(at: Array, box_m: Array) -> bool:
    """Whether a place is farther away than anything that could hold it."""
    return bool((at <= box_m[0]).any() or (at >= box_m[1]).any())


def _enclosure(parts: Any, at_edge: bool, headings: int, at: Array) -> Enclosure:
    if at_edge:
        return Enclosure(False, headings, np.inf)
    away = np.linalg.norm(shapely.get_coordinates(parts) - at, axis=1)
    return Enclosure(True, headings, float(away.max()))


def _kept(pieces: list[Array], half_turn_rad: float) -> list[Array]:
    """What convex pieces hold however they are turned by up to a half turn, and then thinner."""
    found = []
    for piece in pieces:
        moved_m = 2 * np.sin(half_turn_rad / 2) * float(np.linalg.norm(piece, axis=1).max())
        less = shapely.buffer(shapely.Polygon(piece), -moved_m - UNSEEN_M, join_style="mitre")
        if not shapely.is_empty(less):
            found.append(shapely.get_coordinates(shapely.orient_polygons(less))[:-1])
    return found
