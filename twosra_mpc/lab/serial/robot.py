"""A robot on a serial line, as an executor drives it; it is switched off whatever happens.

The firmware reports raw readings of thermistors, if anything. What they mean is decided by the same
stiffness controller that the simulated robot has, run beside the real one; `segments` says when a
heater is on. A command is sent at least every 1.3 s, also while the robot stands and while the rest
of a task is planned: firmware may take 3 s of silence for a dead host, and stop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from twosra_mpc.arguments import check_size, public
from twosra_mpc.errors import InputError, RobotError
from twosra_mpc.execution.robot_interface import Camera, Reading
from twosra_mpc.execution.settings import Patience
from twosra_mpc.interrupts import Interrupts, deferred_interrupts
from twosra_mpc.lab.serial.port import (
    HIGHEST_RATE_HZ,
    Clock,
    Port,
    PortError,
    command,
    parse_report,
    stop_command,
)
from twosra_mpc.lab.serial.segments import MEDIAN_OF, ColdSegment, ModelledSegment, ReportedSegment
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, rigid_mode

RATE_HZ = 15.0  # of the authors' controller in their published trials, by their logs
REPEAT_S = 1.0  # while the robot stands, a command is sent again so often
STOPS, STOP_PAUSE_S = 5, 0.05  # a stop is sent so often: a line can lose a byte

_LONGEST_NAP_S = 0.1  # an interrupt waits no longer than this
_LONGEST_REST_S = 0.2  # the follow-up robot reports once a second
_SAME_TIME_S = 1e-6  # rounding of sums of times


class PoseSource(Protocol):
    """Camera with its software: what sees the robot."""

    @property
    def camera(self) -> Camera:
        """Its rate and noise."""

    def frames(self, now_s: float) -> tuple[Array, Array]:
        """New frames: when each was taken, on the clock that shows ``now_s``, and q (k, 3 + n)."""


@public
@contextmanager
def connected(
    problem: Problem,
    port: Port,
    clock: Clock,
    *,
    rate_Hz: float = RATE_HZ,
    poses: PoseSource | None = None,
    patience: Patience | None = None,
) -> Iterator[SerialRobot]:
    """Connect to a robot; it stands, heaters off, at the end of the block.

    Only a line that is dead prevents that, and then the error says so. In the block Ctrl-C, SIGTERM
    and their relatives interrupt the robot's ``wait`` alone, so no second one cuts the stop short.

    Args:
        problem: The robot with its number, where and how warm it starts, and its air.
        port: The line to the robot.
        clock: Time.
        rate_Hz: Commands per second while driving; with ``poses`` the camera's rate counts.
        poses: What sees the robot; without it the robot is driven blind.
        patience: How long to wait for what.

    Raises:
        InputError: If the line does not carry the rate, or it is less than one a second.
        RobotError: If the line does not work any more.
    """
    camera = Camera(rate_Hz=rate_Hz) if poses is None else poses.camera
    most_Hz = HIGHEST_RATE_HZ
    if not 1 <= camera.rate_Hz <= most_Hz:
        allowed = f"from 1 to {most_Hz:zg} Hz, which the line carries"
        raise InputError("rate", camera.rate_Hz, allowed)
    with deferred_interrupts() as interrupts:
        connection = port, clock, interrupts, poses, patience or Patience()
        robot = SerialRobot(problem, camera, *connection)
        failure = ""
        try:
            yield robot
        except PortError as error:
            failure = f"{error}; "
        finally:
            if (untold := robot.stop()) is not None:
                words = "the robot could NOT be told to stop: switch it off"
                raise PortError(f"{failure or f'{untold}; '}{words}") from untold
        if failure:
            raise PortError(f"{failure}the robot was told to stop")


@public
@dataclass(eq=False)
class SerialRobot:
    """A robot on a serial line; made by ``connected``, which also stops it.

    Attributes:
        problem: The robot as described, how warm its segments are at first, and its air.
        camera: What sees it, or the rate of commands alone.
        port: The line to it.
        clock: Time.
        interrupts: Whether to interrupt it.
        poses: What sees it.
        patience: How long to wait for what.
        reports: True if its temperatures are known.
    """

    problem: Problem
    camera: Camera
    port: Port
    clock: Clock
    interrupts: Interrupts
    poses: PoseSource | None
    patience: Patience
    reports: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        start = self.clock.now_s(), self.problem.temperatures
        self._segments: list[ModelledSegment | ReportedSegment | ColdSegment] = [
            ModelledSegment(self.robot, self.problem.ambient, j, start[1][j], start[0])
            if self.robot.describes_heat
            else ColdSegment(j)
            for j in range(self.robot.coordinates.segments)
        ]
        self._asked: Mode = rigid_mode(self.robot.coordinates.segments)
        self._sent, self._sent_s = b"", -math.inf
        self._turns, self._due_s = False, 0.0

    @property
    def robot(self) -> Robot:
        """The robot as described."""
        return self.problem.robot

    def listen(self) -> None:
        """Wait at rest for reports of all segments; afterwards it is known whether there are any.

        Raises:
            RobotError: If only some segments report, or what nobody can read, or the line does not
                work any more.
        """
        heard: list[list[float]] = [[] for _ in range(self.robot.coordinates.segments)]
        unreadable = [0] * self.robot.coordinates.segments
        until_s = self.clock.now_s() + self.patience.listen_s
        while self.clock.now_s() < until_s - _SAME_TIME_S and min(map(len, heard)) < MEDIAN_OF:
            self._rest()
            for j, new in enumerate(self._heard()):
                heard[j] += [reading_C for reading_C in new if math.isfinite(reading_C)]
                unreadable[j] += sum(map(math.isnan, new))
        for j, lines in enumerate(unreadable):
            if lines >= MEDIAN_OF and len(heard[j]) < MEDIAN_OF:
                raise RobotError(f"segment {j + 1}: nobody can read the temperatures it reports")
        if any(heard) and not all(heard):
            raise RobotError(f"segment {heard.index([]) + 1} does not report its temperature")
        if all(heard):
            self.reports, now_s, air_C = True, self.clock.now_s(), self.problem.ambient
            self._segments = [
                ReportedSegment(self.robot, air_C, j, first_C, now_s)
                for j, first_C in enumerate(heard)
            ]

    def look_out(self, seen: Callable[[], bool], describe: Callable[[], str]) -> Array:
        """Wait at rest until it is seen; return the frames that came in last, (k, 3 + n).

        Args:
            seen: Whether it is.
            describe: What has come in instead, in words.

        Raises:
            RobotError: If nothing sees it, or the line does not work any more.
        """
        until_s, frames = self.clock.now_s() + self.patience.listen_s, self.read().frames
        while not seen():
            if self.clock.now_s() >= until_s:
                known = f"no pose within {self.patience.listen_s:zg} s"
                raise RobotError(f"{known}: {describe()}")
            self._rest()
            frames = self.read().frames
        return frames

    def _rest(self) -> None:
        """Stand for a period, heaters off."""
        off_C = np.full(self.robot.coordinates.segments, self.robot.heater.rigid_setpoint_C)
        self.send(np.zeros(WHEELS), off_C)
        self.wait(self.camera.period_s)

    def read(self) -> Reading:
        """Return what is known now.

        Raises:
            RobotError: If a segment is silent or too hot, or the line does not work any more.
        """
        now_s, heard = self.clock.now_s(), self._heard()
        for j, segment in enumerate(self._segments):
            segment.take(heard[j], bool(self._asked[j]), now_s)
            if (trouble := segment.trouble(now_s, self.patience.silent_s)) is not None:
                raise RobotError(f"segment {j + 1}: {trouble}")
        taken_s, frames = np.empty(0), np.empty((0, self.robot.coordinates.size))
        if self.poses is not None:
            taken_s, frames = self.poses.frames(now_s)
        known = [(item.temperature_C, item.stiffness, item.faulty) for item in self._segments]
        current_A = tuple(item.current_A for item in self._segments)
        return Reading(now_s, taken_s, frames, *zip(*known, strict=True), current_A=current_A)

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        """Send a command, unless the robot stands and has just been told the same.

        The firmware can heat a segment or not: one to be kept warm is not heated.

        Raises:
            InputError: If there are more or fewer wheels or segments, or a number is not finite.
        """
        check_size("wheel_rad_s", wheel_rad_s, WHEELS)
        check_size("heater_setpoint_C", heater_setpoint_C, self.robot.geometry.segments)
        soft_C = self.robot.heater.soft_setpoint_C
        now_s, turned = self.clock.now_s(), self._turns
        self._asked = tuple(int(setpoint_C >= soft_C) for setpoint_C in heater_setpoint_C)
        heated = tuple(
            int(segment.switched(bool(asked), now_s))
            for segment, asked in zip(self._segments, self._asked, strict=True)
        )
        line = command(wheel_rad_s.tolist(), heated, self.robot.robot_id)
        self._turns = bool(wheel_rad_s.any())
        if not (self._turns and turned):
            self._due_s = now_s
        again = line == self._sent and now_s < self._sent_s + REPEAT_S - _SAME_TIME_S
        if self._turns or not again:
            self.port.write(line)
            self._sent, self._sent_s = line, now_s

    def wait(self, at_most_s: float) -> None:
        """Let time pass; at rest not for long, since a segment may be reported to have changed.

        While the wheels turn, times are counted from when they began to: lateness does not add up
        to a longer way.

        Raises:
            KeyboardInterrupt: If that was asked for.
            RobotError: If the wheels have turned for much longer than they should.
        """
        self._due_s += at_most_s if self._turns else min(at_most_s, _LONGEST_REST_S)
        self.interrupts.check()
        while (left_s := self._due_s - self.clock.now_s()) > _SAME_TIME_S:
            self.clock.sleep(min(left_s, _LONGEST_NAP_S))
            self.interrupts.check()
        if self._turns and -left_s > self.patience.held_up_s:
            raise RobotError(f"the computer was held up for {-left_s:z.1f} s with turning wheels")

    def stop(self) -> PortError | None:
        """Tell the robot several times to stand and let its heaters cool; an error if none went."""
        failure: PortError | None = None
        sent = 0
        stop = stop_command(self.robot.coordinates.segments, self.robot.robot_id)
        for _ in range(STOPS):
            try:
                self.port.write(stop)
                sent += 1
            except PortError as error:
                failure = error
            except Exception as error:  # whatever it is, the next try may get through
                failure = PortError(f"cannot write ({error})")
            self.clock.sleep(STOP_PAUSE_S)
        return None if sent else failure

    def _heard(self) -> list[list[float]]:
        """Readings of each segment that have been reported since the last time."""
        heard: list[list[float]] = [[] for _ in range(self.robot.coordinates.segments)]
        for line in self.port.read_lines():
            if (report := parse_report(line, self.robot.coordinates.segments)) is not None:
                heard[report.segment].append(report.temperature_C)
        return heard
