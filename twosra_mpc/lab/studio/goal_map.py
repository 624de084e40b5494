"""Maps of a problem: best mode sequence and duration over two coordinates of its goal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc import InputError, Problem, plan
from twosra_mpc.arguments import public
from twosra_mpc.effort import limited
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import sequence_name
from twosra_mpc.validation import OneOrMore

SIZES = 5, 9, 17, 33  # points a side, coarse to fine: each has all points of the one before
_REACH_M, _BENT = 0.3, 0.8  # either way; share of the largest curvature
WORK = 300.0  # units a point


@public
class Cell(NamedTuple):
    """A point of a map.

    Attributes:
        x: Value of the first coordinate [m, rad or 1/m].
        y: Value of the second.
        sequence: Best mode sequence found; empty without a plan.
        duration_s: How long it takes; None without a plan.
        status: Of the result.
    """

    x: float
    y: float
    sequence: str
    duration_s: float | None
    status: str


@public
def goal_coordinates(problem: Problem) -> dict[str, tuple[float, float]]:
    """Coordinates of a goal that a map may vary, each with its range [m, rad or 1/m].

    Places and headings about the goal's own, curvatures over most of what the robot can.

    Raises:
        InputError: If the problem has no goal.
    """
    if problem.ends_anywhere:
        raise InputError("goal", problem.goal, "a goal: a map varies two of its coordinates")
    q = np.where(np.isnan(problem.goal.configuration), 0.0, problem.goal.configuration)
    bent = _BENT * problem.robot.limits.curvature_per_m
    ways = [_REACH_M, _REACH_M, math.pi]
    ranges = [(at - way, at + way) for at, way in zip(q[:POSE].tolist(), ways, strict=True)]
    ranges += [(-bent, bent)] * (len(q) - POSE)
    names = ["x", "y", "phi", *(f"kappa{j}" for j in range(1, len(q) - POSE + 1))]
    return dict(zip(names, ranges, strict=True))


@public
def goal_map(
    problem: Problem, over: Sequence[str], sizes: OneOrMore[int] = SIZES[:3], work: float = WORK
) -> Iterator[Cell]:
    """Plan a problem for goals on a grid, coarse to fine; each as soon as it is planned.

    Args:
        problem: The problem.
        over: Two coordinates, such as ``("kappa1", "kappa2")``; see `goal_coordinates`.
        sizes: Points a side of the grids in turn; what one has is not planned for the next again.
        work: Units that a point may take.

    Raises:
        InputError: If there are no such coordinates.
    """
    ranges = goal_coordinates(problem)
    if len(over) != 2 or over[0] == over[1] or not set(over) <= set(ranges):
        raise InputError("over", ",".join(over), f"two of {', '.join(ranges)}")
    done = set[tuple[float, float]]()
    for size in sizes:
        lines = [np.linspace(*ranges[name], size).round(9).tolist() for name in over]
        for y in lines[1]:
            for x in lines[0]:
                if (x, y) not in done:
                    done.add((x, y))
                    yield _cell(problem, over, (x, y), work)


def moved(problem: Problem, over: Sequence[str], at: tuple[float, float]) -> Problem:
    """The problem with another goal.

    Raises:
        InputError: If the robot cannot be there.
    """
    goal = problem.goal
    kappa = [float(each) for each in goal.configuration[POSE:]]
    values: dict[str, object] = {}
    for name, value in zip(over, at, strict=True):
        if name.startswith("kappa"):
            kappa[int(name[5:]) - 1] = value
            values["kappa_per_m"] = tuple(kappa)
        else:
            values["phi_rad" if name == "phi" else f"{name}_m"] = value
    return problem.with_values(goal=goal.with_values(**values))


def _cell(problem: Problem, over: Sequence[str], at: tuple[float, float], work: float) -> Cell:
    try:
        with limited(work, math.inf):
            result = plan(moved(problem, over, at))
    except InputError:
        return Cell(*at, "", None, "infeasible")
    if result.plan is None or not result.found:
        return Cell(*at, "", None, str(result.status))
    return Cell(*at, sequence_name(result.plan.sequence), result.plan.duration_s, "found")
