"""Roads through free slices: drives at a fixed heading and turns in place, all of them free.

Nodes are a grid and, so that no part or passage is left out, the middles of the sides between
triangles of every part and a point in each intersection of neighbouring parts. So whatever is
connected in the slices is connected in the roadmap.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from twosra_mpc.effort import Cost, charge
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.lattice import Lattice, lattice, triangles
from twosra_mpc.space.screws import continued, times_at_speed_s, twists
from twosra_mpc.space.slices import FreeSlices, Indices

_MOST = 1000  # grid nodes in a slice
_SEEN = 16  # nearest nodes to which a pose is joined
_FEW = 10_000  # edges whose times are found at once: 2 MiB on the way
_NEAREST = 4  # by which the way to a pose is estimated
_APART = 1e3  # times as far apart as the plane is wide are slices, where they are told apart


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Poses and the free legs between them.

    Attributes:
        slices: What is free.
        rows: Of `rigid_rows`, (m, 3).
        poses: Nodes, (N, 3) [m, m, rad].
        slice_of: Slice of each node, (N,).
        edges: Pairs of nodes, (E, 2).
    """

    slices: FreeSlices
    rows: Array
    poses: Array
    slice_of: Indices
    edges: Indices

    @cached_property
    def graph(self) -> csr_array:
        """Time of each edge at full speed [s], (N, N)."""
        one, other = self.edges.T
        few = np.array_split(self.edges, 1 + len(self.edges) // _FEW)
        ends = (self.poses[each.T] for each in few)
        times = np.concatenate([times_at_speed_s(self.rows, twists(*each)) for each in ends])
        size = len(self.poses)
        return csr_array((times + 1e-9, (one, other)), shape=(size, size))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._told_apart(self.poses[:, :2], self.slice_of))

    def _told_apart(self, positions: Array, slices: Indices) -> Array:
        return np.column_stack([positions, _APART * slices])

    def nearest(self, positions: Array, slices: Indices, count: int) -> Indices:
        """The nodes nearest to positions (m, 2) in slices (m,), (m, count)."""
        _, near = self._tree.query(self._told_apart(positions, slices), k=range(1, count + 1))
        return np.asarray(np.minimum(near, len(self.poses) - 1))

    def links(self, pose: Array) -> tuple[Array, Indices, Array]:
        """Nodes that a pose (3,) gets to by a turn in place, then straight on.

        Returns:
            The pose after the turn for each of them, (k, 3), the nodes (k,), and times (k,) [s].
        """
        found: list[tuple[Array, Indices]] = []
        for part in self.slices.parts_at(pose):
            k = self.slices.slice_of[part]
            at = np.append(self.slices.within(pose[:2]), self.slices.heading_rad(k))
            nodes = self._near(at, k, part)
            found.append((np.tile(at, (len(nodes), 1)), nodes))
        if not found:
            return np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0)
        via, nodes = (np.concatenate(column) for column in zip(*found, strict=True))
        times = times_at_speed_s(self.rows, twists(pose, via))
        return via, nodes, times + times_at_speed_s(self.rows, twists(via, self.poses[nodes]))

    def _near(self, at: Array, k: int, part: int) -> Indices:
        """Nodes of a slice that are seen from a pose in a part, among them some of its triangle."""
        count = min(_SEEN, len(self.poses))
        _, near = self._tree.query(self._told_apart(at[None, :2], np.array([k]))[0], k=count)
        nodes: Indices = np.atleast_1d(near)
        nodes = nodes[self.slice_of[nodes] == k]
        seen = nodes[self._sees(at, nodes, part)]
        if len(seen):
            return seen
        every = np.flatnonzero(self.slice_of == k)
        return every[self._sees(at, every, part)]

    def _sees(self, at: Array, nodes: Indices, part: int) -> NDArray[np.bool_]:
        ends = np.broadcast_to(at[:2], (len(nodes), 2))
        lines = shapely.linestrings(np.stack([ends, self.poses[nodes, :2]], axis=1))
        return np.asarray(shapely.covers(self.slices.parts[part], lines))

    def field(self, pose: Array) -> Field | None:
        """Least times along roads from a pose (3,), or to it; None where it is not in a slice."""
        via, nodes, times = self.links(pose)
        if not len(nodes):
            return None
        charge(Cost.WAY, len(self.poses))
        size = len(self.poses)
        with_pose = csr_array(
            (
                np.concatenate([self.graph.data, times + 1e-9]),
                np.concatenate([self.graph.indices, nodes]),
                np.append(self.graph.indptr, self.graph.nnz + len(nodes)),
            ),
            shape=(size + 1, size + 1),
        )
        times_s, before = dijkstra(
            with_pose, directed=False, indices=[size], return_predecessors=True
        )
        after_turn = dict(zip(nodes.tolist(), via, strict=True))
        return Field(self, pose, after_turn, times_s[0, :-1], before[0])


@dataclass(frozen=True, eq=False)
class Field:
    """Least times along a roadmap from one pose, or to it.

    Attributes:
        roadmap: The roadmap.
        pose: Where from, (3,).
        via: After the turn in place at the pose, by the node it is followed by.
        times_s: To each node at full speed, infinite where there is no road, (N,).
        before: Node before each one, (N + 1,).
    """

    roadmap: Roadmap
    pose: Array
    via: dict[int, Array]
    times_s: Array
    before: NDArray[np.int32]

    def path(self, pose: Array) -> Array | None:
        """Poses of the fastest way to a pose, both ends included, (m, 3); None if there is none.

        Each leg turns in place or keeps its heading. Headings go on over full turns.
        """
        via, nodes, times = self.roadmap.links(pose)
        total = self.times_s[nodes] + times
        if not len(nodes) or not np.isfinite(total.min()):
            return None
        best = int(total.argmin())
        return continued(np.array([*self._way(int(nodes[best])), via[best], pose]))

    def other_path(self, back: Field, path: Array, apart_m: float, longer: float) -> Array | None:
        """The fastest way to where another field is from that goes elsewhere for a while.

        Args:
            back: Times to where it leads.
            path: The fastest way of all, (m, 3).
            apart_m: How far from that it gets, at least.
            longer: How many times longer it may take.
        """
        poses, total = self.roadmap.poses, self.times_s + back.times_s
        away, _ = cKDTree(path[:, :2]).query(poses[:, :2])
        total = np.where(away > apart_m, total, np.inf)
        node = int(total.argmin())
        if not total[node] <= longer * float((self.times_s + back.times_s).min()):
            return None
        return continued(np.array([*self._way(node), *back._way(node)[::-1]]))

    def _way(self, node: int) -> list[Array]:
        """Poses from this one to a node."""
        poses, last = [], node
        while node < len(self.times_s):
            poses.append(self.roadmap.poses[node])
            last, node = node, int(self.before[node])
        return [self.pose, self.via[last], *poses[::-1]]

    def estimates_s(self, poses: Array) -> Array:
        """About how long roads to other poses (m, 3) take, (m,) [s]; zero where that is not known.

        By the nearest nodes of their slices, seen or not.
        """
        roads = self.roadmap
        turn = poses[:, 2] / (2 * np.pi) * roads.slices.headings
        slices = np.round(turn).astype(int) % roads.slices.headings
        near = roads.nearest(roads.slices.within(poses[:, :2]), slices, _NEAREST)
        legs = times_at_speed_s(roads.rows, twists(poses[:, None], roads.poses[near]))
        same = roads.slice_of[near] == slices[:, None]
        times = np.where(same, self.times_s[near] + legs, np.inf).min(axis=1)
        return np.where(np.isfinite(times), times, 0.0)


def roadmap(slices: FreeSlices, rows: Array, spacing_m: float) -> Roadmap:
    """The roadmap of slices that hold something, for speed limits ``rows`` (m, 3).

    Its grid has this spacing, or a wider one where slices are wide.
    """
    x0, y0, x1, y1 = shapely.total_bounds(slices.parts)
    spacing_m = max(spacing_m, ((x1 - x0) * (y1 - y0) / _MOST) ** 0.5)
    grid, exact = lattice(slices, spacing_m), triangles(slices)
    meeting, of_meeting = _in_both(slices)
    some = _one_of_each(grid)
    of_some = slices.index_of(grid.poses[some, 2])
    sizes = np.cumsum([len(grid.poses), len(exact.positions)])
    pairs = sizes[1] + np.arange(len(meeting)).reshape(-1, 2)
    linked = np.concatenate([some, pairs.ravel()])
    points = np.concatenate([grid.poses[some, :2], meeting])
    seen = exact.seen_from(points, np.concatenate([of_some, of_meeting]))
    links = np.column_stack([linked[seen[:, 0]], sizes[0] + seen[:, 1]])
    slice_of = np.concatenate([slices.index_of(grid.poses[:, 2]), exact.slice_of_node, of_meeting])
    positions = np.concatenate([grid.poses[:, :2], exact.positions, meeting])
    poses = np.column_stack([positions, slices.heading_rad(slice_of)])
    edges = np.concatenate([grid.moves, grid.turns, sizes[0] + exact.edges, pairs, links])
    charge(Cost.ROAD, len(poses))
    return Roadmap(slices, rows, poses, slice_of, edges)


def _one_of_each(grid: Lattice) -> Indices:
    """A node of each set of grid nodes of one slice that moves connect."""
    size, (one, other) = len(grid.poses), grid.moves.T
    joined = csr_array((np.ones(len(one)), (one, other)), shape=(size, size))
    _, label = connected_components(joined, directed=False)
    return np.asarray(np.unique(label, return_index=True)[1], dtype=np.int64)


def _in_both(slices: FreeSlices) -> tuple[Array, Indices]:
    """A position in each intersection of neighbouring parts, twice, and the slices it is in."""
    pairs = slices.neighbours
    shared = shapely.intersection(slices.parts[pairs[:, 0]], slices.parts[pairs[:, 1]])
    some = ~shapely.is_empty(shared)
    positions = shapely.get_coordinates(shapely.point_on_surface(shared[some]))
    return np.repeat(positions, 2, axis=0), slices.slice_of[pairs[some].ravel()]
