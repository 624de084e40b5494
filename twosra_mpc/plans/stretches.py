"""Stages of a plan, from when to when, in words."""

from __future__ import annotations

from typing import NamedTuple

from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.stages import Stage
from twosra_mpc.problem.tasks import Task


class Stretch(NamedTuple):
    """The part of a plan in which a stage is done.

    Attributes:
        stage: What is asked.
        from_s: Since when [s].
        to_s: When it is done [s].
    """

    stage: Stage
    from_s: float
    to_s: float

    @property
    def words(self) -> str:
        """Words for the task, e.g. "grasp cup"."""
        return self.stage.words

    @property
    def task(self) -> Task | None:
        """Task; None for the goal."""
        return self.stage.task


def stretches(trajectory: Trajectory) -> tuple[Stretch, ...]:
    """The stages of a plan, in order; none where a plan only reaches a goal."""
    if not trajectory.problem.tasks:
        return ()
    found, before_s = list[Stretch](), 0.0
    for number, stage in enumerate(trajectory.problem.stages()):
        ends = trajectory.done_s if stage.task is not None else ()
        to_s = ends[number] if ends else trajectory.duration_s
        found.append(Stretch(stage, before_s, to_s))
        before_s = to_s
    return tuple(found)
