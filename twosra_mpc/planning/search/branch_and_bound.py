"""Best-first branch and bound that knows nothing of robots.

The lower bound it reports stays honest when leaves are solved only locally: a leaf's local optimum
updates the incumbent, but the leaf's own bound remains in force, as do the bounds of nodes that a
depth limit keeps from being opened. A leaf that costs less than its own bound is an error.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

from twosra_mpc.effort import Ending, OutOfEffortError, spent
from twosra_mpc.errors import ContradictionError
from twosra_mpc.interrupts import noted_interrupts
from twosra_mpc.problem.tolerances import forgiven

Node = TypeVar("Node")
Solution = TypeVar("Solution")
Solution_co = TypeVar("Solution_co", covariant=True)

_TRIED = 16  # steps without a solution as which a leaf without one counts
_ALIKE = 0.5  # of costs: bounds that are no farther apart are as good


class Tree(Protocol[Node, Solution_co]):
    """What the search needs to know of a problem."""

    def root(self) -> Node:
        """Return the node above all leaves."""

    def bound(self, node: Node) -> float:
        """Lower bound on the cost of every leaf at or below ``node``; inf if there is none."""

    def children(self, node: Node) -> Iterable[Node]:
        """Return the children of ``node``."""

    def too_deep(self, node: Node) -> bool:
        """True if a depth limit forbids opening ``node``, although there may be leaves below."""

    def leaf_bound(self, node: Node) -> float:
        """Lower bound on the cost of ``node`` itself as a leaf; inf if it is none or infeasible."""

    def tighter_bound(self, node: Node, enough: float) -> float:
        """Another lower bound on the cost of the leaf ``node``, with more effort."""

    def solve(self, node: Node) -> Iterable[tuple[float, Solution_co] | None]:
        """Yield (cost, solution) of one attempt at the leaf ``node`` after the other."""


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
        first_work: Work until the first solution [units]; inf without one.
    """

    ending: Ending
    cost: float
    solution: Solution | None
    lower_bound: float
    bounded: int
    solved: int
    first_work: float = math.inf


@dataclass(order=True)
class _Entry(Generic[Node, Solution]):
    """A node in the queue: to be solved as a leaf (preferred at equal bounds) or to be branched.

    A leaf goes back into the queue after every attempt to solve it, once with a tighter bound.
    """

    bound: float
    branch: bool
    order: int
    node: Node = field(compare=False)
    attempts: Iterator[tuple[float, Solution] | None] | None = field(default=None, compare=False)
    found: float = field(default=math.inf, compare=False)  # least cost of its attempts
    tight: bool = field(default=False, compare=False)
    done: bool = field(default=False, compare=False)


def branch_and_bound(
    tree: Tree[Node, Solution],
    *,
    gap: float,
    out_of_time: Callable[[], bool],
    on_progress: Callable[[float, float], None],
    incumbent: Callable[[], Iterable[tuple[float, Solution] | None]] = tuple,
    look: Callable[[], tuple[float, Solution] | None] = lambda: None,
    patience: int = 64,
    proved: Callable[[float], float] = lambda bound: bound,
    confirm: Callable[[SearchResult[Solution]], SearchResult[Solution] | None] = lambda made: made,
    worth: float = 0.0,
    known: float = math.inf,
) -> SearchResult[Solution]:
    """Search ``tree`` for a leaf within ``gap`` of the least possible cost.

    Args:
        tree: The problem.
        gap: Relative optimality gap (cost - lower bound) / cost to stop at.
        out_of_time: Asked before every node; True ends the search.
        on_progress: Told (incumbent cost, lower bound) before every node.
        incumbent: Finds (cost, solution) of a leaf that is cheap to try, again and again as long as
            it is better; asked first.
        look: Finds (cost, solution) of a leaf, if it can.
        patience: Steps without a solution until ``look`` is asked.
        proved: What the least bound of the tree proves of all solutions.
        confirm: Makes of an outcome with a solution what is returned; None where that is none
            after all: then the search goes on, with the incumbent before it.
        worth: What is cheaper by no more than this is not looked for, either.
        known: Cost of a solution that is known elsewhere, the first incumbent.

    Raises:
        ContradictionError: If a leaf costs less than its bound: the tree's bounds are wrong.
    """
    search = _Search(tree, gap, proved, [lambda: (look(),), incumbent], worth, patience)
    if known < math.inf:
        search.looks, search.incumbents = [], [(known, None)]
    while True:
        found = search.result(_run(search, out_of_time, on_progress))
        confirmed = found if found.solution is None else confirm(found)
        if confirmed is not None:
            return confirmed
        search.reject()


def _run(
    search: _Search[Node, Solution],
    out_of_time: Callable[[], bool],
    on_progress: Callable[[float, float], None],
) -> Ending:
    """Go on until the incumbent is within the gap, or nothing is left, or it has to stop."""
    with noted_interrupts() as interrupts:
        try:
            if len(search.looks) > 1:
                search.look()
            while search.queue and search.queue[0].bound < search.cost:
                if interrupts.requested:
                    break
                tried = search.steps + _TRIED * search.solved
                if not search.incumbents and tried > search.patience:
                    search.look()
                on_progress(search.cost, low := search.lower_bound)
                if search.enough <= low:
                    break
                if out_of_time():
                    return Ending.LIMIT
                search.step()
        except OutOfEffortError:
            return Ending.LIMIT
        except KeyboardInterrupt:
            interrupts.request()
        except Exception:  # of which some are interrupts that a library made something else of
            if not interrupts.requested:
                raise
    if interrupts.requested:
        return Ending.INTERRUPTED
    return Ending.CLOSED if search.enough <= search.lower_bound else Ending.EXHAUSTED


def dive(
    tree: Tree[Node, Solution],
    children: Callable[[Node], Iterable[Node]],
    *,
    width: int,
    attempts: int,
    tries: int,
    out_of_time: Callable[[], bool],
) -> Iterator[tuple[float, Solution]]:
    """Look for incumbents: the best few nodes of each level, down to leaves.

    Of nodes with about the same bound those that come earlier among their siblings are preferred.

    Args:
        tree: The problem.
        children: Nodes of the next level, such that all leaves are at the same depth.
        width: Nodes of a level that are opened.
        attempts: Leaves that are tried.
        tries: Attempts at each of them.
        out_of_time: Asked before every attempt; True ends it.
    """
    nodes, level = [tree.root()], list[tuple[float, int, Node]]()
    while nodes:
        found = [
            (round(bound / _ALIKE), place, child)
            for node in nodes
            for place, child in enumerate(children(node))
            if (bound := tree.bound(child)) < math.inf
        ]
        if not found:
            break
        level = sorted(found, key=lambda each: each[:2])
        nodes = [node for *_, node in level[:width]]
    for _, _, leaf in level:
        if out_of_time() or not attempts:
            return
        if (bound := tree.leaf_bound(leaf)) < math.inf:
            attempts -= 1
            several = itertools.islice(tree.solve(leaf), tries)
            solved = next((each for each in several if each is not None), None)
            if solved is not None:
                _check(solved[0], max(bound, tree.bound(leaf)))
                yield solved


def _check(cost: float, bound: float) -> None:
    """Raise if a leaf that was found at this cost has a higher bound."""
    if cost < forgiven(bound):
        raise ContradictionError(cost, bound)


class _Search(Generic[Node, Solution]):
    """State of a search; an entry stays in the queue until all that follows from it is known."""

    def __init__(
        self,
        tree: Tree[Node, Solution],
        gap: float,
        proved: Callable[[float], float],
        looks: list[Callable[[], Iterable[tuple[float, Solution] | None]]],
        worth: float,
        patience: int,
    ) -> None:
        self.tree, self.gap, self.proved, self.looks = tree, gap, proved, looks
        self.worth, self.patience = worth, patience
        self.order = itertools.count()
        root = tree.root()
        self.queue: list[_Entry[Node, Solution]] = [
            _Entry(tree.bound(root), True, next(self.order), root)
        ]
        self.kept = math.inf  # least bound of what left the queue without being disproved
        self.failed: list[_Entry[Node, Solution]] = []  # leaves without luck; tightened later
        # Each cheaper than those before it.
        self.incumbents: list[tuple[float, Solution | None]] = []
        self.first_work = math.inf
        self.bounded = self.solved = self.steps = 0
        self.learnt = False  # whether a bound was tightened, and others may be too

    @property
    def cost(self) -> float:
        """Cost of the incumbent; inf without one."""
        return self.incumbents[-1][0] if self.incumbents else math.inf

    @property
    def lower_bound(self) -> float:
        """Proved lower bound on every leaf's cost."""
        waiting = (each.bound for each in (*self.queue[:1], *self.failed))
        return min(self.proved(min([self.kept, *waiting])), self.cost)

    @property
    def enough(self) -> float:
        """Lower bound at which the incumbent is good enough; NaN without one."""
        cost = self.cost
        return math.nan if cost == math.inf else cost - max(self.gap * cost, self.worth)

    def result(self, ending: Ending) -> SearchResult[Solution]:
        """Sum up."""
        low, solution = self.lower_bound, self.incumbents[-1][1] if self.incumbents else None
        counts = self.bounded, self.solved, self.first_work
        return SearchResult(ending, self.cost, solution, low, *counts)

    def look(self) -> None:
        """Look for an incumbent in the next way that was not used yet."""
        for found in self.looks.pop()() if self.looks else ():
            if found is not None and found[0] < self.cost:
                self.accept(*found)

    def accept(self, cost: float, solution: Solution) -> None:
        """Make a solution the incumbent."""
        self.incumbents.append((cost, solution))
        while self.failed:
            heapq.heappush(self.queue, self.failed.pop())
        self.first_work = min(self.first_work, spent())

    def reject(self) -> None:
        """Return to the incumbent before the last one, which is none."""
        self.incumbents.pop()
        self.first_work = self.first_work if self.incumbents else math.inf

    def step(self) -> None:
        """Work on the entry with the least bound, and raise the next to what is known by now."""
        self.steps += 1
        if not (entry := self._next()).branch:
            self._attempt(entry)
        elif self.tree.too_deep(entry.node):
            self.kept, entry.done = min(self.kept, entry.bound), True
        else:
            self._branch(entry)
        while self.queue:
            first = self.queue[0]
            bound = self.tree.bound(first.node) if self.learnt else -math.inf
            if first.done:
                heapq.heappop(self.queue)
            elif bound > first.bound:
                heapq.heapreplace(self.queue, replace(first, bound=bound))
            else:
                break

    def _next(self) -> _Entry[Node, Solution]:
        """The entry with the least bound; before a leaf without luck one that is as good.

        That is within the gap of it, and first attempts cost least: it may be all that it takes.
        """
        first = self.queue[0]
        if self.incumbents or first.attempts is None:
            return first
        most = first.bound / (1 - self.gap)
        fresh = (each for each in self.queue if each.attempts is None and not each.done)
        return min((each for each in fresh if each.bound <= most), default=first)

    def _branch(self, entry: _Entry[Node, Solution]) -> None:
        """Put the node's own leaf and its children in its place."""
        tree, node, opened = self.tree, entry.node, list[_Entry[Node, Solution]]()
        leaf_bound = tree.leaf_bound(node)
        if math.isfinite(leaf_bound):
            self.bounded += 1
            self.learnt |= tree.bound(node) > entry.bound
            bound = max(leaf_bound, entry.bound)
            opened.append(_Entry(bound, False, next(self.order), node))
        for child in tree.children(node):
            if (bound := max(tree.bound(child), entry.bound)) < math.inf:
                opened.append(_Entry(bound, True, next(self.order), child))
        for one in opened:
            heapq.heappush(self.queue, one)
        entry.done = True

    def _attempt(self, entry: _Entry[Node, Solution]) -> None:
        """Try once to solve a leaf; then tighten its bound, if that is of use and not yet done."""
        attempts, bound, tight = entry.attempts, entry.bound, entry.tight
        if attempts is None:
            attempts = iter(self.tree.solve(entry.node))
            self.solved += 1
        try:
            found = next(attempts)
        except StopIteration:  # what was learnt while it was tried may rule it out
            bound = max(bound, self.tree.leaf_bound(entry.node))
            _check(entry.found, bound)
            entry.done = True
            if not self.incumbents and bound < math.inf:  # how tight is tight enough is not known
                self.failed.append(replace(entry, bound=bound, attempts=attempts, done=False))
                return
            self.kept = min(self.kept, bound if tight else self._tighter(entry, bound))
            return
        least = entry.found if found is None else min(entry.found, found[0])
        if found is None:  # as may what was learnt by this attempt
            bound = max(bound, self.tree.leaf_bound(entry.node))
        elif found[0] < self.cost:
            self.accept(*found)
        again = found is None and entry.attempts is None  # a second attempt may cost less
        if not tight and bound < self.enough and not again:
            bound, tight = self._tighter(entry, bound), True
        _check(least, bound)
        worked = replace(entry, bound=bound, attempts=attempts, found=least, tight=tight)
        heapq.heappush(self.queue, worked)
        entry.done = True

    def _tighter(self, entry: _Entry[Node, Solution], bound: float) -> float:
        """A tighter bound of a leaf, if that is of use."""
        if not bound < self.enough:
            return bound
        tighter = self.tree.tighter_bound(entry.node, self.enough)
        self.learnt |= tighter > bound
        return max(bound, tighter)
