"""Poses of objects during a plan: where they were put, or as the robot carries them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.tasks import grasps
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse


class Carried(NamedTuple):
    """An object that moves with the robot for a time.

    It is held from the end of its grasp until the task before its release is done: while the robot
    opens, the object rests.

    Attributes:
        object: Its number, from 0.
        from_s: Since when [s].
        to_s: Until when [s]; the end of the plan if it is not released.
        pose_in_b0: Where it is as seen from b0, (3,) [m, m, rad].
    """

    object: int
    from_s: float
    to_s: float
    pose_in_b0: Array


def carried(trajectory: Trajectory) -> tuple[Carried, ...]:
    """Objects that a plan carries, in order."""
    problem, found = trajectory.problem, list[Carried]()
    names = [item.name for item in problem.objects]
    poses = [item.pose.pose for item in problem.objects]
    begun = [] if problem.start.holding is None else [(-1, problem.start.holding)]
    begun += [(i, task.object) for i, task in grasps(problem.tasks).items()]
    done_s = (*trajectory.done_s, 0.0)  # the last one is that of number -1
    for i, name in begun:
        number, from_s = names.index(name), done_s[i]
        later = range(i + 1, len(problem.tasks))
        ends = [k for k in later if problem.tasks[k].lets_go]
        to_s = done_s[ends[0] - 1] if ends else trajectory.duration_s
        hold, put = trajectory.configuration([from_s, to_s])[:, :POSE]
        pose_in_b0 = composed(inverse(hold), poses[number])
        found.append(Carried(number, from_s, to_s, pose_in_b0))
        poses[number] = composed(put, pose_in_b0)
    return tuple(found)


def object_poses(trajectory: Trajectory, t_s: Array, q: Array | None = None) -> Array:
    """Pose of every object at times (m,), (m, objects, 3).

    Args:
        trajectory: The plan's course.
        t_s: Times [s], growing.
        q: The robot then, (m, 3 + n), if known.
    """
    problem = trajectory.problem
    t_s = np.asarray(t_s, dtype=float)
    found = np.array([[item.pose.pose for item in problem.objects]]).reshape(1, -1, POSE)
    found = np.repeat(found, len(t_s), axis=0)
    if not (held := carried(trajectory)):
        return found
    at = trajectory.configuration(t_s) if q is None else q
    for item in held:
        during, after = (t_s >= item.from_s) & (t_s <= item.to_s), t_s > item.to_s
        found[during, item.object] = composed(at[during, :POSE], item.pose_in_b0)
        put = trajectory.configuration([item.to_s])[0, :POSE]
        found[after, item.object] = composed(put, item.pose_in_b0)
    return found


class TaskDone(NamedTuple):
    """A task in a plan file: when it is done, and where the robot is then."""

    do: str
    name: str
    object: str | None
    done_s: float
    configuration: tuple[float, ...]


class CarriedObject(NamedTuple):
    """Carried object in a plan file: `Carried` with the object's name."""

    object: str
    from_s: float
    to_s: float
    pose_in_b0: tuple[float, float, float]


def mission_document(trajectory: Trajectory) -> dict[str, Any]:
    """Keys of a mission in a plan file, beyond the scenario: ``tasks`` and ``carried``."""
    problem = trajectory.problem
    done = zip(trajectory.done_s, trajectory.configuration(trajectory.done_s), strict=True)
    tasks = [
        TaskDone(task.do, task.name, task.about, at_s, tuple(q.tolist()))._asdict()
        for task, (at_s, q) in zip(problem.tasks, done, strict=True)
    ]
    held = []
    for item in carried(trajectory):
        name, (x, y, phi) = problem.objects[item.object].name, item.pose_in_b0.tolist()
        held.append(CarriedObject(name, item.from_s, item.to_s, (x, y, phi))._asdict())
    return {"tasks": tasks, "carried": held}
