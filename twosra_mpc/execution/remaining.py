"""The rest of a problem, from where the robot is: what is planned when a plan has to be left."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.accuracy import Accuracy
from twosra_mpc.problem.problem import Goal, Problem, Start, Tolerance
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
    return Problem(**{**dict(problem), "start": start, "goal": goal, "modes": modes})


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


def _goal(goal: Goal, q: Array, accuracy: Accuracy, broken: Collection[int]) -> Goal:
    """The same goal, with curvature tolerances within which nothing needs to melt."""
    widths = list(goal.tolerance.kappa_per_m)
    off = np.abs(goal.error(q.copy())[POSE:]) / accuracy.curvature_per_m
    for segment in range(len(widths)):
        kept = ACCEPTED if segment not in broken else 1.0
        share = float(off[segment]) + _ROUNDING if off[segment] <= kept else 0.0
        widths[segment] += share * accuracy.curvature_per_m
    tolerance = Tolerance(**{**dict(goal.tolerance), "kappa_per_m": tuple(widths)})
    return Goal(**{**dict(goal), "tolerance": tolerance})
