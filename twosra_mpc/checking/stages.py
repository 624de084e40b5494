"""What a robot must keep clear of, may touch and holds, from one task of a mission to the next."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from twosra_mpc.checking.sweep import Sweep
from twosra_mpc.plans.carried import Carried, carried, object_poses
from twosra_mpc.plans.trajectory import SAME_TIME_S, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.world import Obstacle, World


class Stage(NamedTuple):
    """From the task before until a task is done, or from the last one to the end.

    Attributes:
        first: First fine time of the sweep.
        last: Last one.
        world: Obstacles to keep clear of.
        resting: Objects to keep clear of, where they are.
        touched: What the robot may touch, where it is.
        held: What it carries, if anything.
        taken: Whether that begins here.
    """

    first: int
    last: int
    world: World
    resting: tuple[Obstacle, ...] = ()
    touched: tuple[Obstacle, ...] = ()
    held: Carried | None = None
    taken: bool = False


def stages(trajectory: Trajectory, sweep: Sweep) -> list[Stage]:
    """Every stage in order; a plan that only reaches a goal is one."""
    problem, world = trajectory.problem, trajectory.problem.world
    found, taken = list[Stage](), iter(carried(trajectory))
    held = held_before = None
    if problem.start.holding is not None:
        held = next(taken)
    ends = (0.0, *trajectory.done_s, trajectory.duration_s)
    for i, (from_s, to_s) in enumerate(itertools.pairwise(ends)):
        if found and to_s - from_s <= SAME_TIME_S and i == len(problem.tasks):
            break
        task = problem.tasks[i] if i < len(problem.tasks) else None
        if task is not None and task.lets_go:
            held = None
        names = touched_in(problem, i)
        poses = object_poses(trajectory, np.array([(from_s + to_s) / 2]))[0]
        things = [
            item.at(pose)
            for k, (item, pose) in enumerate(zip(problem.objects, poses, strict=True))
            if held is None or k != held.object
        ]
        touched = tuple(o for o in (*problem.obstacles, *things) if o.name and o.name in names)
        apart = tuple(item for item in problem.obstacles if item not in touched)
        resting = tuple(item for item in things if item not in touched)
        around = world if len(apart) == len(world.obstacles) else world.with_values(obstacles=apart)
        span, begins = sweep.over(from_s, to_s), held is not held_before
        found.append(Stage(*span, around, resting, touched, held, begins))
        held_before = held
        if task is not None and task.takes:
            held = next(taken)
    return found


def touched_in(problem: Problem, stage: int) -> set[str]:
    """Names of what may be touched until task ``stage`` is done, numbered from 0.

    It is what that task takes hold of, lets go or lies along, and what the one before lay along.
    """
    own, before = problem.tasks[stage : stage + 1], problem.tasks[max(stage - 1, 0) : stage]
    names = {task.about for task in own if task.touches}
    names |= {task.about for task in before if task.lies_along}
    return {name for name in names if name}
