"""How far what follows a path is from it in a run: believed, or true."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

from twosra_mpc.checking.followed import followed, follower
from twosra_mpc.execution.run import Run
from twosra_mpc.problem.tasks import Follow, Task
from twosra_mpc.robot.coordinates import Array


class OffPath(NamedTuple):
    """Distance from a path at places on the way, evenly along it.

    Attributes:
        task: What was asked.
        time_s: When, (m,).
        off_m: How far from the path, (m,).
    """

    task: Follow
    time_s: Array
    off_m: Array


def off_paths(run: Run, time_s: Array, q: Array, objects: Array) -> list[OffPath]:
    """Distance from every path that is followed, as often as that is begun.

    Args:
        run: The run.
        time_s: Times at which the robot was somewhere, (m,).
        q: Where it was, (m, 3 + n).
        objects: Poses of the objects then, (m, objects, 3); empty if nobody knows them.
    """
    found = []
    for task, since_s, until_s in under_way(run):
        during = (time_s >= since_s) & (time_s <= until_s)
        if not isinstance(task, Follow) or during.sum() < 2 or (task.object and not objects.size):
            continue
        there = objects[during] if objects.size else objects
        poses = follower(run.problem, task, q[during], there)
        way = followed(task, time_s[during], poses)
        found.append(OffPath(task, way.t_s, way.off_m))
    return found


def under_way(run: Run) -> list[tuple[Task, float, float]]:
    """Tasks, and from when to when they were under way [s]: anew by each plan of what is left."""
    begun_s = [one.time_s for one in run.events if one.kind in ("plan", "replan", "correct")]
    found = []
    for plan, span in zip(run.plans, pairwise([*begun_s, run.duration_s]), strict=True):
        done_s = [time_s for time_s in run.done_s if span[0] < time_s <= span[1]]
        edges = pairwise([span[0], *done_s, span[1]])
        found += [(task, *edge) for task, edge in zip(plan.problem.tasks, edges, strict=False)]
    return found
