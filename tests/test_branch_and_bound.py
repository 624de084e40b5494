"""Branch and bound on random trees: same optimum as brute force, and bounds that never lie."""

from __future__ import annotations

import contextlib
import math
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twosra_mpc.effort import Ending
from twosra_mpc.errors import ContradictionError
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound, dive

Path = tuple[int, ...]


@dataclass
class RandomTree:
    """A tree whose leaves cost ``costs``; bounds are costs less a non-negative slack.

    ``found`` is what solving a leaf returns: never less than its cost, None where solving fails.
    ``tighter`` is the slack that is left of a leaf's bound with more effort.
    """

    costs: dict[Path, float]
    slack: dict[Path, float]
    found: dict[Path, float | None]
    depth: int
    tighter: dict[Path, float] = field(default_factory=dict)
    solved: list[Path] = field(default_factory=list)
    tried: list[float] = field(default_factory=list)

    def root(self) -> Path:
        return ()

    def _below(self, node: Path) -> list[float]:
        return [cost for path, cost in self.costs.items() if path[: len(node)] == node]

    def bound(self, node: Path) -> float:
        return min(self._below(node), default=math.inf) - self.slack.get(node, 0.0)

    def children(self, node: Path) -> list[Path]:
        return [child for i in range(3) if self._below(child := (*node, i))]

    def too_deep(self, node: Path) -> bool:
        return len(node) > self.depth

    def tighter_bound(self, node: Path, enough: float) -> float:
        assert enough < math.inf
        return self.costs[node] - self.tighter.get(node, math.inf)

    def leaf_bound(self, node: Path) -> float:
        return self.costs.get(node, math.inf) - self.slack.get(node, 0.0)

    def solve(self, node: Path) -> Iterator[tuple[float, Path] | None]:
        self.solved.append(node)
        value = self.found[node]
        for attempt in (None, None) if value is None else (value + 1.0, value):
            self.tried.append(math.inf if attempt is None else attempt)
            yield None if attempt is None else (attempt, node)


PATHS = st.lists(st.integers(0, 2), max_size=3).map(tuple)
COSTS = st.dictionaries(PATHS, st.floats(1.0, 100.0), min_size=1, max_size=25)


def search(tree: RandomTree, gap: float = 0.0, patience: int = 10**9) -> SearchResult[Path]:
    asked = iter(range(10**9))
    return branch_and_bound(
        tree,
        gap=gap,
        out_of_time=lambda: next(asked) >= patience,
        on_progress=lambda cost, low: None,
    )


def exact(costs: dict[Path, float], slack: dict[Path, float], depth: int = 3) -> RandomTree:
    return RandomTree(costs, slack, dict(costs), depth)


@given(costs=COSTS)
def test_tight_bounds_give_the_brute_force_optimum_and_solve_one_leaf(
    costs: dict[Path, float],
) -> None:
    tree = exact(costs, {})
    result = search(tree)
    assert result.cost == result.lower_bound == min(costs.values())
    assert result.ending is Ending.CLOSED
    assert len(tree.solved) == result.solved == 1


@given(
    costs=COSTS,
    slack=st.dictionaries(PATHS, st.floats(0.0, 30.0)),
    tighter=st.dictionaries(PATHS, st.floats(0.0, 10.0)),
    gap=st.sampled_from([0.0, 0.05, 0.3]),
)
def test_cost_is_the_optimum_or_within_the_gap_and_the_bound_is_below_the_optimum(
    costs: dict[Path, float], slack: dict[Path, float], tighter: dict[Path, float], gap: float
) -> None:
    result = search(RandomTree(costs, slack, dict(costs), 3, tighter), gap)
    optimum = min(costs.values())
    assert result.lower_bound <= optimum <= result.cost
    if result.ending is Ending.CLOSED:
        assert result.cost - result.lower_bound <= gap * result.cost + 1e-12
    else:
        assert result.ending is Ending.EXHAUSTED
        assert result.cost == optimum


@given(
    costs=COSTS,
    slack=st.dictionaries(PATHS, st.floats(0.0, 30.0)),
    excess=st.dictionaries(PATHS, st.one_of(st.none(), st.floats(0.0, 50.0))),
    tighter=st.dictionaries(PATHS, st.floats(0.0, 10.0)),
    depth=st.integers(0, 3),
    patience=st.integers(0, 20),
)
def test_the_bound_stays_valid_with_local_solves_depth_limits_and_time_limits(
    costs: dict[Path, float],
    slack: dict[Path, float],
    excess: dict[Path, float | None],
    tighter: dict[Path, float],
    depth: int,
    patience: int,
) -> None:
    found: dict[Path, float | None] = {}
    for path, cost in costs.items():
        extra = excess.get(path, 0.0)
        found[path] = None if extra is None else cost + extra
    tree = RandomTree(costs, slack, found, depth, tighter)
    result = search(tree, patience=patience)
    assert result.lower_bound <= min(costs.values())
    assert result.cost == min(tree.tried, default=math.inf)
    assert (result.solution is None) == (result.cost == math.inf)


@given(costs=COSTS, wrong=st.sets(PATHS, max_size=10))
def test_the_best_is_found_of_the_solutions_that_are_confirmed(
    costs: dict[Path, float], wrong: set[Path]
) -> None:
    result = branch_and_bound(
        exact(costs, {}),
        gap=0.0,
        out_of_time=lambda: False,
        on_progress=lambda cost, low: None,
        confirm=lambda found: None if found.solution in wrong else found,
    )
    right = [cost for path, cost in costs.items() if path not in wrong]
    assert result.cost == min(right, default=math.inf)
    assert result.lower_bound == min(costs.values())


def test_a_tighter_bound_spares_the_second_attempt() -> None:
    costs = {(0,): 5.0, (1,): 5.9}
    loose = {(): 3.0, (0,): 3.0, (1,): 3.0}
    found: dict[Path, float | None] = {(0,): 5.0, (1,): 6.0}
    without = RandomTree(costs, loose, found, 3)
    assert search(without, gap=0.2).lower_bound == 2.0
    assert without.tried == [6.0, 5.0, 7.0, 6.0]
    helped = RandomTree(costs, loose, found, 3, tighter={(0,): 0.2, (1,): 0.2})
    assert search(helped, gap=0.2).lower_bound == 4.8
    assert helped.tried == [6.0, 7.0]


def test_first_attempts_at_leaves_as_good_come_before_a_second_one_at_a_leaf_without_luck() -> None:
    costs = {(0,): 9.0, (1,): 10.0, (2,): 12.0}
    found: dict[Path, float | None] = {(0,): None, (1,): 10.0, (2,): 12.0}
    tree = RandomTree(costs, {}, found, 3)
    result = search(tree, gap=0.2)  # 9 is within it of the first attempt at the second leaf, at 11
    assert result.ending is Ending.CLOSED
    assert (result.cost, result.lower_bound) == (11.0, 9.0)
    assert tree.tried == [math.inf, 11.0]
    strict = RandomTree(costs, {}, found, 3)
    search(strict, gap=0.05)
    assert strict.tried[:3] == [math.inf, math.inf, 11.0]


def test_a_tree_without_leaves_is_proved_infeasible() -> None:
    result = search(exact({}, {}))
    assert result.ending is Ending.EXHAUSTED
    assert result.solution is None
    assert result.lower_bound == math.inf


def test_a_leaf_that_cannot_be_solved_keeps_its_bound() -> None:
    tree = RandomTree({(0,): 5.0}, {}, {(0,): None}, depth=3)
    result = search(tree)
    assert result.solution is None
    assert result.lower_bound == 5.0


@pytest.mark.parametrize("leaves_before", [0, 1, 2])
def test_an_interrupt_returns_the_best_so_far_and_a_valid_bound(leaves_before: int) -> None:
    class Interrupted(RandomTree):
        def solve(self, node: Path) -> Iterator[tuple[float, Path] | None]:
            if len(self.solved) == leaves_before:
                raise KeyboardInterrupt
            return super().solve(node)

    costs = {(0,): 10.0, (1,): 8.0, (2,): 6.0}
    slack = {(0,): 9.0, (1,): 6.0, (2,): 3.0, (): 9.0}
    result = search(Interrupted(costs, slack, dict(costs), 3))
    assert result.ending is Ending.INTERRUPTED
    assert result.solved == leaves_before
    assert result.cost == [math.inf, 10.0, 8.0][leaves_before]
    assert result.lower_bound <= 6.0


def test_the_search_reports_progress_with_a_bound_that_never_falls() -> None:
    seen: list[tuple[float, float]] = []
    costs = {(0, 0): 9.0, (1,): 8.0, (2, 1): 7.0}
    branch_and_bound(
        exact(costs, {(0, 0): 5.0, (): 6.0, (0,): 5.5}),
        gap=0.0,
        out_of_time=lambda: False,
        on_progress=lambda cost, low: seen.append((cost, low)),
    )
    lows = [low for _, low in seen]
    assert lows == sorted(lows)
    assert all(low <= 7.0 for low in lows)


@pytest.mark.parametrize("error", [None, AttributeError("'SX' has no attribute 'full'")])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_a_library_swallows_is_one(
    error: Exception | None, number: signal.Signals
) -> None:
    """CasADi does: an NLP then only fails, or raises something else."""

    class Swallowing(RandomTree):
        def solve(self, node: Path) -> Iterator[tuple[float, Path] | None]:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(number)
            if error is not None:
                raise error
            return iter([None])

    tree = Swallowing({(0,): 10.0}, {(): 1.0}, {(0,): None}, 3)
    before = signal.signal(number, signal.default_int_handler)
    try:
        result = search(tree)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert result.ending is Ending.INTERRUPTED
    assert result.lower_bound == 10.0


def test_what_fails_without_an_interrupt_is_raised() -> None:
    class Failing(RandomTree):
        def solve(self, node: Path) -> Iterator[tuple[float, Path] | None]:
            raise AttributeError(f"nothing at {node}")

    with pytest.raises(AttributeError, match="nothing at"):
        search(Failing({(0,): 10.0}, {(): 1.0}, {(0,): None}, 3))


def test_an_interrupt_while_branching_loses_no_bound() -> None:
    class Interrupted(RandomTree):
        def bound(self, node: Path) -> float:
            if node == (1,):
                raise KeyboardInterrupt
            return super().bound(node)

    costs = {(0,): 50.0, (1,): 10.0}
    result = search(Interrupted(costs, {(): 1.0}, dict(costs), 3))
    assert result.ending is Ending.INTERRUPTED
    assert result.lower_bound <= 10.0


@pytest.mark.parametrize(
    "slack", [{(0,): -3.0}, {(): -3.0}, {(0,): 3.0, (): 3.0}], ids=["leaf", "above it", "tighter"]
)
def test_a_leaf_that_costs_less_than_its_own_bound_is_an_error(slack: dict[Path, float]) -> None:
    tree = RandomTree({(0,): 5.0}, slack, {(0,): 5.0}, 3, tighter={(0,): -3.0})
    with pytest.raises(ContradictionError, match="bug"):
        search(tree)


def test_a_first_look_that_finds_less_than_the_bound_of_its_leaf_is_an_error() -> None:
    tree = RandomTree({(0,): 5.0}, {(0,): -3.0}, {(0,): 5.0}, 3)
    with pytest.raises(ContradictionError):
        next(dive(tree, tree.children, width=1, attempts=1, tries=2, out_of_time=lambda: False))


def test_what_tolerances_take_off_a_cost_is_no_contradiction() -> None:
    tree = RandomTree({(0,): 500.0}, {(0,): -4e-4, (): 2.0}, {(0,): 500.0}, 3)
    tree.found[(0,)] = 499.0  # the second attempt finds it, the first one 500
    tree.slack[(0,)] = 1.0 - 4e-4
    result = search(tree)
    assert result.lower_bound == result.cost == 499.0


@pytest.mark.parametrize("vain", [1, 12])
def test_a_first_plan_is_looked_for_where_attempts_are_in_vain(vain: int) -> None:
    """After some of them; once; and what is found so is beaten by what costs less."""
    costs = {(i, j): 10.0 + 3 * i + j for i in range(3) for j in range(3)} | {(2, 2, 2): 30.0}
    failing = sorted(costs, key=costs.__getitem__)[:vain]
    tree = RandomTree(
        costs, {}, {path: None if path in failing else costs[path] for path in costs}, 3
    )
    looks = list[int]()

    def look() -> tuple[float, Path]:
        looks.append(len(tree.solved))
        return 50.0, (9,)

    result = branch_and_bound(
        tree, gap=0.0, out_of_time=lambda: False, on_progress=lambda *_: None, look=look
    )
    solved = [cost for path, cost in costs.items() if path not in failing]
    assert result.cost == min(solved, default=50.0)
    assert len(looks) == (vain > 4)
    assert all(0 < count < vain for count in looks)
