"""Accuracy with which runs of a robot end at their goals."""

from __future__ import annotations

import math

import numpy as np

from twosra_mpc.robot.coordinates import POSE, Array, Coordinates
from twosra_mpc.validation import Positive, Value

PLANNED = 0.7  # of the accuracy: what plans use of it; the rest is for the run
POSE_SHARE = 0.7  # of the accuracy: more is corrected, which takes seconds
SHAPE_SHARE = 0.9  # of the accuracy: more is planned again, which takes minutes
ACCEPTED = 0.85  # curvature errors up to this share of the accuracy are left as they are


class Accuracy(Value):
    """Distances from the goal at which a run has reached it.

    A robot file gives it as ``[accuracy]``; goals without a tolerance of their own are then planned
    to within 0.7 of it.

    Attributes:
        position_m: In the plane.
        heading_rad: Of b0.
        curvature_per_m: Of each segment.
    """

    position_m: Positive = 2e-3
    heading_rad: Positive = math.radians(1.0)
    curvature_per_m: Positive = 1.0

    def scale(self, coordinates: Coordinates) -> Array:
        """Unit of each coordinate of q, (3 + n,) [m, m, rad, 1/m ...]."""
        return coordinates.each(self.position_m, self.heading_rad, self.curvature_per_m)

    def planned(self, coordinates: Coordinates) -> Array:
        """Half-widths of the box that plans end in, (3 + n,): in x and y a square in the circle."""
        side_m = self.position_m / math.sqrt(2)
        return PLANNED * coordinates.each(side_m, self.heading_rad, self.curvature_per_m)

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
        """True if the goal is reached even if the measured error (3 + n,) is a bit off."""
        return self.of_pose(error) <= POSE_SHARE and self.of_shape(error) <= SHAPE_SHARE

    def describe(self, error: Array) -> str:
        """Put an error of q (3 + n,) into words."""
        millimetres = 1e3 * math.hypot(error[0], error[1])
        degrees = math.degrees(abs(error[2]))
        bent = " and ".join(f"{kappa:+z.2f}" for kappa in error[POSE:].tolist())
        return f"{millimetres:z.1f} mm, {degrees:z.2f} degrees, {bent} 1/m from the goal"
