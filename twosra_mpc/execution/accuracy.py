"""How near to the goal is near enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.coordinates import POSE, Coordinates

Array = NDArray[np.float64]

POSE_SHARE = 0.7  # of the accuracy: more is corrected, which takes seconds
SHAPE_SHARE = 0.9  # of the accuracy: more is planned again, which takes minutes


@dataclass(frozen=True)
class Accuracy:
    """Distances from the goal box at which the goal counts as reached.

    Attributes:
        position_m: In the plane.
        heading_rad: Of b0.
        curvature_per_m: Of each segment.
    """

    position_m: float = 2e-3
    heading_rad: float = math.radians(1.0)
    curvature_per_m: float = 1.0

    def scale(self, coordinates: Coordinates) -> Array:
        """Unit of each coordinate of q, (3 + n,) [m, m, rad, 1/m ...]."""
        return coordinates.each(self.position_m, self.heading_rad, self.curvature_per_m)

    def of_pose(self, error: Array) -> float:
        """Error of x, y, phi in units of this accuracy, from an error of q (3 + n,)."""
        far_m, turn_rad = math.hypot(error[0], error[1]), abs(float(error[2]))
        return max(far_m / self.position_m, turn_rad / self.heading_rad)

    def of_shape(self, error: Array) -> float:
        """Largest error of a curvature in units of this accuracy, from an error of q (3 + n,)."""
        return float(np.abs(error[POSE:]).max()) / self.curvature_per_m

    def of(self, error: Array) -> float:
        """The larger of both; up to 1 the goal is reached."""
        return max(self.of_pose(error), self.of_shape(error))

    def surely(self, error: Array) -> bool:
        """Whether the goal is reached even if the measured error (3 + n,) is a bit off."""
        return self.of_pose(error) <= POSE_SHARE and self.of_shape(error) <= SHAPE_SHARE

    def describe(self, error: Array) -> str:
        """Put an error of q (3 + n,) into words."""
        millimetres = 1e3 * math.hypot(error[0], error[1])
        degrees = math.degrees(abs(error[2]))
        bent = " and ".join(f"{kappa:+.2f}" for kappa in error[POSE:].tolist())
        return f"{millimetres:.1f} mm, {degrees:.2f} degrees, {bent} 1/m from the goal"
