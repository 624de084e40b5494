"""Remaining problem when a run has to be planned again."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.limits import bent_back
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.robot.accuracy import ACCEPTED, PLANNED
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode

_ROUNDING = 1e-9
_CLEARLY_K = 0.5  # a reported stiffness overrules a temperature on the wrong side by this


def remaining_problem(
    problem: Problem,
    q: Array,
    temperature_C: tuple[float, ...],
    mode: Mode,
    broken: Collection[int] = (),
    misses: int = 0,
    avoided: Collection[Mode] = (),
) -> Problem:
    """State what is left of a problem.

    Curvatures that are near enough need not change, so the segment need not melt again; only those
    that are not are asked for, and one that alone is soft, which costs next to nothing. A robot
    that is believed to be bent into itself starts bent back.

    Args:
        problem: What was asked in the beginning.
        q: Configuration now, (3 + n,).
        temperature_C: Measured temperatures.
        mode: Stiffness now, as reported; no segment may be changing.
        broken: Segments (from 0) that cannot be melted any more.
        misses: How often bends have missed so far: the next are aimed nearer to the middle.
        avoided: Modes in which they have.

    Raises:
        InputError: If no mode is left.
    """
    kappa = bent_back(problem.robot, q[POSE:])
    start = Start(
        x_m=q[0],
        y_m=q[1],
        phi_rad=q[2],
        kappa_per_m=tuple(kappa.tolist()),
        temperature_C=_temperatures(problem, temperature_C, mode),
        holding=problem.start.holding,
    )
    modes = tuple(m for m in problem.modes if not any(m[segment] for segment in broken))
    modes = tuple(m for m in modes if m not in avoided)
    aimed = PLANNED / (2 + misses)
    goal = _goal(problem, np.concatenate([q[:POSE], kappa]), mode, broken, aimed)
    workspace = problem.workspace
    if workspace is not None:  # who is out of it already needs so much more room
        shape = robot_shape(problem.robot.geometry, start.configuration)
        thick = problem.robot.geometry.fibre_radius_m
        fibre = (part + end for part in (shape.segments, shape.links) for end in (-thick, thick))
        outline = (shape.units, shape.wheels, *fibre)
        workspace = workspace.holding(np.concatenate([part.reshape(-1, 2) for part in outline]))
    return problem.with_values(start=start, goal=goal, modes=modes, workspace=workspace)


def tasks_left(tasks: tuple[Pass, ...], path: Array) -> tuple[Pass, ...]:
    """Tasks that a path (m, 3 + n) has not done yet, in their order."""
    for done, task in enumerate(tasks):
        met = task.met(path[:, :POSE])
        if not met.any():
            return tasks[done:]
        path = path[met.argmax() :]
    return ()


def _temperatures(problem: Problem, measured_C: tuple[float, ...], mode: Mode) -> tuple[float, ...]:
    """Temperatures that agree with the reported stiffness and the heater's range."""
    solid, liquid = problem.stiffness_thresholds_C
    soft = np.maximum(measured_C, liquid + _CLEARLY_K)
    rigid = np.minimum(measured_C, solid - _CLEARLY_K)
    heater = problem.robot.heater
    agreed = np.where(mode, soft, rigid).clip(heater.temperature_min_C, heater.temperature_max_C)
    return tuple(agreed.tolist())


def _goal(problem: Problem, q: Array, mode: Mode, broken: Collection[int], aimed: float) -> GoalSet:
    """The middle of the goal, with curvature tolerances within which nothing needs to melt.

    What must bend, or alone is soft, is ``aimed`` at to within so much of the accuracy.
    """
    scale = problem.robot.ends_within.scale(problem.robot.coordinates)
    goal = problem.judged_goal
    off = np.abs(goal.error(q.copy())) / scale
    kept, bends = np.where(mode, aimed if sum(mode) == 1 else ACCEPTED, ACCEPTED), off[POSE:]
    kept[list(broken)] = 1.0
    wider = np.where(bends <= kept, bends + _ROUNDING, aimed)
    return goal.loosened(scale * [0.0, 0.0, 0.0, *wider])
