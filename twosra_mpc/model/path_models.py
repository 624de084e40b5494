r"""Path models: how the bend of the fibre follows from the travel of a locomotion unit (LU).

With alpha = kappa l the bending angle of a segment and s the travel of the moving LU [m], a path
model gives four things, and knows no other model:

``displacement``  how b0 moves while a segment bends and its far end is held [m/rad], along and
                  across b0's x axis. The paper's spiral I (its rho term), or l A and l B exactly.
``adjacent``      d alpha / d s when the LU next to the only soft segment moves (case I) [rad/m].
``opposite``      d alpha / d s when the other LU moves (case II) [rad/m].
``share``         g(alpha): how case III (both soft) splits the bend between the segments: whoever
                  moves, d alpha_1 / g(alpha_1) = d alpha_2 / g(alpha_2).
``both``          that common value per travel of the moving LU, so that in case III
                  d alpha_j / d s = both * g(alpha_j).

In every model d phi / d s = -+ d alpha / d s: b0 turns with the segment whose end is held.

``speed`` says what v_j measures, ``wheel_map`` which wheel speeds belong to it: the paper's V (a
side wheel rolls v_j, the others rest) or the exact map.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal, Protocol

import casadi as ca

from twosra_mpc.model.series import (
    sagitta_ratio,
    sinc,
    versine_ratio,
    versine_ratio_squared,
)
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.paths import ArcPath, CardioidPath, LogSpiralPath

_BOTH = 2  # case III among I, II, III


class PathModel(Protocol):
    """What the kinematics needs to know of a path; ``own`` is the segment next to the moving LU."""

    @property
    def speed(self) -> str:
        """Which point's speed v_j is, in words."""

    @property
    def wheel_map(self) -> Literal["paper", "exact"]:
        """Which wheel speeds belong to the model."""

    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Displacement of b0 along and across its x axis per bending angle [m/rad]."""

    def adjacent(self, soft: ca.SX) -> ca.SX:
        """Case I: d alpha / d s of the soft segment, the LU next to it moving [rad/m]."""

    def opposite(self, soft: ca.SX, own: ca.SX) -> ca.SX:
        """Case II: d alpha / d s of the soft segment, the LU on the rigid ``own`` moving."""

    def share(self, alpha: ca.SX) -> ca.SX:
        """Case III: the factor g(alpha) of a segment's bend."""

    def both(self, own: ca.SX, other: ca.SX) -> ca.SX:
        """Case III: d alpha / d s of either segment, divided by its ``share``."""


class FittedCurves(ABC):
    """Path models that replace the paths of cases I, II and III by fitted curves.

    Each segment bends at a rate of its own curvature alone, whatever the other one does.
    """

    @abstractmethod
    def _rate(self, k: int, alpha: ca.SX) -> ca.SX:
        """Bending angle per travel on the curve of case I, II or III (k = 0, 1, 2) [rad/m]."""

    @property
    def wheel_map(self) -> Literal["paper", "exact"]:
        return "paper"

    def adjacent(self, soft: ca.SX) -> ca.SX:
        return self._rate(0, soft)

    def opposite(self, soft: ca.SX, own: ca.SX) -> ca.SX:
        return self._rate(1, soft)

    def share(self, alpha: ca.SX) -> ca.SX:
        return self._rate(2, alpha)

    def both(self, own: ca.SX, other: ca.SX) -> ca.SX:
        return ca.SX(1)


@dataclass(frozen=True)
class LogSpiral(FittedCurves):
    """The paper's spirals in autonomous form: q_0 of its Algorithm 1 is the current q.

    rho_k = a_k exp(-b_k (abs(alpha) / m_k + pi)), d alpha / d s = m_k / rho_k (eq. kappa). The
    absolute value is rounded to sqrt(alpha^2 + eps^2) - eps, so that it is smooth at alpha = 0. The
    derivative of rho is left out of the displacement, as published.
    """

    length_m: float
    path: LogSpiralPath

    @property
    def speed(self) -> str:
        return "fibre end along its spiral (eq. kappa), taken as a side wheel's rolling speed"

    def _radius(self, k: int, alpha: ca.SX) -> ca.SX:
        eps = self.path.smoothing_rad
        size = ca.sqrt(alpha**2 + eps**2) - eps
        a, b, m = self.path.scale[k], self.path.growth[k], self.path.angle_ratio[k]
        in_phase = k == _BOTH and self.path.model == "log_spiral_corrected"
        return a * self.length_m * ca.exp(-b * (size / m + (0.0 if in_phase else math.pi)))

    def _rate(self, k: int, alpha: ca.SX) -> ca.SX:
        return self.path.angle_ratio[k] / self._radius(k, alpha)

    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        m = self.path.angle_ratio[0]
        arm = self._radius(0, alpha) / m
        turn = alpha - alpha / m
        return arm * ca.sin(turn), arm * ca.cos(turn)


@dataclass(frozen=True)
class Cardioid(FittedCurves):
    """The follow-up robot's cardioids r_k = 2 a_k (1 - cos phi_k), as meant.

    d phi / d s = 1 / r leaves out the factor sin(phi / 2) of the true arc length; the displacement
    is that of a point on cardioid I, derivative of r included.
    """

    path: CardioidPath

    @property
    def speed(self) -> str:
        return "fibre end about the cusp of its cardioid, taken as a side wheel's rolling speed"

    def _angle(self, k: int, alpha: ca.SX) -> ca.SX:
        return math.pi + self.path.phi_per_alpha[k] * alpha

    def _rate(self, k: int, alpha: ca.SX) -> ca.SX:
        radius = 2 * self.path.radius_m[k] * (1 - ca.cos(self._angle(k, alpha)))
        return 1 / (self.path.phi_per_alpha[k] * radius)

    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        phi = self._angle(0, alpha)
        arm = self.path.phi_per_alpha[0] * 4 * self.path.radius_m[0] * ca.sin(phi / 2)
        turn = alpha - 1.5 * (phi - math.pi)
        return arm * ca.sin(turn), arm * ca.cos(turn)


@dataclass(frozen=True)
class Arc:
    """Exact constant-curvature arcs; both segments bend equally when both are soft.

    v_j is the speed of the fibre end along its path (``reach_m`` None), or what a side wheel
    ``reach_m`` beyond the fibre end rolls. (t, n) are the components of that point's displacement
    per bending angle along and across its own end frame.
    """

    length_m: float
    link_m: float
    reach_m: float | None

    @property
    def speed(self) -> str:
        if self.reach_m is None:
            return "fibre end along its exact path"
        return "rolling speed of the side wheel, exact"

    @property
    def wheel_map(self) -> Literal["paper", "exact"]:
        return "exact"

    def _rate(self, t: ca.SX, n: ca.SX, lever: float) -> ca.SX:
        if self.reach_m is None:
            return 1 / ca.sqrt(t**2 + n**2)
        return 1 / (n + lever * self.reach_m)

    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        return self.length_m * sagitta_ratio(alpha), self.length_m * versine_ratio_squared(alpha)

    def adjacent(self, soft: ca.SX) -> ca.SX:
        t, n = self.displacement(soft)
        return self._rate(t, n, 1.0)

    def opposite(self, soft: ca.SX, own: ca.SX) -> ca.SX:
        along, across = self._far_end(soft, own)
        return self._rate(along, across, 1.0)

    def share(self, alpha: ca.SX) -> ca.SX:
        return ca.SX(1)

    def both(self, own: ca.SX, other: ca.SX) -> ca.SX:
        along, across = self._far_end(other, own)
        own_along, own_across = self.displacement(own)
        return self._rate(along + own_along, across + own_across, 2.0)

    def _far_end(self, soft: ca.SX, own: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Displacement of the end beyond ``own`` per bend of ``soft``, in that end's frame."""
        l, l0 = self.length_m, self.link_m  # noqa: E741  (the paper's symbols)
        c, s = ca.cos(own), ca.sin(own)
        a, b = sagitta_ratio(soft), versine_ratio_squared(soft)
        along = l * (versine_ratio(own) + c * a + s * b) + l0 * s
        across = l * (sinc(own) + c * b - s * a) + l0 * c
        return along, across


def path_model(robot: Robot) -> PathModel:
    """Build the path model that the robot description names."""
    length = robot.geometry.lengths_m[0]
    match robot.path:
        case LogSpiralPath() as spiral:
            return LogSpiral(length, spiral)
        case CardioidPath() as cardioid:
            return Cardioid(cardioid)
        case ArcPath() as arc:
            reach = robot.geometry.side_wheel_m if arc.speed_reference == "side_wheel" else None
            return Arc(length, robot.geometry.middle_link_m, reach)
