"""Graphs in NumPy alone, which is loaded anyhow: what hangs together, and least times."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.coordinates import Array

Indices = NDArray[np.int64]
_BAND = 5.0  # mean times of an edge by which nodes that are gone on from at once may differ


def components(size: int, edges: NDArray[np.integer[Any]]) -> Indices:
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
        self._band_s = _BAND * float(times_s.mean()) if len(times_s) else 0.0

    def least_times_s(self, nodes: Indices, times_s: Array) -> tuple[Array, Indices]:
        """Least times to every node, infinite without a way, and the node before it, (size,) each.

        Ways begin at ``nodes`` (k,), each at a time of its own, (k,). Where they begin,
        -1 is the node before.
        """
        least = np.full(len(self._first) - 1, np.inf)
        np.minimum.at(least, nodes, times_s)
        waiting = np.isfinite(least)
        while len(some := np.flatnonzero(waiting)):
            now = some[least[some] <= least[some].min() + self._band_s]
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
