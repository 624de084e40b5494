"""plan(): the published problems, random ones, statuses, limits, and brute force as the judge."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from once import planned, solved
from problems import ROBOT, bound_of, network_of, only_goal, random_problem

import twosra_mpc.planning.planner as planner
import twosra_mpc.planning.solver.sequence_solver as sequence_solver
import twosra_mpc.planning.solver.turning_drive as turning_drive
from twosra_mpc import (
    ContradictionError,
    Goal,
    PlanInterrupted,
    Problem,
    Start,
    Status,
    load_problem,
    plan,
)
from twosra_mpc.effort import Cost, Ending, charge, limited
from twosra_mpc.planning.planner import Progress
from twosra_mpc.planning.search.branch_and_bound import SearchResult
from twosra_mpc.planning.solver.fixed_sequence import Candidate
from twosra_mpc.planning.solver.sequence_solver import GoalSolver, Solved, trusted
from twosra_mpc.problem.limits import body_gaps_m
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH
from twosra_mpc.timing.network import TemporalNetwork

PAPER = [f"paper-{n}" for n in range(1, 6)]


@pytest.mark.parametrize("name", PAPER)
def test_the_published_problems_are_solved_to_a_proved_gap(name: str) -> None:
    result = planned(name, robot=ROBOT)
    greedy = planned(name, planner="greedy", robot=ROBOT)
    assert result.status is Status.OPTIMAL
    assert result.gap is not None
    assert result.gap <= 0.015
    assert result.verification.ok
    assert max(map(abs, result.verification.goal_error)) <= 1e-6
    assert greedy.status is Status.FEASIBLE
    assert result.lower_bound is not None
    assert result.lower_bound <= result.duration_s <= greedy.duration_s


@pytest.mark.parametrize(
    ("name", "transitions", "least"),
    [("paper-1", 4, 335), ("paper-2", 2, 298), ("paper-3", 4, 335), ("paper-4", 2, 298)],
)
def test_durations_are_the_transitions_by_hand_plus_a_little_motion(
    name: str, transitions: int, least: float
) -> None:
    result = planned(name, timing="constant", robot=ROBOT)
    assert result.cost.transitions == transitions
    assert least < result.cost.time_s < least + 3


@pytest.mark.parametrize(
    ("name", "total"), [("paper-1", 334.4), ("paper-2", 298.6), ("paper-5", 334.3)]
)
def test_the_published_totals_are_those_of_the_thermal_model(name: str, total: float) -> None:
    result = planned(name, robot=ROBOT)
    assert result.duration_s == pytest.approx(total, abs=0.05)


def test_a_goal_equal_to_the_start_gives_an_empty_plan() -> None:
    problem = load_problem("paper-1", robot=ROBOT)
    q = problem.start.configuration
    goal = Goal(x_m=q[0], y_m=q[1], phi_rad=q[2] + 2 * math.pi, kappa_per_m=q[3:])
    result = plan(Problem(robot=ROBOT, start=problem.start, goal=goal)).require()
    assert result.status is Status.OPTIMAL
    assert result.phases == ()
    assert result.transitions == ()
    assert result.duration_s == result.lower_bound == result.gap == 0.0
    assert not result.samples.v.any()


@pytest.mark.parametrize("seed", range(3))
def test_a_pure_pose_change_melts_nothing_and_has_a_proved_gap(seed: int) -> None:
    problem = random_problem(seed)
    shape = problem.start.kappa_per_m
    goal = problem.goal.with_values(kappa_per_m=shape)
    result = plan(Problem(robot=ROBOT, start=problem.start, goal=goal.model_dump()))
    assert result.found
    assert result.plan.transitions == ()
    assert [phase.mode for phase in result.plan.phases] == [RIGID]
    assert result.gap is not None
    assert result.gap < 0.05


@pytest.mark.parametrize("segment", [0, 1])
def test_a_shape_change_of_one_segment_never_melts_the_other(segment: int) -> None:
    kappa = [0.0, 0.0]
    kappa[segment] = 25.0
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    goal = Goal(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=kappa)
    result = plan(Problem(robot=ROBOT, start=start, goal=goal)).require()
    assert result.status is Status.OPTIMAL
    assert {item.segment for item in result.transitions} == {segment + 1}


def test_what_the_metal_allows_is_found_and_not_coded() -> None:
    """Heating runs while driving, the second melt waits for the first bend, one common freeze."""
    result = planned("move-and-shape", robot=ROBOT)
    melts = sorted((t for t in result.transitions if t.to == "soft"), key=lambda t: t.onset_s)
    freezes = [t for t in result.transitions if t.to == "rigid"]
    drive = result.phases[0]
    assert drive.mode == RIGID
    assert melts[0].heater_s < drive.end_s <= melts[0].onset_s
    assert melts[1].heater_s < melts[0].done_s < melts[1].onset_s
    assert freezes[0].onset_s == pytest.approx(freezes[1].onset_s)


def test_a_start_that_is_already_soft_is_used() -> None:
    base = load_problem("paper-4", robot=ROBOT)
    start = Start(**{**base.start.model_dump(), "temperature_C": (25.0, 63.0)})
    result = planned("paper-4", start=start.model_dump(), robot=ROBOT)
    assert result.status is Status.OPTIMAL
    assert result.duration_s < 250  # no melt: only the freeze, from 63 C, and the motion
    assert [item.to for item in result.transitions] == ["rigid"]


def test_a_goal_may_leave_a_segment_soft() -> None:
    base = load_problem("paper-4", robot=ROBOT)
    goal = {**base.goal.model_dump(), "mode": (0, 1)}
    result = planned("paper-4", goal=goal, robot=ROBOT)
    assert result.status is Status.OPTIMAL
    assert result.duration_s < 70
    assert [item.to for item in result.transitions] == ["soft"]
    assert result.samples.heater_setpoint_C[-1].tolist() == [25.0, 65.0]


def test_free_coordinates_and_tolerances_never_cost_more() -> None:
    full = load_problem("paper-1", robot=ROBOT)
    base = plan(full).require().duration_s
    assert base is not None
    free = planned("paper-1", goal={"kappa_per_m": [-15.0, "free"]}, robot=ROBOT)
    assert free.status is Status.OPTIMAL
    assert free.duration_s < 300 < base
    loose = {**full.goal.model_dump(), "tolerance": {"kappa_per_m": (2.5, 2.5)}}
    near = planned("paper-1", goal=loose, robot=ROBOT)
    assert near.duration_s < 300  # [1,1] alone comes within 2 1/m of both curvatures


def test_a_limit_stops_the_search_with_a_valid_bound() -> None:
    result = solved("paper-1", work_limit=1e-9, robot=ROBOT)
    assert result.status is Status.FAILED
    assert result.ending is Ending.LIMIT
    assert "raise work_limit" in result.message
    assert result.lower_bound is not None
    assert result.lower_bound <= 336


def test_an_interrupt_returns_the_best_plan_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    drives = Mock(side_effect=[(), KeyboardInterrupt])  # the second, once there is a bound
    monkeypatch.setattr(turning_drive, "turning_drives", drives)
    with pytest.raises(PlanInterrupted, match="interrupted") as raised:  # which ends a user's loop
        plan(load_problem("rigid-move", gap=0.0, robot=ROBOT))
    result = raised.value.result
    assert result.ending is Ending.INTERRUPTED
    assert result.status is Status.FEASIBLE
    assert "interrupted" in result.message
    assert result.gap is not None
    assert 0 < result.gap < 0.2


def broken(
    problem: Problem, candidate: Candidate | None, network: TemporalNetwork
) -> tuple[float, Solved] | None:
    """A guess in place of a trusted one that drives a millimetre too far in every phase."""
    found = trusted(problem, candidate, network)
    if found is None:
        return None
    cost, solved = found
    motion = solved.candidate.motion
    far = replace(
        motion, states=motion.states + 1e-3 * np.arange(len(motion.states))[:, None, None]
    )
    moved = replace(solved.candidate, motion=far)
    return cost, Solved(problem, moved, network)


def test_a_trusted_guess_that_does_not_verify_is_searched_for_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = load_problem("paper-3", robot=ROBOT)
    expected = plan(problem)
    monkeypatch.setattr(planner, "trusted", broken)
    result = plan(problem)
    assert result.require().verification.ok
    assert result.status is Status.OPTIMAL
    assert result.lower_bound == expected.lower_bound
    assert result.stats.sequences_bounded == expected.stats.sequences_bounded  # not once more


@pytest.mark.parametrize(
    ("name", "weights"),
    [("paper-2", {}), ("rigid-move", {"effort": 300.0}), ("paper-2", {"energy_s_per_J": 9.9})],
)
def test_a_bound_above_the_cost_of_the_plan_is_a_contradiction(
    name: str, weights: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is never lowered to the cost, and called proved: the search's own cost is no excuse."""
    problem = load_problem(name, motion="fastest", weights=weights)
    cost = plan(problem).require().cost.total

    def raised(*given: Any, **options: Any) -> Any:
        return replace(search(*given, **options), lower_bound=cost * 1.001)

    search = planner.branch_and_bound
    monkeypatch.setattr(planner, "branch_and_bound", raised)
    with pytest.raises(ContradictionError):
        plan(problem)


def test_an_interrupt_before_any_plan_verifies_ends_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searched = []

    def interrupted(found: SearchResult[Solved]) -> SearchResult[Solved]:
        searched.append(found)
        return replace(found, ending=Ending.INTERRUPTED)

    monkeypatch.setattr(planner, "trusted", broken)
    monkeypatch.setattr(planner, "as_asked", interrupted)
    result = planner.plan_until_interrupted(load_problem("paper-3", robot=ROBOT))
    assert len(searched) == 1
    assert searched[0].solution is not None
    assert (result.status, result.ending) == (Status.FAILED, Ending.INTERRUPTED)
    assert result.plan is None
    assert "no plan found (interrupted" in result.message


def test_progress_is_reported() -> None:
    seen: list[Progress] = []
    plan(load_problem("paper-3", robot=ROBOT), on_progress=seen.append)
    assert seen
    assert all(item.lower_bound <= 337 for item in seen)


def test_the_authors_timing_waits_through_every_transition() -> None:
    for name in PAPER:
        result = planned(name, timing="paper", robot=ROBOT)
        greedy = planned(name, timing="paper", planner="greedy", robot=ROBOT)
        assert result.status is Status.OPTIMAL
        assert result.duration_s <= greedy.duration_s
    waits = {"paper-1": 1404.0, "paper-2": 400.0, "paper-4": 400.0}
    for name, wait in waits.items():
        greedy = planned(name, timing="paper", planner="greedy", robot=ROBOT)
        moving = sum(phase.end_s - phase.start_s for phase in greedy.phases)
        assert greedy.duration_s == pytest.approx(wait + moving, abs=1e-6)


def test_weights_enter_cost_and_bound() -> None:
    weights = {"energy_s_per_J": 0.1, "transition_s": 5.0}
    result = planned("paper-1", weights=weights, robot=ROBOT)
    cost = result.cost
    assert cost.total == pytest.approx(cost.time_s + 0.1 * cost.energy_J + 5.0 * cost.transitions)
    assert result.lower_bound is not None
    assert cost.time_s < result.lower_bound <= cost.total
    assert result.status is Status.OPTIMAL


@pytest.mark.parametrize("modes", [[RIGID], [RIGID, SOFT_2], [RIGID, SOFT_1, SOFT_2, SOFT_BOTH]])
@pytest.mark.parametrize("temperatures", [(64.0, 64.0), (64.0, 25.0), (25.0, 64.0)])
def test_a_soft_start_may_always_freeze_and_drive(
    modes: list[tuple[int, int]], temperatures: tuple[float, float]
) -> None:
    start = Start(
        x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(5.0, -5.0), temperature_C=temperatures
    )
    result = plan(Problem(robot=ROBOT, start=start, goal=Goal(x_m=0.05), modes=modes))
    assert result.found
    assert result.plan.duration_s < 252  # cool from 64 C, freeze, drive


def test_resting_needs_no_mode() -> None:
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(5.0, -5.0))
    goal = Goal(x_m=0.0, kappa_per_m=(5.0, -5.0))
    result = plan(Problem(robot=ROBOT, start=start, goal=goal, modes=[SOFT_1])).require()
    assert (result.status, result.duration_s, result.gap) == (Status.OPTIMAL, 0.0, 0.0)


@pytest.mark.parametrize(
    ("temperatures", "last", "timing"),
    [
        ((25.0, 25.0), SOFT_1, "nominal"),
        ((60.0, 60.0), RIGID, "constant"),
        ((64.0, 30.0), SOFT_1, "paper"),
        ((70.0, 64.0), RIGID, "nominal"),
    ],
)
def test_no_plan_costs_less_than_its_bound_with_weights_and_warm_starts(
    temperatures: tuple[float, float], last: tuple[int, int], timing: str
) -> None:
    base = random_problem(90)
    start = Start(**{**base.start.model_dump(), "temperature_C": temperatures})
    goal = Goal(**{**base.goal.model_dump(), "mode": last})
    weights = {"energy_s_per_J": 1.0, "transition_s": 3.0}
    problem = Problem(robot=ROBOT, start=start, goal=goal, weights=weights, timing=timing)
    solver = GoalSolver(only_goal(problem))
    found = 0
    for sequence in ((RIGID, SOFT_1, SOFT_2, RIGID), (RIGID, SOFT_2, SOFT_1), (SOFT_BOTH, SOFT_1)):
        network, bound = network_of(problem, sequence, last), bound_of(problem, sequence, last)
        if bound is None:
            continue
        plans = [attempt for attempt in solver(network, bound) if attempt]
        found += len(plans)
        assert all(bound.cost <= cost + 1e-6 for cost, _ in plans)
    assert found > 0


def test_a_goal_that_just_touches_is_not_called_impossible() -> None:
    """Parts 0.01 mm apart at the end: legal, and found."""
    second, apart, closer = 30.0, 40.0, 60.0
    while closer - apart > 1e-5:
        middle = (apart + closer) / 2
        far = body_gaps_m(ROBOT, np.array([[middle, second]]))[0] >= 1e-5
        apart, closer = (middle, closer) if far else (apart, middle)
    first = apart - 5.0
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(first, second))
    goal = Goal(kappa_per_m=(first + 5.0, second))
    result = plan(Problem(robot=ROBOT, start=start, goal=goal, modes=[SOFT_1]))
    assert result.found


def test_a_limit_keeps_nonlinear_programs_from_starting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequence_solver, "solve", lambda *_: pytest.fail("begun too late"))
    problem = load_problem("rigid-move", gap=0.0, robot=ROBOT)
    network, bound = network_of(problem, (RIGID,)), bound_of(problem, (RIGID,))
    assert bound is not None
    solver = GoalSolver(only_goal(problem))
    with limited(1e-9, math.inf):
        charge(Cost.KEPT)
        assert len(list(solver(network, bound))) == 1  # a screw, and no drive that turns
