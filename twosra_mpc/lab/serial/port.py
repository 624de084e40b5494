r"""Serial line to the robot: lines of the firmware (115200 baud, 8N1, ASCII), and their clock.

A command is the letter ``s`` and then numbers, each ended by a newline:

    s{w1}\n{w2}\n{w3}\n{w4}\n{sigma1}\n{sigma2}\n          and {id}\n, if robots have numbers

with wheel speeds w1 to w4 in rad/s (wheels 1 and 2 on locomotion unit 1, 3 and 4 on unit 2; signs
as in the paper) and a sigma for each segment, 1 to heat it to its soft set-point, 0 to let it cool.
It holds until the next one; nothing is known of a watchdog in the firmware.

A report is one line with the raw reading of a segment's thermistor in degrees Celsius, as the
follow-up robot sends them unasked: ``A58.2`` for segment 1, ``B24.9`` for segment 2. The firmware
of the first robot is not published, and its controller reads nothing back. Robots of one, three or
four segments are none that were built: for them the same is written on, ``C`` and ``D``.

Time is the computer's own, or a clock that only the stream itself moves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from twosra_mpc.control.thermistor import NtcDivider
from twosra_mpc.errors import InputError, RobotError
from twosra_mpc.installation import require
from twosra_mpc.robot.coordinates import WHEELS
from twosra_mpc.robot.modes import Mode, rigid_mode

if TYPE_CHECKING:
    from serial import Serial


class Clock(Protocol):
    """A clock that can be waited on; times in s from its start."""

    def now_s(self) -> float:
        """Time since the start."""

    def sleep(self, duration_s: float) -> None:
        """Let so much time pass."""


class SystemClock:
    """The computer's monotonic clock."""

    def __init__(self) -> None:
        """Start it."""
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._start_s

    def sleep(self, duration_s: float) -> None:
        """Let so much time pass."""
        time.sleep(duration_s)


class SteppedClock:
    """A clock on which waiting takes no time, for trying a stream out."""

    def __init__(self) -> None:
        """Start it."""
        self._now_s = 0.0

    def now_s(self) -> float:
        """Time since the start."""
        return self._now_s

    def sleep(self, duration_s: float) -> None:
        """Move on by so much."""
        self._now_s += duration_s


BAUD = 115200  # of the authors' firmware
HIGHEST_RATE_HZ = 200.0  # 45 to 49 bytes a command are 80 to 85 % of what the line carries

_SEGMENTS = "ABCD"
_LONGEST_REPORT = 12  # characters; longer lines are words, such as a greeting
_PLAUSIBLE_C = NtcDivider().range_C


class Report(NamedTuple):
    """Raw sensor reading [C] of a segment (from 0); NaN where nobody can read it."""

    segment: int
    temperature_C: float


def command(wheel_rad_s: Sequence[float], soft: Mode, robot_id: int | None = None) -> bytes:
    """Write a command.

    Args:
        wheel_rad_s: Speeds of the four wheels.
        soft: 1 for a segment to heat, 0 for one to let cool.
        robot_id: Number of the robot, if the firmware expects one.
    """
    speeds = [f"{speed:z.3f}" for speed in wheel_rad_s]
    ends = [] if robot_id is None else [robot_id]
    return ("s" + "".join(f"{value}\n" for value in (*speeds, *soft, *ends))).encode("ascii")


def stop_command(segments: int, robot_id: int | None = None) -> bytes:
    """Write the command to stop: wheels at zero, heaters of so many segments off."""
    return command((0.0,) * WHEELS, rigid_mode(segments), robot_id)


def parse_report(line: bytes, segments: int) -> Report | None:
    """Read a report of one of so many segments; None for any other line.

    The temperature is NaN if it is garbled, or one that no thermistor can have.
    """
    text = line.decode("ascii", errors="replace").strip()
    if not text or text[0] not in _SEGMENTS[:segments] or len(text) > _LONGEST_REPORT:
        return None
    coldest, hottest = _PLAUSIBLE_C
    try:
        temperature_C = float(text[1:])
    except ValueError:
        temperature_C = math.nan
    if not coldest <= temperature_C <= hottest:
        temperature_C = math.nan
    return Report(_SEGMENTS.index(text[0]), temperature_C)


_WRITE_TIMEOUT_S = 1.0  # a command takes 4 ms: a line that is busy for so long is not working
_LONGEST_LINE = 200  # bytes; a report has ten


class PortError(RobotError):
    """The line to the robot does not work any more."""


class Port(Protocol):
    """Line to a robot: what it must offer."""

    def write(self, data: bytes) -> None:
        """Send bytes, and return when the line has taken them.

        Raises:
            PortError: If the line does not work any more.
        """

    def read_lines(self) -> list[bytes]:
        """Return the lines that have arrived since the last call; does not wait.

        Raises:
            PortError: If the line does not work any more.
        """


class SerialPort:
    """A serial port, by pyserial."""

    def __init__(self, serial: Serial) -> None:
        """Take an open port."""
        self._serial = serial
        self._begun = b""

    def write(self, data: bytes) -> None:
        """Send bytes, and return when the line has taken them."""
        try:
            self._serial.write(data)
        except _FAILURES as error:
            raise PortError(f"cannot write to {self._serial.port} ({error})") from error

    def read_lines(self) -> list[bytes]:
        """Return the lines that have arrived since the last call; does not wait."""
        try:
            self._begun += self._serial.read(self._serial.in_waiting)
        except _FAILURES as error:
            raise PortError(f"cannot read from {self._serial.port} ({error})") from error
        *lines, begun = self._begun.split(b"\n")
        self._begun = begun[-_LONGEST_LINE:]
        return lines

    def close(self) -> None:
        """Give the port back."""
        self._serial.close()


# pyserial raises SerialException, which is an OSError; on a port that is gone also others.
_FAILURES = (OSError, TypeError)


def open_serial_port(name: str) -> SerialPort:
    """Open a serial port for the firmware: 115200 baud, 8N1, for nobody else.

    Args:
        name: Its name, such as /dev/ttyUSB0 or COM3.

    Raises:
        InputError: If pyserial is not installed, or there is no such port.
    """
    require("a serial line", "serial", "pyserial")
    from serial import Serial, SerialException

    try:
        opened = Serial(name, BAUD, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True)
    except (SerialException, ValueError) as error:
        from serial.tools.list_ports import comports

        found = ", ".join(sorted(port.device for port in comports())) or "none is connected now"
        raise InputError("port", name, f"a serial port that can be opened: {found}") from error
    opened.reset_input_buffer()
    return SerialPort(opened)
