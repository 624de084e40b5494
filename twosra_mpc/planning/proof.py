"""Make certificates: which mode sequences must be opened to prove a lower bound.

The checker itself bounds the sequences, so what is claimed here is what it will find.
"""

from __future__ import annotations

import heapq
from typing import Any

from twosra_mpc.checking.certificate import Checker, check
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import ModeSequence

_MOST = 3000  # sequences opened


class Prover:
    """Makes certificates of one problem.

    Raises:
        InputError: If problems of this kind have no proof.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._checker = problem, Checker(problem)

    def certificate(self, target_s: float) -> dict[str, Any]:
        """Prove that no plan costs less than ``target_s``, or than as much of it as can be proved.

        Best first: as long as the least bound is that of a sequence not yet opened, it is opened.

        Args:
            target_s: The lower bound to prove [s]; what is proved may be a little more.

        Returns:
            Plain data: ``opened``, the sequences to open, and ``bound_s``, what that proves.
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
                heapq.heappush(queue, (checker.leaf_bound(sequence), True, sequence))
            for child in checker.children(node):
                heapq.heappush(queue, (max(bound, checker.node_bound(child)), False, child))
        made = {"opened": [[list(mode) for mode in node] for node in sorted(opened)]}
        return {"bound_s": check(self._problem, made).bound, **made}
