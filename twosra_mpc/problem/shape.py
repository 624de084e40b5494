"""Which shapes the robot may take and drive in: units apart, wheels independent."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from twosra_mpc.errors import InputError
from twosra_mpc.model.kinematics import TURNING_RADIUS_M, kinematics, shape_margins_of
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import ModeSequence, is_rigid

Array = NDArray[np.float64]

TOUCHING_M = 1e-9  # rounding allowed in the gap
_SCAN = 61  # shapes per curvature in a scan for singular shapes
_SINGULAR = 1e-6  # scaled singular value below which a wheel matrix counts as singular


class ShapeMargins(NamedTuple):
    """Margins of shapes, arrays of equal length (negative: not allowed)."""

    unit_gap_m: Array
    wheel_independence: Array


def shape_margins(robot: Robot, kappa: ArrayLike) -> ShapeMargins:
    """How far shapes are from what the limits forbid.

    Args:
        robot: The robot.
        kappa: Curvatures, (m, n) or (n,) [1/m].
    """
    pairs = np.atleast_2d(np.asarray(kappa, dtype=float))
    values = shape_margins_of(robot, len(pairs))(pairs.T).full()
    gap = values[0] - robot.limits.unit_gap_m + TOUCHING_M
    return ShapeMargins(gap, values[1] - robot.limits.wheel_independence)


def check_shapes(problem: Problem) -> None:
    """Refuse a start or goal shape in which the locomotion units would overlap.

    Raises:
        InputError: Naming the curvatures and the gap that is missing.
    """
    for name, q in (("start", problem.start.configuration), ("goal", problem.goal.configuration)):
        if np.isnan(q[3:]).any():
            continue
        gap = float(shape_margins(problem.robot, q[3:]).unit_gap_m[0])
        if gap < 0 and not (name == "goal" and problem.goal.half_width[3:].any()):
            least = problem.robot.limits.unit_gap_m
            allowed = (
                f"a shape whose locomotion units are at least {1e3 * least:g} mm apart; "
                f"this one is {-1e3 * gap:.1f} mm short of that"
            )
            raise InputError(f"{name}.kappa_per_m", tuple(q[3:].tolist()), allowed)


def may_drive(problem: Problem, sequence: ModeSequence) -> tuple[bool, ...]:
    """For each phase, whether its inputs may be used: in singular shapes rigid driving may not.

    The shape of the first rigid phase is the start's, of the last one the goal's; in between it is
    not known beforehand, and the answer is True.
    """

    def allowed(phase: int) -> bool:
        if not is_rigid(sequence[phase]):
            return True
        before = all(map(is_rigid, sequence[:phase]))
        after = all(map(is_rigid, sequence[phase:]))
        shape = problem.start.configuration if before else problem.goal.configuration
        loose = not before and bool(problem.goal.half_width[3:].any())
        if not (before or after) or loose or np.isnan(shape[3:]).any():
            return True
        return bool(shape_margins(problem.robot, shape[3:]).wheel_independence[0] >= 0)

    return tuple(allowed(phase) for phase in range(len(sequence)))


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
    """
    limit = robot.limits.curvature_per_m

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
            gap = float(kinematics(robot).shape_margins([a, b]).full()[0, 0])
            found.append(SingularShape(a, b, gap))
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
