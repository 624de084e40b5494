"""Ends of problems: whether shapes, workspace and rigid drives allow them.

A box of shapes is searched for one that is allowed, or for the proof that none is: none is where
its middle misses a limit by more than the margin can change within the box. Other boxes are halved,
until the middle of one is allowed or none is left. As margins count as zero within rounding, that
always ends.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.errors import InputError
from twosra_mpc.keys import unit_of
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.self_collision import self_collision
from twosra_mpc.problem import limits
from twosra_mpc.problem.problem import Alone, Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import ModeSequence, is_rigid

# Half-widths: boxes as small are as good as their corners.
_NARROW_M, _NARROW_RAD, _NARROW_PER_M = 0.01, 0.05, 1.0


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
    """Words for the shape limit that a shape (n,) violates, and by how much."""
    limit = limits.broken_by_shapes(robot, shape)
    assert limit is not None, "it is forbidden"
    if limit is limits.BODY_GAP:
        return f"another shape; in {which} {limits.overlap_in_words(robot, shape)}"
    short = -float(limits.shape_margins(robot, shape)[limit.name][0])
    unit = unit_of(limit.name)
    amount = f"{1e3 * short:z.1f} mm" if unit == "m" else f"{short:z.3g} {unit}"
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
        margins = limits.workspace_margins(problem, q)
        if margins.max() < 0:
            out_mm = -1e3 * margins[0]
            allowed = f"a robot inside the workspace; here it is {out_mm:z.1f} mm outside"
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
    usable = [True] * len(sequence)
    for phase in (i for i, mode in enumerate(sequence) if is_rigid(mode)):
        before = all(map(is_rigid, sequence[:phase]))
        shape = (problem.start if before else problem.goal).configuration[POSE:]
        exact = not problem.goal.half_width[POSE:].any()  # the goal leaves no choice of a shape
        known = before or (exact and all(map(is_rigid, sequence[phase:])))
        if known and not np.isnan(shape).any():
            usable[phase] = bool(limits.may_drive_in(problem.robot, shape).all())
    return tuple(usable)


_MOST = 4096  # boxes of a size; where more are left, nothing is proved
_SIDES = np.array([-1.0, 1.0])[:, None, None]


class Looked(NamedTuple):
    """Knowledge of a box of shapes.

    Attributes:
        shape: Of those that were looked at the one that misses limits least, (n,) [1/m].
        allowed: Whether it misses none.
        forbidden: Whether every shape of the box is proved to miss one.
    """

    shape: Array
    allowed: bool
    forbidden: bool


def look_for_shape(robot: Robot | Body, low: ArrayLike, high: ArrayLike) -> Looked:
    """Look for a shape in a box that no limit forbids, whether the robot drives in it or not.

    Args:
        robot: The robot.
        low: Least curvatures, (n,) [1/m]; -inf where they are free.
        high: Largest.
    """
    body, best, least = robot.body, np.zeros(0), -np.inf
    most = body.limits.curvature_per_m
    lower, upper = np.clip([low, high], -most, most)
    middles, half = (lower + upper)[None] / 2, (upper - lower) / 2
    own, (names, steep, steepest) = self_collision(body), _steepness(body, bool(half.any()))
    while 0 < len(middles) <= _MOST:
        margins = limits.shape_margins(body, middles)
        margin = np.array([margins[name] for name in names])
        left_per_m = (margin / steepest).min(axis=0)
        at = int(left_per_m.argmax())
        if left_per_m[at] > least:
            best, least = middles[at], left_per_m[at]
        if least >= 0:
            break
        possible = (margin + (steep @ half)[:, None] >= 0).all(axis=0)
        meet = possible & (margins[limits.BODY_GAP.name] < 0)
        left_m = own.separations(middles[meet]) + own.eased_m2 @ half
        possible[meet] = (left_m >= -limits.BODY_GAP.rounding).all(axis=1)
        widest = np.eye(len(half))[(half * body.geometry.lengths_m).argmax()]
        half = half * (1 - widest / 2)
        aside = _SIDES * half * widest
        middles = (middles[possible] + aside).reshape(-1, len(half))
    return Looked(best, bool(least >= 0), not len(middles))


@per_body(2)
def _steepness(body: Body, boxes: bool) -> tuple[list[str], Array, Array]:
    """Limits that forbid shapes, and how much each margin changes per curvature, (limits, n).

    And at most, (limits, 1). Of single shapes also those of which that is not known: they count as
    the curvature does.
    """
    forbids = [limit for limit in limits.SHAPE_LIMITS if not limit.driving]
    known = [limit for limit in forbids if limit.steep is not None or not boxes]
    alike = np.ones(body.geometry.segments)
    steep = np.array([limit.steep(body) if limit.steep else alike for limit in known])
    return [limit.name for limit in known], steep, steep.max(axis=1, keepdims=True)
