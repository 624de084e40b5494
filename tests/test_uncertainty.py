"""Windows that hold a share of real transitions: from the ranges of the robot's own parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray
from thermal_problems import V1, V2, settled, thermal_model, thermal_problem, transitions_of

from twosra_mpc import InputError, Problem, Robot, plan
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH, ModeSequence
from twosra_mpc.thermal.model import SegmentModel
from twosra_mpc.thermal.uncertainty import EXACT, Windows, drawn
from twosra_mpc.timing import Transition

Array = NDArray[np.float64]


def windows(robot: Robot, ambient_C: float, quantile: float) -> Windows:
    """The windows of a robot's segments."""
    problem = thermal_problem(robot, ambient_C=ambient_C, transition_quantile=quantile)
    return thermal_model(problem).plans[0].windows


def draws(robot: Robot, ambient_C: float, count: int, seed: int) -> list[SegmentModel]:
    """Segments that a robot may have."""
    rng, nominal = np.random.default_rng(seed), segment_model(robot, ambient_C, 0)
    return [drawn(nominal, robot.thermal_segment(0).ranges, rng) for _ in range(count)]


QUANTILES = (0.5, 0.75, 0.95)
SEQUENCES: list[ModeSequence] = [
    (RIGID, SOFT_1, RIGID),
    (RIGID, SOFT_1, SOFT_BOTH, RIGID),
    (RIGID, SOFT_1, SOFT_2, SOFT_1, RIGID),
    (RIGID, SOFT_1, RIGID, SOFT_1, RIGID),
]
robots = pytest.mark.parametrize("robot", [V1, V2], ids=lambda robot: robot.name)
quantiles = pytest.mark.parametrize("quantile", [0.75, 0.9])


@robots
@pytest.mark.parametrize("ambient_C", [5.0, 45.0])
def test_windows_grow_with_the_quantile_about_the_nominal_times(
    robot: Robot, ambient_C: float
) -> None:
    found = np.array([windows(robot, ambient_C, quantile) for quantile in QUANTILES])
    early, late = found[:, [0, 2]], found[:, [1, 3]]
    assert (np.diff(early, axis=0) <= 0).all()
    assert (np.diff(late, axis=0) >= 0).all()
    assert (early <= 1.0).all()
    assert (late >= 1.0).all()
    assert found[0] == pytest.approx(1.0, abs=0.02)  # a median robot is nearly nominal
    assert (early[-1] < 0.99).all()
    assert (late[-1] > 1.01).all()


@robots
@pytest.mark.parametrize("sequence", SEQUENCES)
def test_a_plan_that_holds_more_often_is_not_shorter(robot: Robot, sequence: ModeSequence) -> None:
    durations = [1.0 if any(mode) else 20.0 for mode in sequence]
    ends = []
    for quantile in (None, *QUANTILES):
        found = settled(thermal_problem(robot, transition_quantile=quantile), sequence, durations)
        assert found is not None
        ends.append(found.finish_s)
    assert ends == sorted(ends)
    assert ends[1] == pytest.approx(ends[0], rel=0.02)
    assert ends[-1] > 1.03 * ends[0]


@robots
def test_draws_vary_about_the_nominal_values_within_their_ranges(robot: Robot) -> None:
    nominal = segment_model(robot, 25.0, 0)
    some = draws(robot, 25.0, 2000, seed=5)
    ranges = robot.thermal_segment(0).ranges
    for name, value in vars(nominal).items():
        values = np.array([getattr(model, name) for model in some])
        if name not in ranges:
            assert (values == value).all(), name
            continue
        low, high = ranges[name]
        assert np.mean(values < value) == pytest.approx(0.5, abs=0.04)
        assert np.mean(values < low) == pytest.approx(0.05, abs=0.015), name
        assert np.mean(values > high) == pytest.approx(0.05, abs=0.015), name
    assert some == draws(robot, 25.0, 2000, seed=5)


# --- what drawn robots do under the heater times of a plan ---------------------------------------


def executed(
    model: SegmentModel, setpoint_C: float, current_A: float, planned: Sequence[Transition]
) -> list[tuple[float, float]]:
    """(onset, done) of each transition of a cold segment heated and switched off as planned."""
    state, t, holding = model.initial(model.ambient_C), 0.0, False
    seen = []
    for item in planned:
        state = heated(model, state, item.heater_s - t, setpoint_C, current_A if holding else 0.0)
        t, holding = item.heater_s, item.to == "soft"
        levels = [model.solid_level, model.liquid_level]
        if not holding:
            levels.reverse()
        current = current_A if holding else 0.0
        onset, done = (model.time_until(state, current, level) for level in levels)
        already = (model.level(state) > model.solid_level) == holding
        seen.append((t if already else t + onset, t + done))
    return seen


def heated(
    model: SegmentModel, state: tuple[float, ...], span: float, setpoint_C: float, current_A: float
) -> tuple[float, ...]:
    """Full current up to the set-point, then hold it; without current, cool."""
    if current_A == 0.0:
        return model.propagate(state, 0.0, span)
    reached = model.time_until(state, current_A, model.level_at(setpoint_C))
    state = model.propagate(state, current_A, min(reached, span))
    return model.hold(state, max(0.0, span - reached))


def drawn_spans(problem: Problem, seed: int) -> Iterator[tuple[Transition, Array, Array]]:
    """Each planned transition, and when drawn robots begin and have done it."""
    found = settled(problem, (RIGID, SOFT_1, RIGID), [0.0, 30.0, 0.0])
    assert found is not None
    planned, heater = transitions_of(problem, found.network, found.times), problem.robot.heater
    seen = np.array(
        [
            executed(model, heater.soft_setpoint_C, heater.melt_current_A, planned)
            for model in draws(problem.robot, problem.ambient, 400, seed)
        ]
    )
    for i, item in enumerate(planned):
        yield item, seen[:, i, 0], seen[:, i, 1]


@robots
@quantiles
def test_drawn_robots_stay_within_the_windows_of_a_plan_as_often_as_asked(
    robot: Robot, quantile: float
) -> None:
    problem = thermal_problem(robot, transition_quantile=quantile)
    for item, begun_s, done_s in drawn_spans(problem, seed=11):
        early, late = begun_s >= item.onset_s - 1e-6, done_s <= item.done_s + 1e-6
        assert early.mean() >= quantile - 0.05, item
        assert late.mean() >= quantile - 0.05, item
        assert min(early.mean(), late.mean()) <= quantile + 0.15, "wider than asked"


@robots
def test_without_a_quantile_about_half_of_the_robots_are_late(robot: Robot) -> None:
    for item, _, done_s in drawn_spans(thermal_problem(robot), seed=12):
        assert 0.3 < (done_s <= item.done_s + 1e-6).mean() < 0.7


# --- where there are no windows ------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("quantile", [0.9, 0.99])
def test_air_in_which_many_robots_would_not_freeze_has_no_windows(quantile: float) -> None:
    """At 60.5 C a robot that melts at 60.4 C stays liquid; its windows were nominal once."""
    with pytest.raises(InputError, match=r"in air of 60\.5 C too many") as caught:
        windows(V1, 60.5, quantile)
    assert (caught.value.field, caught.value.value) == ("transition_quantile", quantile)
    problem = thermal_problem(V1, ambient_C=60.5, transition_quantile=quantile)
    with pytest.raises(InputError, match="transition_quantile"):
        plan(problem)


@robots
def test_a_robot_that_is_known_exactly_has_no_windows(robot: Robot) -> None:
    assert robot.segment is not None
    known = robot.segment.with_values(ranges={})
    exact = robot.with_values(segment=known, name=f"{robot.name} known")
    assert windows(exact, 25.0, 0.95) == EXACT == Windows(1.0, 1.0, 1.0, 1.0)
