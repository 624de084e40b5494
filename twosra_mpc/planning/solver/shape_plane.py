"""The plane of the shapes of two segments: where limits forbid them, and bends through them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.bending import bending
from twosra_mpc.model.cache import per_body
from twosra_mpc.planning.bounds.detours import COARSE, IMPOSSIBLE, UNCLEAR, Cells, joined
from twosra_mpc.problem.limits import levers_left, most_gaps_m, parts_moved_m
from twosra_mpc.problem.tolerances import BEYOND_PER_M, CERTAIN_END, CERTAIN_LEVER
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Body
from twosra_mpc.robot.modes import Mode

_CELLS = 160  # along the coarse plane
_ALONE = (1, 0), (0, 1)

Bools = NDArray[np.bool_]
Asked = Callable[[Array, Array], Bools]  # of corners of boxes, (m, 2): answers, (k, m)


class _Plane(NamedTuple):
    """Cells, and what is forbidden there.

    Attributes:
        edges: W of each segment at the edges of cells.
        overlaps: Whether parts overlap in all of its shapes, and in its middle, (2, n1, n2).
        lost: Of each segment, whether the wheels surely lose hold of it on the cell's lower edge,
            anywhere in it, and if it ends in it; and whether in its middle, (4, n1, n2).
    """

    edges: tuple[Array, ...]
    overlaps: Bools
    lost: list[Bools]


def cells_of(body: Body, fineness: int) -> Cells:
    """The plane of both W, cut so many times finer, and what bends cost there.

    What is forbidden is kept of a body, fine cells, of 100 MiB, go with the search that asks.
    """
    edges, (overlaps, touches), lost = _plane(body, fineness)
    costs: dict[Mode, list[Array]] = {(1, 1): [_cost(overlaps, touches)] * 3}
    for j, (mode, (edge, _, ended, unclear)) in enumerate(zip(_ALONE, lost, strict=True)):
        against = edges[j][:-1] > 0, edges[j][1:] < 0  # its spring
        up, down = (np.expand_dims(each, 1 - j) for each in against)
        costs[mode] = [
            _cost(overlaps | (edge & up), touches | (unclear & up)),
            _cost(overlaps | (np.roll(edge, -1, axis=j) & down), touches | (unclear & down)),
            _cost(overlaps | ended, touches | unclear),
        ]
    return joined(edges, costs)


def _cost(impossible: Bools, unclear: Bools) -> Array:
    return np.where(impossible, IMPOSSIBLE, np.where(_around(unclear), UNCLEAR, 0.0))


def _around(truth: Bools) -> Bools:
    """Where it is true, or beside that."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(truth, 1), (3, 3))
    return np.asarray(windows.any(axis=(2, 3)))


@per_body(2, bodies=2)  # 4 MiB each
def _plane(body: Body, fineness: int) -> _Plane:
    """Finer cells are asked about only where coarse ones do not tell, or beside others."""
    facts, most = bending(body), body.limits.curvature_per_m + BEYOND_PER_M
    most_w = [facts.coordinate(most, j) for j in range(2)]
    step = 2 * max(most_w) / _CELLS
    counts = [fineness * math.ceil(w / step) for w in most_w]
    edges = tuple(step / fineness * np.arange(-count, count + 1.0) for count in counts)
    kappa = [facts.curvature(w, j) for j, w in enumerate(edges)]
    low = np.stack(np.meshgrid(*(k[:-1] for k in kappa), indexing="ij"), axis=-1)
    high = np.stack(np.meshgrid(*(k[1:] for k in kappa), indexing="ij"), axis=-1)
    off_m = parts_moved_m(body, (high - low).max(axis=(0, 1)) / 2).max()

    def overlaps(low: Array, high: Array) -> Bools:
        gaps_m = most_gaps_m(body, (low + high) / 2)
        return np.array([gaps_m + off_m < 0, gaps_m < 0])

    def lost(j: int, low: Array, high: Array) -> Bools:
        middle, edge = (low + high) / 2, high.copy()
        edge[:, j] = low[:, j]
        in_middle = levers_left(body, j, middle, middle)[1]
        passed, ended = in_middle.copy(), in_middle.copy()
        some = in_middle < 0.0
        ended[some] = levers_left(body, j, low[some], high[some])[1]
        some &= ended >= -CERTAIN_LEVER
        passed[some] = levers_left(body, j, low[some], edge[some])[1]
        never = np.minimum(passed, ended) < -CERTAIN_LEVER
        return np.array([never, ended < -CERTAIN_LEVER, ended < -CERTAIN_END, in_middle < 0.0])

    asked: list[Asked] = [overlaps, partial(lost, 0), partial(lost, 1)]
    if fineness == COARSE:
        flat = low.reshape(-1, 2), high.reshape(-1, 2)
        found = [ask(*flat).reshape(-1, *low.shape[:2]) for ask in asked]
        return _Plane(edges, found[0], found[1:])
    coarse, found = _plane(body, COARSE), []
    known = [coarse.overlaps, *(each[[1, 1, 2, 3]] for each in coarse.lost)]  # of all in a cell
    for ask, of_cells in zip(asked, known, strict=True):
        finer = of_cells.repeat(fineness, axis=1).repeat(fineness, axis=2)
        near = of_cells.any(axis=0) & ~of_cells.all(axis=0)
        near |= _around(of_cells[-1]) & _around(~of_cells[-1])
        where = near.repeat(fineness, axis=0).repeat(fineness, axis=1)
        finer[:, where] = ask(low[where], high[where])
        found.append(finer)
    return _Plane(edges, found[0], found[1:])
