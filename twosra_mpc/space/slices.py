r"""Free space of one shape: slices of headings, in the plane exact.

With headings :math:`I_k` within :math:`h = \pi / n` of :math:`\varphi_k`, for pieces :math:`A` of
the footprint, convex parts :math:`O` of obstacles and :math:`-` for "turned by half a circle",

.. math:: F^-_k = W^- \setminus \bigcup O \oplus -R(\varphi_k) A^-, \qquad
          F^+_k = W^+ \setminus \bigcup O \oplus -R(\varphi_k) A^+.

:math:`A^-` holds an outer piece turned by up to h either way, and all that is nearer than
``kept_m`` to it; so every pose of :math:`F^-_k \times I_k` keeps that. :math:`A^+` is what an inner
piece holds however it is turned, and only what is nearer than ``kept_m`` to it; so a pose in
:math:`I_k` whose position is inside of such a sum keeps less, and all that keep it are in
:math:`F^+_k \times I_k`. W is where the outer pieces are inside the workspace whatever the heading
in :math:`I_k`, or where the inner ones may be. The heading alone is discretised.

Parts of neighbouring slices that intersect share poses of the heading between them. So two poses in
one component of F- are joined by a path, and two in different components of F+ are not. F+ is made
of sums 0.2 mm smaller: what verification may not see, and no passage is too narrow for polygons.

Where the workspace has no edge, slices end at a box so far out that on its edge all is free. Beyond
it all is free too, so that what is connected in the plane is so in the box.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge, remembered
from twosra_mpc.problem.tolerances import UNSEEN_M
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array, rotation, wrapped
from twosra_mpc.space.footprint import Footprint
from twosra_mpc.space.minkowski import (
    kept_by_all,
    merged,
    minkowski_sums,
    parts_around,
    parts_within,
    reach,
    stacked,
    swept,
    turned,
)

Geometries = NDArray[np.object_]
Indices = NDArray[np.int64]

_ROUNDING_M = 1e-6  # of GEOS, and to spare
_SMOOTH = 1.0  # of what turning moves a robot in a slice: by so much obstacles may be larger
# GEOS may lose whole polygons in floating point; where it has, it is asked again on a grid.
_SUMS = 4_000  # made and united at once, 1 MiB of corners: of as many headings as that is, or less
_GRID_M, _LOST_M2 = 1e-9, 1e-9  # of overlays that lose area without a grid; as near is the same
AT_EDGE_M = 1e-6  # of a box: rounding of GEOS
_AROUND_M = 0.1  # beyond what obstacles can block
_AXES = np.array([np.pi, 1.5 * np.pi, 0.0, 0.5 * np.pi])  # towards low x, low y, high x, high y


@dataclass(frozen=True, eq=False)
class FreeSlices:
    """Free space for the b0 of one shape, in slices of headings.

    Attributes:
        headings: Number n of slices; slice k is of headings within pi / n of 2 pi k / n.
        parts: Polygons of positions of b0, each connected, (m,).
        slice_of: Slice of each part, (m,), growing.
        box_m: Where slices end without a workspace: least and largest x and y, infinite with one,
            (2, 2).
    """

    headings: int
    parts: Geometries
    slice_of: Indices
    box_m: Array

    @cached_property
    def first(self) -> Indices:
        """First part of each slice, and the number of parts, (n + 1,)."""
        return np.searchsorted(self.slice_of, np.arange(self.headings + 1))

    @cached_property
    def neighbours(self) -> Indices:
        """Pairs of parts of neighbouring slices that intersect, (pairs, 2)."""
        count = np.diff(self.first)
        after = (self.slice_of + 1) % self.headings
        one = np.repeat(np.arange(len(self.parts)), count[after])
        start = np.cumsum(count[after]) - count[after]
        other = np.arange(len(one)) - start[one] + self.first[after[one]]
        charge(Cost.MEETING, len(one))
        shapely.prepare(self.parts)
        meet = shapely.intersects(self.parts[one], self.parts[other])
        return np.column_stack([one[meet], other[meet]])

    @cached_property
    def component_of(self) -> Indices:
        """Component of each part, (m,)."""
        return components(len(self.parts), self.neighbours)

    def slices_of(self, heading_rad: float) -> tuple[int, ...]:
        """The slice that holds a heading; both on the border between two."""
        at = heading_rad / (2 * np.pi) * self.headings
        near = {round(at - 1e-9) % self.headings, round(at + 1e-9) % self.headings}
        return tuple(sorted(near))

    def heading_rad(self, k: Indices) -> Array:
        """Middle of slices (m,), the heading of their polygons, (m,)."""
        return 2 * np.pi * k / self.headings

    def index_of(self, heading_rad: Array) -> Indices:
        """A slice that holds each heading (m,), (m,)."""
        turns = heading_rad / (2 * np.pi) * self.headings
        return np.rint(turns).astype(np.int64) % self.headings

    def hold_leg(self, start: Array, end: Array) -> bool:
        """True if a leg between two poses (3,) is free that keeps its heading or turns in place."""
        turn = float(wrapped(end[2] - start[2]))
        if abs(turn) > 1e-12 and np.abs(end[:2] - start[:2]).max() > 1e-12:
            return False
        k = np.rint(np.array([start[2], start[2] + turn]) * self.headings / (2 * np.pi))
        passed = np.arange(k.min(), k.max() + 1).astype(np.int64) % self.headings
        line = shapely.LineString(self.within(np.array([start[:2], end[:2]])))
        return all(
            shapely.covers(self.parts[self.first[i] : self.first[i + 1]], line).any()
            for i in passed
        )

    def within(self, positions: Array) -> Array:
        """Positions (..., 2), moved to the edge of the box from beyond, where all is free."""
        return np.clip(positions, *self.box_m)

    def parts_at(self, pose: Array) -> list[int]:
        """Parts that hold a pose (3,): none, one, or on a border between headings several."""
        point = shapely.points(self.within(pose[:2]))
        near = [np.arange(*self.first[k : k + 2]) for k in self.slices_of(pose[2])]
        candidates = np.concatenate(near)
        return [int(i) for i in candidates[shapely.intersects(self.parts[candidates], point)]]

    def component(self, pose: Array) -> int | None:
        """Component that holds a pose (3,); None if there is none."""
        parts = self.parts_at(pose)
        return int(self.component_of[parts[0]]) if parts else None


def certified_slices(
    footprint: Footprint, world: World, kept_m: float, headings: int
) -> FreeSlices:
    """F-: poses at which a robot is sure to keep ``kept_m`` [m], from ``headings`` slices."""
    half_turn, pieces = np.pi / headings, _rectangles(footprint.outer)
    grown = list(swept(pieces, half_turn, kept_m + _ROUNDING_M))
    extent = _extents(footprint.outer, half_turn, headings) + _ROUNDING_M
    around = parts_around(world.obstacles, _SMOOTH * half_turn * footprint.radius_m)
    return _slices(world, grown, around, extent, headings)


def possible_slices(footprint: Footprint, world: World, kept_m: float, headings: int) -> FreeSlices:
    """F+: poses at which a robot may keep ``kept_m`` [m], or seem to; none other can."""
    return _possible(footprint.inner.tobytes(), world, kept_m, headings)


@remembered(2)  # drives ask, and proofs of what is necessary
def _possible(inner: bytes, world: World, kept_m: float, headings: int) -> FreeSlices:
    held = np.frombuffer(inner).reshape(-1, 4, 2)
    half_turn, pieces = np.pi / headings, _rectangles(held)
    shrunk = kept_by_all(pieces, half_turn, kept_m - UNSEEN_M)
    extent = _extents(held, -half_turn, headings) - UNSEEN_M
    obstacles = parts_within(world.obstacles)
    return _slices(world, shrunk, obstacles, extent, headings)


def component_around(
    pieces: list[Array], obstacles: list[Array], headings: int, at: Array
) -> tuple[Geometries, bool] | None:
    """Positions that convex pieces, turned to the middles of slices, get to from one at heading 0.

    Slices are made as they are come to, and no more once a position is at the edge of `box_around`.

    Args:
        pieces: Of what moves, counter-clockwise, (corners, 2) each [m].
        obstacles: Convex parts of what is around, the same.
        headings: Slices.
        at: The position, (2,).

    Returns:
        Parts of the component, and whether it is at the edge; None where the position is not free.
    """
    box, made = box_around(pieces, obstacles), dict[int, Geometries]()
    (low, high), moving, still = box[:, None], stacked(pieces), stacked(obstacles)
    alike = _alike_after(pieces, headings)

    def parts_of(k: int) -> Geometries:
        if (k := k % alike) not in made:
            charge(Cost.SLICE)
            charge(Cost.SUM, len(pieces) * len(obstacles))
            whole = np.array([shapely.box(*box.ravel())], dtype=object)
            blocked = _blocked(moving, still, _centres(headings)[k : k + 1], low, high)
            made[k] = shapely.get_parts(_left_of(whole, blocked))
        return made[k]

    first = np.flatnonzero(shapely.intersects(parts_of(0), shapely.Point(at)))
    if not len(first):
        return None
    found = dict.fromkeys([(0, int(first[0]))])
    todo = list(found)
    while todo:
        k, i = todo.pop(0)
        part = parts_of(k)[i]
        if (np.abs(np.reshape(part.bounds, (2, 2)) - box) <= AT_EDGE_M).any():
            return np.array([part]), True
        for beside in {(k - 1) % headings, (k + 1) % headings} - {k}:
            meet = np.flatnonzero(shapely.intersects(parts_of(beside), part)).tolist()
            new = [(beside, j) for j in meet if (beside, j) not in found]
            found |= dict.fromkeys(new)
            todo += new
    return np.array([parts_of(k)[i] for k, i in found]), False


def _alike_after(pieces: list[Array], headings: int) -> int:
    """Slices after which one convex piece looks the same, a square after a quarter of them."""
    for k in (k for k in range(1, headings) if headings % k == 0 and len(pieces) == 1):
        apart = (pieces[0] @ rotation(2 * np.pi * k / headings))[:, None] - pieces[0]
        if np.abs(apart).max(axis=2).min(axis=1).max() < _GRID_M:
            return k
    return headings


def _rectangles(pieces: Array) -> Array:
    """Pieces (m, 4, 2), those whose union is a rectangle as one."""
    fewer = merged(list(pieces))
    return np.array(fewer) if all(len(piece) == 4 for piece in fewer) else pieces


def _extents(pieces: Array, half_turn_rad: float, headings: int) -> Array:
    """Extents of pieces from b0 at each heading, towards low x, low y, high x, high y, (n, 4)."""
    angles = (_AXES - _centres(headings)[:, None])[:, :, None]
    return reach(pieces, angles, half_turn_rad).max(axis=-1)


def _centres(headings: int) -> Array:
    return np.arange(headings) * 2 * np.pi / headings


def _slices(
    world: World, pieces: list[Array], obstacles: list[Array], extent: Array, headings: int
) -> FreeSlices:
    edges = world.workspace.corners_m if world.workspace else np.array([[-np.inf], [np.inf]])
    edges, box = np.broadcast_to(edges, (2, 2)), box_around(pieces, obstacles)
    low = np.where(np.isfinite(edges[0]), edges[0] + extent[:, :2], box[0])
    high = np.where(np.isfinite(edges[1]), edges[1] - extent[:, 2:], box[1])
    some = (low < high).all(axis=1)
    free = np.full(headings, shapely.Polygon(), dtype=object)
    free[some] = shapely.box(*low[some].T, *high[some].T)
    if pieces and obstacles:
        high, centres = np.where(some[:, None], high, -np.inf), _centres(headings)
        moving, still, few = stacked(pieces), stacked(obstacles), max(1, _SUMS // len(pieces))
        several = max(1, few // len(obstacles))
        chunks = itertools.product(range(0, headings, several), range(0, len(obstacles), few))
        for first, some in chunks:
            k, them = slice(first, first + several), still[some : some + few]
            charge(Cost.SLICE, len(centres[k]))
            charge(Cost.SUM, len(centres[k]) * len(pieces) * len(them))
            free[k] = _left_of(free[k], _blocked(moving, them, centres[k], low[k], high[k]))
    parts, slice_of = shapely.get_parts(free, return_index=True)
    kept = shapely.area(parts) > 0
    beyond = np.where(np.isfinite(edges), [[-np.inf], [np.inf]], box)
    return FreeSlices(headings, parts[kept], slice_of[kept].astype(np.int64), beyond)


def _blocked(
    pieces: Array, obstacles: Array, headings: Array, low: Array, high: Array
) -> Geometries:
    """Positions that obstacles block at headings (n,), of those in the boxes low to high, (n,)."""
    sums = minkowski_sums(-turned(pieces, headings), obstacles)
    met = (sums.min(axis=-2) < high[:, None, None]).all(axis=-1)
    met &= (sums.max(axis=-2) > low[:, None, None]).all(axis=-1)
    blocked = np.full(met.shape, None, dtype=object)
    blocked[met] = shapely.polygons(sums[met])
    by_obstacle = np.asarray(shapely.union_all(blocked, axis=1))  # faster than all at once
    whole = np.asarray(shapely.union_all(by_obstacle, axis=1), dtype=object)
    at, *_ = np.nonzero(met)
    middles = shapely.points(sums[met].mean(axis=1))
    shapely.prepare(whole)
    for k in set(at[~shapely.intersects(whole[at], middles)].tolist()):
        whole[k] = shapely.union_all(blocked[k].ravel(), grid_size=_GRID_M)
    return whole


def _left_of(free: Geometries, blocked: Geometries) -> Geometries:
    """Boxes without what is blocked, (n,)."""
    left = np.asarray(shapely.difference(free, blocked), dtype=object)
    covered = shapely.area(shapely.intersection(free, blocked))
    lost = np.abs(shapely.area(free) - shapely.area(left) - covered) > _LOST_M2
    left[lost] = shapely.difference(free[lost], blocked[lost], grid_size=_GRID_M)
    return left


def box_around(pieces: list[Array], obstacles: list[Array]) -> Array:
    """A box that holds all that obstacles can block, with room around, (2, 2)."""
    far = max((float(np.linalg.norm(piece, axis=1).max()) for piece in pieces), default=0.0)
    corners = np.concatenate(obstacles or [np.zeros((1, 2))])
    around = np.array([[-1.0], [1.0]]) * (far + _AROUND_M)
    return np.array([corners.min(axis=0), corners.max(axis=0)]) + around


def components(size: int, edges: Indices) -> Indices:
    """Component of each node of a graph with edges (E, 2), numbered from 0, (size,)."""
    root = np.arange(size)
    while True:
        ends = root[edges]
        ends = ends[ends[:, 0] != ends[:, 1]]
        if not len(ends):
            return np.unique(root, return_inverse=True)[1].ravel()
        np.minimum.at(root, ends.max(axis=1), ends.min(axis=1))
        while not np.array_equal(further := root[root], root):
            root = further
