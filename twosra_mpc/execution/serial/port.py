"""The serial line to the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from twosra_mpc.errors import InputError
from twosra_mpc.execution.robot_interface import RobotError
from twosra_mpc.execution.serial.firmware_lines import BAUD
from twosra_mpc.installation import require

if TYPE_CHECKING:
    from serial import Serial

_WRITE_TIMEOUT_S = 1.0  # a command takes 4 ms: a line that is busy for so long is not working
_LONGEST_LINE = 200  # bytes; a report has ten


class PortError(RobotError):
    """The line to the robot does not work any more."""


class Port(Protocol):
    """What a line to a robot must offer."""

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
