r"""Poses as lines of a tracking system, on standard input or to a UDP port of this computer.

A line is the time at which the frame was taken [s, Unix time, as ``date +%s.%N`` shows it] and the
configuration seen then, numbers separated by spaces or commas:

    1763825400.125 0.1502 -0.0498 0.7854 12.5 -8.0

that is x [m], y [m] and phi [rad] of the middle link, and the curvature [1/m] of each segment, in
the frame of the plan. Empty lines and lines that begin with # are skipped. A line that is garbled,
holds NaN, is too late, from the future or out of order, or shows a shape that no robot has, is
refused and counted: it is as if the frame had not been taken, and without frames no wheel turns.
"""

from __future__ import annotations

import math
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.execution.robot_interface import Camera
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot

HOST = "127.0.0.1"  # nobody else's poses
LATEST_S = 1.0  # at 0.05 m/s a frame that old is 50 mm off
EARLIEST_S = -0.1  # a frame this far from the future is of another clock
NOISE = (1e-3, 0.02, 1.0)  # of the authors' camera: its rounding in their logs

_LONGEST = 65536  # bytes at a time, and of a line
_BEYOND = 1.5  # times the curvature that the robot may have


class PoseLines:
    """`PoseSource` of lines: what sees the robot.

    Attributes:
        camera: Rate and noise of the tracking system.
        taken: How many lines were taken.
        refused: How many were not.
        trouble: The last line that was refused, and why.
    """

    def __init__(
        self,
        receive: Callable[[], bytes],
        robot: Robot,
        rate_Hz: float,
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        """Read nothing yet.

        Args:
            receive: Returns what has come in, b"" if nothing has; does not wait.
            robot: The robot that is seen.
            rate_Hz: Frames per second.
            unix_s: The clock of the lines.
        """
        self.camera = Camera(rate_Hz=rate_Hz, noise=NOISE)
        self.taken, self.refused, self.trouble = 0, 0, ""
        self._receive, self._unix_s, self._begun = receive, unix_s, b""
        self._size, self._last_s = robot.coordinates.size, -math.inf
        self._most_per_m = _BEYOND * robot.limits.curvature_per_m

    def frames(self, now_s: float) -> tuple[Array, Array]:
        """New frames: when each was taken, on the clock that shows ``now_s``, and q (k, 3 + n)."""
        *lines, begun = (self._begun + self._receive()).split(b"\n")
        self._begun = begun[-_LONGEST:]
        times, found, unix_s = [], [], self._unix_s()
        for line in lines:
            text = line.decode("ascii", errors="replace").strip()
            if not text or text.startswith("#"):
                continue
            try:
                taken_s, *q = self._understood(text, unix_s)
            except ValueError as error:
                self.refused, self.trouble = self.refused + 1, f"{text[:80]!r}: {error}"
                continue
            self.taken, self._last_s = self.taken + 1, taken_s
            times.append(now_s - (unix_s - taken_s))
            found.append(q)
        return np.array(times), np.array(found).reshape(-1, self._size)

    def describe(self) -> str:
        """Words for what has come in so far."""
        last = f", the last one {self.trouble}" if self.refused else ""
        return f"{self.taken} lines of poses were taken, {self.refused} refused{last}"

    def _understood(self, text: str, unix_s: float) -> list[float]:
        """Numbers of a line, the time first."""
        numbers = [float(word) for word in text.replace(",", " ").split()]
        if len(numbers) != 1 + self._size:
            raise ValueError(f"{len(numbers)} numbers, not {1 + self._size}")
        if not all(map(math.isfinite, numbers)):
            raise ValueError("not all numbers are finite")
        age_s, kappa = unix_s - numbers[0], numbers[1 + POSE :]
        if not EARLIEST_S <= age_s <= LATEST_S:
            raise ValueError(f"taken {age_s:z.3g} s ago; at most {LATEST_S:zg} s are of use")
        if numbers[0] <= self._last_s:
            raise ValueError("not taken after the line before it")
        if max(map(abs, kappa)) > self._most_per_m:
            raise ValueError(f"a curvature beyond {self._most_per_m:z.0f} 1/m")
        return numbers


@contextmanager
def pose_lines(source: str, robot: Robot, rate_Hz: float) -> Iterator[PoseLines]:
    """Open a source of poses.

    Args:
        source: "-" for standard input, or the number of a UDP port.
        robot: The robot that is seen.
        rate_Hz: Frames per second.

    Raises:
        InputError: If it is neither, or the port is taken.
    """
    if source == "-":
        yield PoseLines(_standard_input, robot, rate_Hz)
        return
    if not (source.isdecimal() and 0 < int(source) < 65536):
        raise InputError("camera", source, "- for standard input, or a UDP port from 1 to 65535")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        try:
            opened.bind((HOST, int(source)))
        except OSError as error:
            allowed = f"a UDP port that can be opened ({error.strerror})"
            raise InputError("camera", source, allowed) from error
        opened.setblocking(False)
        yield PoseLines(lambda: _datagrams(opened), robot, rate_Hz)


def _standard_input() -> bytes:
    """What has come in; on Windows, where a pipe cannot be asked, use a port."""
    source, found = sys.stdin.fileno(), b""
    while len(found) < _LONGEST and select.select([source], [], [], 0.0)[0]:
        if not (piece := os.read(source, _LONGEST)):
            break  # nobody writes any more
        found += piece
    return found


def _datagrams(opened: socket.socket) -> bytes:
    """What has come in, each datagram ended as a line."""
    found = b""
    while len(found) < _LONGEST:
        try:
            found += opened.recv(_LONGEST) + b"\n"
        except BlockingIOError:
            break
    return found
