"""A robot's firmware at the other end of a cable, on a clock that the stream moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twosra_mpc.control.heated_segment import HeatedSegment
from twosra_mpc.control.stiffness import stiffness_controller
from twosra_mpc.control.thermistor import temperature_sensor
from twosra_mpc.lab.serial.port import SerialPort
from twosra_mpc.lab.serial.robot import STOPS
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.description import segment_model
from twosra_mpc.robot.modes import Mode, rigid_mode

REPORT_PERIOD_S = 0.5


class Received(NamedTuple):
    """A command as the firmware understood it, and what the robot truly was at that time."""

    time_s: float
    wheel_rad_s: tuple[float, ...]
    heated: Mode
    tail: tuple[int, ...]
    truly_soft: Mode


class Cable:
    """Both directions of a line, as pyserial shows them to the port."""

    port = "cable"

    def __init__(self) -> None:
        self.to_robot, self.to_computer, self.dead = b"", b"", False

    def write(self, data: bytes) -> None:
        self._check()
        self.to_robot += data

    @property
    def in_waiting(self) -> int:
        self._check()
        return len(self.to_computer)

    def read(self, count: int) -> bytes:
        self._check()
        data, self.to_computer = self.to_computer[:count], self.to_computer[count:]
        return data

    def close(self) -> None:
        self.dead = True

    def _check(self) -> None:
        if self.dead:
            raise OSError(5, "Input/output error")


def raw_C(segment: HeatedSegment) -> float:
    """What the firmware reads off a segment's thermistor."""
    rule = segment.controller
    return rule.ambient_C + rule.sensor_gain * (segment.measured_C - rule.ambient_C)


class FullCurrent(HeatedSegment):
    """A segment whose firmware lets the melting current flow for as long as it is told to."""

    melt_current_A, heated = 0.0, False

    @property
    def current_A(self) -> float:
        return self.melt_current_A * self.heated

    def advance(self, setpoint_C: float, duration_s: float) -> None:
        self.heated = setpoint_C > self.rigid_setpoint_C
        super().advance(setpoint_C, duration_s)


class SimulatedFirmware:
    """Parses commands, heats segments, reports temperatures; is also the stream's clock."""

    def __init__(
        self,
        plan: Plan,
        reports: Callable[[float, int, float], bytes] = lambda _t, j, T: b"%c%.2f\n" % (65 + j, T),
        broken_heaters: tuple[int, ...] = (),
        numbers: int = 0,
        regulates: bool = True,
    ) -> None:
        """Start it.

        Args:
            plan: For the robot and its start.
            reports: Bytes to report at a time for a segment (0, 1) at a temperature [C].
            broken_heaters: Segments whose heaters are broken.
            numbers: How many numbers a command has beyond wheels and heaters.
            regulates: Whether it holds segments at the soft set-point by itself.
        """
        self._cable = Cable()
        self.port = SerialPort(self._cable)  # type: ignore[arg-type]
        self.reports, self._numbers = reports, 4 + plan.robot.coordinates.segments + numbers
        robot, problem = plan.robot, plan.problem
        kind = HeatedSegment if regulates else FullCurrent
        FullCurrent.melt_current_A = robot.heater.melt_current_A
        self.hottest_C = 0.0
        self.segments = [
            kind(
                segment_model(robot, problem.ambient, j),
                temperature_sensor(robot, problem.ambient, j),
                stiffness_controller(robot, problem.ambient, j),
                problem.temperatures[j],
                np.random.default_rng(j).standard_normal,
                rigid_setpoint_C=robot.heater.rigid_setpoint_C,
                broken_heater=j in broken_heaters,
            )
            for j in range(robot.coordinates.segments)
        ]
        self._setpoints = (robot.heater.rigid_setpoint_C, robot.heater.soft_setpoint_C)
        self._now_s, self._next_report_s = 0.0, 0.0
        self._buffer = b""
        self.heated: Mode = rigid_mode(robot.coordinates.segments)
        self.received: list[Received] = []
        self.at: dict[float, Callable[[], None]] = {}

    @property
    def moves(self) -> list[Received]:
        """Commands that turn the wheels."""
        return [item for item in self.received if any(item.wheel_rad_s)]

    def now_s(self) -> float:
        """Time of the robot and of the stream."""
        return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Let time pass on the robot."""
        self.receive()
        self._now_s += duration_s
        for segment, heated in zip(self.segments, self.heated, strict=True):
            segment.advance(self._setpoints[heated], duration_s)
            self.hottest_C = max(self.hottest_C, segment.temperature_C)
        for time_s in [time_s for time_s in self.at if time_s <= self._now_s]:
            self.at.pop(time_s)()
        if self._now_s >= self._next_report_s and not self._cable.dead:
            self._next_report_s += REPORT_PERIOD_S
            self._report()

    def die(self) -> None:
        """Lose power: the line goes dead."""
        self.receive()
        self.close()

    def close(self) -> None:
        """Release the line."""
        self.port.close()

    def receive(self) -> None:
        """Take in everything that the port has written."""
        self._buffer += self._cable.to_robot
        self._cable.to_robot = b""
        while self._buffer.count(b"\n") >= self._numbers:
            *numbers, self._buffer = self._buffer.split(b"\n", self._numbers)
            self._understand(numbers)

    def _understand(self, numbers: list[bytes]) -> None:
        assert numbers[0].startswith(b"s")
        numbers[0] = numbers[0][1:]
        last = 4 + len(self.segments)
        self.heated = tuple(int(number) for number in numbers[4:last])
        tail = tuple(int(number) for number in numbers[last:])
        soft = tuple(int(segment.soft) for segment in self.segments)
        wheels = tuple(float(number) for number in numbers[:4])
        self.received.append(Received(self._now_s, wheels, self.heated, tail, soft))

    def _report(self) -> None:
        for j, segment in enumerate(self.segments):
            self._cable.to_computer += self.reports(self._now_s, j, raw_C(segment))


def assert_off(firmware: SimulatedFirmware) -> None:
    """The last commands are stops, as many as promised."""
    firmware.receive()
    last = firmware.received[-STOPS:]
    assert len(last) == STOPS
    assert not any(any(item.wheel_rad_s) or any(item.heated) for item in last)
