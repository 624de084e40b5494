"""Ways to the begin of paths: tasks that lead there what follows them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.tasks import Task, put
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import POSE, Array, composed
from twosra_mpc.robot.description import Robot


def part_in_b0(robot: Robot, kappa: Array, part: str) -> Array:
    """Pose of what follows a path in the frame of b0, (3,)."""
    if part == "middle link":
        return np.zeros(POSE)
    shape = robot_shape(robot.geometry, np.concatenate([np.zeros(POSE), kappa]), 2)
    return np.append(shape.centres[0], shape.ends[0, 2])


def with_ways(
    robot: Robot, q: Array, objects: Sequence[Object], tasks: Sequence[Task]
) -> Iterator[Task]:
    """Yield tasks, and before each path that begins elsewhere one that leads to its begin.

    Of a part of the robot that is known where the path is the first task alone.

    Args:
        robot: The robot.
        q: Where it starts, (3 + n,).
        objects: Where they are then.
        tasks: What is asked, in order.
    """
    known = {item.name: item.pose.pose for item in objects}
    for number, task in enumerate(tasks):
        path = task.stage([robot.rigid]).follows
        if path is not None and (number == 0 or path.object is not None):
            part = composed(q[:POSE], part_in_b0(robot, q[POSE:], path.part))
            yield from path.led_to(known[path.object] if path.object else part, q)
        for name, to in put([task]).items():
            heading = math.nan if to.phi_rad is None else to.phi_rad
            known[name] = np.array([to.x_m, to.y_m, heading])
        yield task
