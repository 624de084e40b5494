"""A grid in every slice at once: which of its nodes are free, and which see their neighbours.

Scan lines along rows, columns and diagonals of the grid: sides of polygons cross a line between
nodes. A node is free if an odd number of them cross its line before it, and sees the next one if
none crosses between.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    """How many sides cross each line after a node and before the next one, (n, lines, nodes).

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
    """Whether an odd number of sides crosses before nodes; one less than of cells on the axis."""
    before = np.roll(crossings, 1, axis=axis).cumsum(axis=axis)
    odd: NDArray[np.bool_] = np.take(before, np.arange(before.shape[axis] - 1), axis=axis) % 2 == 1
    return odd


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
