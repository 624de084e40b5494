"""Facts about bending that planning needs as numbers: invariant coordinates and fastest rates.

W(kappa) is the *bending coordinate* of a segment: the integral of 1 / g from 0 to kappa l, with g
the path model's ``shared_rate``. In mode [1,1] both segments' W change by the same amount, so
W(kappa1) - W(kappa2) is conserved; in a one-soft mode one W changes freely and the other rests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.path_models import Arc, LogSpiral, path_model
from twosra_mpc.robot import Robot

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_PANELS = np.array([0.0, 0.02, 0.1, 0.5, 1.5, 4.0, 8.0])  # rad; fine at 0, where spirals bend


@dataclass(frozen=True)
class Bending:
    """Bending coordinate of a robot and bounds on how fast it can change.

    Attributes:
        coordinate: kappa [1/m] -> W, odd and increasing; unit [m] or [rad] after the path model.
        fastest_single: Upper bound of abs(dW/dt) with one segment soft; inf if none is proved.
        fastest_both: Upper bound of abs(dW/dt) with both soft; inf if none is proved.
    """

    coordinate: Callable[[float], float]
    fastest_single: float
    fastest_both: float


@lru_cache(maxsize=32)
def bending(robot: Robot) -> Bending:
    """Work out the bending coordinate and the proved rate bounds of ``robot``."""
    alpha = ca.SX.sym("alpha")
    path = path_model(robot)
    density = ca.Function("density", [alpha], [1 / path.shared_rate(alpha)])
    length = robot.geometry.segment_length_m

    def coordinate(kappa: float) -> float:
        return float(np.sign(kappa) * _integral(density, abs(kappa) * length))

    single, both = _fastest(robot)
    return Bending(coordinate, single, both)


def _integral(density: ca.Function, upper: float) -> float:
    """Integrate an even density from 0 to ``upper`` by Gauss-Legendre on graded panels."""
    if upper == 0.0:
        return 0.0
    edges = np.append(_PANELS[upper > _PANELS], upper)
    half = np.diff(edges)[:, None] / 2
    points = edges[:-1, None] + half * (1 + _NODES)
    values: Array = density(points.reshape(1, -1)).full().reshape(points.shape)
    return float(np.sum(half * _WEIGHTS * values))


def _fastest(robot: Robot) -> tuple[float, float]:
    """Bound abs(dW/dt) with one and with both segments soft, all locomotion units at full speed.

    Log spiral, both soft: dW = (v1 + v2) dt exactly. One soft: dW/dt = v (r_I + r_II) / r_III with
    r_k = c_k exp(p_k s), s >= 0; as a sum of exponentials of s it is convex, so its maximum over
    the curvature range lies at an end. Arc: no bound is proved yet.
    """
    match path_model(robot):
        case LogSpiral() as spiral:
            speed = _slowest_limit(robot)
            ends = np.array([0.0, robot.limits.curvature_per_m * robot.geometry.segment_length_m])
            alpha = ca.SX.sym("alpha")
            ratio = (spiral.adjacent(alpha) + spiral.opposite(alpha, alpha)) / spiral.shared_rate(
                alpha
            )
            values = ca.Function("ratio", [alpha], [ratio])(ends.reshape(1, -1)).full()
            return float(speed * values.max()), 2 * speed
        case Arc():
            return np.inf, np.inf
        case other:
            raise TypeError(f"no bending bound for path model {type(other).__name__}")


def _slowest_limit(robot: Robot) -> float:
    """Largest speed of a locomotion unit that both its own and its side wheel's limit allow."""
    wheel = robot.limits.wheel_speed_rad_s * robot.geometry.wheel_radius_m
    return min(robot.limits.unit_speed_m_s, wheel)
