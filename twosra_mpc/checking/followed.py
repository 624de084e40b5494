"""Independent check that a path is followed: where what follows it is, from the sweep alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from twosra_mpc.checking.sweep import swept
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.trajectory import SAME_TIME_S, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Follow
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import POSE, Array

_FINE_M, _FINE = 1e-3, 0.05  # between places that are looked at, and of the tolerance
_STILL_M = 1e-9  # gone: it has not set off
_AHEAD = 4.0  # times the tolerance, that progress may gain at once


class Followed(NamedTuple):
    """How a path is followed.

    Attributes:
        t_s: Times that were looked at, (m,).
        along_m: How far along the path it is then, (m,).
        off_m: How far from the path, (m,).
        off_rad: How far from the heading that is asked for, (m,); zero where it is free.
        most_m: The same at most, until the next time, (m,).
        most_rad: The same of the heading, (m,).
        left_m: What it has not come to of the path.
        within_m: How far from the path it may be.
        due_m: How far from each point that has a time it is then, (k,); inf if it ends before.
        late_s: How much later than due it has come so far, to within its tolerance, (k,).
    """

    t_s: Array
    along_m: Array
    off_m: Array
    off_rad: Array
    most_m: Array
    most_rad: Array
    left_m: float
    within_m: float
    due_m: Array
    late_s: Array


OFF_PATH = "off its path"  # what is said of it, wherever numbers are called something


def off_words(mean_m: float, worst_m: float) -> str:
    """Say how far something is from its path: on average along the way, and at worst."""
    return f"mean {1e3 * mean_m:z.2f} mm, worst {1e3 * worst_m:z.2f} mm"


def plan_off_words(trajectory: Trajectory) -> str:
    """Say the same of a plan's own sweep; nothing where it follows no path."""
    problem = trajectory.problem
    if not any(stage.follows for stage in problem.stages):
        return ""
    if (sweep := swept(problem, trajectory.samples)) is None:
        return ""
    spans = itertools.pairwise((0.0, *trajectory.done_s))
    objects = object_poses(trajectory, sweep.t_s, sweep.q)
    found = followed_in(problem, spans, sweep.t_s, sweep.q, objects)
    off_m = np.concatenate([each.off_m for each in found])
    return off_words(float(off_m.mean()), float(off_m.max()))


def followed_in(
    problem: Problem, spans: Iterable[tuple[float, float]], t_s: Array, q: Array, objects: Array
) -> list[Followed]:
    """How each path of a problem is followed, as far as what follows it is known.

    Args:
        problem: Its tasks are those that were begun.
        spans: When each of them was begun, and done, as far as they were.
        t_s: Times, (m,).
        q: The robot then, (m, 3 + n).
        objects: Poses of the objects then, (m, objects, 3); empty where they are not known.
    """
    found = list[Followed]()
    for task, (since_s, until_s) in zip(problem.tasks, spans, strict=False):
        path = task.stage(problem.modes).follows
        at = (t_s >= since_s - SAME_TIME_S) & (t_s <= until_s + SAME_TIME_S)
        if path is None or not at.any() or (path.object is not None and not objects.size):
            continue
        there = objects if path.object is None else objects[at]
        found.append(followed(path, t_s[at], follower(problem, path, q[at], there)))
    return found


def follower(problem: Problem, task: Follow, q: Array, objects: Array) -> Array:
    """Poses of what follows a path, (m, 3), the robot being at q (m, 3 + n), objects there."""
    if task.object is not None:
        number = [item.name for item in problem.objects].index(task.object)
        poses: Array = objects[:, number].copy()
        if problem.objects[number].disc is not None:
            poses[:, 2] = q[:, 2]
        return poses
    if task.part == "middle link":
        return q[:, :POSE]
    shape = robot_shape(problem.robot.geometry, q, 2)
    return np.column_stack([shape.units[:, 0].mean(axis=1), shape.ends[:, 0, 2]])


def followed(task: Follow, t_s: Array, poses: Array) -> Followed:
    """How poses (m, 3) at fine times (m,) follow a path: progress never goes back."""
    line, near_m = task.left, task.position_tolerance_m
    step = np.hypot(*np.diff(poses[:, :2], axis=0).T) + np.abs(np.diff(poses[:, 2])) * near_m
    gone = np.append(0.0, np.cumsum(step))
    fine = min(_FINE_M, _FINE * near_m)
    marks = np.unique(np.searchsorted(gone, [*np.arange(0.0, gone[-1], fine), gone[-1]]))
    at = poses[marks]
    along_m = line.along(at[:, :2], _AHEAD * near_m)
    off_m = np.hypot(*(at[:, :2] - line.at(along_m)).T)
    asked = np.interp(along_m, line.length_m, line.headings)
    turned = np.nan_to_num(at[:, 2] - asked)
    off_rad = np.abs(np.mod(turned + math.pi, math.tau) - math.pi)
    changed = np.abs(np.diff(at[:, 2])) + np.abs(np.diff(asked))
    sets_off_s = t_s[np.searchsorted(gone, _STILL_M, side="right") - 1]
    due = task.due
    due_s = due[:, 1] + sets_off_s
    due_s[np.isclose(due_s, t_s[-1], rtol=0.0, atol=SAME_TIME_S)] = t_s[-1]
    then = [np.interp(due_s, t_s, xy, right=np.inf) for xy in poses[:, :2].T]
    return Followed(
        t_s[marks],
        along_m,
        off_m,
        off_rad,
        _most(off_m, np.diff(gone[marks])),
        _most(off_rad, np.nan_to_num(changed)),
        float(line.length_m[-1] - along_m[-1]),
        near_m,
        np.hypot(*(np.column_stack(then) - line.at(due[:, 0])).T),
        np.fmax(np.interp(due[:, 0] - near_m, along_m, t_s[marks]) - sets_off_s - due[:, 1], 0.0),
    )


def _most(off: Array, changed: Array) -> Array:
    """Most that ``off`` (m,) may be until the next time, where so much ``changed`` (m - 1,)."""
    return np.append((off[:-1] + off[1:] + changed) / 2, off[-1])


def tube_problems(task: Follow, found: Followed) -> Iterator[str]:
    """Say where what follows a path leaves the tube around it, or does not come to its end."""
    most = task.position_tolerance_m, task.heading_tolerance_rad
    worst = int(found.most_m.argmax())
    if found.most_m[worst] > most[0] + GOAL_TOLERANCE:
        off = f"{1e3 * found.most_m[worst]:z.3g} mm off its path at {found.t_s[worst]:z.1f} s"
        yield f"it is {off} (position_tolerance_m = {most[0]:zg} m)"
    worst = int(found.most_rad.argmax())
    if found.most_rad[worst] > most[1] + GOAL_TOLERANCE:
        off = f"{found.most_rad[worst]:z.3g} rad at {found.t_s[worst]:z.1f} s"
        yield f"its heading is off by {off} (heading_tolerance_rad = {most[1]:zg} rad)"
    if found.due_m.max(initial=0.0) > most[0] + GOAL_TOLERANCE:
        late = int(found.due_m.argmax())
        where = f"where it is due {task.due[late, 1]:z.4g} s after it set off"
        far = f"it is {1e3 * found.due_m[late]:z.3g} mm from"
        yield f"{far if math.isfinite(found.due_m[late]) else 'it ends before it is'} {where}"
    if found.left_m > 2 * most[0]:
        yield f"its path is not followed to the end: {found.left_m:z.3g} m are left"
