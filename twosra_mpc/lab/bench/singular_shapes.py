"""Shapes in which the wheels lose control of the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter
from scipy.optimize import minimize

from twosra_mpc.model.kinematics import TURNING_RADIUS_M, kinematics
from twosra_mpc.problem.limits import UNIT_GAP, WHEEL_INDEPENDENCE, shape_margins
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot

MOST_SHAPES = 5  # that are reported where singular shapes are not isolated
_SCAN = {1: 61, 2: 61, 3: 17, 4: 9}  # shapes per curvature in a scan, by number of segments
_DESCENTS = 40  # from the best shapes of the scan
_SINGULAR = 1e-6  # scaled wheel rates below which a motion needs no wheel to turn
_SAME_PER_M = 1e-2  # nearer shapes are one, found twice


class SingularShape(NamedTuple):
    """A shape in which some rigid motion needs no wheel to turn; curvatures (n,) in 1/m."""

    kappa_per_m: tuple[float, ...]
    unit_gap_m: float


def singular_set_in_words(segments: int) -> str:
    """Dimension of the set of singular shapes: loss of rank costs two of ``segments`` freedoms."""
    return ("isolated shapes", "isolated shapes", "curves", "surfaces")[segments - 1]


def condition_number(robot: Robot, kappa: Sequence[float]) -> float:
    """Condition number of the rigid wheel matrix, its turning column measured at 0.1 m."""
    values = np.linalg.svd(_scaled_wheels(robot, kappa), compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else math.inf


def singular_shapes(robot: Robot) -> list[SingularShape]:
    """Shapes within the curvature limits in which the rigid wheel matrix loses rank.

    From local minima of a scan, descent to the nearest shape of least norm with a motion that turns
    no wheel. With up to two segments such shapes are isolated, and all that are met are
    returned, in order. With more they form curves or surfaces: at most `MOST_SHAPES` are returned,
    those of least norm, nearest to the straight shape.
    """
    segments, limit = robot.geometry.segments, robot.limits.curvature_per_m
    axis = np.linspace(-limit, limit, _SCAN[segments])
    grid = np.stack(np.meshgrid(*[axis] * segments, indexing="ij"), axis=-1)
    shapes = grid.reshape(-1, segments)
    table = shape_margins(robot, shapes)[WHEEL_INDEPENDENCE.name].reshape(grid.shape[:-1])
    starts = shapes[(table <= minimum_filter(table, size=3, mode="nearest")).ravel()]
    margins = shape_margins(robot, starts)[WHEEL_INDEPENDENCE.name]
    found: list[Array] = []
    for start in starts[np.argsort(margins, kind="stable")][:_DESCENTS]:
        kappa = _nearest_singular(robot, start)
        if kappa is not None and all(np.abs(kappa - k).max() > _SAME_PER_M for k in found):
            found.append(kappa)
    if segments > 2:
        found = sorted(found, key=lambda kappa: round(float(np.linalg.norm(kappa)), 6))
        found = found[:MOST_SHAPES]
    return sorted(_described(robot, kappa) for kappa in found)


def _nearest_singular(robot: Robot, start: Array) -> Array | None:
    """Shape of locally least norm with a unit twist that turns no wheel, from this shape on."""
    limit, size = robot.limits.curvature_per_m, len(start)
    twist = np.linalg.svd(_scaled_wheels(robot, start))[2][-1]
    begin: Array = np.concatenate([start / limit, twist])

    def norm(z: Array) -> float:
        return float(z[:size] @ z[:size]) / size

    def off(z: Array) -> Array:
        rates = _scaled_wheels(robot, limit * z[:size]) @ z[size:]
        return np.append(rates, z[size:] @ z[size:] - 1)

    constraints: Any = [{"type": "eq", "fun": off}]
    settings: Any = {"method": "SLSQP", "bounds": [(-1.0, 1.0)] * len(begin), "tol": 1e-12}
    result = minimize(norm, begin, constraints=constraints, **settings)
    kappa: Array = limit * result.x[:size]
    return kappa if np.abs(off(result.x)).max() < _SINGULAR else None


def _described(robot: Robot, kappa: Array) -> SingularShape:
    gap_m = float(shape_margins(robot, kappa)[UNIT_GAP.name][0]) + robot.limits.unit_gap_m
    return SingularShape(tuple(kappa.tolist()), gap_m)


def _scaled_wheels(robot: Robot, kappa: Sequence[float] | Array) -> Array:
    """Rigid wheel matrix (4, 3) of a shape (n,), wheel radius divided out, turning at 0.1 m."""
    matrix = kinematics(robot).wheel_matrix([0.0, 0.0, 0.0, *kappa], robot.rigid).full()[:, 2:]
    turning = np.array([1.0, 1.0, 1.0 / TURNING_RADIUS_M])
    return matrix * robot.geometry.wheel_radius_m * turning
