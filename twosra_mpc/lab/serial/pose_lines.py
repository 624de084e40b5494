r"""Poses as lines of a tracking system, on standard input or to a UDP port of this computer.

A line is the time at which the frame was taken [s, Unix time, as ``date +%s.%N`` shows it] and the
configuration seen then, numbers separated by spaces or commas:

    1763825400.125 0.1502 -0.0498 0.7854 12.5 -8.0

that is x [m], y [m] and phi [rad] of the middle link, and the curvature [1/m] of each segment, in
the frame of the plan. Of a robot with `Markers` a line has x, y and heading of each marker instead,
``nan`` for one that is not seen. Empty lines and lines that begin with # are skipped. A line that
is garbled, holds no number, is too late, from the future or out of order, or shows a shape that no
robot has, is refused and counted: it is as if the frame had not been taken, and without frames no
wheel turns.
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
from twosra_mpc.execution.robot_interface import Camera, OfKind
from twosra_mpc.lab.serial.markers import Markers, configuration_by_markers, marker_poses
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot

HOST = "127.0.0.1"  # nobody else's poses
LATEST_S = 1.0  # at 0.05 m/s a frame that old is 50 mm off
EARLIEST_S = -0.1  # a frame this far from the future is of another clock
NOISE = (1e-3, 0.02, 1.0)  # of the authors' camera: its rounding in their logs

_LONGEST = 65536  # bytes at a time, and of a line
_BEYOND = 1.5  # times the curvature that the robot may have
_APART = 6.0  # times their noise: markers that far from where any shape has them are mixed up


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
        markers: Markers | None = None,
    ) -> None:
        """Read nothing yet.

        Args:
            receive: Returns what has come in, b"" if nothing has; does not wait.
            robot: The robot that is seen.
            rate_Hz: Frames per second.
            unix_s: The clock of the lines.
            markers: Whose poses the lines are; default: lines are configurations.
        """
        noise = NOISE if markers is None else _noise(robot, markers)
        self.camera = Camera(rate_Hz=rate_Hz, noise=noise)
        self.taken, self.refused, self.trouble = 0, 0, ""
        self._receive, self._unix_s, self._begun = receive, unix_s, b""
        self._robot, self._markers, self._last_s = robot, markers, -math.inf

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
                taken_s, q = self._understood(text, unix_s)
            except (ValueError, InputError) as error:
                self.refused, self.trouble = self.refused + 1, f"{text[:80]!r}: {error}"
                continue
            self.taken, self._last_s = self.taken + 1, taken_s
            times.append(now_s - (unix_s - taken_s))
            found.append(q)
        return np.array(times), np.array(found).reshape(-1, self._robot.coordinates.size)

    def describe(self) -> str:
        """Words for what has come in so far."""
        last = f", the last one {self.trouble}" if self.refused else ""
        return f"{self.taken} lines of poses were taken, {self.refused} refused{last}"

    def _understood(self, text: str, unix_s: float) -> tuple[float, Array]:
        """Time and configuration of a line."""
        taken_s, *told = [float(word) for word in text.replace(",", " ").split()]
        size = self._robot.coordinates.size
        count = size if self._markers is None else POSE * len(self._markers.marker)
        if len(told) != count:
            raise ValueError(f"{1 + len(told)} numbers, not {1 + count}")
        if not math.isfinite(taken_s) or (
            self._markers is None and not all(map(math.isfinite, told))
        ):
            raise ValueError("not all numbers are finite")
        age_s = unix_s - taken_s
        if not EARLIEST_S <= age_s <= LATEST_S:
            raise ValueError(f"taken {age_s:z.3g} s ago; at most {LATEST_S:zg} s are of use")
        if taken_s <= self._last_s:
            raise ValueError("not taken after the line before it")
        q = np.array(told) if self._markers is None else self._by_markers(self._markers, told)
        most_per_m = _BEYOND * self._robot.limits.curvature_per_m
        if np.abs(q[POSE:]).max() > most_per_m:
            raise ValueError(f"a curvature beyond {most_per_m:z.0f} 1/m")
        return taken_s, q

    def _by_markers(self, markers: Markers, told: list[float]) -> Array:
        """Configuration by markers; nothing is begun from that was seen before."""
        seen = configuration_by_markers(self._robot, markers, np.reshape(told, (-1, POSE)))
        too_far = seen.residual_m > _APART * markers.noise_m
        if too_far or seen.residual_rad > _APART * markers.noise_rad:
            off = f"{1e3 * seen.residual_m:z.1f} mm, {math.degrees(seen.residual_rad):z.1f} degrees"
            raise ValueError(f"markers that no shape of the robot explains: {off} are left")
        return seen.q


def _noise(robot: Robot, markers: Markers) -> OfKind:
    """Standard deviations of a straight robot's configuration by markers."""
    straight = np.zeros(robot.coordinates.size)
    seen = configuration_by_markers(
        robot, markers, marker_poses(robot, markers, straight), near=straight
    )
    deviation = np.sqrt(np.diag(seen.covariance))
    x_m, phi_rad, curved = deviation[:2].max(), deviation[2], deviation[POSE:].max()
    return float(x_m), float(phi_rad), float(curved)


@contextmanager
def pose_lines(
    source: str, robot: Robot, rate_Hz: float, markers: Markers | None = None
) -> Iterator[PoseLines]:
    """Open a source of poses.

    Args:
        source: "-" for standard input, or the number of a UDP port.
        robot: The robot that is seen.
        rate_Hz: Frames per second.
        markers: Whose poses the lines are; default: lines are configurations.

    Raises:
        InputError: If it is neither, or the port is taken.
    """
    if source == "-":
        yield PoseLines(_standard_input, robot, rate_Hz, markers=markers)
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
        yield PoseLines(lambda: _datagrams(opened), robot, rate_Hz, markers=markers)


def _standard_input() -> bytes:
    """Lines that have come in; on Windows, where a pipe cannot be asked, use a port."""
    source, found = sys.stdin.fileno(), b""
    while len(found) < _LONGEST and select.select([source], [], [], 0.0)[0]:
        if not (piece := os.read(source, _LONGEST)):
            break  # nobody writes any more
        found += piece
    return found


def _datagrams(opened: socket.socket) -> bytes:
    """Lines that have come in, each datagram ended as a line."""
    found = b""
    while len(found) < _LONGEST:
        try:
            found += opened.recv(_LONGEST) + b"\n"
        except BlockingIOError:
            break
    return found
