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

from twosra_mpc.effort import Cost, charge, remembered
from twosra_mpc.model.flow import twists
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.lattice import lattice, triangles
from twosra_mpc.space.screws import continued, times_at_speed_s
from twosra_mpc.space.slices import FreeSlices, Indices, components

_MOST = 1000  # grid nodes in a slice
_SEEN = 16  # nearest nodes to which a pose is joined
_FEW = 10_000  # edges whose times are found at once: 2 MiB on the way
_NEAREST = 4  # by which the way to a pose is estimated


class Graph:
    """Nodes, and how long it takes along the edges between them, either way.

    Args:
        size: Number of nodes.
        edges: Pairs of nodes, (E, 2).
        times_s: Of each, more than zero, (E,) [s].
    """

    def __init__(self, size: int, edges: Indices, times_s: Array) -> None:
        begin, end = np.concatenate([edges, edges[:, ::-1]]).T
        order = np.argsort(begin, kind="stable")
        self._begin, self._end = begin[order], end[order]
        self._times_s = np.tile(times_s, 2)[order]
        self._first = np.searchsorted(self._begin, np.arange(size + 1))

    def least_times_s(self, nodes: Indices, times_s: Array) -> tuple[Array, Indices]:
        """Least times to every node, infinite without a way, and the node before it, (size,) each.

        Ways begin at ``nodes`` (k,), each at a time of its own, (k,). Where they begin,
        -1 is the node before.
        """
        least = np.full(len(self._first) - 1, np.inf)
        np.minimum.at(least, nodes, times_s)
        waiting = np.isfinite(least)
        while len(now := np.flatnonzero(waiting)):
            waiting[now] = False
            first, count = self._first[now], self._first[now + 1] - self._first[now]
            edges = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
            ends, times = self._end[edges], np.repeat(least[now], count) + self._times_s[edges]
            sooner = times < least[ends]
            np.minimum.at(least, ends[sooner], times[sooner])
            waiting[ends[sooner]] = True
        before = np.full(len(least), -1)
        ways = np.isfinite(least[self._begin])
        ways &= least[self._begin] + self._times_s == least[self._end]
        before[self._end[ways]] = self._begin[ways]
        before[nodes[least[nodes] == times_s]] = -1
        return least, before


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
    def graph(self) -> Graph:
        """Time of each edge at full speed [s]."""
        few = np.array_split(self.edges, 1 + len(self.edges) // _FEW)
        ends = (self.poses[each.T] for each in few)
        times = np.concatenate([times_at_speed_s(self.rows, twists(*each)) for each in ends])
        return Graph(len(self.poses), self.edges, times + 1e-9)

    @cached_property
    def _in_slices(self) -> list[Indices]:
        order = np.argsort(self.slice_of, kind="stable")
        return np.split(
            order, np.searchsorted(self.slice_of[order], np.arange(1, self.slices.headings))
        )

    def nearest(self, positions: Array, k: int, count: int) -> Indices:
        """Up to ``count`` nodes of slice k that are nearest to positions (m, 2), (m, some)."""
        nodes = self._in_slices[k]
        apart_m = np.linalg.norm(positions[:, None] - self.poses[nodes, :2], axis=-1)
        return nodes[np.argsort(apart_m, axis=1, kind="stable")[:, :count]]

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
        for nodes in self.nearest(at[None, :2], k, _SEEN)[0], self._in_slices[k]:
            seen: Indices = nodes[self._sees(at, nodes, part)]
            if len(seen):
                break
        return seen

    def _sees(self, at: Array, nodes: Indices, part: int) -> NDArray[np.bool_]:
        ends = np.broadcast_to(at[:2], (len(nodes), 2))
        lines = shapely.linestrings(np.stack([ends, self.poses[nodes, :2]], axis=1))
        return np.asarray(shapely.covers(self.slices.parts[part], lines))

    @remembered(3)  # many drives end in one goal
    def field(self, *at: float) -> Field | None:
        """Least times along roads from a pose, or to it; None where it is not in a slice."""
        pose = np.array(at)
        via, nodes, times = self.links(pose)
        if not len(nodes):
            return None
        charge(Cost.WAY, len(self.poses))
        times_s, before = self.graph.least_times_s(nodes, times + 1e-9)
        return Field(self, pose, dict(zip(nodes.tolist(), via, strict=True)), times_s, before)


@dataclass(frozen=True, eq=False)
class Field:
    """Least times along a roadmap from one pose, or to it.

    Attributes:
        roadmap: The roadmap.
        pose: Where from, (3,).
        via: After the turn in place at the pose, by the node it is followed by.
        times_s: To each node at full speed, infinite where there is no road, (N,).
        before: Node before each one, -1 for the pose, (N,).
    """

    roadmap: Roadmap
    pose: Array
    via: dict[int, Array]
    times_s: Array
    before: Indices

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
        total = self.times_s + back.times_s
        near = np.flatnonzero(total <= longer * float(total.min()))
        for at in np.unique(path[:, :2], axis=0):
            near = near[np.hypot(*(self.roadmap.poses[near, :2] - at).T) > apart_m]
        if not len(near):
            return None
        node = int(near[total[near].argmin()])
        return continued(np.array([*self._way(node), *back._way(node)[::-1]]))

    def _way(self, node: int) -> list[Array]:
        """Poses from this one to a node."""
        poses, last = [], node
        while node >= 0:
            poses.append(self.roadmap.poses[node])
            last, node = node, int(self.before[node])
        return [self.pose, self.via[last], *poses[::-1]]

    def estimates_s(self, poses: Array) -> Array:
        """About how long roads to other poses (m, 3) take, (m,) [s]; zero where that is not known.

        By the nearest nodes of their slices, seen or not.
        """
        roads = self.roadmap
        slices = roads.slices.index_of(poses[:, 2])
        times = np.full(len(poses), np.inf)
        for k in {*slices.tolist()}:
            own = slices == k
            near = roads.nearest(roads.slices.within(poses[own, :2]), k, _NEAREST)
            legs = times_at_speed_s(roads.rows, twists(poses[own, None], roads.poses[near]))
            times[own] = (self.times_s[near] + legs).min(axis=1, initial=np.inf)
        return np.where(np.isfinite(times), times, 0.0)


def roadmap(slices: FreeSlices, rows: Array, spacing_m: float) -> Roadmap:
    """The roadmap of slices that hold something, for speed limits ``rows`` (m, 3).

    Its grid has this spacing, or a wider one where slices are wide.
    """
    x0, y0, x1, y1 = shapely.total_bounds(slices.parts)
    spacing_m = max(spacing_m, ((x1 - x0) * (y1 - y0) / _MOST) ** 0.5)
    grid, exact = lattice(slices, spacing_m), triangles(slices)
    meeting, of_meeting = _in_both(slices)
    own = components(len(grid.poses), grid.moves)
    some = np.unique(own, return_index=True)[1]  # a node of each set that moves connect
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


def _in_both(slices: FreeSlices) -> tuple[Array, Indices]:
    """A position in each intersection of neighbouring parts, twice, and the slices it is in."""
    pairs = slices.neighbours
    shared = shapely.intersection(slices.parts[pairs[:, 0]], slices.parts[pairs[:, 1]])
    some = ~shapely.is_empty(shared)
    positions = shapely.get_coordinates(shapely.point_on_surface(shared[some]))
    return np.repeat(positions, 2, axis=0), slices.slice_of[pairs[some].ravel()]
