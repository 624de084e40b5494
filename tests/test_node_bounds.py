"""Bounds of nodes: no leaf costs less than any node above it, whatever the timing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from once import planned
from problems import ROBOT, at, goal_tree, network_of, random_problem
from thermal_problems import SEQUENCES, earliest_finish, thermal_problem, thermal_problems

from twosra_mpc import Problem, Status, load_problem, load_robot, plan
from twosra_mpc.planning.bounds.bends import unreachable_reason
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.planning.search.nodes import Node
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.robot.modes import (
    MODES,
    RIGID,
    SOFT_1,
    SOFT_2,
    SOFT_BOTH,
    Mode,
    ModeSequence,
    all_modes,
)
from twosra_mpc.robot.timing import SequentialTiming
from twosra_mpc.timing import transition_model


def lineages(tree: Tree[Any], depth: int) -> Iterator[list[Node]]:
    """Every node down to a depth, with its ancestors from the root on."""
    rows = [[tree.root()]]
    for _ in range(depth):
        yield from rows
        rows = [[*row, child] for row in rows for child in tree.children(row[-1])]
    yield from rows


@pytest.mark.parametrize("timing", ["nominal", "constant", "paper"])
@pytest.mark.parametrize("heaters", [1, 2])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_leaf_is_bounded_below_a_node_above_it(seed: int, timing: str, heaters: int) -> None:
    rng = np.random.default_rng(seed)
    start = random_problem(seed).start.with_values(
        temperature_C=tuple(rng.choice([25.0, 50.0, 70.0], 2, p=[0.4, 0.3, 0.3]))
    )
    if heaters == 1 and min(start.temperature_C or (0.0,)) > 61.0:
        start = start.with_values(temperature_C=(25.0, 70.0))
    weights = {"energy_s_per_J": [0.0, 0.05][seed % 2], "transition_s": 2.0}
    given = {"start": start.model_dump(), "timing": timing, "heaters_at_once": heaters}
    if timing == "nominal":
        given["transition_quantile"] = [None, 0.9, 0.8][seed]
    problem = random_problem(seed, weights=weights, **given)
    assert leaves_checked(problem, 3) >= 5


def leaves_checked(problem: Problem, depth: int) -> int:
    """Number of sequences whose bound was compared with those of all nodes above it."""
    tree = goal_tree(problem)
    bounds, leaves = dict[Node, float](), 0
    for *above, node in lineages(tree, depth):
        bounds[node] = tree.bound(node)
        highest = max(bounds[item] for item in (*above, node))
        leaf = tree.leaf_bound(node)
        assert leaf >= highest - 1e-6, (node, leaf, highest)
        leaves += math.isfinite(leaf)
    return leaves


ALLOWED = [(RIGID, SOFT_1, SOFT_2, SOFT_BOTH), (RIGID, SOFT_1, SOFT_2), (SOFT_1, SOFT_2, SOFT_BOTH)]


@pytest.mark.parametrize("seed", range(15))
def test_waits_of_any_length_bound_no_leaf_below_a_node_above_it(seed: int) -> None:
    """To freeze all, or to pass through another mode, may be the cheapest way to a mode."""
    rng = np.random.default_rng(seed)
    heat_s, freeze_s, reconfigure_s = rng.uniform(5.0, 500.0, 3)
    waits = SequentialTiming(
        overlap="none",
        heat_s=heat_s,
        freeze_s=freeze_s,
        reconfigure_s=reconfigure_s,
        reconfigure_cool_s=reconfigure_s * rng.uniform(0.1, 0.95),
    )
    heaters = int(rng.integers(1, 3))
    hottest = 70.0 if heaters == 2 else 50.0
    start = random_problem(seed).start.with_values(
        temperature_C=(rng.choice([25.0, 50.0, 70.0]), rng.choice([25.0, 50.0, hottest]))
    )
    weights = {
        "energy_s_per_J": rng.choice([0.0, 0.05, 10.0]),
        "transition_s": rng.choice([0.0, 2.0, 45.0]),
    }
    problem = random_problem(
        seed,
        robot=ROBOT.with_values(timing={"nominal": waits}),
        start=start.model_dump(),
        modes=ALLOWED[rng.integers(3)],
        heaters_at_once=heaters,
        weights=weights,
    )
    last = [RIGID, SOFT_1, SOFT_2][rng.integers(3)]
    problem = problem.with_values(goal=problem.goal.with_values(mode=last))
    assert leaves_checked(problem, 4) >= 5


def test_with_fewer_modes_no_plan_costs_less_than_the_bound_with_all() -> None:
    given: dict[str, Any] = {"timing": "paper", "robot": "2sra-v1-paper"}
    given["weights"] = {"transition_s": 45.0}
    every = planned("paper-1", **given)
    fewer = planned("paper-1", **given, modes=[RIGID, SOFT_1, SOFT_2])
    assert every.lower_bound is not None
    assert every.lower_bound <= fewer.cost.total


def test_with_fewer_phases_the_bound_holds_for_longer_sequences() -> None:
    problem = load_problem("paper-1", timing="paper", modes=[RIGID, SOFT_1, SOFT_2])
    short = goal_tree(problem.with_values(max_phases=4))
    longer = plan(problem.with_values(max_phases=5)).require()
    assert longer.cost.total < 815.0
    assert max(map(short.bound, map(at, [(RIGID,), (RIGID, SOFT_1)]))) <= longer.cost.total


@pytest.mark.parametrize("price", [0.0, 10.0])
def test_to_freeze_everything_in_between_may_be_quicker_and_take_less_heat(price: float) -> None:
    """As published, 300 + 100 s and heat for 100 s; a reconfiguration takes 502 s, of which 102."""
    given = {"temperature_C": (25.0, 65.0), "timing": "paper"}
    problem = thermal_problem(**given, weights={"energy_s_per_J": price})
    tree = goal_tree(problem)
    leaf = tree.leaf_bound(at((SOFT_2, RIGID, SOFT_1)))
    assert leaf < tree.leaf_bound(at((SOFT_2, SOFT_1)))
    assert tree.bound(at((SOFT_2,))) <= leaf


@given(problem=thermal_problems(), sequence=SEQUENCES, mode=st.sampled_from(MODES))
def test_a_phase_appended_never_makes_the_transitions_quicker_or_cheaper(
    problem: Problem, sequence: ModeSequence, mode: Mode
) -> None:
    # Put in between it may: metal that is frozen and melted again can freeze sooner than hot metal.
    shorter, more = network_of(problem, sequence), network_of(problem, (*sequence, mode))
    assert earliest_finish(more) >= earliest_finish(shorter) - 1e-6
    assert more.melt_energy_J >= shorter.melt_energy_J - 1e-6
    assert more.transitions >= shorter.transitions


@given(problem=thermal_problems(), sequence=SEQUENCES, cut=st.integers(1, 6))
def test_no_sequence_of_transitions_is_cheaper_than_the_bound_of_its_beginning(
    problem: Problem, sequence: ModeSequence, cut: int
) -> None:
    timing, weights = transition_model(problem), problem.cost_weights
    assume(unreachable_reason(sequence, bending_task(problem)) is None)
    assume(timing.refusal(sequence, problem.goal.mode) is None)
    whole = timing.network(sequence, problem.goal.mode, [0.0] * len(sequence))
    cost = earliest_finish(whole) + weights.energy_s_per_J * whole.melt_energy_J
    cost += weights.transition_s * whole.transitions
    tree = goal_tree(problem)
    assert tree.bound(at(sequence[:cut])) <= cost + 1e-6


FOUR = load_robot("3sra").with_values(
    geometry=load_robot("3sra").geometry.with_values(segments=4, segment_length_m=(0.04,) * 4)
)
RIGID_4, *SOFT_4 = all_modes(4)


def four_segments(seed: int, **asked: Any) -> Problem:
    """A change of shape and pose of a robot of four segments, three of them alike at the start."""
    rng = np.random.default_rng(seed)
    pose = dict(zip(("x_m", "y_m", "phi_rad"), rng.uniform(-0.3, 0.3, 3).tolist(), strict=True))
    start, goal = (tuple(kappa.tolist()) for kappa in rng.uniform(-20.0, 20.0, (2, 4)))
    warm = {"temperature_C": (25.0, 25.0, 25.0, float(rng.choice([25.0, 50.0])))}
    origin = dict.fromkeys(("x_m", "y_m", "phi_rad"), 0.0)
    return Problem(
        robot=FOUR,
        start=origin | {"kappa_per_m": start} | warm,
        goal=pose | {"kappa_per_m": goal},
        **asked,
    )


@pytest.mark.parametrize("seed", range(6))
def test_no_transitions_of_four_segments_are_cheaper_than_the_bound_of_their_beginning(
    seed: int,
) -> None:
    problem, rng = four_segments(seed), np.random.default_rng(seed)
    tree, timing, task = goal_tree(problem), transition_model(problem), bending_task(problem)
    tried = 0
    while tried < 10:
        soft = [SOFT_4[i] for i in rng.permutation(len(SOFT_4))[: rng.integers(4, 6)]]
        sequence = (RIGID_4, *soft, RIGID_4)
        if unreachable_reason(sequence, task) is None:
            network, tried = timing.network(sequence, RIGID_4, [0.0] * len(sequence)), tried + 1
            beginnings = (sequence[:cut] for cut in range(1, len(sequence)))
            assert max(map(tree.bound, map(at, beginnings))) <= earliest_finish(network) + 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_segments_that_are_alike_take_the_same_times_whichever_of_them_changes(seed: int) -> None:
    problem, rng = four_segments(seed), np.random.default_rng(seed)
    timing = transition_model(problem)
    for _ in range(10):
        sequence = tuple(SOFT_4[i] for i in rng.integers(len(SOFT_4), size=4))
        order = [*rng.permutation(3), 3]  # the last may be warm
        other = tuple(tuple(mode[j] for j in order) for mode in sequence)
        assert timing.ordered(sequence) == timing.ordered(other)
        finish = [
            earliest_finish(timing.network(each, RIGID_4, [0.0] * len(each)))
            for each in (sequence, other)
        ]
        assert finish[0] == pytest.approx(finish[1], rel=1e-12)


def test_modes_that_a_bend_lacks_are_as_few_as_suffice() -> None:
    """Compared with every set of modes of three segments."""
    problem = load_problem("three-segments")
    stage, task = goal_tree(problem).variants[0][0], bending_task(problem)
    sets = [
        frozenset(some)
        for count in range(8)
        for some in itertools.combinations(all_modes(3)[1:], count)
    ]
    enough = [some for some in sets if unreachable_reason([*some], task) is None]
    assert len(sets) > len(enough) > 1
    for some in sets:
        assert stage.lacks(some) == min(len(more - some) for more in enough)


def test_four_segments_are_planned_with_little_work() -> None:
    """There are 15 ** 8 sequences of soft modes: none of them is written down before it is due."""
    result = plan(four_segments(1))
    assert result.status is Status.OPTIMAL
    assert result.stats.work < 500.0
