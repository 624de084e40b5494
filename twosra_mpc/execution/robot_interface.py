"""What a robot must offer to be driven: camera and thermistors to read, wheels and heaters to set.

An executor knows nothing else of the robot it drives, simulated or real.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.robot.description import Robot

Array = NDArray[np.float64]
OfConfiguration = tuple[float, float, float, float, float]

EXACT: OfConfiguration = (0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Camera:
    """What is known about the camera that measures q = [x, y, phi, kappa1, kappa2].

    Attributes:
        rate_Hz: Frames per second.
        noise: Standard deviation of a frame [m, m, rad, 1/m, 1/m].
        step: What a frame's values are rounded to, same units; 0 is not at all.
    """

    rate_Hz: float = 15.0
    noise: OfConfiguration = EXACT
    step: OfConfiguration = EXACT

    @property
    def period_s(self) -> float:
        """Time from a frame to the next."""
        return 1.0 / self.rate_Hz

    @property
    def variance(self) -> Array:
        """Of one frame, rounding included, (5,)."""
        spread: Array = np.square(self.noise) + np.square(self.step) / 12
        return spread


@dataclass(frozen=True, eq=False)
class Reading:
    """What has become known since the reading before.

    Attributes:
        time_s: Now.
        taken_s: When each new frame was taken; it arrives later, (n,).
        frames: Configurations in them [m, m, rad, 1/m, 1/m], (n, 5).
        temperature_C: Of the two segments, by their sensors.
        stiffness: Of the two segments, as their stiffness controllers report it.
        faulty: Whether a controller has given up on its sensor or heater.
    """

    time_s: float
    taken_s: Array
    frames: Array
    temperature_C: tuple[float, float]
    stiffness: tuple[KnownStiffness, KnownStiffness]
    faulty: tuple[bool, bool] = (False, False)


class RobotInterface(Protocol):
    """A robot with its camera."""

    @property
    def robot(self) -> Robot:
        """The robot as its owner describes it; only plans for this one are run."""

    @property
    def camera(self) -> Camera:
        """What is known about its camera."""

    def read(self) -> Reading:
        """Return what is known now; does not wait."""

    def send(self, wheel_rad_s: Array, heater_setpoint_C: Array) -> None:
        """Set the wheels (4,) and the temperatures of the segments (2,) until the next call.

        A set-point up to the robot's rigid one switches the heater off, one from its soft one on
        melts the segment, and one in between keeps it warm without letting it change.
        """

    def wait(self, at_most_s: float) -> None:
        """Let time pass; less than asked if a segment reports another stiffness meanwhile."""
