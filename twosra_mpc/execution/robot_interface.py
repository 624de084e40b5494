"""Interface of robots: camera and thermistors to read, wheels and heaters to set, and their stop.

An executor knows nothing else of the robot it drives, simulated or real. `stopped_after` is a stop
that always happens: whatever ends a run, the last command is wheels zero, heaters off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.errors import InputError, RobotError
from twosra_mpc.interrupts import Interrupts, deferred_interrupts, raised_interrupts
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array, Coordinates
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.validation import ArrayValue, NonNegative, Positive

OfKind = tuple[NonNegative, NonNegative, NonNegative]

EXACT: OfKind = (0.0, 0.0, 0.0)


@public
@dataclass(frozen=True)
class Camera:
    """Camera that measures q = [x, y, phi, kappa1 ... kappan].

    Attributes:
        rate_Hz: Frames per second.
        noise: Standard deviation of a frame: of x and y [m], of phi [rad], of curvatures [1/m].
        step: What a frame's values are rounded to, same units; 0 is not at all.
    """

    rate_Hz: Positive = 15.0
    noise: OfKind = EXACT
    step: OfKind = EXACT

    @property
    def period_s(self) -> float:
        """Time from a frame to the next."""
        return 1.0 / self.rate_Hz

    def variance(self, coordinates: Coordinates) -> Array:
        """Variance of one frame, rounding included, (3 + n,)."""
        noise, step = coordinates.each(*self.noise), coordinates.each(*self.step)
        return np.square(noise) + np.square(step) / 12


@public
@dataclass(frozen=True, eq=False, repr=False)
class Reading(ArrayValue):
    """Reading: what has become known since the one before; n segments.

    Lists are taken for arrays, None for a number that is not known.

    Attributes:
        time_s: Now.
        taken_s: When each new frame was taken; it arrives later, (k,).
        frames: Configurations in them [m, m, rad, 1/m ...], (k, 3 + n); none if nothing sees it.
        temperature_C: Of the segments, by their sensors; NaN if not reported.
        stiffness: Of the segments, as their stiffness controllers report it; None if not reported.
        faulty: Whether the controller of each has given up on its sensor or heater.
        objects: Poses of the problem's objects in the frames, (k, objects, 3) [m, m, rad]; None
            from a robot whose camera sees no objects.
        current_A: Root mean square of the current that each controller has let flow since the
            reading before, which is what heats; None from a robot that does not tell: it is then
            taken for one that switches full current at the set-point, as where it tells what no
            heater draws: less than nothing, or more than 1 kA.

    Raises:
        InputError: If a field is of another kind, or fields differ in length.
    """

    time_s: float
    taken_s: Array
    frames: Array
    temperature_C: tuple[float, ...]
    stiffness: tuple[KnownStiffness | None, ...]
    faulty: tuple[bool, ...]
    objects: Array | None = field(default=None, kw_only=True)
    current_A: tuple[float | None, ...] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Take what is meant."""
        taken_s = _numbers("taken_s", self.taken_s, None)
        shown_C = _numbers("temperature_C", self.temperature_C, None)
        count, segments = len(taken_s), len(shown_C)
        taken: dict[str, object] = {
            "time_s": float(_numbers("time_s", self.time_s)),
            "taken_s": taken_s,
            "frames": _numbers("frames", self.frames, count, POSE + segments),
            "temperature_C": tuple(shown_C.tolist()),
            "faulty": tuple(_numbers("faulty", self.faulty, segments).astype(bool).tolist()),
        }
        if self.objects is not None:
            taken["objects"] = _numbers("objects", self.objects, count, None, POSE)
        if self.current_A is not None:
            drawn_A = _numbers("current_A", self.current_A, segments).tolist()
            taken["current_A"] = tuple(a if 0.0 <= a <= _MOST_A else None for a in drawn_A)
        if not isinstance(told := self.stiffness, tuple | list) or len(told) != segments:
            raise InputError("reading.stiffness", told, f"{segments} words")
        taken["stiffness"] = tuple(told)
        if unknown := [word for word in told if word not in _TOLD]:
            allowed = "'soft', 'rigid', 'changing', or None if not reported"
            raise InputError("reading.stiffness", unknown[0], allowed)
        for name, value in taken.items():
            object.__setattr__(self, name, value)

    def describe(self, segment: int) -> str:
        """Words for what is known about a segment (from 0)."""
        known = f"{self.stiffness[segment]} at {self.temperature_C[segment]:z.1f} C"
        return f"segment {segment + 1} {known}"


_MOST_A = 1e3
_TOLD = ("soft", "rigid", "changing", None)


def _numbers(name: str, given: object, *shape: int | None) -> Array:
    """A field of a reading as numbers of this shape, of which None is any length.

    Raises:
        InputError: If it is not made of them.
    """
    try:
        numbers = np.asarray(given, dtype=float)
        if not numbers.size:  # of no frame, however it is written
            numbers = numbers.reshape([length or 0 for length in shape])
        fits = zip(shape, numbers.shape, strict=True)
        if all(length in (None, found) for length, found in fits):
            return numbers
    except (TypeError, ValueError):  # they are no numbers, or in no such order
        pass
    words = " x ".join("any" if length is None else str(length) for length in shape)
    raise InputError(f"reading.{name}", given, f"{words or 'plain'} numbers")


def still() -> Array:
    """Wheel speeds of a robot that stands, (4,) [rad/s]."""
    return np.zeros(WHEELS)


@public
@dataclass(frozen=True, eq=False)
class Command(ArrayValue):
    """Command: what a robot is to be told, until its controller has the next reading.

    Attributes:
        heater_setpoint_C: Temperature set-points of the segments, (n,).
        at_most_s: Time after which the next reading is due; at rest it may come earlier.
        wheel_rad_s: Wheel speeds, (4,).
        mode: Mode in which the wheels are driven; None while they stand.
        planned: Where the plan is now, (3 + n,); empty without one.
        soft_for_s: Time for which segments must stay soft, (n,); inf, or empty: nobody knows.
    """

    heater_setpoint_C: Array
    at_most_s: float
    wheel_rad_s: Array = field(default_factory=still)
    mode: Mode | None = None
    planned: Array = field(default_factory=lambda: np.empty(0))
    soft_for_s: Array = field(default_factory=lambda: np.empty(0))


class RobotInterface(Protocol):
    """A robot, and what sees and measures it.

    A class of this shape is one. A subclass has ``robot`` and ``camera`` as properties, or declares
    them as attributes: ``robot: Robot``.

    Raises:
        RobotError: By any of its methods, if it cannot be driven any more.
    """

    if TYPE_CHECKING:  # only read; at run time a property here would keep subclasses from setting

        @property
        def robot(self) -> Robot:
            """The robot as its owner describes it; only plans for this one are run."""

        @property
        def camera(self) -> Camera:
            """Its camera; commands are given at the camera's rate."""

    def read(self) -> Reading:
        """Return what is known now; does not wait."""

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        """Set the wheels (4,) and the temperatures of the segments (n,) until the next call.

        A set-point up to the robot's rigid one switches the heater off, one from its soft one on
        melts the segment, and one in between keeps it warm without letting it change.
        """

    def wait(self, at_most_s: float) -> None:
        """Let so much time pass; a robot at rest may return earlier, for there may be news."""


_UNTOLD = "the robot could NOT be told to stop: switch it off"
_TRIES = 5  # a line can fail once, and a driver too

Driven = TypeVar("Driven")


def stopped_after(robot: RobotInterface, drive: Callable[[Interrupts], Driven]) -> Driven:
    """Drive a robot and stop it, however the drive ends; no number of signals cuts that short.

    The first signal that would end the program raises KeyboardInterrupt in the drive, as Ctrl-C
    does; later ones are only noted. The drive should check the interrupts it is given from time to
    time: a library may swallow the exception, or make another error of it. That the robot could
    not be told to stop is a note to the error that ended the drive.

    Raises:
        RobotError: If nothing else went wrong but the stop.
    """
    with raised_interrupts() as interrupts:
        try:
            try:
                driven = drive(interrupts)
            finally:  # from here on no signal raises: the only one that may has been or is caught
                interrupts.held = True
        except BaseException as error:
            if (untold := _stop(robot)) is not None:
                error.add_note(f"{untold}; {_UNTOLD}")
            interrupts.check()
            raise
        if (untold := _stop(robot)) is not None:
            raise RobotError(f"{untold}; {_UNTOLD}") from untold
        return driven


def _stop(robot: RobotInterface) -> BaseException | None:
    """Send wheels zero and heaters off until that goes through; the last error if it never does."""
    failure: BaseException | None = None
    off_C = np.full(robot.robot.coordinates.segments, robot.robot.heater.rigid_setpoint_C)
    with deferred_interrupts():
        for _ in range(_TRIES):
            try:
                robot.send(np.zeros(WHEELS), off_C)
                return None
            except BaseException as error:  # whatever it is, the next try may get through
                failure = error
    return failure


_AT_REST_RAD_S = 1e-3  # a motor that runs down to this stands


class Motors:
    r"""The motors of the four wheels: each goes to its command with a lag of first order.

    .. math:: \tau\,\dot\omega = \omega_c - \omega

    So what is left to turn once they are told to stand is :math:`\tau\,\omega`.

    Attributes:
        lag_s: Their time constant; 0: they turn as they are told.
        rad_s: How fast they turn now, (4,).
    """

    def __init__(self, lag_s: float) -> None:
        """They stand."""
        self.lag_s, self.rad_s = lag_s, np.zeros(WHEELS)

    def turned(self, told_rad_s: Array, period_s: float) -> Array:
        """Turns in a period in which they are told to turn at these speeds (4,), (4,) [rad]."""
        behind = self.rad_s - told_rad_s
        left = behind * math.exp(-period_s / self.lag_s) if self.lag_s > 0 else np.zeros(WHEELS)
        now = told_rad_s + left
        self.rad_s = np.where(np.abs(now) < _AT_REST_RAD_S, 0.0, now)
        return told_rad_s * period_s + self.lag_s * (behind - left)
