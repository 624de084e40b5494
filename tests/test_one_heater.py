"""One heater at a time: dwells follow each other, at a cost, and cold [1,1] is ruled out."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from problems import random_problem
from thermal_problems import (
    SEQUENCES,
    SPANS_S,
    V1,
    V2,
    settled,
    thermal_model,
    thermal_problem,
    thermal_problems,
)

from twosra_mpc import Goal, Problem, Robot, Start, Status, plan
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
from twosra_mpc.thermal.heating import TemperatureTrajectory
from twosra_mpc.thermal.least_times import LeastTimes
from twosra_mpc.timing import transition_model

ONE_HEATER = "mode [1,1] needs both heaters at once, but heaters_at_once is 1"
Pair = tuple[float, float]
timings = pytest.mark.parametrize("timing", ["nominal", "constant", "paper"])


def bending(robot: Robot, start: Pair, goal: Pair, warm_C: Pair, **given: Any) -> Problem:
    """A change of shape with one heater."""
    here = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=start, temperature_C=warm_C)
    there = Goal(kappa_per_m=goal, tolerance="exact")
    return Problem(robot=robot, start=here, goal=there, heaters_at_once=1, **given)


def both_on(problem: Problem) -> bool:
    """Whether two currents flow at once anywhere in the plan of a problem."""
    samples = plan(problem).require().samples
    lasting = np.append(np.diff(samples.t_s), np.inf) > 1e-4
    return bool(((samples.heater_current_A > 0).all(axis=1) & lasting).any())


@timings
@pytest.mark.parametrize("seed", range(3))
def test_no_two_heaters_are_on_at_once_and_that_never_costs_less(timing: str, seed: int) -> None:
    two = random_problem(seed, timing=timing)
    one = random_problem(seed, timing=timing, heaters_at_once=1)
    costs = []
    for problem in (one, two):
        result = plan(problem).require()
        assert result.lower_bound is not None
        assert result.lower_bound <= result.cost.total
        costs.append((result.lower_bound, result.cost.total))
    assert not both_on(one)
    if timing != "paper":  # this heats both for their common freeze, given two heaters
        assert both_on(two)
    # Each is optimal to 1 % only, so that only bounds and costs can be compared.
    assert costs[0][1] >= costs[1][0]
    assert costs[0][1] >= 0.99 * costs[1][1]


@given(problem=thermal_problems(heaters_at_once=1), sequence=SEQUENCES, spans=SPANS_S)
def test_dwells_of_a_settled_schedule_do_not_overlap_and_keep_its_network(
    problem: Problem, sequence: ModeSequence, spans: list[float]
) -> None:
    assume(thermal_model(problem).refusal(sequence, problem.goal.mode) is None)
    found = settled(problem, sequence, spans[: len(sequence)])
    assume(found is not None)
    assert found is not None
    assert found.violated() == []
    for one, two in itertools.product(*(dwells(c, found.finish_s) for c in found.trajectories)):
        assert one[1] <= two[0] + 1e-6 or two[1] <= one[0] + 1e-6


def dwells(trajectory: TemperatureTrajectory, until_s: float) -> list[tuple[float, float]]:
    """(on, off) of a heater; heat that no longer flows in the plan does not count."""
    ends = [piece.start_s for piece in trajectory.pieces[1:]] + [until_s]
    return [
        (piece.start_s, end)
        for piece, end in zip(trajectory.pieces, ends, strict=True)
        if piece.current_A != 0.0 and piece.start_s < end - 1e-6
    ]


def test_a_melt_waits_for_the_heater_before_it_and_not_for_its_freeze() -> None:
    """By hand: the second heater goes on when the first goes off, 18.8 s before that freeze."""
    problem = thermal_problem(heaters_at_once=1)
    found = settled(problem, (RIGID, SOFT_1, SOFT_2, RIGID), [0.0, 40.0, 1.0, 0.0])
    assert found is not None
    one, two = (dwells(trajectory, found.finish_s) for trajectory in found.trajectories)
    assert len(one) == 2  # up to the set-point, and held
    assert two[0][0] >= one[-1][1] - 1e-6
    layout, times = found.network.layout, found.times
    freeze, melt = times[layout.onset(2, 0)], times[layout.onset(2, 1)]
    assert freeze - one[-1][1] == pytest.approx(18.81, abs=0.01)
    # Segment 2 freezes last; its melt (26.34 s to the plateau) is hidden in the first freeze.
    assert melt - two[0][0] == pytest.approx(26.34, abs=0.01)
    free = settled(thermal_problem(), (RIGID, SOFT_1, SOFT_2, RIGID), [0.0, 40.0, 1.0, 0.0])
    assert free is not None
    assert found.finish_s == pytest.approx(free.finish_s)


def test_a_liquid_start_goes_first_and_may_share_a_phase_while_it_coasts() -> None:
    """From 85 C segment 1 stays liquid for 91 s without heat; segment 2 melts in 63 s."""
    warm = thermal_problem(temperature_C=(85.0, 25.0), heaters_at_once=1)
    sequence = (SOFT_1, SOFT_BOTH, RIGID)
    assert thermal_model(warm).refusal(sequence, RIGID) is None
    found = settled(warm, sequence, [1.0, 20.0, 0.0])
    assert found is not None
    assert found.violated() == []
    assert settled(warm, sequence, [1.0, 40.0, 0.0]) is None  # it would freeze meanwhile
    cool = thermal_problem(temperature_C=(66.0, 25.0), heaters_at_once=1)
    assert settled(cool, sequence, [1.0, 1.0, 0.0]) is None
    modes = [RIGID, SOFT_BOTH, SOFT_1]
    result = plan(bending(V1, (0.0, 0.0), (20.0, 20.0), (85.0, 25.0), modes=modes))
    assert result.found
    assert SOFT_BOTH in [phase.mode for phase in result.plan.phases]


@pytest.mark.parametrize("quantile", [None, 0.8, 0.95])
@pytest.mark.parametrize("ambient_C", [5.0, 25.0, 35.0])
def test_no_segment_of_the_papers_robot_coasts_while_the_other_one_melts(
    ambient_C: float, quantile: float | None
) -> None:
    """What the refusal of two overlapping melts rests on: 18.8 s of coasting, 36.4 s to melt."""
    problem = thermal_problem(ambient_C=ambient_C, transition_quantile=quantile)
    least = LeastTimes(thermal_model(problem).plans[0], problem.start_states[0])
    assert least.longest_coasting_s < min(least.melting_s, least.first_melting_s)


def test_what_coasting_makes_possible_is_not_called_impossible() -> None:
    """In air of 45 C metal coasts for 40 s; a segment at 60.9 C melts in 36 s when it may."""
    given = {"ambient_C": 45.0, "temperature_C": (45.0, 60.9)}
    heating = thermal_model(thermal_problem(**given)).plans[0]
    model, full_A = heating.model, heating.melt_current_A
    one, two = model.initial(45.0), model.initial(60.9)
    hot = model.time_until(one, full_A, model.level_at(heating.soft_setpoint_C))
    one, two = model.propagate(one, full_A, hot), model.propagate(two, 0.0, hot)
    melting = model.time_until(two, full_A, model.liquid_level)
    assert melting < model.time_until(one, 0.0, model.liquid_level) - 3.0  # both are liquid then
    modes = {"modes": [RIGID, SOFT_BOTH], "heaters_at_once": 1}
    assert thermal_model(thermal_problem(**given, **modes)).refusal((SOFT_BOTH,), RIGID) is None
    assert plan(thermal_problem(**given, **modes, max_phases=2)).status is Status.FAILED
    cold = {**given, "temperature_C": (45.0, 45.0)}
    assert thermal_model(thermal_problem(**cold, **modes)).refusal((SOFT_BOTH,), RIGID)


def test_metal_coasts_while_the_other_segment_melts() -> None:
    """Both are soft at once with one heater: one after the other takes 159 s."""
    problem = bending(V2, (16.4, 4.3), (-10.9, 7.1), (47.4, 50.3), work_limit=1000)
    assert plan(problem).require().cost.total < 115.0
    assert not both_on(problem)


@timings
@pytest.mark.parametrize(
    ("sequence", "last", "refused"),
    [
        ((RIGID, SOFT_1, SOFT_2, RIGID), RIGID, False),
        ((RIGID, SOFT_1, RIGID, SOFT_1, RIGID), RIGID, False),
        ((RIGID, SOFT_1, SOFT_BOTH, RIGID), RIGID, True),
        ((RIGID, SOFT_BOTH), SOFT_1, True),
        ((RIGID, SOFT_1), SOFT_2, False),
        ((RIGID, SOFT_1), SOFT_BOTH, True),
    ],
)
def test_sequences_that_need_both_heaters_are_refused_with_one_only(
    sequence: ModeSequence, last: tuple[int, int], refused: bool, timing: str
) -> None:
    for heaters in (1, 2):
        model = transition_model(thermal_problem(timing=timing, heaters_at_once=heaters))
        expected = ONE_HEATER if refused and heaters == 1 else None
        assert model.refusal(sequence, last) == expected
