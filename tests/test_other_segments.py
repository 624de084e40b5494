"""Plans of robots with one, two unequal and three segments."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from problems import at, goal_tree, only_goal

from twosra_mpc import Goal, Problem, Robot, Start, load_problem, load_robot, plan
from twosra_mpc.planning.solver.sequence_solver import SequenceSolver
from twosra_mpc.robot.modes import ModeSequence, all_modes

THREE = load_problem("three-segments")


def robot_of(*lengths: float) -> Robot:
    document = load_robot("2sra-v1").model_dump()
    document["geometry"] |= {"segments": len(lengths), "segment_length_m": lengths}
    document["limits"]["curvature_per_m"] = 60.0
    return Robot(**document)


def problem_of(robot: Robot, kappa: tuple[float, ...]) -> Problem:
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0,) * len(kappa))
    goal = Goal(x_m=0.1, y_m=0.05, phi_rad=0.5, kappa_per_m=kappa)
    return Problem(robot=robot, start=start, goal=goal)


@pytest.mark.parametrize(
    ("lengths", "kappa"),
    [
        ((0.04,), (25.0,)),
        ((0.03, 0.05), (25.0, -10.0)),
        ((0.05, 0.03), (-20.0, -20.0)),
        ((0.03, 0.04, 0.05), (15.0, 15.0, -10.0)),
        ((0.04, 0.04, 0.04), (0.0, 20.0, 0.0)),
    ],
)
def test_plans_verify_and_are_proved(lengths: tuple[float, ...], kappa: tuple[float, ...]) -> None:
    found = plan(problem_of(robot_of(*lengths), kappa)).require()
    assert found.gap is not None
    assert found.gap <= 0.01
    assert found.verification.ok
    assert found.samples.q.shape[1] == 3 + len(lengths)
    assert found.samples.q[-1, 3:] == pytest.approx(kappa, abs=1e-6)
    unchanged = [j + 1 for j, value in enumerate(kappa) if value == 0.0]
    assert not {item.segment for item in found.transitions} & set(unchanged)


def test_segments_that_bend_alike_bend_together() -> None:
    """Three equal bends take one phase in which all are soft, and one freeze."""
    found = plan(problem_of(robot_of(0.04, 0.04, 0.04), (15.0, 15.0, 15.0))).require()
    assert [phase.mode for phase in found.phases if any(phase.mode)] == [(1, 1, 1)]


def sequences(length: int) -> list[ModeSequence]:
    """Mode sequences of three segments that start and end rigid, none twice in a row."""
    rigid, modes = (0, 0, 0), all_modes(3)
    return [
        (rigid, *between, rigid)
        for between in itertools.product(modes, repeat=length - 2)
        if all(a != b for a, b in itertools.pairwise((rigid, *between, rigid)))
    ]


def test_the_search_finds_what_solving_every_short_sequence_finds() -> None:
    """Over all sequences of up to four phases and the closing rigid one; bounds are below costs."""
    goal = Goal(x_m=0.15, y_m=0.1, phi_rad=0.8, kappa_per_m=(20.0, -15.0, 30.0))
    problem = THREE.with_values(goal=goal, max_phases=5, gap=1e-3)
    tree = goal_tree(problem, SequenceSolver([only_goal(problem)]))
    best, solved = math.inf, 0
    for sequence in [((0, 0, 0),), *(s for n in (3, 4, 5) for s in sequences(n))]:
        node = at(sequence[:-1] if len(sequence) > 1 else sequence)
        bound = tree.leaf_bound(node)
        if bound >= best:
            continue
        attempts = itertools.islice(tree.solve(node), 1)  # the NLP would take minutes
        costs = [found[0] for found in attempts if found is not None]
        solved += bool(costs)
        assert all(cost >= bound - 1e-6 for cost in costs)
        best = min([best, *costs])
    found = plan(problem).require()
    assert solved >= 1
    assert found.cost.total == pytest.approx(best, rel=1e-3)
    assert found.lower_bound is not None
    assert found.lower_bound <= best + 1e-6


def test_the_three_segment_scenario_is_planned_to_a_proved_gap() -> None:
    found = plan(THREE).require()
    assert found.gap is not None
    assert found.gap <= 0.01
    assert {item.segment for item in found.transitions} == {1, 2, 3}
    assert np.unique(found.samples.mode.sum(axis=1)).tolist() == [0, 1, 2, 3]
