"""Best-first branch and bound that knows nothing of robots.

The lower bound it reports stays honest when leaves are solved only locally: a leaf's local optimum
updates the incumbent, but the leaf's own bound remains in force, as do the bounds of nodes that a
depth limit keeps from being opened.
"""

from __future__ import annotations

import enum
import heapq
import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

Node = TypeVar("Node")
Solution = TypeVar("Solution")
Solution_co = TypeVar("Solution_co", covariant=True)


class Tree(Protocol[Node, Solution_co]):
    """What the search needs to know of a problem."""

    def root(self) -> Node:
        """Return the node above all leaves."""

    def bound(self, node: Node) -> float:
        """Lower bound on the cost of every leaf at or below ``node``; inf if there is none."""

    def children(self, node: Node) -> Iterable[Node] | None:
        """Return the children of ``node``; None if a depth limit forbids opening it."""

    def leaf_bound(self, node: Node) -> float:
        """Lower bound on the cost of ``node`` itself as a leaf; inf if it is none or infeasible."""

    def solve(self, node: Node, target: float) -> Iterable[tuple[float, Solution_co]]:
        """Yield solutions of the leaf ``node`` as they are found; cost ``target`` is enough."""


class Ending(enum.Enum):
    """Why a search ended."""

    CLOSED = "the incumbent is within the gap of the lower bound"
    EXHAUSTED = "nothing left to open can beat the incumbent"
    LIMIT = "a limit was reached"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class SearchResult(Generic[Solution]):
    """Outcome of a search.

    Attributes:
        ending: Why it ended.
        cost: Cost of the incumbent, an upper bound; inf without one.
        solution: The incumbent, or None.
        lower_bound: Proved lower bound on every leaf's cost; inf if proved infeasible.
        bounded: Leaves whose bound was computed.
        solved: Leaves handed to ``solve``.
    """

    ending: Ending
    cost: float
    solution: Solution | None
    lower_bound: float
    bounded: int
    solved: int


@dataclass(order=True)
class _Entry(Generic[Node]):
    """A node in the queue: to be solved as a leaf (preferred at equal bounds) or to be branched."""

    bound: float
    branch: bool
    order: int
    node: Node = field(compare=False)


def branch_and_bound(
    tree: Tree[Node, Solution],
    *,
    gap: float,
    out_of_time: Callable[[], bool],
    on_progress: Callable[[float, float], None],
) -> SearchResult[Solution]:
    """Search ``tree`` for a leaf within ``gap`` of the least possible cost.

    Args:
        tree: The problem.
        gap: Relative optimality gap (cost - lower bound) / cost to stop at.
        out_of_time: Asked before every node; True ends the search.
        on_progress: Told (incumbent cost, lower bound) before every node.
    """
    order = itertools.count()
    root = tree.root()
    queue: list[_Entry[Node]] = [_Entry(tree.bound(root), True, next(order), root)]
    kept = math.inf  # least bound of what is no longer in the queue but not disproved either
    best: tuple[float, Solution | None] = (math.inf, None)
    bounded = solved = 0

    def result(ending: Ending) -> SearchResult[Solution]:
        low = min(kept, queue[0].bound if queue else math.inf, best[0])
        return SearchResult(ending, best[0], best[1], low, bounded, solved)

    try:
        while queue and queue[0].bound < best[0] and math.isfinite(queue[0].bound):
            low = min(kept, queue[0].bound)
            on_progress(best[0], low)
            if best[0] - low <= gap * best[0] < math.inf:
                return result(Ending.CLOSED)
            if out_of_time():
                return result(Ending.LIMIT)
            entry = queue[0]
            if entry.branch:  # the entry stays in the queue until all that follows it is known
                opened: list[_Entry[Node]] = []
                children = tree.children(entry.node)
                leaf_bound = tree.leaf_bound(entry.node)
                if math.isfinite(leaf_bound):
                    bounded += 1
                    bound = max(leaf_bound, entry.bound)
                    opened.append(_Entry(bound, False, next(order), entry.node))
                for child in children or ():
                    bound = max(tree.bound(child), entry.bound)
                    opened.append(_Entry(bound, True, next(order), child))
                for one in opened:
                    heapq.heappush(queue, one)
                kept = min(kept, entry.bound) if children is None else kept
                queue.remove(entry)
                heapq.heapify(queue)
            else:
                for found in tree.solve(entry.node, entry.bound / (1 - gap)):
                    best = min(best, found, key=lambda one: one[0])
                heapq.heappop(queue)
                kept = min(kept, entry.bound)
                solved += 1
    except KeyboardInterrupt:
        return result(Ending.INTERRUPTED)
    closed = best[0] - min(kept, best[0]) <= gap * best[0] < math.inf
    return result(Ending.CLOSED if closed else Ending.EXHAUSTED)
