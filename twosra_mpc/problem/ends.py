"""Where problems begin and end: whether shapes, workspace and rigid drives allow it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.problem.free_shapes import look_for_shape
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.limits import (
    BODY_GAP,
    broken_by_shapes,
    may_drive_in,
    overlap_in_words,
    shape_margins,
    workspace_margins,
)
from twosra_mpc.problem.problem import Alone, Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import ModeSequence, is_rigid

# Half-widths: boxes as small are as good as their corners.
_NARROW_M, _NARROW_RAD, _NARROW_PER_M = 0.01, 0.05, 1.0


def exact(goal: GoalSet) -> bool:
    """Whether a goal leaves no choice of a curvature that it asks for."""
    return not goal.half_width[POSE:].any()


def check_shapes(problem: Problem) -> None:
    """Refuse a start or goal all of whose shapes are forbidden by one limit or another.

    Raises:
        InputError: Naming the curvatures, a limit and what is missing.
    """
    robot, start = problem.robot, problem.start.configuration
    for name, q, box in (
        ("start", start, (start, start)),
        ("goal", problem.goal.configuration, problem.goal.box(start)),
    ):
        looked = look_for_shape(robot, *(end[POSE:] for end in box))
        if looked.forbidden:
            given = tuple(None if math.isnan(k) else k for k in q[POSE:].tolist())
            shape, which = q[POSE:], "this one"
            if None in given:
                shape = looked.shape
                which = f"({', '.join(f'{k:zg}' for k in shape)}), which lacks least,"
            raise InputError(f"{name}.kappa_per_m", given, _what_lacks(robot, shape, which))


def _what_lacks(robot: Robot, shape: Array, which: str) -> str:
    """What a shape (n,) would have to be, and is not."""
    limit = broken_by_shapes(robot, shape)
    assert limit is not None, "it is forbidden"
    if limit is BODY_GAP:
        return f"another shape; in {which} {overlap_in_words(robot, shape)}"
    short = -float(shape_margins(robot, shape)[limit.name][0])
    amount = f"{1e3 * short:z.1f} mm" if limit.unit == "m" else f"{short:z.3g} {limit.unit}"
    return f"another shape; {which} is {amount} short: {limit.words(robot.limits)}"


def _corners(width: Array) -> Array:
    """Signs of the corners of a box of these half-widths, (corners, n)."""
    return np.array([*itertools.product(*([-1.0, 1.0] if w else [0.0] for w in width))])


def check_workspace(problem: Problem) -> None:
    """Refuse a start outside of the workspace, and narrow goals with nothing inside near them.

    Raises:
        InputError: Naming the end, and by how much it is outside.
    """
    if problem.workspace is None:
        return
    for name, q in ends_to_check(problem):
        margins = workspace_margins(problem, q)
        if margins.max() < 0:
            allowed = (
                f"a robot inside the workspace; here it is {-1e3 * margins[0]:z.1f} mm outside"
            )
            raise InputError(name, tuple(q[0].tolist()), allowed)


def ends_to_check(problem: Problem) -> Iterator[tuple[str, Array]]:
    """Name and configurations (m, 3 + n) of the start, and of a goal that leaves little choice.

    Of the goal these are its middle and its corners; one that leaves more is not given.
    """
    goal, start = problem.goal, problem.start.configuration
    width = goal.half_width
    ends = goal.configuration + width * np.vstack([np.zeros_like(width), _corners(width)])
    narrow = problem.robot.coordinates.each(_NARROW_M, _NARROW_RAD, _NARROW_PER_M)
    yield "start", start[None]
    if np.isfinite(ends).all() and (width <= narrow).all():
        yield "goal", ends


def may_drive(problem: Problem | Alone, sequence: ModeSequence) -> tuple[bool, ...]:
    """For each phase, whether its inputs may be used: in some shapes rigid driving may not.

    The shape of the first rigid phase is the start's, of the last one the goal's; in between it is
    not known beforehand, and the answer is True.
    """

    def allowed(phase: int) -> bool:
        if not is_rigid(sequence[phase]):
            return True
        before = all(map(is_rigid, sequence[:phase]))
        after = all(map(is_rigid, sequence[phase:]))
        shape = (problem.start if before else problem.goal).configuration[POSE:]
        loose = not before and not exact(problem.goal)
        if not (before or after) or loose or np.isnan(shape).any():
            return True
        return bool(may_drive_in(problem.robot, shape).all())

    return tuple(allowed(phase) for phase in range(len(sequence)))
