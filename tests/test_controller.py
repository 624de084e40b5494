"""The stiffness controller step by step: PI law, limits, trip, faults, what it remembers."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twosra_mpc.control.stiffness_controller import (
    CURRENT_GAINS,
    POWER_GAINS,
    ControllerState,
    Event,
    StiffnessController,
    stiffness_controller,
)
from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import load_robot
from twosra_mpc.robot.modes import Stiffness

STEP_S = 0.1
PAPER = stiffness_controller(load_robot("2sra-v1"), 25.0, 0)
LOGGED = stiffness_controller(load_robot("2sr-v2"), 22.6, 0)
BOTH = pytest.mark.parametrize("controller", [PAPER, LOGGED], ids=["v1", "v2"])

READINGS_C = st.lists(st.floats(0.0, 120.0), min_size=1, max_size=40)


def reading_C(controller: StiffnessController, segment_C: float) -> float:
    """What the sensor shows of a segment that has long had this temperature."""
    return controller.ambient_C + controller.sensor_gain * (segment_C - controller.ambient_C)


def stepped(
    controller: StiffnessController,
    state: ControllerState,
    setpoint: Stiffness,
    segment_C: float,
    seconds: float = STEP_S,
) -> tuple[ControllerState, list[Event]]:
    """Steps with one temperature of the segment, as its sensor shows it."""
    events: list[Event] = []
    for _ in range(round(seconds / STEP_S)):
        state, news = controller.step(state, setpoint, reading_C(controller, segment_C), STEP_S)
        events += news
    return state, events


def started(controller: StiffnessController, segment_C: float) -> ControllerState:
    """The controller's state at a temperature of the segment."""
    return controller.start(reading_C(controller, segment_C))


# --- the PI law ----------------------------------------------------------------------------------


def test_output_is_proportional_part_plus_integrator() -> None:
    output, integrator = PAPER.pi_law(0.1, 64.0, 0.1)
    assert output == pytest.approx(0.20 * 1.0 + 0.1)
    assert integrator == pytest.approx(0.1 + 0.004 * 1.0 * 0.1)


def test_the_integrator_stops_while_the_output_is_saturated_towards_the_error() -> None:
    assert PAPER.pi_law(0.1, 25.0, 0.1) == (0.8, 0.1)
    assert PAPER.pi_law(0.1, 80.0, 0.1) == (0.0, 0.1)
    output, integrator = PAPER.pi_law(0.3, 66.0, 0.1)  # unwinds
    assert output == pytest.approx(0.1)
    assert integrator < 0.3


def test_the_integrator_is_clamped_to_what_holding_needs() -> None:
    assert PAPER.pi_law(0.35, 64.9, 0.1)[1] == 0.35
    assert PAPER.pi_law(0.0, 65.1, 0.1)[1] == 0.0
    assert (CURRENT_GAINS.integrator_max, POWER_GAINS.integrator_max) == (0.35, 0.5)


def test_a_share_of_power_goes_with_the_square_of_the_current() -> None:
    """4 K below the set-point: a share of 0.4 of full power, 0.63 of full current."""
    state, _ = stepped(LOGGED, started(LOGGED, 70.5), "soft", 70.5)
    assert state.current_A == pytest.approx(0.8 * math.sqrt(0.10 * 4.0))
    state, _ = stepped(PAPER, started(PAPER, 61.0), "soft", 61.0)
    assert state.current_A == pytest.approx(0.20 * 4.0)


def test_the_sensor_is_scaled_to_the_segment() -> None:
    """Rescaled temperature Ta + (y - Ta) / gain; the follow-up robot's is not used any more."""
    scaled = replace(LOGGED, sensor_gain=0.75)
    assert scaled.segment_C(54.4) == pytest.approx(22.6 + (54.4 - 22.6) / 0.75)
    assert LOGGED.segment_C(54.4) == pytest.approx(54.4)
    assert PAPER.segment_C(54.4) == pytest.approx(54.4)


@BOTH
@given(readings=READINGS_C, setpoints=st.lists(st.booleans(), min_size=40, max_size=40))
def test_current_and_integrator_stay_within_their_limits(
    controller: StiffnessController, readings: list[float], setpoints: list[bool]
) -> None:
    state = controller.start(readings[0])
    for reading, soft in zip(readings, setpoints, strict=False):
        state, _ = controller.step(state, "soft" if soft else "rigid", reading, 0.2)
        assert 0.0 <= state.current_A <= controller.full_current_A
        assert 0.0 <= state.integrator <= controller.gains.integrator_max
        assert soft or state.current_A == 0.0
    assert controller.full_current_A <= load_robot("2sra-v1").heater.current_max_A


def test_gains_can_be_given() -> None:
    gentle = replace(CURRENT_GAINS, proportional_per_K=0.10, integral_per_K_s=0.002)
    controller = stiffness_controller(load_robot("2sra-v1"), 25.0, 0, gentle)
    assert controller.gains is gentle


# --- trip ----------------------------------------------------------------------------------------


@BOTH
def test_the_heater_trips_at_85_and_is_on_again_below_80(controller: StiffnessController) -> None:
    hungry = replace(controller, soft_setpoint_C=100.0)  # so that only the trip stops it
    state, events = stepped(hungry, started(hungry, 84.0), "soft", 84.0)
    assert state.current_A > 0
    state, events = stepped(hungry, state, "soft", 85.1)
    assert state.current_A == 0.0
    assert [event.kind for event in events] == ["tripped"]
    state, events = stepped(hungry, state, "soft", 80.2, 5.0)
    assert (state.current_A, events) == (0.0, [])
    state, events = stepped(hungry, state, "soft", 79.8, 0.3)
    assert state.current_A > 0
    assert [event.kind for event in events] == ["cleared"]


# --- faults --------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_no_reading_is_a_fault_and_switches_off(
    controller: StiffnessController, broken: float
) -> None:
    state, _ = stepped(controller, started(controller, 65.0), "soft", 64.0, 2.0)
    assert state.current_A > 0
    state, events = controller.step(state, "soft", broken, STEP_S)
    assert (state.current_A, state.integrator, state.protection) == (0.0, 0.0, "fault")
    assert [event.kind for event in events] == ["fault", "changing"]
    assert {event.stiffness for event in events} == {"changing"}
    assert events[0].time_s == pytest.approx(2.1)
    assert controller.step(state, "soft", broken, STEP_S)[1] == ()


@BOTH
def test_a_fault_lasts_until_a_good_reading_under_the_setpoint_rigid(
    controller: StiffnessController,
) -> None:
    state, _ = controller.step(started(controller, 40.0), "soft", math.nan, STEP_S)
    state, events = stepped(controller, state, "soft", 40.0, 5.0)
    assert (state.protection, state.current_A, events) == ("fault", 0.0, [])
    state, _ = controller.step(state, "rigid", math.nan, STEP_S)
    assert state.protection == "fault"
    state, events = stepped(controller, state, "rigid", 40.0)
    assert (state.protection, state.stiffness) == ("none", "changing")
    assert [event.kind for event in events] == ["cleared"]
    assert state.time_s == pytest.approx(5.3)
    state, _ = stepped(controller, state, "soft", 40.0)
    assert state.current_A == controller.full_current_A


@BOTH
def test_after_a_fault_the_sensor_must_show_anew_that_the_segment_is_rigid(
    controller: StiffnessController,
) -> None:
    state, _ = controller.step(started(controller, 40.0), "rigid", math.nan, STEP_S)
    state, events = stepped(controller, state, "rigid", 40.0, 25.0)
    assert state.stiffness == "changing"
    state, events = stepped(controller, state, "rigid", 40.0, 10.0)
    assert [event.kind for event in events] == ["rigid"]


@BOTH
def test_a_sensor_that_has_come_off_is_a_fault(controller: StiffnessController) -> None:
    """It reads the air, however hot the segment gets; the trip would never see it."""
    state, events = stepped(controller, started(controller, 25.0), "soft", 25.0, 30.0)
    assert (state.protection, state.current_A) == ("fault", 0.0)
    fault = next(event for event in events if event.kind == "fault")
    assert fault.time_s < 21.0


@BOTH
def test_one_reading_that_is_far_off_changes_nothing(controller: StiffnessController) -> None:
    """One K from the set-point, where the integrator moves the current by less than the limit."""
    held_C = controller.soft_setpoint_C - 1.0
    state, _ = stepped(controller, started(controller, held_C), "soft", held_C, 3.0)
    assert 0 < state.current_A < controller.full_current_A
    for spike_C in (84.0, 30.0):
        after, events = stepped(controller, state, "soft", spike_C)
        assert not events
        assert after.current_A == pytest.approx(state.current_A, abs=1e-3)


# --- memory --------------------------------------------------------------------------------------


@BOTH
def test_a_rested_segment_is_known_by_its_temperature(controller: StiffnessController) -> None:
    melting = (controller.rule.solid_below_C + controller.rule.liquid_above_C) / 2
    known = {t: started(controller, t).stiffness for t in (30.0, melting, 66.0)}
    assert known == {30.0: "rigid", melting: "changing", 66.0: "soft"}
    assert controller.melt_fraction(started(controller, 30.0)) == 0.0
    assert controller.melt_fraction(started(controller, melting)) == pytest.approx(0.5)
    assert controller.melt_fraction(started(controller, 66.0)) == 1.0


@BOTH
def test_a_step_is_a_function_of_its_arguments(controller: StiffnessController) -> None:
    state, _ = stepped(controller, started(controller, 50.0), "soft", 55.0, 3.0)
    before = replace(state)
    once = stepped(controller, state, "soft", 58.0)
    assert stepped(controller, state, "soft", 58.0) == once
    assert state == before
    with pytest.raises(FrozenInstanceError):
        state.current_A = 1.0  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        controller.trip_C = 1000.0  # type: ignore[misc]


@BOTH
@pytest.mark.parametrize("dt_s", [0.0, -0.1, math.nan, math.inf])
def test_time_must_pass(controller: StiffnessController, dt_s: float) -> None:
    with pytest.raises(InputError, match="dt_s"):
        controller.step(started(controller, 30.0), "soft", 30.0, dt_s)


@BOTH
def test_a_start_needs_a_reading(controller: StiffnessController) -> None:
    with pytest.raises(InputError, match="measured_C"):
        controller.start(math.nan)


def test_a_robot_without_a_thermal_description_has_no_controller() -> None:
    robot = load_robot("2sra-v1")
    timing = {"constant": robot.timing["constant"]}
    bare = robot.with_values(segment=None, timing=timing)
    with pytest.raises(InputError, match=r"segment = None .* thermal description"):
        stiffness_controller(bare, 25.0, 0)


@pytest.mark.parametrize("name", ["2sra-v1", "2sr-v2"])
def test_nothing_would_freeze_in_such_air(name: str) -> None:
    with pytest.raises(InputError, match=r"ambient_C = 59\.0 .* below which"):
        stiffness_controller(load_robot(name), 59.0, 0)
