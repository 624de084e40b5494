"""Nodes in free slices, and which see each other: a grid in every slice at once, and triangles.

Scan lines run along rows, columns and diagonals of the grid: sides of polygons cross a line between
nodes. A node is free if an odd number of them cross its line before it, and sees the next one if
none crosses between. Triangles give nodes that leave out no part and no passage.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.slices import FreeSlices, Indices


@dataclass(frozen=True, eq=False)
class Lattice:
    """Free nodes of a grid in slices.

    Attributes:
        poses: Nodes, (N, 3) [m, m, rad].
        moves: Pairs of neighbours in one slice that see each other, (M, 2).
        turns: Pairs of nodes at one position in neighbouring slices, (T, 2).
    """

    poses: Array
    moves: Indices
    turns: Indices


def lattice(slices: FreeSlices, spacing_m: float) -> Lattice:
    """The grid of all multiples of a spacing in free slices."""
    bounds = shapely.total_bounds(slices.parts)
    low = np.ceil(bounds[:2] / spacing_m).astype(int)
    size = np.maximum(np.floor(bounds[2:] / spacing_m).astype(int) - low + 1, 1)
    sides, slice_of = _sides(slices)
    sides = sides / spacing_m - low  # nodes are at whole numbers from here on
    nx, ny = size.tolist()
    x, y = sides[..., 0], sides[..., 1]
    along_x = _crossings(x, y, slice_of, (slices.headings, ny, nx)).transpose(0, 2, 1)
    along_y = _crossings(y, x, slice_of, (slices.headings, nx, ny))
    inside = _inside(along_x, axis=1)
    i, j = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    shape = (slices.headings, nx + ny - 1, nx)
    falling = _crossings(x, x + y, slice_of, shape)[:, i + j, i]
    rising = _crossings(x, y - x + nx - 1, slice_of, shape)[:, j - i + nx - 1, i]
    names = np.cumsum(inside).reshape(inside.shape) - 1
    here, there = slice(None, -1), slice(1, None)
    moves = [
        _pairs(names, inside, along_x == 0, (here, slice(None)), (there, slice(None))),
        _pairs(names, inside, along_y == 0, (slice(None), here), (slice(None), there)),
        _pairs(names, inside, rising == 0, (here, here), (there, there)),
        _pairs(names, inside, falling == 0, (here, there), (there, here)),
    ]
    after = np.roll(inside, -1, axis=0)
    turning = inside & after
    turns = np.column_stack([names[turning], np.roll(names, -1, axis=0)[turning]])
    found = np.argwhere(inside)
    positions = (found[:, 1:] + low) * spacing_m
    poses = np.column_stack([positions, slices.heading_rad(found[:, 0])])
    return Lattice(poses, np.concatenate(moves), turns)


def _sides(slices: FreeSlices) -> tuple[Array, Indices]:
    """Sides of all polygons, (m, 2, 2), and their slices, (m,)."""
    rings, part_of = shapely.get_rings(slices.parts, return_index=True)
    corners, ring_of = shapely.get_coordinates(rings, return_index=True)
    same = ring_of[1:] == ring_of[:-1]
    sides = np.stack([corners[:-1][same], corners[1:][same]], axis=1)
    return sides, slices.slice_of[part_of[ring_of[1:][same]]]


def _crossings(along: Array, across: Array, slice_of: Indices, shape: tuple[int, ...]) -> Indices:
    """Number of sides that cross each line between a node and the next one, (n, lines, nodes).

    What crosses before the first node counts as crossing after node -1, which comes last.

    Args:
        along: Coordinate of both ends of the sides along lines, (m, 2).
        across: The other one, whole on lines.
        slice_of: Slice of each side, (m,).
        shape: Slices, lines, nodes of a line.
    """
    _, lines, nodes = shape
    low, high = np.ceil(np.sort(across, axis=1)).astype(np.int64).T.clip(0, lines)
    count = high - low
    side = np.repeat(np.arange(len(across)), count)
    line = np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count) + low[side]
    (a, b), (p, q) = along[side].T, across[side].T
    cell = np.floor(a + (b - a) * (line - p) / (q - p)).astype(np.int64).clip(-1, nodes - 1)
    flat = (slice_of[side] * lines + line) * (nodes + 1) + cell % (nodes + 1)
    size = shape[0] * lines * (nodes + 1)
    return np.bincount(flat, minlength=size).reshape(shape[0], lines, nodes + 1)


def _inside(crossings: Indices, axis: int) -> NDArray[np.bool_]:
    """True where an odd number of sides crosses before nodes, one less than cells on the axis."""
    before = np.roll(crossings, 1, axis=axis).cumsum(axis=axis)
    return np.take(before, np.arange(before.shape[axis] - 1), axis=axis) % 2 == 1


def _pairs(
    names: Indices,
    inside: NDArray[np.bool_],
    clear: NDArray[np.bool_],
    one: tuple[slice, slice],
    other: tuple[slice, slice],
) -> Indices:
    """Names of neighbours that are both inside with nothing between, (m, 2)."""
    nx, ny = inside.shape[1:]
    free = clear[:, :nx, :ny][:, *one] & inside[:, *one] & inside[:, *other]
    return np.column_stack([names[:, *one][free], names[:, *other][free]])


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles of all parts, and nodes in the middles of the sides that two of them share.

    A part that is one triangle has its centroid as its node.

    Attributes:
        corners: Of each triangle, (T, 3, 2) [m].
        slice_of: Slice of each triangle, (T,).
        node_of: Node on each of its sides, -1 on sides of the part, (T, 3).
        positions: Nodes, (N, 2) [m].
        slice_of_node: Slice of each node, (N,).
    """

    corners: Array
    slice_of: Indices
    node_of: Indices
    positions: Array
    slice_of_node: Indices

    @property
    def edges(self) -> Indices:
        """Pairs of nodes of one triangle, which see each other, (E, 2)."""
        pairs = np.concatenate([self.node_of[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
        return pairs[(pairs >= 0).all(axis=1)]

    def _apart(self, positions: Array, slices: Indices) -> Array:
        wide = 1.0 + 4 * float(np.abs(self.corners).max(initial=0.0))
        return positions + np.stack([wide * slices, np.zeros_like(slices)], axis=-1)

    def seen_from(self, positions: Array, slices: Indices) -> Indices:
        """Nodes of the triangle that holds each position, pairs (position, node), (m, 2)."""
        points = shapely.points(self._apart(positions, slices))
        own: Any = shapely.polygons(self._apart(self.corners, self.slice_of[:, None]))
        point, triangle = shapely.STRtree(own).query(points, predicate="intersects")
        pairs = np.column_stack([np.repeat(point, 3), self.node_of[triangle].ravel()])
        pairs = pairs[pairs[:, 1] >= 0]
        return pairs[np.unique(pairs @ [len(self.positions), 1], return_index=True)[1]]


def triangles(slices: FreeSlices) -> Triangles:
    """The constrained Delaunay triangles of free slices."""
    found, part_of = shapely.get_parts(
        shapely.constrained_delaunay_triangles(slices.parts), return_index=True
    )
    corners = shapely.get_coordinates(found).reshape(-1, 4, 2)[:, :3]
    middles = ((corners + np.roll(corners, -1, axis=1)) / 2).reshape(-1, 2)
    part = np.repeat(part_of, 3)
    order = np.lexsort([*middles.T, part])
    new = (middles[order[1:]] != middles[order[:-1]]).any(axis=1)
    new |= part[order[1:]] != part[order[:-1]]
    group = np.cumsum(np.append(True, new)) - 1
    shared = np.bincount(group) > 1
    name = np.where(shared, np.cumsum(shared) - 1, -1)  # -1: a side of the part
    node_of = np.empty((len(corners), 3), dtype=np.int64)
    node_of.ravel()[order] = name[group]
    one = order[np.append(True, new)][shared]
    alone = np.flatnonzero((node_of < 0).all(axis=1))
    node_of[alone, 0] = len(one) + np.arange(len(alone))
    positions = np.concatenate([middles[one], corners[alone].mean(axis=1)])
    slice_of = slices.slice_of[part_of]
    of_node = np.concatenate([slices.slice_of[part[one]], slice_of[alone]])
    return Triangles(corners, slice_of, node_of, positions, of_node)
