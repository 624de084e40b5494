"""Facts about bending that planning needs as numbers: invariant coordinates and fastest rates.

W(kappa) is the *bending coordinate* of a segment: the integral of 1 / g from 0 to kappa l, with g
the path model's ``share``. In mode [1,1] both segments' W change by the same amount, so
W(kappa1) - W(kappa2) is conserved; in a one-soft mode one W changes freely and the other rests.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import kinematics, shape_margins_of
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import SOFT_1, SOFT_BOTH, Mode

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_PANELS = np.array([0.0, 0.02, 0.1, 0.5, 1.5, 4.0, 8.0])  # rad; fine at 0, where spirals bend
_TABLE = 2001  # points of the table that inverts W
_BOXES = {0: 1, 1: 200, 2: 40}  # boxes per curvature range, by number of unknown curvatures
_CERTAIN_M = 1e-4  # overlap that interpolating the inverse (below 1e-6 m) cannot feign
_PIECES = 40  # pieces of a bend whose least time is proved


@dataclass(frozen=True)
class Bending:
    """Bending coordinate of a robot, and proved bounds on how fast it can change."""

    robot: Robot

    def coordinate(self, kappa: float) -> float:
        """W(kappa), odd and increasing; unit [m] for spirals and cardioids, [rad] for arcs."""
        return _coordinate(self.robot, kappa)

    def curvature(self, coordinates: Array) -> Array:
        """Inverse of ``coordinate``, interpolated to 1e-9 rad; clipped just beyond the limits."""
        _, table = _inverse_table(self.robot)
        inverse: Array = _inverse(self.robot)(np.clip(coordinates, table[0], table[-1]))
        return inverse

    def fastest(self, mode: Mode, kappa: tuple[float | None, float | None]) -> float:
        """Upper bound of abs(dW/dt) of a soft segment with both locomotion units at full speed.

        ``kappa`` fixes a segment's curvature [1/m]; None lets it be anything within the limits.
        """
        return _fastest(self.robot, mode, kappa)

    def least_time(self, mode: Mode, origin: tuple[float, float], bend: float) -> float:
        """Lower bound on the time in which ``mode`` changes W by ``bend``, from (W_1, W_2) on.

        Whatever the path, W passes every value in between, each at no more than the fastest rate
        there; so the sum over pieces of abs(dW) / (enclosed rate) is a lower bound. It is infinite
        if one of those shapes makes the locomotion units overlap.
        """
        pieces = bend * np.linspace(0.0, 1.0, _PIECES + 1)
        edges = [self._curvature(origin[j] + mode[j] * pieces) for j in (0, 1)]
        if self._collides([origin[j] + mode[j] * pieces for j in (0, 1)]):
            return np.inf
        lower = np.array([np.minimum(edge[:-1, 0], edge[1:, 0]) for edge in edges])
        upper = np.array([np.maximum(edge[:-1, 1], edge[1:, 1]) for edge in edges])
        rates = _largest_rate(self.robot, mode, lower, upper)
        return float(np.sum(abs(bend) / _PIECES / rates))

    def motions_between(
        self, mode: Mode, origin: tuple[float, float], along: Array
    ) -> tuple[Array, Array]:
        """Enclose what each locomotion unit at full speed does to the robot during a bend.

        Args:
            mode: A soft mode.
            origin: (W_1, W_2) where ``along`` is 0.
            along: Changes of W, increasing; between neighbours lies a box of shapes, (n + 1,).

        Returns:
            Lower and upper bounds in each box, each (2, 4, n): for LU1 and LU2 b0's twist
            (u, v, r) [m/s, m/s, rad/s] and dW/dt.
        """
        edges = [self._curvature(origin[j] + mode[j] * along) for j in (0, 1)]
        lower = np.array([np.minimum(edge[:-1, 0], edge[1:, 0]) for edge in edges])
        upper = np.array([np.maximum(edge[:-1, 1], edge[1:, 1]) for edge in edges])
        twists = enclose(_twists(self.robot, mode), lower, upper)
        rates = enclose(_rates(self.robot, mode), lower, upper)
        speed = _unit_speed(self.robot)
        low, high = (
            speed * np.concatenate([twist.reshape(2, 3, -1), rate[:, None]], axis=1)
            for twist, rate in zip(twists, rates, strict=True)
        )
        return low, high

    def _collides(self, coordinates: list[Array]) -> bool:
        """Whether the units overlap by over 0.1 mm in one of the shapes with these W."""
        shapes = np.array([self.curvature(w) for w in coordinates])
        gaps = shape_margins_of(self.robot, shapes.shape[1])(shapes).full()[0]
        return bool(gaps.min() < self.robot.limits.unit_gap_m - _CERTAIN_M)

    def _curvature(self, coordinates: Array) -> Array:
        """Curvatures between which W takes these values, (n, 2): grid neighbours of the inverse."""
        kappa, table = _inverse_table(self.robot)
        above = np.clip(np.searchsorted(table, coordinates), 1, _TABLE - 1)
        return np.column_stack([kappa[above - 1], kappa[above]])


def bending(robot: Robot) -> Bending:
    """Describe how ``robot`` bends."""
    return Bending(robot)


@lru_cache(maxsize=1024)
def _coordinate(robot: Robot, kappa: float) -> float:
    upper = abs(kappa) * robot.geometry.lengths_m[0]
    edges = np.append(_PANELS[upper > _PANELS], upper)
    half = np.diff(edges)[:, None] / 2
    if half.size == 0:
        return 0.0
    points = edges[:-1, None] + half * (1 + _NODES)
    values: Array = _density(robot)(points.reshape(1, -1)).full().reshape(points.shape)
    return float(np.sign(kappa) * np.sum(half * _WEIGHTS * values))


@lru_cache(maxsize=32)
def _density(robot: Robot) -> ca.Function:
    alpha = ca.SX.sym("alpha")
    return ca.Function("density", [alpha], [1 / path_model(robot).share(alpha)])


@lru_cache(maxsize=32)
def _inverse_table(robot: Robot) -> tuple[Array, Array]:
    """A grid of curvatures a little beyond the limits, and W there."""
    limit = 1.01 * robot.limits.curvature_per_m
    half = np.linspace(0.0, limit, _TABLE // 2 + 1)
    widths = np.diff(half) * robot.geometry.lengths_m[0]
    points = half[:-1, None] * robot.geometry.lengths_m[0] + widths[:, None] / 2 * (1 + _NODES)
    values = _density(robot)(points.reshape(1, -1)).full().reshape(points.shape)
    cumulative = np.concatenate([[0.0], np.cumsum(values @ _WEIGHTS * widths / 2)])
    kappa = np.concatenate([-half[:0:-1], half])
    return kappa, np.concatenate([-cumulative[:0:-1], cumulative])


@lru_cache(maxsize=32)
def _inverse(robot: Robot) -> CubicHermiteSpline:
    """W -> kappa through the table, with the slope dkappa / dW = g / l at its points."""
    kappa, table = _inverse_table(robot)
    length = robot.geometry.lengths_m[0]
    slopes = 1 / (length * _density(robot)(kappa[None] * length).full()[0])
    return CubicHermiteSpline(table, kappa, slopes)


@lru_cache(maxsize=64)
def _rates(robot: Robot, mode: Mode) -> ca.Function:
    """(kappa1, kappa2) -> dW/ds of a soft segment per travel of LU1 and of LU2."""
    kappa, path = ca.SX.sym("kappa", 2), path_model(robot)
    alpha = kappa * robot.geometry.lengths_m[0]
    if mode == SOFT_BOTH:
        rates = ca.vertcat(path.both(alpha[0], alpha[1]), path.both(alpha[1], alpha[0]))
    else:
        soft, own = alpha[mode.index(1)], alpha[mode.index(0)]
        near, far = path.adjacent(soft), path.opposite(soft, own)  # LU next to it, the other LU
        rates = ca.vertcat(*((near, far) if mode == SOFT_1 else (far, near))) / path.share(soft)
    return ca.Function("rates", [kappa], [ca.densify(rates)])


def _largest_rate(robot: Robot, mode: Mode, lower: Array, upper: Array) -> Array:
    """Enclosed maximum of abs(dW/dt) in each box of curvatures, both units at full speed."""
    low, high = enclose(_rates(robot, mode), lower, upper)
    per_travel: Array = np.maximum(np.abs(low), np.abs(high)).sum(axis=0)
    return np.where(np.isnan(per_travel), np.inf, per_travel) * _unit_speed(robot)


@lru_cache(maxsize=32)
def _twists(robot: Robot, mode: Mode) -> ca.Function:
    """(kappa1, kappa2) -> twists (u, v, r) of b0 per travel of LU1 and of LU2, stacked (6,)."""
    kappa = ca.SX.sym("kappa", 2)
    jacobian = kinematics(robot).jacobian(ca.vertcat(0, 0, 0, kappa), mode)
    stacked = ca.vertcat(jacobian[:3, 0], jacobian[:3, 1])
    return ca.Function("twists", [kappa], [ca.densify(stacked)])


def _unit_speed(robot: Robot) -> float:
    """Full speed of a locomotion unit [m/s]."""
    speed = robot.limits.unit_speed_m_s
    if path_model(robot).wheel_map == "paper":  # there a side wheel rolls as far as its unit goes
        return min(speed, robot.limits.wheel_speed_rad_s * robot.geometry.wheel_radius_m)
    return speed


@lru_cache(maxsize=512)
def _fastest(robot: Robot, mode: Mode, kappa: tuple[float | None, float | None]) -> float:
    limit, boxes = robot.limits.curvature_per_m, _BOXES[sum(value is None for value in kappa)]
    edges = [
        np.linspace(-limit, limit, boxes + 1) if value is None else np.array([value, value])
        for value in kappa
    ]
    lower = np.array(list(itertools.product(edges[0][:-1], edges[1][:-1]))).T
    upper = np.array(list(itertools.product(edges[0][1:], edges[1][1:]))).T
    return float(_largest_rate(robot, mode, lower, upper).max())
