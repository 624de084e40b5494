"""The rest of a problem, from where the robot is: what is planned when a plan has to be left."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.accuracy import Accuracy
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode

Array = NDArray[np.float64]

ACCEPTED = 0.85  # curvature errors up to this share of the accuracy are left as they are
_ROUNDING = 1e-9
_CLEARLY_K = 0.5  # a reported stiffness overrules a temperature on the wrong side by this


def remaining_problem(
    problem: Problem,
    q: Array,
    temperature_C: tuple[float, ...],
    mode: Mode,
    accuracy: Accuracy,
    broken: Collection[int] = (),
) -> Problem:
    """State what is left of a problem.

    Curvatures that are near enough need not change, so the segment need not melt again; only those
    that are not are asked for.

    Args:
        problem: What was asked in the beginning.
        q: Configuration now, (3 + n,).
        temperature_C: Measured temperatures.
        mode: Stiffness now, as reported; no segment may be changing.
        accuracy: How near to the goal is near enough.
        broken: Segments (from 0) that cannot be melted any more.

    Raises:
        InputError: If no mode is left.
    """
    limit = problem.robot.limits.curvature_per_m
    kappa = np.clip(q[POSE:], -limit, limit)
    start = Start(
        x_m=q[0],
        y_m=q[1],
        phi_rad=q[2],
        kappa_per_m=tuple(kappa.tolist()),
        temperature_C=_temperatures(problem, temperature_C, mode),
    )
    modes = tuple(m for m in problem.modes if not any(m[segment] for segment in broken))
    goal = _goal(problem.goal, np.concatenate([q[:POSE], kappa]), accuracy, broken)
    return problem.with_values(start=start, goal=goal, modes=modes)


def _temperatures(problem: Problem, measured_C: tuple[float, ...], mode: Mode) -> tuple[float, ...]:
    """Temperatures that agree with the reported stiffness and the heater's range."""
    solid, liquid = problem.stiffness_thresholds_C
    heater = problem.robot.heater

    def agreed(temperature_C: float, soft: int) -> float:
        if soft:
            temperature_C = max(temperature_C, liquid + _CLEARLY_K)
        else:
            temperature_C = min(temperature_C, solid - _CLEARLY_K)
        return min(max(temperature_C, heater.temperature_min_C), heater.temperature_max_C)

    return tuple(map(agreed, measured_C, mode))


def _goal(goal: GoalSet, q: Array, accuracy: Accuracy, broken: Collection[int]) -> GoalSet:
    """The same goal, with curvature tolerances within which nothing needs to melt."""
    off = np.abs(goal.error(q.copy())[POSE:]) / accuracy.curvature_per_m
    kept = [1.0 if segment in broken else ACCEPTED for segment in range(len(off))]
    return goal.loosened(np.where(off <= kept, off + _ROUNDING, 0.0) * accuracy.curvature_per_m)
