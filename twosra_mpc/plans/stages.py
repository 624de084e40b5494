"""Stages of a mission's plan, from when to when, in words."""

from __future__ import annotations

from typing import NamedTuple

from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.tasks import Task

_WORDS = {"conform": "conform to", "pass": "pass through"}


class Stage(NamedTuple):
    """The part of a plan from the task before until a task is done, or until the goal is reached.

    Attributes:
        words: What is done, e.g. "grasp cup".
        from_s: Since when [s].
        to_s: When it is done [s].
        task: The task; None for the goal.
    """

    words: str
    from_s: float
    to_s: float
    task: Task | None


def stages(trajectory: Trajectory) -> tuple[Stage, ...]:
    """The stages of a mission, in order; none where a plan only reaches a goal."""
    problem, found, before_s = trajectory.problem, list[Stage](), 0.0
    if not problem.is_mission:
        return ()
    for number, (task, done_s) in enumerate(
        zip(problem.tasks, trajectory.done_s, strict=True), start=1
    ):
        found.append(Stage(task_words(task, number), before_s, done_s, task))
        before_s = done_s
    if not problem.ends_anywhere:
        found.append(Stage("reach the goal", before_s, trajectory.duration_s, None))
    return tuple(found)


def task_words(task: Task, number: int) -> str:
    """Words for a task, e.g. "grasp cup"; ``number`` from 1 names one that nothing else does."""
    return f"{_WORDS.get(task.do, task.do)} {task.name or task.about or f'goal {number}'}"
