"""Shapes in which the wheels lose control of the robot."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from twosra_mpc.errors import InputError
from twosra_mpc.model.kinematics import TURNING_RADIUS_M, kinematics
from twosra_mpc.problem.limits import UNIT_GAP, shape_margins
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot

_SCAN = 61  # shapes per curvature in a scan for singular shapes
_SINGULAR = 1e-6  # scaled singular value below which a wheel matrix counts as singular


class SingularShape(NamedTuple):
    """A shape in which some rigid motion needs no wheel to turn; curvatures in 1/m."""

    kappa1_per_m: float
    kappa2_per_m: float
    unit_gap_m: float


def condition_number(robot: Robot, kappa: ArrayLike) -> float:
    """Condition number of the rigid wheel matrix, its turning column measured at 0.1 m."""
    values = _singular_values(robot, np.asarray(kappa, dtype=float))
    return float(values[0] / values[-1]) if values[-1] > 0 else math.inf


def singular_shapes(robot: Robot) -> list[SingularShape]:
    """Shapes within the curvature limits in which the rigid wheel matrix loses rank.

    Found by descent on the smallest singular value from every local minimum of a scan, so that
    isolated shapes are met; the mirror shape of each is listed too.

    Raises:
        InputError: If the robot has not two segments.
    """
    if robot.coordinates.segments != 2:
        allowed = "one of two segments: singular shapes are looked for in a plane"
        raise InputError("robot", robot.name, allowed)
    limit, least_gap = robot.limits.curvature_per_m, robot.limits.unit_gap_m

    def smallest(share: Array) -> float:
        return float(_singular_values(robot, limit * share)[-1])

    grid = np.linspace(-limit, limit, _SCAN)
    table = np.array([[_singular_values(robot, np.array([a, b]))[-1] for b in grid] for a in grid])
    found: list[SingularShape] = []
    for i, j in _local_minima(table):
        result = minimize(
            smallest,
            x0=np.array([grid[i], grid[j]]) / limit,
            method="Nelder-Mead",
            bounds=[(-1.0, 1.0), (-1.0, 1.0)],
            tol=1e-11,
        )
        a, b = (limit * result.x).tolist()
        known = any(math.hypot(a - s.kappa1_per_m, b - s.kappa2_per_m) < 1e-2 for s in found)
        if result.fun < _SINGULAR and not known:
            margins = shape_margins(robot, (a, b))
            found.append(SingularShape(a, b, float(margins[UNIT_GAP.name][0]) + least_gap))
    return sorted(found)


def _local_minima(table: Array) -> list[tuple[int, int]]:
    padded = np.pad(table, 1, constant_values=np.inf)
    n = len(table)
    around = [padded[i : i + n, j : j + n] for i in range(3) for j in range(3)]
    rows, columns = np.nonzero(table <= np.min(around, axis=0))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def _singular_values(robot: Robot, kappa: Array) -> Array:
    matrix = kinematics(robot).wheel_matrix([0.0, 0.0, 0.0, *kappa], robot.rigid).full()[:, 2:]
    scale = robot.geometry.wheel_radius_m * np.array([1.0, 1.0, 1.0 / TURNING_RADIUS_M])
    values: Array = np.linalg.svd(matrix * scale, compute_uv=False)
    return values
