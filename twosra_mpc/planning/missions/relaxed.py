"""What the search must know of a mission's stages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twosra_mpc.model.bending import bending
from twosra_mpc.planning.missions.stages import Stage
from twosra_mpc.planning.search.bends import BendingTask, Intervals
from twosra_mpc.planning.search.mission_bound import MissionRelaxation
from twosra_mpc.planning.search.stage_task import StageTask
from twosra_mpc.planning.single_goal.relaxed import bending_task
from twosra_mpc.problem.goals import Goal, Tolerance
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, is_rigid

_NARROW_PER_M = 3.0  # half-width of a box of shapes whose bends are looked at more closely

Box = tuple[Array, Array]


def relaxation(problem: Problem) -> MissionRelaxation:
    """Rates, speeds and room of a problem's robot."""
    robot, facts = problem.robot, bending(problem.robot)
    n, limits = robot.coordinates.segments, robot.limits
    here = facts.coordinates(problem.start.kappa_per_m).tolist()
    most = [facts.coordinate(limits.curvature_per_m, j) for j in range(n)]

    def speed_m_s(mode: Mode) -> float:
        if is_rigid(mode):
            return math.inf if limits.speed_m_s is None else limits.speed_m_s
        return facts.largest_speed_m_s(mode)

    return MissionRelaxation(
        room=tuple((-w - at, w - at) for w, at in zip(most, here, strict=True)),
        rate=lambda mode: facts.fastest(mode, (None,) * n),
        speed_m_s=speed_m_s,
        soft_travel_m=limits.soft_travel_m if problem.world_at_start.obstacles else math.inf,
    )


def stage_tasks(problem: Problem, members: Sequence[Sequence[Stage]]) -> tuple[StageTask, ...]:
    """What the search must know of each stage, for all members of a variant."""
    start = problem.start.configuration
    before: Box = (start, start)
    here = Stage(problem.goal, None, (), problem.world, ends=start[None, :POSE])
    known, begins, since = before, list[Stage]([here] * len(members)), 1
    found = []
    for same in zip(*members, strict=True):
        boxes = [stage.box(before[0]) for stage in same]
        after = np.min([low for low, _ in boxes], axis=0), np.max([top for _, top in boxes], axis=0)
        far_m = min(_apart_m(known, after, *pair) for pair in zip(begins, same, strict=True))
        stage = same[0]
        found.append(
            StageTask(
                change=_changes(problem, after),
                bend=_bend(problem, before, after),
                modes=stage.modes,
                last=stage.last,
                drives_first=stage.drives_first,
                drives_last=stage.drives_last,
                distance_m=far_m,
                since=since,
                rigid_s=far_m / (problem.robot.limits.speed_m_s or math.inf) if since == 1 else 0.0,
                reshapes=stage.reshapes,
            )
        )
        before, since = after, since + 1
        if np.isfinite([end[:2] for end in after]).all():
            known, begins, since = after, list(same), 1
    return tuple(found)


def _w(problem: Problem, end: Array) -> Array:
    """W of the shape of one end of a box, clipped to the limits."""
    limit = problem.robot.limits.curvature_per_m
    return bending(problem.robot).coordinates(np.clip(end[POSE:], -limit, limit))


def _changes(problem: Problem, after: Box) -> Intervals:
    """Changes of W since t = 0 that lead into a box."""
    here = _w(problem, problem.start.configuration)
    ends = ((_w(problem, end) - here).tolist() for end in after)
    return tuple(zip(*ends, strict=True))


def _bend(problem: Problem, before: Box, after: Box) -> BendingTask | None:
    """What a stage must bend, where the shapes at both of its ends are nearly known."""
    widths = np.array([high[POSE:] - low[POSE:] for low, high in (before, after)])
    if not widths.max() <= 2 * _NARROW_PER_M:
        return None
    middle, shape = ((low[POSE:] + high[POSE:]) / 2 for low, high in (before, after))
    tolerance = Tolerance(kappa_per_m=tuple((widths[1] / 2).tolist()))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=tuple(middle.tolist()))
    goal = Goal(kappa_per_m=tuple(shape.tolist()), tolerance=tolerance)
    alone = problem.with_values(start=start, goal=goal, tasks=(), objects=())
    task = bending_task(alone)
    within = np.max([abs(_w(problem, end) - task.origin) for end in before], axis=0)
    return replace(
        task,
        change=_wider(task.change, within),
        room=_wider(task.room, within),
        origin_within=tuple(within.tolist()),
    )


def _wider(intervals: Intervals, within: Array) -> Intervals:
    pairs = zip(intervals, within.tolist(), strict=True)
    return tuple((low - by, high + by) for (low, high), by in pairs)


def _apart_m(before: Box, after: Box, begin: Stage, end: Stage) -> float:
    """Least distance of b0's positions where two stages end."""
    if begin.ends is not None and end.ends is not None:
        apart = np.linalg.norm(begin.ends[:, None, :2] - end.ends[None, :, :2], axis=-1)
        return max(0.0, float(apart.min()) - begin.within_m - end.within_m)
    gaps = np.maximum(after[0][:2] - before[1][:2], before[0][:2] - after[1][:2])
    return float(np.linalg.norm(np.maximum(gaps, 0.0)))
