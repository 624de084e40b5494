"""A robot driven by hand, for a time: the first thing to do with a new one.

Speeds rise and fall within the robot's acceleration; at the end the robot stands, heaters off.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.execution.robot_interface import Reading, RobotError
from twosra_mpc.execution.settings import Patience
from twosra_mpc.lab.serial.port import Clock, Port
from twosra_mpc.lab.serial.robot import RATE_HZ, connected
from twosra_mpc.problem.limits import drive_rows
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode

_ROUNDING = 1e-9  # relative; of a speed at its limit


class Jog(NamedTuple):
    """Wheel speeds, (4,) [rad/s], and the segments to heat."""

    wheel_rad_s: Array
    heated: Mode


def wheels_of_twist(robot: Robot, twist: tuple[float, float, float]) -> Array:
    """Wheel speeds of a straight, solid robot, (4,) [rad/s].

    Args:
        robot: The robot.
        twist: Speed along x and y of its middle, and turning rate [m/s, m/s, rad/s].

    Raises:
        InputError: If it is beyond the robot's limits.
    """
    limits, (along, across, turn) = robot.limits, twist
    speed = float(np.hypot(along, across))
    _check("speed", speed, limits.speed_m_s, "speed_m_s", "m/s")
    _check("turn", abs(turn), limits.turn_rate_rad_s, "turn_rate_rad_s", "rad/s")
    wheels: Array = drive_rows(robot, np.zeros(robot.coordinates.segments))[1] @ np.array(twist)
    return wheels


def _check(name: str, value: float, limit: float | None, key: str, unit: str) -> None:
    if not np.isfinite(value):
        raise InputError(name, value, f"a number [{unit}]")
    if limit is not None and value > limit * (1 + _ROUNDING):
        raise InputError(name, value, f"at most limits.{key} of the robot, {limit:zg} {unit}")


def jog(
    robot: Robot,
    port: Port,
    clock: Clock,
    asked: Jog,
    duration_s: float,
    *,
    cold: bool = False,
    patience: Patience | None = None,
    on_reading: Callable[[Reading, Jog], None] = lambda reading, jog: None,
) -> None:
    """Drive a robot by what is asked for; it stands, heaters off, at the end.

    Args:
        robot: The robot.
        port: The line to it.
        clock: Time.
        asked: Wheel speeds and segments to heat.
        duration_s: For how long, ramps included.
        cold: Whether its segments are known to be as cold as the air, so that one that does not
            report may be heated by the model.
        patience: How long to wait for what.
        on_reading: Called with what is known, and what was sent, every period.

    Raises:
        InputError: If the time is not positive, or the wheels are asked for more than their limit.
        RobotError: If a segment is too hot or silent, or is to be heated and nobody knows how warm
            it is; or the line does not work any more.
    """
    for wheel, speed in enumerate(np.abs(asked.wheel_rad_s).tolist(), start=1):
        most = robot.limits.wheel_speed_rad_s
        _check(f"wheel {wheel}", speed, most, "wheel_speed_rad_s", "rad/s")
    if not 0 < duration_s < np.inf:
        raise InputError("for", duration_s, "a positive time [s]")
    anywhere = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0}
    start = {**anywhere, "kappa_per_m": (0.0,) * robot.coordinates.segments}
    given = {"robot": robot, "start": start, "goal": anywhere, "timing": next(iter(robot.timing))}
    heater, heated = robot.heater, np.array(asked.heated) == 1
    setpoint_C = np.where(heated, heater.soft_setpoint_C, heater.rigid_setpoint_C)
    fastest = max(float(np.abs(asked.wheel_rad_s).max()), _ROUNDING)
    rise_per_s = (robot.limits.wheel_acceleration_rad_s2 or np.inf) / fastest
    with connected(Problem.parse(given, robot.name), port, clock, patience=patience) as line:
        line.listen()
        if heated.any() and not (line.reports or cold):
            words = "no temperature is reported: heat only segments that are surely cold"
            raise RobotError(f"{words}, and say so (--cold)")
        begun_s, period_s = clock.now_s(), 1.0 / RATE_HZ
        while (past_s := clock.now_s() - begun_s) < duration_s - _ROUNDING:
            share = min(1.0, rise_per_s * min(past_s + period_s, duration_s - past_s))
            sent = asked._replace(wheel_rad_s=share * asked.wheel_rad_s)
            line.send(sent.wheel_rad_s, setpoint_C)
            line.wait(period_s)
            on_reading(line.read(), sent)


def heated_mode(robot: Robot, segments: tuple[int, ...]) -> Mode:
    """Mode in which segments (from 1) are heated.

    Raises:
        InputError: If there is none of that number.
    """
    count = robot.coordinates.segments
    for segment in segments:
        if not 1 <= segment <= count:
            raise InputError("heat", segment, f"a segment from 1 to {count}")
    return tuple(int(j + 1 in segments) for j in range(count))
