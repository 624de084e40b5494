"""Driving by hand: what is sent, what is refused, and that the robot stands at the end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from conftest import Run
from once import planned
from simulated_firmware import SimulatedFirmware

from twosra_mpc import InputError, Robot, load_robot
from twosra_mpc.execution.robot_interface import RobotError
from twosra_mpc.execution.settings import Patience
from twosra_mpc.lab.bench.jog import Jog, jog, wheels_of_twist
from twosra_mpc.lab.serial.robot import RATE_HZ, STOPS

STILL, COLD = np.zeros(4), (0, 0)
ROBOT = load_robot("2sra-v1")
LIMITS = ROBOT.limits


@pytest.fixture
def firmware() -> Iterator[SimulatedFirmware]:
    """A robot that lets full current flow as long as it is told to."""
    made = SimulatedFirmware(planned("rigid-move"), regulates=False)
    yield made
    made.close()


def assert_off(firmware: SimulatedFirmware) -> None:
    firmware.receive()
    last = firmware.received[-STOPS:]
    assert not any(any(item.wheel_rad_s) or any(item.heated) for item in last)


def test_options_turn_the_wheels_so_far_and_no_speed_jumps(firmware: SimulatedFirmware) -> None:
    wheels = wheels_of_twist(ROBOT, (0.02, -0.01, 0.1))
    jog(ROBOT, firmware.port, firmware, Jog(wheels, COLD), 3.0)
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


def test_reports_switch_the_heater_off_before_it_is_too_hot(firmware: SimulatedFirmware) -> None:
    jog(ROBOT, firmware.port, firmware, Jog(STILL, (1, 0)), 120.0)
    assert firmware.segments[0].melt_fraction == 1.0
    assert 62.0 < firmware.hottest_C < ROBOT.heater.temperature_max_C - 5.0
    assert firmware.segments[1].temperature_C < 26.0
    assert_off(firmware)


def test_without_reports_only_cold_segments_are_heated_and_by_the_model(
    firmware: SimulatedFirmware,
) -> None:
    firmware.reports = lambda _t, _j, _temperature: b""
    asked = Jog(STILL, (0, 1)), 120.0
    with pytest.raises(RobotError, match=r"no temperature is reported: heat only .* \(--cold\)"):
        jog(ROBOT, firmware.port, firmware, *asked, patience=Patience(listen_s=1.0))
    assert firmware.hottest_C < 26.0
    jog(ROBOT, firmware.port, firmware, *asked, cold=True)
    assert firmware.segments[1].melt_fraction == 1.0
    assert firmware.hottest_C < ROBOT.heater.soft_setpoint_C + 3.0
    assert_off(firmware)


def test_a_segment_that_is_too_hot_ends_it(firmware: SimulatedFirmware) -> None:
    firmware.reports = lambda t, j, T: b"%c%.1f\n" % (65 + j, T if t < 4 else 90)
    with pytest.raises(RobotError, match="segment 1: too hot, 90"):
        jog(ROBOT, firmware.port, firmware, Jog(STILL, COLD), 10.0)
    assert_off(firmware)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--forward", "0.06", "--for", "1"), "at most limits.speed_m_s of the robot, 0.05 m/s"),
        (("--turn", "-0.4", "--for", "1"), "at most limits.turn_rate_rad_s of the robot, 0.3"),
        (("--wheel", "2", "11", "--for", "1"), "wheel 2 = 11.0 is not acceptable"),
        (("--wheel", "5", "1", "--for", "1"), "Invalid value for '--wheel'"),
        (("--forward", "nan", "--for", "1"), "speed = nan is not acceptable"),
        (("--heat", "3", "--for", "1"), "heat = 3 is not acceptable; allowed: a segment from 1"),
        (("--forward", "0.01", "--for", "0"), "for = 0.0 is not acceptable"),
        (("--wheel", "1", "1"), "Missing option '--for'"),
    ],
)
def test_bad_input_is_refused(run: Run, arguments: tuple[str, ...], words: str) -> None:
    outcome = run("jog", "--robot", "2sra-v1", "--dry-run", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert words in outcome.err


def test_a_dry_run_sends_the_robots_number(run: Run) -> None:
    outcome = run("jog", "--robot", "2sr-v2", "--forward", "0.01", "--for", "0.5", "--dry-run")
    lines = outcome.out.split()[1::2]
    assert outcome.code == 0
    assert all(line.endswith("\\n1\\n") and line.count("\\n") == 7 for line in lines)
    assert "s0.000\\n-1.000\\n0.000\\n-1.000\\n0\\n0\\n1\\n" in lines


def bare() -> Robot:
    """A robot whose file says nothing of heat, with constant times only."""
    robot = load_robot("2sra-v1")
    return robot.with_values(segment=None, timing={"constant": robot.timing["constant"]})


def test_a_robot_without_a_thermal_model_is_driven_but_never_heated() -> None:
    firmware = SimulatedFirmware(planned("rigid-move"), reports=lambda *_: b"")
    robot, wheels = bare(), np.array([1.0, 0.0, -1.0, 0.0])
    jog(robot, firmware.port, firmware, Jog(wheels, COLD), 0.5)
    assert any(any(item.wheel_rad_s) for item in firmware.received)
    with pytest.raises(RobotError, match="nobody knows when it is hot"):
        jog(robot, firmware.port, firmware, Jog(0 * wheels, (1, 0)), 0.5, cold=True)
    assert_off(firmware)
    firmware.close()


def test_a_speed_that_is_no_number_is_refused_by_robots_without_that_limit() -> None:
    with pytest.raises(InputError, match="turn = nan"):
        wheels_of_twist(load_robot("2sra-v1-paper"), (0.0, 0.0, float("nan")))
