"""Make certificates: which mode sequences must be opened to prove a bound, and at what prices.

The checker itself bounds the sequences, so what is claimed here is what it will find.
"""

from __future__ import annotations

import heapq
import itertools
import math
from typing import Any

import numpy as np
from scipy.optimize import linprog

from twosra_mpc.checking.certificate import Checker, Prices, check
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import ModeSequence

_MOST = 3000  # sequences opened
_DIGITS = 10  # of prices


class Prover:
    """Makes certificates of one problem.

    Raises:
        InputError: If problems of this kind have no proof.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._checker = problem, Checker(problem)
        self._prices: dict[ModeSequence, Prices] = {}

    def certificate(self, target_s: float) -> dict[str, Any]:
        """Prove that no plan costs less than ``target_s``, or than as much of it as can be proved.

        Best first: as long as the least bound is that of a sequence not yet opened, it is opened.

        Args:
            target_s: The lower bound to prove [s]; what is proved may be a little more.

        Returns:
            Plain data: ``opened``, the sequences to open; ``priced``, the leaves that need prices;
            and ``bound_s``, what that proves.
        """
        checker, opened = self._checker, list[ModeSequence]()
        root = checker.root()
        queue = [(checker.node_bound(root), False, root)]
        while len(opened) < _MOST:
            bound, leaf, node = heapq.heappop(queue)
            if leaf or bound >= target_s:
                break
            opened.append(node)
            if (sequence := checker.leaf(node)) is not None:
                heapq.heappush(queue, (self._leaf_bound(sequence, target_s), True, sequence))
            for child in checker.children(node):
                heapq.heappush(queue, (max(bound, checker.node_bound(child)), False, child))
        made: dict[str, Any] = {"opened": [_listed(node) for node in sorted(opened)]}
        if self._prices:
            made["priced"] = [
                {"sequence": _listed(leaf), **prices._asdict()}
                for leaf, prices in sorted(self._prices.items())
            ]
        return {"bound_s": check(self._problem, made).bound, **made}

    def _leaf_bound(self, sequence: ModeSequence, enough_s: float) -> float:
        """Bound of a leaf; where that is not enough, with the best prices."""
        bound = self._checker.leaf_bound(sequence)
        if bound >= enough_s or not any(map(any, sequence)):
            return bound
        prices = _best_prices(self._checker, sequence)
        if (priced := self._checker.leaf_bound(sequence, prices)) > bound:
            self._prices[sequence] = prices
        return max(bound, priced)


def _best_prices(checker: Checker, sequence: ModeSequence) -> Prices:
    """Multipliers of the linear program of a leaf: event times, changes of W, and what limits them.

    Where it has no solution, those of the program that makes the limits of W as wide as is needed.
    """
    least = checker.least_durations(sequence) or []
    network = checker.network(sequence, least)
    events = {
        event: i for i, event in enumerate({e: 0 for u, v, _ in network.edges for e in (u, v)})
    }
    phases = [i for i, mode in enumerate(sequence) if any(mode)]
    count = len(events) + len(sequence) + 1  # times, changes of W, and what the limits miss
    rows, limits = list[np.ndarray[Any, Any]](), list[float]()

    def at_least(terms: dict[int, float], limit: float) -> None:
        row = np.zeros(count)
        for column, factor in terms.items():
            row[column] -= factor
        rows.append(row)
        limits.append(-limit)

    for u, v, apart in network.edges:
        at_least({events[v]: 1.0, events[u]: -1.0}, float(apart))
    for sign, (i, sums) in itertools.product((1.0, -1.0), enumerate(checker.sums(sequence))):
        for j, total in enumerate(sums):
            changes = {len(events) + k: sign * sequence[k][j] for k in range(i + 1)}
            limit = float(total.lower()) if sign > 0 else -float(total.upper())
            at_least({**changes, count - 1: 1.0}, limit)
    for sign, i in itertools.product((1.0, -1.0), phases):
        start, end, fastest = (
            ("start", i, 0, 0),
            ("end", i, 0, 0),
            float(checker.fastest(sequence, i)),
        )
        if math.isfinite(fastest):
            at_least({events[end]: fastest, events[start]: -fastest, len(events) + i: sign}, 0.0)
    cost = np.zeros(count)
    cost[events[network.finish]] += 1.0
    for u, v, price in network.holds:
        cost[events[v]] += float(price)
        cost[events[u]] -= float(price)
    bounds: list[tuple[float | None, float | None]] = [(0.0, None)] * len(events)
    bounds += [(None, None)] * len(sequence)
    bounds[events["origin", 0, 0, 0]] = (0.0, 0.0)
    for objective, missed in ((cost, 0.0), (np.eye(count)[-1], None)):
        solved = linprog(objective, np.array(rows), limits, bounds=[*bounds, (0.0, missed)])
        if solved.status == 0:
            break
    y = np.round(-np.asarray(solved.ineqlin.marginals), _DIGITS) + 0.0
    edges, shaped = len(network.edges), len(sequence) * len(checker.change)
    up, down = y[edges : edges + shaped], y[edges + shaped : edges + 2 * shaped]
    bends = (up - down).reshape(len(sequence), -1)
    return Prices(bends.tolist(), y[:edges].tolist())


def _listed(sequence: ModeSequence) -> list[list[int]]:
    return [list(mode) for mode in sequence]
