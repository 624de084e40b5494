"""A goal set of one's own: anywhere on a circle, in a given shape.

A goal set says which member to aim at, a box that holds all members (the lower bound rests on it),
and equations that members, and nothing else in the box, fulfil.
"""

import math
from typing import Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc import GoalSet, Problem, Robot, Start, load_robot, plan

Array = NDArray[np.float64]


class OnCircle(GoalSet):
    """Middle link on a circle about the origin, any heading, given curvatures."""

    radius_m: float
    kappa_per_m: tuple[float, float]

    def of_robot(self, robot: Robot) -> Self:
        """Nothing is left to the robot."""
        return self

    def box(self, near: Array) -> tuple[Array, Array]:
        """Of x, y, phi, kappa1, kappa2."""
        low = np.array([-self.radius_m, -self.radius_m, -math.inf, *self.kappa_per_m])
        return low, np.array([self.radius_m, self.radius_m, math.inf, *self.kappa_per_m])

    def aim(self, q: Array) -> Array:
        """The nearest point of the circle."""
        on_circle = q[:2] * self.radius_m / np.hypot(*q[:2])
        return np.array([*on_circle, q[2], *self.kappa_per_m])

    def residual(self, q: ca.SX) -> ca.SX:
        """In metres."""
        return (q[0] ** 2 + q[1] ** 2 - self.radius_m**2) / self.radius_m


problem = Problem(
    robot=load_robot("2sra-v1"),
    start=Start(x_m=0.30, y_m=0.10, phi_rad=0.4, kappa_per_m=[0.0, 0.0]),
    goal=OnCircle(radius_m=0.20, kappa_per_m=(20.0, -15.0)),
)
made = plan(problem).require()
print(made)
print(f"ends {np.hypot(*made.samples.q[-1, :2]):.6f} m from the origin")
