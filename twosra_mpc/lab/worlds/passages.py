"""Passages: shapes that can drive from the start of a problem to its goal, and those that cannot.

A shape is kept all the way. Free slices of headings decide: F- certifies a drive, F+ proves that
there is none; between them the shape stays undecided at the finest slices.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.problem.limits import broken_by_shapes, may_drive_in
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.space.drives import Drives

if TYPE_CHECKING:  # it imports shapely
    from twosra_mpc.space.possible import Box

Verdict = Literal["certified", "blocked", "undecided", "not allowed"]
Headings = Literal["free", "given"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


_MOST_STEPS = 200  # of the grid, from straight to the most that is allowed


@dataclass(frozen=True, eq=False)
class Passages:
    """Verdicts on shapes on a grid.

    Attributes:
        kappa_per_m: Curvatures on the grid, the same for both segments, (m,) [1/m].
        verdicts: One of ``VERDICTS`` for each shape, (m, m), segment 1 first. "not allowed": the
            robot's own limits forbid to drive in it. Nothing is said of shapes in between.
        start: Verdict on the shape at the start.
        goal: Verdict on the goal's shape; None if the goal leaves it open.
        nearest_per_m: The certified shape on the grid that is nearest to that at the start, by the
            segment that differs most; None if there is none.
    """

    kappa_per_m: Array
    verdicts: NDArray[np.str_]
    start: Verdict
    goal: Verdict | None
    nearest_per_m: tuple[float, float] | None

    def count(self, verdict: Verdict) -> int:
        """Number of shapes on the grid with a verdict."""
        return int((self.verdicts == verdict).sum())


def find_passages(
    problem: Problem,
    step_per_m: float = 10.0,
    headings: Headings = "free",
    progress: Callable[[int, int], None] | None = None,
) -> Passages:
    """Decide for shapes on a grid whether a drive from start to goal exists.

    Args:
        problem: Its robot must have two segments.
        step_per_m: Between neighbours on the grid; (0, 0) is on it.
        headings: "free": from the start's position to the goal's, at whatever headings; "given": at
            those of start and goal.
        progress: Told the number of shapes done, and of all.

    Raises:
        InputError: If the robot has not two segments, or the step is not positive or too small.
    """
    robot = problem.robot
    if robot.coordinates.segments != 2:
        raise InputError("robot", robot.name, "one of two segments: shapes are drawn in a plane")
    most = robot.limits.curvature_per_m
    if not most / _MOST_STEPS <= step_per_m < math.inf:
        allowed = f"a finite number, at least {most / _MOST_STEPS:zg} 1/m"
        raise InputError("step_per_m", step_per_m, allowed)
    count = math.floor(most / step_per_m)
    kappa = step_per_m * np.arange(-count, count + 1, dtype=float)
    ends = [problem.start.configuration, problem.goal.configuration]
    shapes = [*itertools.product(kappa.tolist(), repeat=2), *(tuple(q[POSE:]) for q in ends)]
    found = []
    for done, shape in enumerate(shapes):
        found.append(_verdict(problem, np.array(shape), headings))
        if progress is not None:
            progress(done + 1, len(shapes))
    *grid, start, goal = found
    verdicts = np.array(grid).reshape(len(kappa), -1)
    nearest = _nearest(kappa, verdicts, ends[0][POSE:])
    return Passages(kappa, verdicts, start or "undecided", goal, nearest)


def _verdict(problem: Problem, kappa: Array, headings: Headings) -> Verdict | None:
    if np.isnan(kappa).any():
        return None
    robot, shape = problem.robot, kappa[None]
    if broken_by_shapes(robot, shape) or not may_drive_in(robot, shape)[0]:
        return "not allowed"
    drives = Drives(robot, problem.world, kappa)
    return decide_between(drives, *_boxes(problem, headings))


def decide_between(drives: Drives, start: Box, goal: Box) -> Verdict:
    """Verdict on drives from one box of poses to another; infinite ends are free."""
    from twosra_mpc.space.possible import apart  # shapely

    kept_m = _kept_by_the_first_leg(drives, *start)
    for fineness in drives.headings:
        sure = drives.certified_slices(fineness)
        if not apart(sure, start, goal):
            return "certified"
        if apart(drives.possible_slices(fineness, kept_m), start, goal):
            return "blocked"
    return "undecided"


def _kept_by_the_first_leg(drives: Drives, low: Array, high: Array) -> float:
    """Clearance that drives which start in a box of headings must keep."""
    if low[2] == high[2]:
        return drives.separation.kept_from_m(low[None])
    turned = np.linspace(0.0, 2 * np.pi, drives.headings[-1])
    poses = np.column_stack([np.tile(low[:2], (len(turned), 1)), turned])
    between = drives.footprint.radius_m * float(turned[1])
    return drives.separation.kept_from_m(poses, between)


def _boxes(problem: Problem, headings: Headings) -> tuple[Box, Box]:
    """Poses to start at, and to end at."""
    at = problem.start.configuration[:POSE].copy()
    low, high = problem.goal.box(problem.start.configuration)
    boxes = (at, at.copy()), (low[:POSE].copy(), high[:POSE].copy())
    if headings == "free":
        for least, most in boxes:
            least[2], most[2] = -np.inf, np.inf
    return boxes


def _nearest(kappa: Array, verdicts: NDArray[np.str_], start: Array) -> tuple[float, float] | None:
    rows, columns = np.nonzero(verdicts == "certified")
    if not len(rows):
        return None
    shapes = np.column_stack([kappa[rows], kappa[columns]])
    off = np.abs(shapes - start)
    best = np.lexsort([off.sum(axis=1), off.max(axis=1)])[0]
    first, second = shapes[best].tolist()
    return first, second
