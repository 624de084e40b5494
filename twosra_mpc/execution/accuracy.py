"""How near to the goal is near enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

    @property
    def scale(self) -> Array:
        """Unit of each coordinate of q, (5,) [m, m, rad, 1/m, 1/m]."""
        position, curvature = self.position_m, self.curvature_per_m
        return np.array([position, position, self.heading_rad, curvature, curvature])

    def of_pose(self, error: Array) -> float:
        """Error of x, y, phi in units of this accuracy, from an error of q (5,)."""
        shares = error / self.scale
        return max(math.hypot(shares[0], shares[1]), abs(float(shares[2])))

    def of_shape(self, error: Array) -> float:
        """Larger error of the curvatures in units of this accuracy, from an error of q (5,)."""
        return float(np.abs(error[3:]).max()) / self.curvature_per_m

    def of(self, error: Array) -> float:
        """The larger of both; up to 1 the goal is reached."""
        return max(self.of_pose(error), self.of_shape(error))

    def surely(self, error: Array) -> bool:
        """Whether the goal is reached even if the measured error (5,) is a little wrong."""
        return self.of_pose(error) <= POSE_SHARE and self.of_shape(error) <= SHAPE_SHARE

    def describe(self, error: Array) -> str:
        """Put an error of q (5,) into words."""
        millimetres = 1e3 * math.hypot(error[0], error[1])
        degrees = math.degrees(abs(error[2]))
        first, second = error[3:].tolist()
        return (
            f"{millimetres:.1f} mm, {degrees:.2f} degrees, "
            f"{first:+.2f} and {second:+.2f} 1/m from the goal"
        )
