"""A plan over a serial line: what arrives is the plan, and at the end the robot stands."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from once import planned
from problems import ROBOT
from simulated_firmware import SimulatedFirmware, assert_off

from twosra_mpc import InputError, Mode, NoPlanError, Plan, Robot, load_problem, load_robot
from twosra_mpc import plan as find_plan
from twosra_mpc.execution.run import Drive
from twosra_mpc.execution.settings import Patience
from twosra_mpc.lab.serial.playing import WheelCommand, wheel_commands
from twosra_mpc.lab.serial.port import PortError, SteppedClock, SystemClock, stop_command
from twosra_mpc.lab.serial.robot import STOPS
from twosra_mpc.lab.serial.segments import ModelledSegment
from twosra_mpc.lab.serial.stream import Confirm, StreamError, StreamState, stream
from twosra_mpc.robot.modes import RIGID

RATE_HZ, SLOW_HZ = 15.0, 5.0
SILENT: Callable[[float, int, float], bytes] = lambda _t, _j, _temperature: b""  # noqa: E731
# Metal that may take four times as long to melt: readings of 61 C contradict no heat for a while.
LONG_MELTS = ROBOT.with_values(
    segment=ROBOT.segment.with_values(ranges={**ROBOT.segment.ranges, "latent_J": (131.0, 600.0)})
)


def send(
    plan: Plan, firmware: SimulatedFirmware, rate_Hz: float = SLOW_HZ, **options: object
) -> tuple[Drive, ...]:
    return stream(plan, firmware.port, firmware, rate_Hz=rate_Hz, **options).drives  # type: ignore[arg-type]


def reporting(plan: Plan, shown_C: Callable[[float, float], float]) -> SimulatedFirmware:
    """Firmware that shows something else than its time and temperature would have it show."""
    return SimulatedFirmware(plan, lambda t, j, T: b"%c%.1f\n" % (65 + j, shown_C(t, T)))


def regulating(robot: Robot) -> Robot:
    """The robot whose file says that its firmware regulates, as the simulated one does."""
    return robot.with_values(heater=robot.heater.with_values(hold_duty=1.0))


def commands_of(plan: Plan, rate_Hz: float = SLOW_HZ) -> list[tuple[Mode, WheelCommand]]:
    """Every wheel command of a plan, with the mode it needs."""
    return [
        (phase.mode, order)
        for phase in plan.phases
        for order in wheel_commands(plan.trajectory, phase, rate_Hz)
    ]


# --- wheel commands ------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_Hz", [3.0, 15.0, 120.0])
@pytest.mark.parametrize("scenario", ["paper-1", "paper-2"])
def test_commands_turn_the_wheels_as_far_as_the_plan_and_never_faster(
    scenario: str, rate_Hz: float
) -> None:
    plan = planned(scenario)
    for phase in plan.phases:
        orders = wheel_commands(plan.trajectory, phase, rate_Hz)
        samples, trajectory = plan.samples, plan.trajectory
        inside = (samples.t_s[:-1] >= phase.start_s - 1e-9) & (
            samples.t_s[:-1] < phase.end_s - 1e-9
        )
        travel = np.diff(trajectory.wheel_travel_rad(phase[1:]), axis=0)[0]
        sent = np.sum([order.wheel_rad_s for order in orders], axis=0) / rate_Hz
        np.testing.assert_allclose(sent, travel, atol=1e-12)
        ends = samples.wheel_rad_s[:-1][inside], trajectory.wheel_rad_s_before[inside]
        fastest = np.abs(np.concatenate(ends)).max(axis=0)
        assert (np.max(np.abs([o.wheel_rad_s for o in orders]), axis=0) <= fastest + 1e-9).all()
        lasts = len(orders) / rate_Hz
        assert 0 <= lasts - (phase.end_s - phase.start_s) + 1e-9 <= 1 / rate_Hz + 1e-9


# --- to the end ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "bend", "rate_Hz"),
    [("paper-2", None, RATE_HZ), ("three-segments", (0.0, -15.0, 0.0), SLOW_HZ)],
)
def test_confirmed_phases_are_sent_as_planned_and_only_when_the_metal_is_ready(
    scenario: str, bend: tuple[float, ...] | None, rate_Hz: float
) -> None:
    goal = load_problem(scenario).goal
    if bend:
        goal = goal.with_values(kappa_per_m=bend)
    plan = planned(scenario, robot=regulating(load_problem(scenario).robot), goal=goal)
    firmware = SimulatedFirmware(plan)
    drives = send(plan, firmware, rate_Hz, confirm=Confirm.REQUIRED)
    expected = commands_of(plan, rate_Hz)
    assert [move.truly_soft for move in firmware.moves] == [mode for mode, _ in expected]
    np.testing.assert_allclose(
        [move.wheel_rad_s for move in firmware.moves],
        [order.wheel_rad_s for _, order in expected],
        atol=5.001e-4,  # three decimals
    )
    assert [drive.mode for drive in drives] == [phase.mode for phase in plan.phases]
    assert not any(segment.soft for segment in firmware.segments)
    assert_off(firmware)


def test_without_reports_everything_happens_at_the_plans_times_and_is_told_again() -> None:
    plan = planned("paper-2", transition_quantile=0.9)
    firmware = SimulatedFirmware(plan, SILENT)
    drives = send(plan, firmware, RATE_HZ, confirm=Confirm.NEVER)
    begun_s = drives[0].start_s - plan.phases[0].start_s
    for drive, phase in zip(drives, plan.phases, strict=True):
        assert abs(drive.start_s - begun_s - phase.start_s) < 0.2
    soft_C = plan.robot.heater.soft_setpoint_C
    for item in firmware.received[:-STOPS]:
        if item.time_s < begun_s or any(item.wheel_rad_s):
            continue
        at = np.abs(plan.samples.t_s - (item.time_s - begun_s)) > 0.3  # a period or two of slack
        before = np.searchsorted(plan.samples.t_s, item.time_s - begun_s, side="right") - 1
        if at.all():
            planned_soft = plan.samples.heater_setpoint_C[before] >= soft_C
            assert (item.heated <= planned_soft).all()  # pulses hold it
    assert abs(firmware.now_s() - begun_s - plan.samples.t_s[-1]) < 0.6
    times = [item.time_s for item in firmware.received]
    assert 0.9 < np.diff(times).max() < 1.1  # a standing robot is told again: within 1.3 s
    assert_off(firmware)


@pytest.mark.parametrize("confirm", Confirm)
@pytest.mark.parametrize(("robot", "bend"), [("2sra-v1", 30.0), ("2sr-v2", 10.0)])
def test_firmware_that_does_not_regulate_melts_what_must_be_soft_and_overheats_nothing(
    confirm: Confirm, robot: str, bend: float
) -> None:
    asked: dict[str, object] = {"goal": {"kappa_per_m": [bend, 0.0]}, "robot": robot}
    if confirm is Confirm.NEVER:
        asked["transition_quantile"] = 0.9
    plan = find_plan(load_problem("shape-change", **asked)).require()
    firmware = SimulatedFirmware(plan, regulates=False, numbers=int(robot == "2sr-v2"))
    if confirm is Confirm.NEVER:
        firmware.reports = SILENT
    send(plan, firmware, confirm=confirm)
    modes = [mode for mode, _ in commands_of(plan)]
    assert [move.truly_soft for move in firmware.moves] == modes
    soft_C = plan.robot.heater.soft_setpoint_C
    assert soft_C - 4.0 < firmware.hottest_C < soft_C + (3.0 if confirm is Confirm.NEVER else 15.0)
    assert not any(segment.soft for segment in firmware.segments)
    assert_off(firmware)


def test_a_heater_holds_by_pulses_unless_the_firmware_is_known_to_regulate() -> None:
    robot = load_robot("2sra-v1")
    told = regulating(robot)
    times_s = np.arange(0.0, 600.0, 0.2).tolist()
    pulsed, left_on = (ModelledSegment(each, 25.0, 0, 25.0, 0.0) for each in (robot, told))
    on = np.array([pulsed.switched(True, time_s) for time_s in times_s])
    assert all(left_on.switched(True, time_s) for time_s in times_s)
    assert on[: int(60 / 0.2)].all()
    assert on[-1000:].mean() == pytest.approx(robot.heater.duty_of_hold, rel=0.05)
    soft_C = robot.heater.soft_setpoint_C
    assert soft_C - 0.3 < pulsed.model.temperature_C(pulsed.state) < soft_C + 1.5
    assert not pulsed.switched(False, 601.0)


def test_a_plan_that_waits_for_no_slow_metal_is_not_sent_without_reports() -> None:
    port = FailingPort(0, -1)
    with pytest.raises(InputError, match="transition_quantile") as caught:
        stream(planned("paper-2"), port, SteppedClock(), confirm=Confirm.NEVER)
    assert "nothing confirms that a segment is soft or rigid" in str(caught.value)
    assert not port.tries


def test_reports_that_do_not_change_are_reports() -> None:
    plan = planned("rigid-move")
    firmware = SimulatedFirmware(plan, reports=lambda _t, j, _temperature: b"%c24.9\n" % (65 + j))
    assert send(plan, firmware, patience=Patience(silent_s=1.0))


def test_single_readings_that_are_far_off_and_lines_that_are_none_change_nothing() -> None:
    plan, lines = planned("paper-2"), iter(range(10**6))

    def noisy(_time_s: float, segment: int, temperature_C: float) -> bytes:
        name, number = 65 + segment, next(lines)
        if number % 14 == 6:
            return b"%c99.0\n" % name
        if number % 14 == 9:
            return b"%c-12\n" % name
        rubbish = [b"", b"\xff\xfe\n", b"Anan\n", b"B1e9\nA\n", b"ready\r\n\n"][number % 5]
        return rubbish + b"%c%.2f\r\n" % (name, temperature_C)

    firmware = SimulatedFirmware(plan, reports=noisy)
    send(plan, firmware, confirm=Confirm.REQUIRED)
    modes = [mode for mode, _ in commands_of(plan)]
    assert [move.truly_soft for move in firmware.moves] == modes
    assert_off(firmware)


def test_a_slow_computer_turns_the_wheels_no_further_and_tells_its_state_in_words() -> None:
    plan, states = planned("paper-2"), list[StreamState]()
    firmware = SimulatedFirmware(plan)

    def dawdle(state: StreamState) -> None:
        firmware.sleep(0.01)
        states.append(state)

    drives = send(plan, firmware, on_state=dawdle)
    for drive, phase in zip(drives, plan.phases, strict=True):
        periods = len(wheel_commands(plan.trajectory, phase, SLOW_HZ))
        assert abs(drive.end_s - drive.start_s - periods / SLOW_HZ) < 1e-3
    told = list(dict.fromkeys(state.during for state in states))
    assert told == [
        "listening for temperatures",
        "in phase 1 of 2 [0,0]",
        "waiting for phase 2 of 2 [1,0]",
        "in phase 2 of 2 [1,0]",
        "waiting for the end [0,0]",
    ]
    assert any("segment 1 changing at 5" in state.known for state in states)


def test_the_number_of_the_robot_ends_each_command() -> None:
    plan = planned("rigid-move", robot=ROBOT.with_values(robot_id=12))
    firmware = SimulatedFirmware(plan, numbers=1)
    send(plan, firmware)
    assert {item.tail for item in firmware.received} == {(12,)}
    assert_off(firmware)


# --- other endings -------------------------------------------------------------------------------


@pytest.mark.parametrize("when_s", [0.4, 2.0, 40.0])
def test_a_signal_stops_the_robot_however_often_it_comes(when_s: float) -> None:
    """Of those that can be caught, one: see test_serial_line."""
    number = signal.SIGTERM
    plan, before = planned("paper-2"), signal.getsignal(number)
    firmware = SimulatedFirmware(plan)
    for again_s in (0.0, 0.02, 0.1, 0.2, 0.27):
        firmware.at[when_s + again_s] = lambda: os.kill(os.getpid(), number)
    with pytest.raises(KeyboardInterrupt):
        send(plan, firmware)
    assert firmware.now_s() < when_s + 1.0
    assert_off(firmware)
    assert signal.getsignal(number) == before


def test_an_error_of_the_caller_stops_the_robot() -> None:
    plan = planned("paper-2")
    firmware = SimulatedFirmware(plan)

    def fail(state: StreamState) -> None:
        if state.time_s > 30:
            raise RuntimeError("the terminal is gone")

    with pytest.raises(RuntimeError, match="the terminal is gone"):
        send(plan, firmware, on_state=fail)
    assert_off(firmware)


@pytest.mark.parametrize("rubbish", [b"", b"~\x00\n"])
def test_firmware_that_falls_silent_is_an_error(rubbish: bytes) -> None:
    plan = planned("paper-2")

    def until_30(time_s: float, segment: int, temperature_C: float) -> bytes:
        return b"%c%.2f\n" % (65 + segment, temperature_C) if time_s < 30 else rubbish

    firmware = SimulatedFirmware(plan, reports=until_30)
    words = r"waiting for phase 2 of 2 \[1,0\]: segment 1: no readable temperature report for 5 s"
    with pytest.raises(StreamError, match=words):
        send(plan, firmware)
    assert 30 < firmware.now_s() < 37
    assert_off(firmware)


FAILURES: dict[str, tuple[dict[str, Any], set[Mode]]] = {  # and in which modes it has moved
    "segment 2 does not report": (
        {"reports": lambda _t, j, T: b"A%.1f\n" % T if j == 0 else b""},
        set(),
    ),
    "no temperature report within 5 s": ({"reports": SILENT}, set()),
    "segment 1: heating does not warm it": ({"broken_heaters": (0,)}, {RIGID}),
    "segment 1: too hot, 90": (
        {"reports": lambda t, j, T: b"%c%.1f\n" % (65 + j, T if t < 50 else 90)},
        {RIGID},
    ),
}


@pytest.mark.parametrize("words", FAILURES)
def test_a_failure_is_an_error_that_says_which(words: str) -> None:
    plan, (made, moved) = planned("paper-2"), FAILURES[words]
    firmware = SimulatedFirmware(plan, **made)
    with pytest.raises(StreamError, match=words):
        send(plan, firmware)
    assert {move.truly_soft for move in firmware.moves} == moved
    assert_off(firmware)


@pytest.mark.parametrize("late", [1.5, 2.5])  # by default 3, and its sensor is found to lie before
def test_a_mode_is_waited_for_as_long_as_the_patience_says(late: float) -> None:
    plan = planned("paper-2", robot=LONG_MELTS)
    firmware = reporting(plan, lambda _t, T: min(T, 61.0))
    words = r"segment 1: changing at 61\.0 C, not soft after \d+ s: the heater is too weak"
    with pytest.raises(StreamError, match=words) as caught:
        send(plan, firmware, patience=Patience(late=late))
    melt = plan.transitions[0]
    heated_s = next(item.time_s for item in firmware.received if item.heated == (1, 0))
    waited_s = caught.value.time_s - heated_s
    assert waited_s == pytest.approx(late * (melt.done_s - melt.heater_s), abs=2.0)
    assert {move.truly_soft for move in firmware.moves} == {(0, 0)}
    assert_off(firmware)


def test_the_wheels_stop_while_a_segment_is_not_what_the_phase_needs() -> None:
    limits = ROBOT.limits.with_values(unit_speed_m_s=0.003)
    plan = planned("paper-2", robot=regulating(ROBOT.with_values(limits=limits)))
    firmware = SimulatedFirmware(plan)
    first = len(wheel_commands(plan.trajectory, plan.phases[0], SLOW_HZ))
    lost: list[float] = []
    lasts_s = 1.5  # a sensor that jumps for longer has failed

    def cold(time_s: float, segment: int, temperature_C: float) -> bytes:
        """For a moment in the middle of the second phase, segment 1 seems to be cold."""
        if segment == 0 and len(firmware.moves) > first + 20:
            lost.append(time_s)
            temperature_C = 25.0 if time_s < lost[0] + lasts_s else temperature_C
        return b"%c%.2f\n" % (65 + segment, temperature_C)

    firmware.reports = cold
    send(plan, firmware)
    times = np.array([move.time_s for move in firmware.moves[first:]])
    gap = int(np.argmax(np.diff(times)))
    assert lost[0] < times[gap] < lost[0] + 1.5
    assert lost[0] + lasts_s < times[gap + 1] < lost[0] + lasts_s + 10
    assert len(firmware.moves) == len(commands_of(plan))
    assert_off(firmware)


@pytest.mark.parametrize(
    ("when_s", "during"),
    [(0.4, "before the plan began"), (2.0, "in phase 1 of 2"), (30.0, "waiting for phase 2 of 2")],
)
def test_a_dead_line_is_an_error_that_tells_when_and_to_switch_off(
    when_s: float, during: str
) -> None:
    plan = planned("paper-2")
    firmware = SimulatedFirmware(plan)
    firmware.at[when_s] = firmware.die
    with pytest.raises(StreamError, match="could NOT be told to stop: switch it off") as caught:
        send(plan, firmware)
    assert caught.value.during.startswith(during)
    assert when_s <= caught.value.time_s < when_s + 2.0


class FailingPort:
    """A port whose writes fail from one number to another; an interrupt comes with the first."""

    def __init__(self, first: int, last: float) -> None:
        self.first, self.last = first, last
        self.sent: list[bytes] = []
        self.tries = 0

    def write(self, data: bytes) -> None:
        self.tries += 1
        if self.first <= self.tries <= self.last:
            os.kill(os.getpid(), signal.SIGINT)
            raise PortError("cannot write")
        self.sent.append(data)

    def read_lines(self) -> list[bytes]:
        return []


@pytest.mark.parametrize(
    ("last", "words"), [(10, "the robot was told to stop"), (math.inf, "could NOT be told to stop")]
)
def test_a_line_that_fails_once_carries_the_stop_and_a_dead_one_is_told_even_of_an_interrupt(
    last: float, words: str
) -> None:
    plan, port = planned("paper-2", transition_quantile=0.9), FailingPort(10, last)
    with pytest.raises(StreamError, match=f"cannot write; .*{words}"):
        stream(plan, port, SteppedClock(), confirm=Confirm.NEVER)
    assert port.tries >= 10 + STOPS
    stops = port.sent[9:]
    assert set(stops) <= {stop_command(2)}
    assert len(stops) >= STOPS if last == 10 else not stops


def test_an_interrupt_while_the_robot_is_being_stopped_changes_nothing() -> None:
    plan, clock, port = planned("rigid-move"), SteppedClock(), FailingPort(0, -1)
    write = port.write

    def interrupted(data: bytes) -> None:
        if data == stop_command(2):
            os.kill(os.getpid(), signal.SIGINT)
        write(data)

    port.write = interrupted  # type: ignore[method-assign]
    stream(plan, port, clock, confirm=Confirm.NEVER)
    assert port.sent[-STOPS:] == [stop_command(2)] * STOPS


def test_outside_of_the_main_thread_signals_are_left_alone() -> None:
    plan, port = planned("rigid-move"), FailingPort(0, -1)
    worker = threading.Thread(
        target=stream, args=(plan, port, SteppedClock()), kwargs={"confirm": Confirm.NEVER}
    )
    worker.start()
    worker.join(60)
    assert port.sent[-STOPS:] == [stop_command(2)] * STOPS


def test_a_computer_that_is_held_up_while_driving_is_an_error() -> None:
    plan = planned("paper-2")
    firmware = SimulatedFirmware(plan)
    firmware.at[2.0] = lambda: firmware.sleep(3.0)
    with pytest.raises(StreamError, match=r"held up for 3\.\d s with turning wheels"):
        send(plan, firmware, RATE_HZ)
    assert_off(firmware)


# --- refused -------------------------------------------------------------------------------------


class Untouched:
    """A port that must not be used."""

    def write(self, data: bytes) -> None:
        raise AssertionError(data)

    def read_lines(self) -> list[bytes]:
        raise AssertionError


def test_a_plan_that_does_not_verify_is_refused() -> None:
    from dataclasses import replace

    plan = planned("paper-2")
    wheels = plan.samples.wheel_rad_s.copy()
    wheels[3] += 0.5
    samples = replace(plan.samples, wheel_rad_s=wheels)
    forged = replace(plan, trajectory=replace(plan.trajectory, samples=samples))
    with pytest.raises(
        NoPlanError, match=r"verified again, at .* a wheel's speed jumps by 0.5 rad/s"
    ):
        stream(forged, Untouched(), SystemClock())


@pytest.mark.parametrize("rate_Hz", [0.0, 0.5, 201.0, float("nan"), float("inf")])
def test_a_rate_that_the_line_does_not_carry_is_refused(rate_Hz: float) -> None:
    with pytest.raises(InputError, match=r"from 1 to 200 Hz|a finite number"):
        stream(planned("paper-2"), Untouched(), SystemClock(), rate_Hz=rate_Hz)


def test_the_system_clock_goes_on_by_itself() -> None:
    clock, begun = SystemClock(), time.monotonic()
    clock.sleep(0.01)
    assert 0.01 <= clock.now_s() <= time.monotonic() - begun + 0.01
