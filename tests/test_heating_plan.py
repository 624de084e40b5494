"""How a segment is heated: as late as the schedule allows, and kept warm only where that pays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from thermal_problems import (
    SPANS_S,
    V1,
    V2,
    History,
    history,
    settled,
    thermal_model,
    thermal_problem,
    thermal_problems,
    transitions_of,
)

from twosra_mpc import Problem, Robot
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, Stiffness
from twosra_mpc.thermal.heating import (
    HeatingPlan,
    KeepWarm,
    SegmentTransition,
    TemperatureTrajectory,
)
from twosra_mpc.thermal.model import State

TWO_SOFT_PHASES = (RIGID, SOFT_1, RIGID, SOFT_1, RIGID)
robots = pytest.mark.parametrize("robot", [V1, V2], ids=lambda robot: robot.name)


def heating_of(problem: Problem) -> HeatingPlan:
    return thermal_model(problem).plans[0]


def made(
    heating: HeatingPlan, start_C: float, onsets: list[tuple[Stiffness, float]]
) -> tuple[TemperatureTrajectory, list[SegmentTransition]]:
    """The temperature trajectory of a segment that is solid at the start."""
    return heating.heated(heating.model.initial(start_C), soft=False, onsets=onsets)


# --- what happens when ---------------------------------------------------------------------------


@given(
    problem=thermal_problems(transition_quantile=None),
    waits=st.lists(st.floats(0.0, 500.0), min_size=4, max_size=4),
)
def test_the_metal_passes_its_thresholds_when_the_trajectory_says(
    problem: Problem, waits: list[float]
) -> None:
    heating, model = heating_of(problem), heating_of(problem).model
    soft = bool(problem.start_mode[0])
    kinds: list[Stiffness] = ["soft", "rigid", "soft", "rigid"]
    asked = list(zip(kinds[soft:], np.cumsum(waits), strict=False))
    trajectory, timed = heating.heated(problem.start_states[0], soft, asked)
    span = model.liquid_level - model.solid_level
    before, first = 0.0, model.level(problem.start_states[0])
    changing = model.solid_level < first < model.liquid_level
    for (to, onset), item in zip(asked, timed, strict=True):
        assert item.to == to
        goes_on = changing and item is timed[0]  # or turns back: at t = 0
        assert item.onset_s == 0.0 if goes_on else item.onset_s >= onset - 1e-6
        if item.onset_s > onset + 1e-6:  # as soon as it can
            assert item.heater_s == before
        assert before - 1e-6 <= item.heater_s <= item.onset_s + 1e-9 <= item.done_s + 1e-9
        levels = [model.level(trajectory.state_at(t)) for t in (item.onset_s, item.done_s)]
        ends = [model.solid_level, model.liquid_level][:: 1 if to == "soft" else -1]
        ends[0] = first if goes_on else ends[0]
        assert levels == pytest.approx(ends, abs=1e-6 * span)
        before = item.done_s


@given(problem=thermal_problems(), spans=SPANS_S)
def test_currents_that_vary_are_sampled_with_their_energy_and_effect(
    problem: Problem, spans: list[float]
) -> None:
    found = history(problem, TWO_SOFT_PHASES, spans)
    trajectory, model = found.trajectories[0], heating_of(problem).model
    t = np.unique([*np.arange(0.0, found.finish_s, 5.0), *trajectory.event_times(), found.finish_s])
    t = t[t <= found.finish_s]
    state, energy = problem.start_states[0], 0.0
    for current, span in zip(
        trajectory.current_A(t)[:-1].tolist(), np.diff(t).tolist(), strict=True
    ):
        energy += model.energy_J(state, current, span)
        state = model.propagate(state, current, span)
    assert energy == pytest.approx(trajectory.energy_J(found.finish_s), rel=1e-4, abs=1e-3)
    end_C = model.temperature_C(trajectory.state_at(found.finish_s))
    assert model.temperature_C(state) == pytest.approx(end_C, abs=0.02)


def test_set_points_say_what_the_heater_does() -> None:
    heating = heating_of(thermal_problem(transition_quantile=0.8, heating="keep_warm"))
    trajectory, timed = made(heating, 25.0, [("soft", 100.0), ("rigid", 300.0), ("soft", 1500.0)])
    first, freeze, second = timed
    t = np.array([0.0, first.heater_s, freeze.heater_s - 1, freeze.heater_s, second.heater_s - 1])
    assert trajectory.setpoint_C(t).tolist() == [25.0, 65.0, 65.0, 25.0, 58.0]
    assert trajectory.setpoint_C(np.array([second.heater_s])).tolist() == [65.0]


# --- as late as possible -------------------------------------------------------------------------


def held_early(heating: HeatingPlan, state: State, lead_s: float) -> float:
    """Energy of heating at once to the plateau and waiting there, still solid."""
    model = heating.model
    needed = model.time_until(state, heating.melt_current_A, model.solid_level)
    at = model.propagate(state, heating.melt_current_A, needed)
    energy = model.energy_J(state, heating.melt_current_A, needed)
    return energy + model.holding_energy_J(at, lead_s - needed)


def heated_slowly(heating: HeatingPlan, state: State, lead_s: float) -> float:
    """Energy of a smaller current that reaches the plateau just in time."""
    model = heating.model

    def late(current: float) -> float:
        return model.level(model.propagate(state, current, lead_s)) - model.solid_level

    current = float(brentq(late, 0.0, heating.melt_current_A, xtol=1e-14))
    return model.energy_J(state, current, lead_s)


@robots
@given(start_C=st.floats(5.0, 50.0), wait=st.floats(60.0, 900.0), earlier=st.floats(0.01, 1.0))
def test_heating_earlier_takes_more_energy(
    robot: Robot, start_C: float, wait: float, earlier: float
) -> None:
    heating = heating_of(thermal_problem(robot))
    trajectory, (melt,) = made(heating, start_C, [("soft", wait)])
    assert melt.onset_s == pytest.approx(wait)
    late_J = trajectory.energy_J(melt.onset_s)
    on = melt.heater_s * (1 - earlier)
    for way in (held_early, heated_slowly):
        early_J = way(heating, trajectory.state_at(on), wait - on)
        assert early_J >= late_J - 1e-6
        if melt.heater_s - on > 20.0:
            assert early_J > late_J + 0.1


@robots
@given(start_C=st.floats(5.0, 50.0), wait=st.floats(60.0, 900.0), later=st.floats(0.01, 5.0))
def test_the_heater_goes_on_at_the_latest_and_off_at_the_earliest(
    robot: Robot, start_C: float, wait: float, later: float
) -> None:
    heating, model = heating_of(thermal_problem(robot)), heating_of(thermal_problem(robot)).model
    asked: list[tuple[Stiffness, float]] = [("soft", wait), ("rigid", 2 * wait + 50.0)]
    trajectory, (melt, freeze) = made(heating, start_C, asked)
    cold, _ = made(heating, start_C, [])
    missed = cold.state_at(melt.heater_s + later)
    until = model.time_until(missed, heating.melt_current_A, model.solid_level)
    assert melt.heater_s + later + until > melt.onset_s + 1e-6
    early = trajectory.state_at(max(melt.done_s, freeze.heater_s - later))
    off = max(melt.done_s, freeze.heater_s - later)
    coasting = model.time_until(early, 0.0, model.liquid_level)
    assert off == melt.done_s or off + coasting < freeze.onset_s - 1e-6


@robots
def test_holding_on_until_the_freeze_takes_more_energy(robot: Robot) -> None:
    heating, model = heating_of(thermal_problem(robot)), heating_of(thermal_problem(robot)).model
    trajectory, (melt, freeze) = made(heating, 25.0, [("soft", 100.0), ("rigid", 400.0)])
    unfrozen, _ = made(heating, 25.0, [("soft", 100.0)])
    assert melt.done_s < freeze.heater_s < freeze.onset_s
    assert trajectory.energy_J(freeze.onset_s) < unfrozen.energy_J(freeze.onset_s) - 1.0
    setpoint = model.level_at(heating.soft_setpoint_C)
    assert model.level(unfrozen.state_at(freeze.onset_s)) == pytest.approx(setpoint)


# --- kept warm -----------------------------------------------------------------------------------


def kept_warm(found: History) -> bool:
    """Whether segment 1 is held at a temperature at which it is solid."""
    return any(
        piece.current_A is None and piece.setpoint_C < 60.0
        for piece in found.trajectories[0].pieces
    )


def idle(robot: Robot, idle_s: float, **overrides: object) -> tuple[Problem, History]:
    """Two soft phases of 1 s of segment 1 with a drive in between."""
    problem = thermal_problem(robot, **overrides)
    found = settled(problem, TWO_SOFT_PHASES, [0.0, 1.0, idle_s, 1.0, 0.0])
    assert found is not None
    return problem, found


@pytest.mark.parametrize("quantile", [0.6, 0.8, 0.95])
@pytest.mark.parametrize("price", [0.0, 0.02, 0.1, 1.0])
@pytest.mark.parametrize("idle_s", [0.0, 60.0, 600.0])
def test_keeping_warm_never_costs_more(quantile: float, price: float, idle_s: float) -> None:
    costs = []
    for heating in ("fastest", "keep_warm"):
        weights = {"energy_s_per_J": price}
        _, found = idle(V1, idle_s, transition_quantile=quantile, weights=weights, heating=heating)
        costs.append(found.finish_s + price * found.energy_J)
        assert not kept_warm(found) or heating == "keep_warm"
    if kept_warm(found):
        assert costs[1] < costs[0]
    else:
        assert costs[1] == pytest.approx(costs[0])


@pytest.mark.parametrize("quantile", [0.8, 0.95])
def test_without_a_price_a_drive_in_between_keeps_the_segment_warm(quantile: float) -> None:
    """At 0.95 and 600 s apart this saves 18 s of the window, for 278 J."""
    (_, fast), (_, warm) = (
        idle(V1, 600.0, transition_quantile=quantile, heating=heating)
        for heating in ("fastest", "keep_warm")
    )
    assert kept_warm(warm)
    assert not kept_warm(fast)
    assert warm.finish_s < fast.finish_s - 5.0
    assert warm.energy_J > fast.energy_J + 200.0
    trajectory = warm.trajectories[0]
    held = next(piece for piece in trajectory.pieces if piece.setpoint_C == 58.0)
    assert trajectory.model.temperature_C(held.state) == pytest.approx(58.0)


@given(
    quantile=st.sampled_from([0.6, 0.8, 0.95]),
    gap=st.floats(0.0, 2000.0),
    factor=st.floats(0.5, 1.5).filter(lambda factor: abs(factor - 1) > 1e-3),
)
def test_a_segment_is_kept_warm_exactly_where_the_energy_costs_less_than_the_time(
    quantile: float, gap: float, factor: float
) -> None:
    heating = heating_of(thermal_problem(transition_quantile=quantile))
    _, timed = made(heating, 25.0, [("soft", 0.0), ("rigid", 0.0)])
    asked: list[tuple[Stiffness, float]]
    asked = [("soft", 0.0), ("rigid", 0.0), ("soft", timed[1].done_s + gap)]
    cold, (*_, late) = made(heating, 25.0, asked)
    free = replace(heating, keep_warm=KeepWarm(58.0, 0.0))
    warm, (*_, soon) = made(free, 25.0, asked)
    saved = late.done_s - soon.done_s
    spent = warm.energy_J(soon.done_s) - cold.energy_J(late.done_s)
    if saved == 0.0:
        assert warm.pieces == cold.pieces
        return
    assert saved > 0.0
    if spent <= 0.0:
        return
    priced = replace(heating, keep_warm=KeepWarm(58.0, factor * saved / spent))
    trajectory, _ = made(priced, 25.0, asked)
    assert trajectory.pieces == (warm.pieces if factor < 1 else cold.pieces)


@pytest.mark.parametrize("idle_s", [0.0, 30.0, 600.0])
@robots
def test_without_a_window_nothing_is_kept_warm(robot: Robot, idle_s: float) -> None:
    """Heating is hidden in the drive then: warm metal would melt no sooner."""
    _, found = idle(robot, idle_s, heating="keep_warm")
    assert not kept_warm(found)
    assert found.energy_J == idle(robot, idle_s)[1].energy_J


def test_a_single_heater_keeps_nothing_warm() -> None:
    """Another segment may need it: in mode [0,1] heater 1 is off."""
    given = {"transition_quantile": 0.95, "heating": "keep_warm", "heaters_at_once": 1}
    problem = thermal_problem(**given)
    found = settled(problem, (RIGID, SOFT_1, SOFT_2, SOFT_1, RIGID), [0.0, 1.0, 1.0, 1.0, 0.0])
    assert found is not None
    assert not kept_warm(found)
    t = np.arange(0.0, found.finish_s, 0.5)
    assert not np.all(
        [trajectory.current_A(t) > 0 for trajectory in found.trajectories], axis=0
    ).any()
    assert len(transitions_of(problem, found.network, found.times)) == 6


@robots
@pytest.mark.parametrize("idle_s", [0.0, 30.0, 120.0, 600.0])
def test_keeping_warm_does_not_make_up_for_a_later_freeze(robot: Robot, idle_s: float) -> None:
    """A body that was kept warm melts sooner and freezes later; both count."""
    finish = [
        idle(robot, idle_s, transition_quantile=0.8, heating=heating)[1].finish_s
        for heating in ("fastest", "keep_warm")
    ]
    assert finish[1] <= finish[0] + 1e-6
