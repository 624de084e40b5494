"""Free slices in triangles: nodes of a roadmap that leave out no part and no passage."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.slices import FreeSlices, Indices


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

    @cached_property
    def _tree(self) -> shapely.STRtree:
        """Of the triangles, slices apart from each other."""
        apart = self._apart(self.corners, self.slice_of[:, None])
        return shapely.STRtree(np.asarray(shapely.polygons(apart), dtype=object))

    def _apart(self, positions: Array, slices: Indices) -> Array:
        wide = 1.0 + 4 * float(np.abs(self.corners).max(initial=0.0))
        return positions + np.stack([wide * slices, np.zeros_like(slices)], axis=-1)

    def seen_from(self, positions: Array, slices: Indices) -> Indices:
        """Nodes of the triangle that holds each position, pairs (position, node), (m, 2)."""
        points = shapely.points(self._apart(positions, slices))
        point, triangle = self._tree.query(points, predicate="intersects")
        pairs = np.column_stack([np.repeat(point, 3), self.node_of[triangle].ravel()])
        return np.unique(pairs[pairs[:, 1] >= 0], axis=0)


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
