"""Proofs of what is impossible among obstacles, on supersets of what is free.

Something has no way out of convex pieces if its component of such a superset is bounded. Poses at
which it may be free are slices of headings, exact in the plane, as :math:`F^+` of `space.slices`;
from one component there is no way to another. What moves is taken `UNSEEN_M` thinner than it is, so
that touching is no obstacle.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.tolerances import UNSEEN_M
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array, wrapped
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import Footprint
from twosra_mpc.space.slices import (
    AT_EDGE_M,
    FreeSlices,
    box_around,
    component_around,
    possible_slices,
)

Box = tuple[Array, Array]  # of poses: least and largest x, y, phi, infinite where free

_QUADRANT = 16  # corners in a quarter of a disc
_AROUND_M = 1.0  # beyond all obstacles
_EVERYWHERE_M = 1e6  # stands for infinity, where GEOS wants numbers


def components_in(slices: FreeSlices, low: Array, high: Array) -> frozenset[int]:
    """Components that some pose of a box (3,) to (3,) is in; infinite ends are free."""
    box = np.clip([low[:2], high[:2]], *slices.box_m)
    here = np.ones(len(slices.parts), dtype=bool)
    if np.isfinite([low[2], high[2]]).all():
        middle, half = (low[2] + high[2]) / 2, (high[2] - low[2]) / 2 + np.pi / slices.headings
        off = wrapped(slices.heading_rad(slices.slice_of) - middle)
        here = np.abs(off) <= half + 1e-9
    low_x, high_x = np.clip(box, -1e3, 1e3) + np.array([[-1e-9], [1e-9]])
    here &= shapely.intersects(slices.parts, shapely.box(*low_x, *high_x))
    return frozenset(slices.component_of[here].tolist())


def apart(slices: FreeSlices, here: Box, there: Box) -> bool:
    """True if no drive joins a box of poses to another one, proved, for slices of F+.

    What is kept there must be no more than the first leg has to keep.
    """
    return components_in(slices, *here).isdisjoint(components_in(slices, *there))


@dataclass(frozen=True)
class Region:
    """Positions of b0 in the plane.

    Where the workspace has no edge, slices end at a box; beyond it all is free. A region that
    reaches its edge goes on there; what is beyond is as near to it as the box's nearest point.

    Attributes:
        shape: The positions, as far as the box.
        box_m: Least and largest x and y of the box, (2, 2); infinite where a workspace ends.
        goes_on: Whether there are more of them beyond the box.
    """

    shape: shapely.Geometry
    box_m: Array
    goes_on: bool

    @classmethod
    def of(cls, slices: FreeSlices, components: frozenset[int]) -> Region:
        """Positions in some components of a shape, at whatever heading."""
        held = np.isin(slices.component_of, list(components))
        shape = shapely.union_all(slices.parts[held])
        ends = np.reshape(shapely.bounds(shape), (2, 2))
        at_edge = np.abs(ends - slices.box_m) <= AT_EDGE_M
        return cls(shape, slices.box_m, bool(at_edge.any()))

    def apart_m(self, other: Region) -> float:
        """Least distance of their positions, or less; infinite if one of them is empty."""
        if shapely.is_empty(self.shape) or shapely.is_empty(other.shape):
            return np.inf
        if self.goes_on and other.goes_on:
            return 0.0
        return float(shapely.distance(self.shape, other.shape))

    def from_box_m(self, low: Array, high: Array) -> float:
        """Least distance of its positions to those of a box of poses, or less."""
        ends = np.clip([low[:2], high[:2]], *np.clip(self.box_m, -_EVERYWHERE_M, _EVERYWHERE_M))
        box = shapely.box(*ends[0], *ends[1])
        return np.inf if shapely.is_empty(self.shape) else float(shapely.distance(self.shape, box))


def within_obstacles(world: World, low: Array, high: Array) -> bool:
    """True if b0, which is a point of the robot, has no place in a box of poses (3,) to (3,)."""
    if not world.obstacles or not np.isfinite([low[:2], high[:2]]).all():
        return False
    return bool(shapely.covers(_inner_union(world), shapely.box(*low[:2], *high[:2])))


def _inner_union(world: World) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(item.inner_corners_m) for item in world.obstacles])


def _grown(corners: Array, by_m: float) -> shapely.Geometry:
    charge(Cost.CORNER, len(corners))
    return shapely.buffer(shapely.Polygon(corners), by_m, quad_segs=_QUADRANT)


def blocked_unit(
    geometry: Geometry,
    world: World,
    start: Array,
    goal: Array,
    off_m: float,
    kept_m: float = 0.0,
) -> int | None:
    """A locomotion unit, 1 or 2, whose inscribed disc has no way from start to goal (3 + n,).

    Its centre must stay farther than half its frame from obstacles, whatever the shape, at all
    times; discs around obstacles are taken a little too small, what is free a little too large.

    Args:
        geometry: Lengths of the robot.
        world: What is around it.
        start: Configuration at the start.
        goal: Configuration to end in.
        off_m: How far the units may end from where that has them.
        kept_m: Distance that is kept on the whole way.
    """
    radius = geometry.unit_frame_m / 2 - UNSEEN_M + kept_m
    ends = robot_shape(geometry, np.array([start, goal]), 2).centres  # (2, unit, 2)
    grown = [_grown(each.inner_corners_m, radius) for each in world.obstacles]
    blocked = shapely.union_all(grown)  # of all at once GEOS takes half a gigabyte
    if world.workspace is not None:
        edges = world.workspace.corners_m + (radius - kept_m) * np.array([[1.0], [-1.0]])
    else:
        edges = np.array([[-np.inf], [np.inf]])
    around = np.concatenate([shapely.bounds(blocked).reshape(2, 2), ends.reshape(-1, 2)])
    low = np.maximum(edges[0], around.min(axis=0) - _AROUND_M)
    high = np.minimum(edges[1], around.max(axis=0) + _AROUND_M)
    parts = shapely.get_parts(shapely.difference(shapely.box(*low, *high), blocked))
    for unit, (here, there) in enumerate(zip(*ends, strict=True), start=1):
        from_start = shapely.dwithin(parts, shapely.points(here), 1e-6)
        to_goal = shapely.dwithin(parts, shapely.points(there), off_m + 1e-6)
        if any(from_start) and not any(itertools.compress(from_start, to_goal)):
            return unit
    return None


def unit_apart(
    geometry: Geometry, world: World, ends: Box, off: tuple[float, float], kept_m: float
) -> int | None:
    """As `blocked_unit`, of a unit with its wheels, at whatever heading.

    Args:
        geometry: Lengths of the robot.
        world: What is around it.
        ends: Configuration at the start, and to end in, (3 + n,) each.
        off: How far units may end from where that has them, and how far turned [m, rad].
        kept_m: Distance that is kept on the whole way.
    """
    straight = robot_shape(geometry, np.zeros_like(ends[0]), 2)
    placed = robot_shape(geometry, np.array(ends), 2)
    poses = np.concatenate([placed.centres, placed.ends[..., 2:]], axis=-1)  # (2, unit, 3)
    within = np.array([off[0], off[0], off[1]])
    for unit, (here, there) in enumerate(zip(*poses, strict=True)):
        held = np.concatenate([straight.units[[unit]], straight.wheels[2 * unit : 2 * unit + 2]])
        pieces = held - straight.centres[unit]
        slices = possible_slices(Footprint(pieces, pieces), world, kept_m, HEADINGS[1])
        if apart(slices, (here, here), (there - within, there + within)):
            return unit + 1
    return None


HEADINGS = (72, 180, 360)  # slices of 5, 2 and 1 degrees
_FINE_QUADRANT = 32  # corners in a quarter of a disc
_BESIDE_M = 0.1  # beyond what is around an object


class Enclosure(NamedTuple):
    """Knowledge about ways out.

    Attributes:
        proved: There is none.
        room_m: How far its reference point may get, at most; infinite where not proved.
    """

    proved: bool
    room_m: float


def disc_enclosed(around: Array, radius_m: float, at: Array) -> Enclosure | None:
    """Enclosure of a disc at a point (2,) by pieces (m, 4, 2); None: it overlaps them."""
    body = shapely.union_all(shapely.polygons(around))
    blocked = shapely.buffer(body, radius_m - UNSEEN_M, quad_segs=_FINE_QUADRANT)  # inscribed
    box = np.reshape(shapely.bounds(blocked), (2, 2)) + np.array([[-_BESIDE_M], [_BESIDE_M]])
    if _outside(at, box):
        return Enclosure(False, np.inf)
    parts: Any = shapely.get_parts(shapely.difference(shapely.box(*box[0], *box[1]), blocked))
    held = parts[shapely.intersects(parts, shapely.Point(at))]
    at_edge = bool((np.abs(shapely.bounds(held).reshape(-1, 2, 2) - box) <= AT_EDGE_M).any())
    return _enclosure(held, at_edge, at) if len(held) else None


def polygon_enclosed(around: Array, corners: Array, at: Array) -> Enclosure | None:
    """Enclosure of a polygon by pieces (m, 4, 2); None: it overlaps them.

    Args:
        around: Convex pieces, counter-clockwise.
        corners: Of the polygon, counter-clockwise, from its reference point, (k, 2) [m].
        at: Where that is, (2,).
    """
    pieces = convex_parts(corners)
    for headings in (1, *HEADINGS):  # with one it does not turn
        thinner = _kept(pieces, 0.0 if headings == 1 else np.pi / headings)
        if _outside(at, box_around(thinner, list(around))):
            return Enclosure(False, np.inf)
        component = component_around(thinner, list(around), headings, at)
        if component is None:
            return None
        found = _enclosure(*component, at)
        if found.proved != (headings == 1):
            return found
    return found


def _outside(at: Array, box_m: Array) -> bool:
    """True if a place is farther away than anything that could hold it."""
    return bool((at <= box_m[0]).any() or (at >= box_m[1]).any())


def _enclosure(parts: Any, at_edge: bool, at: Array) -> Enclosure:
    if at_edge:
        return Enclosure(False, np.inf)
    away = np.linalg.norm(shapely.get_coordinates(parts) - at, axis=1)
    return Enclosure(True, float(away.max()))


def _kept(pieces: list[Array], half_turn_rad: float) -> list[Array]:
    """Cores that convex pieces hold however they turn by up to a half turn, and then thinner."""
    found = []
    for piece in pieces:
        moved_m = 2 * np.sin(half_turn_rad / 2) * float(np.linalg.norm(piece, axis=1).max())
        less = shapely.buffer(shapely.Polygon(piece), -moved_m - UNSEEN_M, join_style="mitre")
        if not shapely.is_empty(less):
            found.append(shapely.get_coordinates(shapely.orient_polygons(less))[:-1])
    return found
