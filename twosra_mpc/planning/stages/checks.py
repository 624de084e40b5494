"""Checks of what cannot be: starts, goals and objects that overlap or are outside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twosra_mpc.checking.clearance import check_apart, check_obstacles
from twosra_mpc.errors import InputError
from twosra_mpc.problem.ends import check_shapes, check_workspace
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import carries
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import mode_name


def check_around(problem: Problem) -> None:
    """Refuse what no plan can do among obstacles and objects, or at rest on the way to the goal.

    Raises:
        InputError: If the greedy rule is asked for tasks, if they may not drive, or if at the
            start, at a goal or where objects are or should be carried to something overlaps or is
            outside of the workspace.
    """
    if problem.obstacles or problem.objects:
        check_obstacles(problem)
    if problem.objects or any(task.rests for task in problem.tasks):
        if problem.planner == "greedy":
            raise InputError("planner", "greedy", "optimal: the greedy rule knows no tasks")
        if (rigid := problem.robot.rigid) not in problem.modes:
            raise InputError("modes", problem.modes, f"{mode_name(rigid)} among them: tasks drive")
    held = problem.start.holding
    poses = [None if item.name == held else item.pose.pose for item in problem.objects]
    start = problem.start.with_values(holding=None) if held else problem.start
    alone = {"start": start, "tasks": (), "objects": ()}
    for i, task in enumerate(problem.tasks):
        if task.ends_in is not None:
            reached = problem.with_values(**alone, goal=task.ends_in)
            for check in (check_shapes, check_workspace, check_obstacles):
                _named(check, reached, i)
    for i, carry in carries(problem.tasks).items():
        number = [item.name for item in problem.objects].index(carry.object)
        target = np.array([carry.x_m, carry.y_m, carry.phi_rad or 0.0])
        check_apart(f"tasks.{i}", problem.objects[number].at(target), problem.world)
    placed = list(problem.world.obstacles)
    for i, (item, pose) in enumerate(zip(problem.objects, poses, strict=True)):
        if pose is not None:
            around = problem.world.with_values(obstacles=tuple(placed))
            check_apart(f"objects.{i}.pose", item.at(pose[:POSE]), around)
            placed.append(item.at(pose))


def _named(check: Callable[[Problem], None], problem: Problem, task: int) -> None:
    """Check a goal on the way; what is wrong is said of its task."""
    try:
        check(problem)
    except InputError as error:
        field = error.field.replace("goal", f"tasks.{task}", 1)
        raise InputError(field, error.value, error.allowed) from None
