"""Graphs: what hangs together and least times are those of SciPy, and ways add up to them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from twosra_mpc.checking.holds import _leads_away
from twosra_mpc.space.roadmap import Graph
from twosra_mpc.space.slices import components


@pytest.mark.parametrize(("size", "count"), [(1, 0), (40, 0), (40, 25), (300, 290), (300, 2000)])
def test_least_times_are_those_of_dijkstra(size: int, count: int) -> None:
    rng = np.random.default_rng(size + count)
    edges = np.unique(np.sort(rng.integers(0, size, (count, 2)), axis=1), axis=0)
    edges = edges[edges[:, 0] < edges[:, 1]]
    times = rng.exponential(1.0, len(edges)) + 1e-9
    begin = rng.choice(size, min(size, 3), replace=False)
    begin_s = rng.uniform(0, 5, len(begin))
    ends = np.vstack([edges, np.column_stack([np.full(len(begin), size), begin])])
    graph = csr_array((np.append(times, begin_s), tuple(ends.T)), shape=(size + 1, size + 1))
    wanted = dijkstra(graph, directed=False, indices=size)[:-1]
    least, before = Graph(size, edges, times).least_times_s(begin, begin_s)
    assert (least == wanted).all()
    one = {(a, b): t for (a, b), t in zip(edges.tolist(), times.tolist(), strict=True)}
    for node, last in enumerate(before.tolist()):
        if last >= 0:
            assert least[node] == least[last] + one[min(node, last), max(node, last)]
        else:
            assert least[node] == np.inf or node in begin
    _, own = connected_components(graph[:-1, :-1], directed=False)
    found = components(size, edges)
    assert len({*zip(own.tolist(), found.tolist(), strict=True)}) == own.max() + 1
    assert found.max() == own.max()


@pytest.mark.parametrize("headings", [1, 2, 7])
def test_boxes_lead_away_where_a_flood_gets_to_the_edge(headings: int) -> None:
    rng = np.random.default_rng(headings)
    seen = set()
    for share in np.linspace(0.3, 0.7, 40):
        free = rng.random((headings, 15, 15)) < share
        free[0, 7, 7] = True
        places, _ = label(np.concatenate([free] * 4))  # four turns are as good as no end
        own = np.unique(places[headings::headings, 7, 7])
        edge = np.zeros((15, 15), dtype=bool)
        edge[[0, -1]] = edge[:, [0, -1]] = True
        wanted = np.isin(places[:, edge], own[own > 0]).any()
        assert _leads_away(free.copy().__getitem__, headings) == wanted
        seen.add(bool(wanted))
    assert seen == {False, True}
