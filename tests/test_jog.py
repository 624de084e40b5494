"""Driving by hand: what must be held, what is refused, and that the robot stands at the end."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
from conftest import Run
from once import planned
from simulated_firmware import SimulatedFirmware, assert_off

from twosra_mpc import InputError, Robot, load_robot
from twosra_mpc.errors import RobotError
from twosra_mpc.execution.settings import Patience
from twosra_mpc.lab.bench.jog import (
    HEATED_S,
    HELD_S,
    Jog,
    Keys,
    for_a_time,
    jog,
    ramped,
    wheels_of_twist,
)
from twosra_mpc.lab.serial.port import stop_command
from twosra_mpc.lab.serial.robot import RATE_HZ, STOPS

STOP = stop_command(2)
STILL, COLD = np.zeros(4), (0, 0)
ROBOT = load_robot("2sra-v1")
LIMITS = ROBOT.limits


@pytest.fixture
def firmware() -> Iterator[SimulatedFirmware]:
    """A robot that lets full current flow as long as it is told to."""
    made = SimulatedFirmware(planned("rigid-move"), regulates=False)
    yield made
    made.close()


def test_options_turn_the_wheels_so_far_and_no_speed_jumps(firmware: SimulatedFirmware) -> None:
    wheels = wheels_of_twist(ROBOT, (0.02, -0.01, 0.1))
    jog(ROBOT, firmware.port, firmware, for_a_time(ROBOT, Jog(wheels, COLD), 3.0))
    assert_off(firmware)
    sent = np.array([item.wheel_rad_s for item in firmware.received])
    most = LIMITS.wheel_acceleration_rad_s2
    assert most is not None
    assert np.abs(np.diff(sent, axis=0)).max() <= most / RATE_HZ + 2e-3
    travel = sent.sum(axis=0) / RATE_HZ
    rise_s = np.abs(wheels).max() / most
    np.testing.assert_allclose(travel, wheels * (3.0 - rise_s), atol=np.abs(wheels).max() / RATE_HZ)


def test_forward_rolls_the_robot_forward() -> None:
    from twosra_mpc.model.rolling import NO_DRIFT, rolling

    for twist in ((0.02, 0.0, 0.0), (0.0, 0.02, 0.0), (0.0, 0.0, 0.2)):
        turned = 0.1 * wheels_of_twist(ROBOT, twist)
        after = rolling(ROBOT, COLD)(np.zeros(5), turned, NO_DRIFT).full().ravel()
        np.testing.assert_allclose(after[:3], 0.1 * np.array(twist), atol=1e-9)


def test_a_key_that_is_not_held_stops_the_wheels_within_a_fraction_of_a_second(
    firmware: SimulatedFirmware,
) -> None:
    began: list[float] = []

    def typed() -> str:
        began.append(firmware.now_s())
        since = began[-1] - began[0]
        if since > 4.0:
            return "x"
        return "w" if since < 2.0 and len(began) % 5 == 0 else ""

    jog(ROBOT, firmware.port, firmware, Keys(ROBOT, typed, 0.01, 0.1))
    moved = [move.time_s - began[0] for move in firmware.moves]
    assert 0.2 < moved[0] < 0.4
    assert max(np.diff(moved)) < 0.1
    assert 2.0 < moved[-1] < 2.0 + HELD_S + 0.1
    assert_off(firmware)


def test_keys_mean_what_the_help_says() -> None:
    typed = list[str]()
    keys = Keys(ROBOT, lambda: typed.pop() if typed else "", 0.01, 0.1)

    def after(key: str, time_s: float) -> Jog:
        typed.append(key)
        found = keys(time_s)
        assert found is not None
        return found

    forward = wheels_of_twist(ROBOT, (0.01, 0.0, 0.0))
    np.testing.assert_allclose(after("w", 1.0).wheel_rad_s, forward)
    np.testing.assert_allclose(after("s", 1.1).wheel_rad_s, -forward)
    turned = wheels_of_twist(ROBOT, (0.0, 0.0, -0.1))
    np.testing.assert_allclose(after("d", 1.2).wheel_rad_s, turned)
    assert after("3", 1.3).wheel_rad_s.tolist() == [0.0, 0.0, 1.0, 0.0]
    assert not after("-", 1.4).wheel_rad_s.any()
    assert after("3", 1.5).wheel_rad_s.tolist() == [0.0, 0.0, -1.0, 0.0]
    assert not after("z", 1.6).wheel_rad_s.any()
    assert after("j", 1.7).heated == (0, 1)
    assert after("l", 1.8).heated == (0, 1)  # there is no segment 4
    assert after("", 1.8 + HEATED_S).heated == (0, 1)
    assert after("", 1.9 + HEATED_S).heated == (0, 0)
    typed.append("x")
    assert keys(200.0) is None


def test_speeds_rise_in_ramps_along_a_line_and_stop_at_once() -> None:
    wanted = np.array([3.0, -1.5, 0.0, 0.0])
    np.testing.assert_allclose(ramped(STILL, wanted, 1.0), [1.0, -0.5, 0.0, 0.0])
    np.testing.assert_allclose(ramped(wanted, STILL, 1.0), STILL)


def test_reports_switch_the_heater_off_before_it_is_too_hot(firmware: SimulatedFirmware) -> None:
    jog(ROBOT, firmware.port, firmware, for_a_time(ROBOT, Jog(STILL, (1, 0)), 120.0))
    assert firmware.segments[0].melt_fraction == 1.0
    assert 62.0 < firmware.hottest_C < ROBOT.heater.temperature_max_C - 5.0
    assert firmware.segments[1].temperature_C < 26.0
    assert_off(firmware)


def test_without_reports_only_cold_segments_are_heated_and_by_the_model(
    firmware: SimulatedFirmware,
) -> None:
    firmware.reports = lambda _t, _j, _temperature: b""
    asked = for_a_time(ROBOT, Jog(STILL, (0, 1)), 120.0)
    with pytest.raises(RobotError, match=r"no temperature is reported: heat only .* \(--cold\)"):
        jog(ROBOT, firmware.port, firmware, asked, patience=Patience(listen_s=1.0))
    assert firmware.hottest_C < 26.0
    jog(ROBOT, firmware.port, firmware, asked, cold=True)
    assert firmware.segments[1].melt_fraction == 1.0
    assert firmware.hottest_C < ROBOT.heater.soft_setpoint_C + 3.0
    assert_off(firmware)


def test_a_segment_that_is_too_hot_ends_it(firmware: SimulatedFirmware) -> None:
    firmware.reports = lambda t, j, T: b"%c%.1f\n" % (65 + j, T if t < 4 else 90)
    with pytest.raises(RobotError, match="segment 1: too hot, 90"):
        jog(ROBOT, firmware.port, firmware, for_a_time(ROBOT, Jog(STILL, COLD), 10.0))
    assert_off(firmware)


def test_a_dry_run_sends_the_robots_number(run: Run) -> None:
    outcome = run("jog", "--robot", "2sr-v2", "--forward", "0.01", "--for", "0.5", "--dry-run")
    lines = outcome.out.split()[1::2]
    assert outcome.code == 0
    assert all(line.endswith("\\n1\\n") and line.count("\\n") == 7 for line in lines)
    assert "s0.000\\n-1.000\\n0.000\\n-1.000\\n0\\n0\\n1\\n" in lines


def test_keys_beyond_the_limits_are_refused() -> None:
    with pytest.raises(InputError, match=r"limits\.speed_m_s"):
        Keys(ROBOT, lambda: "", 0.06, 0.1)


def test_the_program_takes_keys_and_stops_when_its_terminal_closes() -> None:
    line, robot_end = os.openpty()
    child, terminal = pty.openpty()
    asked = ["jog", "--robot", "2sra-v1", "--port", os.ttyname(robot_end)]
    program = subprocess.Popen(
        [sys.executable, "-m", "twosra_mpc", *asked],
        stdin=terminal,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(terminal)
    heard, until_s = b"", time.monotonic() + 30.0
    while b"s0.000\n1.000\n0.000\n-1.000\n" not in heard:
        assert time.monotonic() < until_s, heard[-100:]
        os.write(child, b"w")
        if select.select([line], [], [], 0.05)[0]:
            heard += os.read(line, 1024)
        if heard.count(b"s") < 6:
            os.write(line, b"A25.0\nB25.0\n")
    os.close(child)
    while not heard.endswith(STOP * STOPS):
        assert select.select([line], [], [], 10.0)[0], heard[-100:]
        heard += os.read(line, 1024)
    assert program.wait(20) in (0, 4)
    os.close(line)
    os.close(robot_end)


def bare() -> Robot:
    """A robot whose file says nothing of heat, with constant times only."""
    robot = load_robot("2sra-v1")
    return robot.with_values(segment=None, timing={"constant": robot.timing["constant"]})


def test_a_robot_without_a_thermal_model_is_driven_but_never_heated() -> None:
    firmware = SimulatedFirmware(planned("rigid-move"), reports=lambda *_: b"")
    robot, wheels = bare(), np.array([1.0, 0.0, -1.0, 0.0])
    jog(robot, firmware.port, firmware, for_a_time(robot, Jog(wheels, COLD), 0.5))
    assert any(any(item.wheel_rad_s) for item in firmware.received)
    heat = for_a_time(robot, Jog(0 * wheels, (1, 0)), 0.5)
    with pytest.raises(RobotError, match="nobody knows when it is hot"):
        jog(robot, firmware.port, firmware, heat, cold=True)
    assert_off(firmware)
    firmware.close()


def test_a_speed_that_is_no_number_is_refused_by_robots_without_that_limit() -> None:
    with pytest.raises(InputError, match="turn = nan"):
        wheels_of_twist(load_robot("2sra-v1-paper"), (0.0, 0.0, float("nan")))
