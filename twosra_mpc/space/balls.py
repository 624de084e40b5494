r"""Free space by distance: balls of poses, each certified by one distance, only where a way leads.

A pose that keeps :math:`d` more than it must certifies all poses that no point of the robot travels
farther to: with the farthest point at :math:`\rho` from b0, the ball of travel
:math:`|\Delta(x, y)| + \rho |\Delta\varphi| \le d`. Two balls whose radii add up to the travel
between their middles are joined by a turn in place and a straight leg. Middles are on lattices of
:math:`(x, y, \rho \varphi)`, each twice as fine as the one before; the smaller a ball the finer the
one of its neighbours. So the time a search takes grows with the way and how narrow it is, not with
how much is around it nor with how rough that is.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
import shapely

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.flow import twists
from twosra_mpc.problem.tolerances import ROUNDING_M
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array, rotation, wrapped
from twosra_mpc.space.footprint import Footprint
from twosra_mpc.space.screws import Proof, continued, moved

_COARSEST_M, _LEVELS = 0.064, 10  # spacings of lattices: to a sixteenth of a millimetre
_FINEST_M = _COARSEST_M / (1 << _LEVELS)
_STEP, _AHEAD = 1.5, 1.5  # of radii that neighbours are away; weight of what is left of a way
_AT_ONCE = 24  # balls whose neighbours are looked at
_STEPS = np.array([s for s in itertools.product((-1, 0, 1), repeat=3) if np.abs(s).sum() < 2])

_ROUGHLY_M, _GRID_M, _FAR_M = 1e-4, 1e-9, 10.0
_LIFT_M, _LEAST_LIFT_M, _LIFTS = 1e-3, 2e-5, 40
_ENOUGH_M, _MOST = 1e-3, 100_000  # balls: a way that needs more is too narrow
_AROUND = np.array(
    [s for s in itertools.product((-1.0, 0.0, 1.0), repeat=3) if np.abs(s).sum() % 2]
)

Spare = Callable[[Array], Array]  # poses (m, 3) -> by how much they keep more than they must [m]
Place = tuple[float, int, int]  # about how long a way by a ball is [m], the ball, its lattice


class Room:
    """What is around one footprint, by distance: GEOS's, of its outline to all that is around.

    Args:
        footprint: The robot in one shape.
        world: What is around it.
        kept_m: What is to be kept from obstacles, as `footprint.kept_m` says.
    """

    def __init__(self, footprint: Footprint, world: World, kept_m: float) -> None:
        self.kept_m = kept_m
        outline = shapely.union_all(shapely.polygons(footprint.outer), grid_size=_GRID_M)
        # Thinner by the rounding, so that what overlaps is told from what touches.
        thin = shapely.get_parts(shapely.buffer(outline, -ROUNDING_M / 2, join_style="mitre"))
        self._outlines = [shapely.get_coordinates(part.exterior) for part in thin]
        polygons = [shapely.Polygon(obstacle.corners_m) for obstacle in world.obstacles]
        self._exact = shapely.union_all(polygons, grid_size=_GRID_M)
        grown = shapely.buffer(self._exact, _ROUGHLY_M / 2, join_style="mitre", mitre_limit=1.5)
        simple = shapely.simplify(grown, _ROUGHLY_M / 2)
        self._solid = simple if shapely.covers(simple, self._exact) else self._exact
        shapely.prepare([self._solid, self._exact])
        self._edges = None if world.workspace is None else world.workspace.corners_m

    def roughly(self) -> Room:
        """The same with outlines of fewer corners, and nothing to keep: to find ways by."""
        other = copy(self)
        other.kept_m = 0.0
        other._solid = other._exact = shapely.simplify(self._exact, _ROUGHLY_M)
        shapely.prepare(other._solid)
        return other

    def simply(self) -> Room:
        """The same by outlines of fewer corners around those that are there."""
        other = copy(self)
        other._exact = self._solid
        return other

    def spare_m(self, poses: Array) -> Array:
        """By how much poses (m, 3) keep more than they must, or less if negative, (m,) [m]."""
        charge(Cost.BALL, len(poses))
        found = np.full(len(poses), _FAR_M)
        for outline in self._outlines:
            placed = outline @ rotation(poses[:, 2]) + poses[:, None, :2]
            if not shapely.is_empty(self._solid):
                drawn: Any = shapely.polygons(placed)
                spare: Array = shapely.distance(self._solid, drawn) - self.kept_m - ROUNDING_M
                if self._exact is not self._solid:  # asked where what is simpler may decide
                    near = np.abs(spare) < 2 * _ROUGHLY_M
                    apart = shapely.distance(self._exact, drawn[near])
                    spare[near] = apart - self.kept_m - ROUNDING_M
                found = np.minimum(found, spare)
            if self._edges is not None:
                low, high = self._edges
                inside = np.minimum(placed.min(axis=1) - low, high - placed.max(axis=1))
                found = np.minimum(found, inside.min(axis=1))
        return found


def lifted(spare_m: Spare, radius_m: float, poses: Array, enough_m: float) -> Array:
    """Poses (m, 3) with the inner ones moved to where they keep more, nearby, if not enough.

    Each tries steps all around, in directions that are turned every time, and half as large ones
    where none leads on: what poses keep has ridges.
    """
    poses, best, scale = poses.copy(), spare_m(poses), np.array([1.0, 1.0, 1.0 / radius_m])
    step, rng = np.full(len(poses), _LIFT_M), np.random.default_rng(0)
    step[[0, -1]] = 0.0
    for _ in range(_LIFTS):
        some = np.flatnonzero((best < enough_m) & (step > _LEAST_LIFT_M))
        if not len(some):
            break
        turned = _AROUND @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        tried = poses[some, None] + step[some, None, None] * turned * scale
        kept = spare_m(tried.reshape(-1, 3)).reshape(tried.shape[:2])
        at, row = kept.argmax(axis=1), np.arange(len(some))
        more = kept[row, at] > best[some]
        step[some[~more]] /= 2
        better = some[more]
        poses[better], best[better] = tried[row, at][more], kept[row, at][more]
    return poses


def way(room: Room, radius_m: float, start: Array, goal: Array, proof: Proof) -> Array | None:
    """A way between two poses (3,) whose legs are proved: poses (m, 3); None: none found.

    By balls of a robot that keeps nothing from outlines of fewer corners, lifted to what it must
    keep; where that fails, by those of one that keeps it.
    """
    ends, rough = np.array([start, goal]), room.roughly()
    if room.spare_m(ends).min() < 0:
        return None
    found = Balls(rough.spare_m, radius_m, ends).way()
    if found is not None:
        found = lifted(rough.spare_m, radius_m, found, _ENOUGH_M + room.kept_m)
        found = _mended(room, radius_m, found, proof)
    if found is None:
        found = Balls(room.spare_m, radius_m, ends).way()
    return None if found is None else _pulled(found, proof)


def _mended(room: Room, radius_m: float, poses: Array, proof: Proof) -> Array | None:
    """Poses (m, 3) with ways between them by balls where legs are not clear; None: some have none.

    First a pose between the two, lifted, may do.
    """
    poses = poses[room.spare_m(poses) >= 0]
    bad = np.flatnonzero(~proof(poses[:-1], poses[1:]))
    half = moved(poses[bad], twists(poses[bad], poses[bad + 1]), np.full(len(bad), 0.5))
    half = lifted(room.spare_m, radius_m, np.vstack([poses[:1], half, poses[:1]]), _ENOUGH_M)[1:-1]
    mended = proof(poses[bad], half) & proof(half, poses[bad + 1])
    ways: dict[int, Array] = dict(zip(bad[mended].tolist(), half[mended, None], strict=True))
    for k in bad[~mended].tolist():
        several = (each.spare_m for each in (room.simply(), room))
        ways_by = (Balls(spare_m, radius_m, poses[k : k + 2]).way() for spare_m in several)
        by = next((found for found in ways_by if found is not None), None)
        if by is None:
            return None
        ways[k] = by[1:-1]
    parts = [np.vstack([pose[None], ways.get(k, pose[None][:0])]) for k, pose in enumerate(poses)]
    return np.concatenate(parts)


def _pulled(poses: Array, proof: Proof) -> Array:
    """A way through few of poses (m, 3), neighbours among them taken as clear: the longest legs."""
    kept, at, last = [0], 0, len(poses) - 1
    while at < last:
        least, most, step = 1, last - at, 1
        while step < most and proof(poses[[at]], poses[[at + min(2 * step, most)]]).all():
            step = least = min(2 * step, most)
        most = min(2 * step, most)
        while most - least > 1 and step < last - at:
            middle = (least + most) // 2
            if proof(poses[[at]], poses[[at + middle]]).all():
                least = middle
            else:
                most = middle
        at += least
        kept.append(at)
    return poses[kept]


class _Side:
    """Balls found from one end: travel to each and the one before it."""

    def __init__(self) -> None:
        self.cost_m, self.before = dict[int, float](), dict[int, int]()
        self.waiting: list[list[Place]] = [[] for _ in range(_LEVELS + 1)]


class Balls:
    """Balls about two poses, on lattices that begin at the first one.

    Args:
        spare_m: Poses (m, 3) -> by how much they keep more than they must, (m,) [m].
        radius_m: Farthest point of the robot from b0.
        ends: The two poses, (2, 3).
    """

    def __init__(self, spare_m: Spare, radius_m: float, ends: Array) -> None:
        self._spare_of, self._ends = spare_m, ends
        self._arms = np.array([1.0, radius_m])
        self._turns = int(np.ceil(2 * np.pi * radius_m / _COARSEST_M)) << _LEVELS
        self._unit = np.array([_FINEST_M, _FINEST_M, 2 * np.pi / self._turns])
        self._poses, self._spare = ends.copy(), spare_m(ends)
        self._size = len(ends)
        self._named: dict[tuple[int, ...], int] = {}
        self._sides = _Side(), _Side()
        for end, side in enumerate(self._sides):
            side.cost_m[end], side.before[end] = 0.0, end
            level = int(self._levels(self._spare[end]))
            side.waiting[level].append((0.0, end, level))

    def way(self) -> Array | None:
        """Poses (m, 3) from one to the other, legs between them in balls; None: none found."""
        if self._spare.min() < 0:
            return None
        for level in range(_LEVELS + 1):
            for side in self._sides:
                heapq.heapify(side.waiting[level])
            while self._size < _MOST and all(side.waiting[level] for side in self._sides):
                fewer = int(len(self._sides[0].cost_m) > len(self._sides[1].cost_m))
                if (met := self._grow(fewer, level)) is not None:
                    return self._through(met)
            for side in self._sides if level < _LEVELS else ():
                side.waiting[level + 1] += side.waiting[level]
        return None

    def _levels(self, spare_m: Array) -> Array:
        """Coarsest lattices whose spacing is within balls; the finest for smaller ones."""
        finer = np.ceil(np.log2(_COARSEST_M / np.maximum(_STEP * spare_m, 1e-9)))
        return np.clip(finer, 0, _LEVELS).astype(np.int64)

    def _travel_m(self, start: Array, end: Array) -> Array:
        by = end - start
        apart = np.stack([np.hypot(by[..., 0], by[..., 1]), np.abs(wrapped(by[..., 2]))], axis=-1)
        return apart @ self._arms

    def _grow(self, k: int, level: int) -> int | None:
        """Look at the neighbours of the next balls of a side; the one where it meets the other."""
        side, other = self._sides[k], self._sides[1 - k]
        heap = side.waiting[level]
        places = [heapq.heappop(heap) for _ in range(min(_AT_ONCE, len(heap)))]
        few, lattices = np.array([place[1:] for place in places]).T
        step = (1 << (_LEVELS - lattices))[:, None]
        own = np.rint((self._poses[few] - self._ends[0]) / self._unit / step).astype(np.int64)
        near = self._balls(((own[:, None] + _STEPS) * step[:, None]).reshape(-1, 3)).reshape(-1, 7)
        here = few[:, None]
        by_m = self._travel_m(self._poses[here], self._poses[near])
        joined = (by_m <= self._spare[here] + self._spare[near]) & (self._spare[near] >= 0)
        ahead_m = self._travel_m(self._poses[near], self._ends[1 - k])
        again = ~joined.all(axis=1) & (lattices == self._levels(self._spare[few]))
        for i in np.flatnonzero(again).tolist() if level < _LEVELS else ():
            about_m, ball, lattice = places[i]
            side.waiting[level + 1].append((about_m, ball, lattice + 1))
        row, column = np.nonzero(joined)
        links = few[row], near[row, column], by_m[row, column], ahead_m[row, column]
        own = self._levels(self._spare[near[row, column]])
        for i, j, m, left, at in zip(*(e.tolist() for e in (*links, own)), strict=True):
            cost = side.cost_m[i] + m
            if cost >= side.cost_m.get(j, np.inf) - 1e-9:
                continue
            if j not in side.cost_m:
                place = cost + _AHEAD * left, j, at
                if at > level:
                    side.waiting[at].append(place)
                else:
                    heapq.heappush(heap, place)
            side.cost_m[j], side.before[j] = cost, i
            if j in other.cost_m:
                return j
        return None

    def _balls(self, places: Array) -> Array:
        """Balls at places of the finest lattice (m, 3), made where they are not known, (m,)."""
        places[:, 2] %= self._turns
        named = [tuple(place) for place in places.tolist()]
        new = [place for place in dict.fromkeys(named) if place not in self._named]
        if new:
            self._named |= zip(new, itertools.count(self._size), strict=False)
            poses, first = self._ends[0] + np.array(new) * self._unit, self._size
            self._size += len(new)
            if self._size > len(self._poses):  # twice as much room
                self._poses = np.resize(self._poses, (2 * self._size, 3))
                self._spare = np.resize(self._spare, 2 * self._size)
            self._poses[first : self._size] = poses
            self._spare[first : self._size] = self._spare_of(poses)
        return np.array([self._named[place] for place in named])

    def _through(self, met: int) -> Array:
        """Poses of the way by a ball that both sides have found."""
        halves = []
        for side in self._sides:
            way = [met]
            while side.before[way[-1]] != way[-1]:
                way.append(side.before[way[-1]])
            halves.append(way)
        poses = self._poses[[*halves[0][::-1], *halves[1][1:]]]
        between = np.column_stack([poses[:-1, :2], poses[1:, 2]])  # a turn in place, then straight
        return continued(np.insert(poses, np.arange(1, len(poses)), between, axis=0))
