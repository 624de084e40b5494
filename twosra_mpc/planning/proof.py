"""Make certificates: which mode sequences must be opened to prove a bound, and at what prices.

The checker itself bounds the sequences, so what is claimed here is what it will find.
"""

from __future__ import annotations

import heapq
import itertools
import math
from contextlib import suppress
from typing import Any

import numpy as np

from twosra_mpc.checking.certificate import Checker, Leaf, Prices, check, joined
from twosra_mpc.checking.events import ORIGIN
from twosra_mpc.checking.legs import in_any_order
from twosra_mpc.effort import Cost, OutOfEffortError, charge, limited, out_of_effort
from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.robot.modes import ModeSequence

_MOST = 3000  # sequences opened
_DIGITS = 10  # of prices
_TANGENTS = np.geomspace(1e-5, 4.0, 30)  # slopes of effort over duration


class Prover:
    """Makes certificates of one problem.

    Raises:
        InputError: If problems of this kind have no proof.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._checkers = problem, list(map(Checker, in_any_order(problem)))
        self._prices: dict[ModeSequence, Prices] = {}

    def certificate(self, target_s: float) -> dict[str, Any]:
        """Prove that no plan costs less than ``target_s``, or than as much of it as can be proved.

        Best first: as long as the least bound is that of a sequence not yet opened, it is opened.
        Whatever is opened proves something: it may take the problem's ``work_limit``.

        Args:
            target_s: The lower bound to prove [s]; what is proved may be a little more.

        Returns:
            Plain data: ``opened``, the sequences to open; ``priced``, the leaves that need prices;
            ``bound_s``, what that proves; and ``target_s``.
        """
        problem, opened, numbers = self._problem, set[ModeSequence](), itertools.count()
        roots = [(checker, checker.root()) for checker in self._checkers]
        queue = [(at.node_bound(root), next(numbers), False, root, at) for at, root in roots]
        heapq.heapify(queue)
        with suppress(OutOfEffortError), limited(problem.work_limit, problem.time_limit_s):
            while len(opened) < _MOST and not out_of_effort():
                bound, _, leaf, node, at = heapq.heappop(queue)
                if leaf or forgiven(bound, problem.replay_tolerance) >= target_s:
                    break
                opened.add(node)
                if (sequence := at.leaf(node)) is not None:
                    least = max(bound, self._leaf_bound(at, sequence, target_s))
                    heapq.heappush(queue, (least, next(numbers), True, sequence, at))
                for child in at.children(node):
                    charge(Cost.PROOF)
                    least = max(bound, at.node_bound(child))
                    heapq.heappush(queue, (least, next(numbers), False, child, at))
        made: dict[str, Any] = {"opened": [_listed(node) for node in sorted(opened)]}
        if self._prices:
            made["priced"] = [
                {"sequence": _listed(leaf), **prices._asdict()}
                for leaf, prices in sorted(self._prices.items())
            ]
        return {"bound_s": check(problem, made).bound, "target_s": target_s, **made}

    def _leaf_bound(self, checker: Checker, sequence: ModeSequence, enough_s: float) -> float:
        """Bound of a leaf; where that is not enough, with the best prices."""
        bound, leaf = checker.leaf_bound(sequence), checker.timed(sequence)
        enough = forgiven(bound, self._problem.replay_tolerance) >= enough_s
        if leaf is None or enough or not any(map(any, sequence)):
            return bound
        prices = _Program(checker, sequence, leaf).prices()
        if (priced := checker.leaf_bound(sequence, prices)) > bound:
            self._prices[sequence] = prices
        return max(bound, priced)


class _Program:
    """The linear program of a leaf: event times, changes of W, efforts, and what limits them.

    Columns: events, the change of W in each phase, the effort of each phase, and by how much the
    limits of W are missed.
    """

    def __init__(self, checker: Checker, node: ModeSequence, leaf: Leaf) -> None:
        (least, network), sequence = leaf, joined(node)
        self._network = network
        self._events = {
            e: i for i, e in enumerate({e: 0 for edge in network.edges for e in edge[:2]})
        }
        self._efforts = [float(one.effort) for one in least]
        self._shape = len(sequence), len(checker.origin)
        self._first = len(self._events)
        self._width = self._first + 2 * len(sequence) + 1
        self._rows, self._limits = list[np.ndarray[Any, Any]](), list[float]()
        for u, v, apart in network.edges:
            self._at_least({self._events[v]: 1.0, self._events[u]: -1.0}, float(apart))
        for sign, (i, sums) in itertools.product((1.0, -1.0), enumerate(checker.sums(node))):
            for j, total in enumerate(sums):
                bends = {self._first + k: sign * sequence[k][j] for k in range(i + 1)}
                limit = float(total.lower()) if sign > 0 else -float(total.upper())
                self._at_least({**bends, self._width - 1: 1.0}, limit)
        for i, mode in enumerate(sequence):
            fastest = float(checker.fastest(sequence, i)) if any(mode) else math.inf
            for sign in (1.0, -1.0) if math.isfinite(fastest) else ():
                self._at_least({**self._duration(i, fastest), self._first + i: sign}, 0.0)
        self._cost = np.zeros(self._width)
        self._cost[self._events[network.finish]] += 1.0
        for u, v, price in network.holds:
            self._cost[self._events[v]] += float(price)
            self._cost[self._events[u]] -= float(price)
        self._cost[self._first + len(sequence) : -1] = checker.problem.cost_weights.effort

    def _at_least(self, terms: dict[int, float], limit: float) -> None:
        row = np.zeros(self._width)
        for column, factor in terms.items():
            row[column] -= factor
        self._rows.append(row)
        self._limits.append(-limit)

    def _duration(self, phase: int, factor: float) -> dict[int, float]:
        start, end = self._events["start", phase, 0, 0], self._events["end", phase, 0, 0]
        return {end: factor, start: -factor}

    def _solved(
        self, slopes: list[list[float]]
    ) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        """Optimum and multipliers, with these tangents of effort over duration.

        Where there is no solution, those of the program that misses the limits by the least.
        """
        known, bounds = len(self._rows), list[tuple[float | None, float | None]]()
        for i, (effort, steep) in enumerate(zip(self._efforts, slopes, strict=True)):
            for slope in steep:
                column = self._first + self._shape[0] + i
                self._at_least(
                    {**self._duration(i, slope), column: 1.0}, 2 * math.sqrt(slope * effort)
                )
        bounds = [(0.0, None)] * self._first + [(None, None)] * self._shape[0]
        bounds += [(0.0, None)] * self._shape[0]
        bounds[self._events[ORIGIN]] = (0.0, 0.0)
        missed = np.eye(self._width)[-1]
        for cost, most in ((self._cost, 0.0), (missed, None)):
            rows, limits = np.array(self._rows), np.array(self._limits)
            if (solved := minimise(cost, rows, limits, [*bounds, (0.0, most)])) is not None:
                break
        assert solved is not None, "limits can always be missed"
        del self._rows[known:], self._limits[known:]
        return solved.x, -solved.marginals

    def prices(self) -> Prices:
        """The best multipliers, rounded."""
        phases, segments = self._shape
        slopes = [0.0] * phases
        if self._cost[-2] > 0:
            x, _ = self._solved([list(_TANGENTS) if effort else [] for effort in self._efforts])
            for i, effort in enumerate(self._efforts):
                duration = sum(x[column] * sign for column, sign in self._duration(i, 1.0).items())
                slopes[i] = float(effort / duration**2) if effort and duration > 0 else 0.0
        _, y = self._solved([[slope] if slope else [] for slope in slopes])
        y = np.round(y, _DIGITS) + 0.0
        edges, shaped = len(self._network.edges), phases * segments
        up, down = y[edges : edges + shaped], y[edges + shaped : edges + 2 * shaped]
        bends = (up - down).reshape(phases, segments)
        return Prices(bends.tolist(), y[:edges].tolist(), slopes)


def _listed(sequence: ModeSequence) -> list[list[int]]:
    return [list(mode) for mode in sequence]
