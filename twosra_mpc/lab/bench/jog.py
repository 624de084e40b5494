"""A robot driven by hand, a little at a time: the first thing to do with a new one.

Whatever asks for motion, a key that is held or options with a time, is asked again every period;
speeds rise within the robot's acceleration, and fall to zero at once when nothing is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twosra_mpc import InputError, Mode, Problem, Robot
from twosra_mpc.errors import RobotError
from twosra_mpc.execution.robot_interface import Reading
from twosra_mpc.execution.settings import Patience
from twosra_mpc.lab.serial.port import Clock, Port
from twosra_mpc.lab.serial.robot import RATE_HZ, connected
from twosra_mpc.problem.speeds import drive_rows
from twosra_mpc.robot.coordinates import WHEELS, Array

HELD_S = 0.5  # a key that has not come again for so long is not held; keyboards repeat by then
HEATED_S = 120.0  # without any key heaters go off after so long; a melt takes a minute
_ROUNDING = 1e-9  # relative, of speeds and times


class Jog(NamedTuple):
    """Command of the moment: wheel speeds, (4,) [rad/s], and the segments to heat."""

    wheel_rad_s: Array
    heated: Mode


Asked = Callable[[float], Jog | None]  # of the time since the start [s]; None: that is all


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
    check_wheels(robot, wheels)
    return wheels


def check_wheels(robot: Robot, wheel_rad_s: Array) -> None:
    """Refuse wheel speeds (4,) beyond the robot's limit.

    Raises:
        InputError: If one is.
    """
    limit = robot.limits.wheel_speed_rad_s
    for wheel, speed in enumerate(np.abs(wheel_rad_s).tolist(), start=1):
        _check(f"wheel {wheel}", speed, limit, "wheel_speed_rad_s", "rad/s")


def _check(name: str, value: float, limit: float | None, key: str, unit: str) -> None:
    if not np.isfinite(value):
        raise InputError(name, value, f"a number [{unit}]")
    if limit is not None and value > limit * (1 + _ROUNDING):
        raise InputError(name, value, f"at most limits.{key} of the robot, {limit:zg} {unit}")


def for_a_time(robot: Robot, jog: Jog, duration_s: float) -> Asked:
    """Ask for something for so long; speeds rise and fall within the robot's acceleration.

    Raises:
        InputError: If the time is not positive, or the wheels are asked for more than their limit.
    """
    check_wheels(robot, jog.wheel_rad_s)
    if not 0 < duration_s < np.inf:
        raise InputError("for", duration_s, "a positive time [s]")
    fastest = max(float(np.abs(jog.wheel_rad_s).max()), _ROUNDING)
    rise_per_s = (robot.limits.wheel_acceleration_rad_s2 or np.inf) / fastest

    def asked(time_s: float) -> Jog | None:
        left_s = duration_s - time_s
        if left_s <= _ROUNDING:
            return None
        return jog._replace(wheel_rad_s=jog.wheel_rad_s * min(1.0, rise_per_s * left_s))

    return asked


@dataclass(eq=False)
class Keys:
    """Commands by keys: a key must come again and again, or the wheels stop.

    w s: forward, back; q e: left, right; a d: turn; 1 2 3 4: a wheel, - the other way; h j k l:
    heater of segment 1 to 4 on or off; x: end. Every other key stops the wheels.

    Attributes:
        robot: The robot.
        receive: Returns the keys that have been pressed since, "" if none.
        speed_m_s: Of the motions.
        turn_rad_s: Of the turns.
    """

    robot: Robot
    receive: Callable[[], str]
    speed_m_s: float
    turn_rad_s: float

    def __post_init__(self) -> None:
        """Raises: InputError: If a speed is beyond the robot's limits."""
        v, r = self.speed_m_s, self.turn_rad_s
        twists = {"w": (v, 0.0, 0.0), "s": (-v, 0.0, 0.0), "q": (0.0, v, 0.0), "e": (0.0, -v, 0.0)}
        twists |= {"a": (0.0, 0.0, r), "d": (0.0, 0.0, -r)}
        self._wheels = {key: wheels_of_twist(self.robot, twist) for key, twist in twists.items()}
        single = np.eye(WHEELS) * v / self.robot.geometry.wheel_radius_m
        check_wheels(self.robot, single.max(axis=0))
        self._wheels |= {str(wheel + 1): single[wheel] for wheel in range(WHEELS)}
        self._now, self._last_s, self._direction = Jog(np.zeros(WHEELS), self.robot.rigid), 0.0, 1

    def __call__(self, time_s: float) -> Jog | None:
        """Command at a time."""
        for key in self.receive():
            if key == "x":
                return None
            self._press(key)
            self._last_s = time_s
        if time_s - self._last_s > HELD_S:
            self._now = self._now._replace(wheel_rad_s=np.zeros(WHEELS))
        if time_s - self._last_s > HEATED_S:
            self._now = self._now._replace(heated=self.robot.rigid)
        return self._now

    def _press(self, key: str) -> None:
        wheels, heated = np.zeros(WHEELS), list(self._now.heated)
        segment = "hjkl".find(key)
        if 0 <= segment < len(heated):
            heated[segment] = 1 - heated[segment]
        elif key == "-":
            self._direction = -self._direction
        elif key in self._wheels:
            wheels = self._wheels[key] * (self._direction if key.isdigit() else 1)
        self._now = Jog(wheels, tuple(heated))


def jog(
    robot: Robot,
    port: Port,
    clock: Clock,
    asked: Asked,
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
        asked: What is asked for at each time.
        cold: Whether its segments are known to be as cold as the air, so that one that does not
            report may be heated by the model.
        patience: How long to wait for what.
        on_reading: Called with what is known, and what was sent, every period.

    Raises:
        RobotError: If a segment is too hot or silent, or is to be heated and nobody knows how warm
            it is; or the line does not work any more.
    """
    anywhere = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0}
    start = {**anywhere, "kappa_per_m": (0.0,) * robot.coordinates.segments}
    given = {"robot": robot, "start": start, "goal": anywhere, "timing": next(iter(robot.timing))}
    problem = Problem.parse(given, robot.name)
    heater, wheels = robot.heater, np.zeros(WHEELS)
    with connected(problem, port, clock, patience=patience) as line:
        line.listen()
        begun_s, step = clock.now_s(), (robot.limits.wheel_acceleration_rad_s2 or np.inf) / RATE_HZ
        while (wanted := asked(clock.now_s() - begun_s)) is not None:
            if any(wanted.heated) and not (line.reports or cold):
                words = "no temperature is reported: heat only segments that are surely cold"
                raise RobotError(f"{words}, and say so (--cold)")
            wheels = ramped(wheels, wanted.wheel_rad_s, step)
            soft = np.array(wanted.heated) == 1
            line.send(wheels, np.where(soft, heater.soft_setpoint_C, heater.rigid_setpoint_C))
            line.wait(1.0 / RATE_HZ)
            on_reading(line.read(), Jog(wheels, wanted.heated))


def ramped(before: Array, wanted: Array, step_rad_s: float) -> Array:
    """Wheel speeds after ``before`` on the way to ``wanted`` (4,); at once to nothing."""
    change = wanted - before
    largest = float(np.abs(change).max())
    if not wanted.any() or largest <= step_rad_s:
        return wanted
    return before + change * (step_rad_s / largest)


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
