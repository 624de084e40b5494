"""Roads through free slices: drives at a fixed heading and turns in place, all of them free.

Nodes are a grid and, so that no part or passage is left out, the middles of the sides between
triangles of every part and a point in each intersection of neighbouring parts. So whatever is
connected in the slices is connected in the roadmap.

Drives are then made shorter: fewer legs, better poses between them, or one pose guessed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from twosra_mpc.effort import Cost, charge
from twosra_mpc.robot.coordinates import Array, wrapped
from twosra_mpc.space.lattice import Lattice, lattice, triangles
from twosra_mpc.space.screws import continued, moved, times_at_speed_s, twists
from twosra_mpc.space.slices import FreeSlices, Indices

Bools = NDArray[np.bool_]
Times = Callable[[Array, Array], Array]  # of legs between poses (m, 3) each, (m,) [s]
Proof = Callable[[Array, Array], Bools]  # which of them are clear, (m,)

_WINDOW = 20  # poses of which every pair is tried at once
_STEPS = (0.04, 0.02, 0.01, 0.005)  # m, by which poses between legs are moved
_PER_STEP_RAD = 5.0  # turns go with them, per metre
_WORTH_S = 1e-3  # a shorter way by less is rounding
_TRIED = 4  # of the moves that save most
_GUESSES = 16  # poses tried between two legs, the quickest first
_SIGNS = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
_MOVES = _SIGNS[_SIGNS.any(axis=1)] * np.array([1.0, 1.0, _PER_STEP_RAD])  # of poses, per metre


def shortest(poses: Array, times: Times, proof: Proof) -> Array:
    """The fastest of the drives that leave out poses (m, 3) and are proved clear."""
    while len(poses) > 2:
        windows = [poses[i : i + _WINDOW + 1] for i in range(0, len(poses) - 1, _WINDOW)]
        found = [_fastest(window, times, proof) for window in windows]
        shorter = np.concatenate([*(part[:-1] for part in found), poses[-1:]])
        if len(shorter) == len(poses) or len(windows) == 1:
            return shorter
        poses = shorter
    return poses


def _fastest(poses: Array, times: Times, proof: Proof) -> Array:
    """The fastest way through some of a few poses, neighbours among them taken as clear."""
    one, other = np.triu_indices(len(poses), k=1)
    taken = times(poses[one], poses[other])
    own = np.concatenate([[0.0], np.cumsum(taken[other - one == 1])])
    known = other - one == 1
    asked = np.flatnonzero(~known & (taken < own[other] - own[one]))
    known[asked] = proof(poses[one[asked]], poses[other[asked]])
    least, before = np.full(len(poses), np.inf), np.zeros(len(poses), dtype=int)
    least[0] = 0.0
    for i, j, leg in zip(one[known], other[known], taken[known], strict=True):  # i grows
        if least[i] + leg < least[j]:
            least[j], before[j] = least[i] + leg, i
    chain = [len(poses) - 1]
    while chain[-1] > 0:
        chain.append(int(before[chain[-1]]))
    return poses[chain[::-1]]


def improved(poses: Array, times: Times, proof: Proof) -> Array:
    """A drive with its inner poses moved a little wherever that saves time and is clear."""
    poses = poses.copy()
    for step in _STEPS:
        for _ in range(2):
            before = poses.copy()
            for first in (1, 2):  # every other one at once
                i = np.arange(first, len(poses) - 1, 2)
                if len(i):
                    poses[i] = _better(poses[i - 1], poses[i], poses[i + 1], step, times, proof)
            if (poses == before).all():
                break
    return poses


def _better(
    before: Array, here: Array, after: Array, step_m: float, times: Times, proof: Proof
) -> Array:
    """Poses between two others each, moved to where most is saved of what is clear, (k, 3)."""
    nearer = moved(before, twists(before, after), np.full(len(here), 0.5)) - here
    nearer[:, 2] = wrapped(nearer[:, 2])
    shares = np.array([0.25, 0.5, 1.0])[:, None]
    moves = np.broadcast_to(step_m * _MOVES, (len(here), *_MOVES.shape))
    tried = here[:, None] + np.concatenate([moves, shares * nearer[:, None]], axis=1)
    ends = [np.broadcast_to(pose[:, None], tried.shape) for pose in (before, after)]
    taken = times(ends[0], tried) + times(tried, ends[1])
    order = np.argsort(taken, axis=1, kind="stable")[:, :_TRIED]
    now = times(before, here) + times(here, after)
    row, rank = np.nonzero(np.take_along_axis(taken, order, axis=1) < now[:, None] - _WORTH_S)
    some = tried[row, order[row, rank]]
    clear = _both_clear(before[row], some, after[row], proof)
    chosen = here.copy()
    for k in np.flatnonzero(clear)[::-1]:  # the best of each row is written last
        chosen[row[k]] = some[k]
    return chosen


def _both_clear(before: Array, some: Array, after: Array, proof: Proof) -> Bools:
    """True where the leg to a pose and the one after it are clear, (m,)."""
    to, on = np.split(proof(np.concatenate([before, some]), np.concatenate([some, after])), 2)
    return to & on


def by_one_pose(
    start: Array,
    goal: Array,
    free: Callable[[Array], Bools],
    times: Times,
    proof: Proof,
) -> Array | None:
    """The fastest clear drive by one of a few poses around the way from start to goal (3,)."""
    apart = float(np.hypot(*(goal - start)[:2])) + 0.1
    along = np.array([-0.5, -0.25, 0.0, 0.25, 0.5])
    turn = float(wrapped(goal[2] - start[2]))
    x, y, share = np.meshgrid(along, along, [0.0, 0.5, 1.0], indexing="ij")
    tried = np.stack([x * apart, y * apart, share * turn], axis=-1).reshape(-1, 3)
    tried += np.array([*(start + goal)[:2] / 2, start[2]])
    ends = [np.broadcast_to(pose, tried.shape) for pose in (start, goal)]
    taken = times(ends[0], tried) + times(tried, ends[1])
    order = np.argsort(taken, kind="stable")
    order = order[free(tried[order])][:_GUESSES]
    some = tried[order]
    clear = _both_clear(ends[0][order], some, ends[1][order], proof)
    return np.array([start, some[clear][0], goal]) if clear.any() else None


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
