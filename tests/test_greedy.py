"""The greedy reference planner: sequences as published, a plan like any other, and a clear end."""

from __future__ import annotations

import pytest
from once import planned, solved
from problems import ROBOT, random_problem

import twosra_mpc.planning.greedy as greedy
from twosra_mpc import Status, load_problem, plan
from twosra_mpc.planning.greedy import GreedyEnding, greedy_path
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH

# Mode sequences of the published simulations; the autonomous Jacobian gives the same ones.
PUBLISHED = {
    "paper-1": (SOFT_BOTH, SOFT_2, SOFT_1, RIGID),
    "paper-2": (SOFT_1, RIGID),
    "paper-3": (SOFT_BOTH, SOFT_2, SOFT_1, RIGID),
    "paper-4": (SOFT_2, RIGID),
    "paper-5": (SOFT_2, SOFT_1, RIGID),
}


def test_the_default_robot_goes_from_rest_to_rest_between_the_steps_of_the_rule() -> None:
    result = solved("rigid-move", planner="greedy")
    assert result.status is Status.FEASIBLE
    assert result.plan.verification.limits["wheel_acceleration_rad_s2"] >= 0.0
    assert not result.plan.samples.v[[0, -1]].any()


@pytest.mark.parametrize(("name", "sequence"), PUBLISHED.items())
def test_the_published_mode_sequences_are_found(name: str, sequence: object) -> None:
    result = solved(name, robot=ROBOT, planner="greedy")
    assert tuple(phase.mode for phase in result.plan.phases) == sequence
    assert result.status is Status.FEASIBLE
    assert result.planner == "greedy"
    assert result.lower_bound is None
    assert result.gap is None
    assert "by the greedy rule" in result.message
    assert result.plan.verification.ok


def test_the_error_never_grows_and_the_mode_changes_only_when_stuck() -> None:
    problem = random_problem(50)
    path = greedy_path(problem)
    assert path.ending is GreedyEnding.REACHED
    assert len(set(path.modes)) <= 4
    runs = 1 + sum(a != b for a, b in zip(path.modes, path.modes[1:], strict=False))
    assert runs <= 6


def test_it_stops_when_no_allowed_mode_helps() -> None:
    result = solved("paper-1", planner="greedy", modes=[RIGID])
    assert result.status is Status.FAILED
    assert result.plan is None
    assert "no allowed mode comes nearer to the goal" in result.message


def test_it_stops_at_its_iteration_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(greedy, "MAX_ITERATIONS", 5)
    result = plan(load_problem("paper-1", planner="greedy"))
    assert result.status is Status.FAILED
    assert "iterations" in result.message


def test_a_goal_equal_to_the_start_gives_an_empty_plan() -> None:
    problem = load_problem("paper-1", planner="greedy")
    goal = dict(zip(("x_m", "y_m", "phi_rad"), problem.start.configuration, strict=False))
    goal["kappa_per_m"] = problem.start.kappa_per_m
    result = planned("paper-1", planner="greedy", goal=goal)
    assert result.duration_s == 0.0
    assert result.phases == ()


def test_a_path_beyond_the_curvature_limit_is_not_called_feasible() -> None:
    """On this problem greedy overshoots to 63 1/m between curvatures below 48 1/m."""
    limits = ROBOT.limits.with_values(curvature_per_m=50.0)
    robot = ROBOT.with_values(limits=limits)
    result = plan(random_problem(37, planner="greedy", robot=robot))
    assert result.status is Status.FAILED
    assert result.plan is None
    assert "curvature is beyond curvature_per_m = 50 1/m" in result.message
    optimal = plan(random_problem(37, robot=robot))
    assert optimal.status is Status.OPTIMAL
