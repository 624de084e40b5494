"""Stages: what a problem asks for in turn, one value for each task and one for the goal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from twosra_mpc.problem.goals import Anywhere, GoalSet
from twosra_mpc.robot.modes import Mode, rigid_mode

if TYPE_CHECKING:  # tasks make stages
    from twosra_mpc.problem.tasks import Carry, Conform, Grasp, Pass, Release, Task


@dataclass(frozen=True)
class Stage:
    """A stretch of a plan, from the end of the stage before to its own.

    Attributes:
        modes: Modes that it may use.
        last: Stiffness at its end; None: any.
        goal: Goal set in which it ends, if there is one.
        through: Box that b0 has entered at its end, where it need not be at rest.
        along: Thing that segments lie along at its end.
        grasps: Object that is in hand at its end.
        carries: Pose of the object in hand at its end.
        releases: Object that is free at its end.
        least_s: Least duration [s].
        words: What is done, e.g. "grasp cup".
        touches: Names of what the robot need not keep clear of.
        holds: Name of the object that is in hand all the time.
        task: The task that asks for it; None: the goal does.
    """

    modes: Sequence[Mode]
    last: Mode | None = None
    goal: GoalSet | None = None
    through: Pass | None = None
    along: Conform | None = None
    grasps: Grasp | None = None
    carries: Carry | None = None
    releases: Release | None = None
    least_s: float = 0.0
    words: str = ""
    touches: frozenset[str] = frozenset()
    holds: str | None = None
    task: Task | None = None


def stages_of(
    tasks: Sequence[Task], goal: GoalSet, modes: Sequence[Mode], held: str | None
) -> Iterator[Stage]:
    """Yield the stages of tasks in this order, and of the goal, unless that is anywhere.

    Args:
        tasks: The tasks.
        goal: What comes after them.
        modes: Modes that stages may use.
        held: Name of the object in hand at t = 0.
    """
    along, rests = frozenset[str](), False
    for number, task in enumerate(tasks, start=1):
        about = frozenset([task.about] if task.about else ())
        own, held = task.stage(modes), None if task.lets_go else held
        touches = along | about if task.touches else along
        own = replace(own, words=task.said(number), touches=touches, task=task)
        yield _with_in_hand(own, held)
        along, rests = about if task.lies_along else frozenset(), task.rests
        held = task.about if task.takes else held
    if not (rests and isinstance(goal, Anywhere)):
        to_goal = Stage(modes, goal.mode, goal, words="reach the goal", touches=along)
        yield _with_in_hand(to_goal, held)


def _with_in_hand(stage: Stage, held: str | None) -> Stage:
    """The stage with an object in hand, if there is one: then nothing bends."""
    if held is None:
        return stage
    return replace(stage, modes=(rigid_mode(len(stage.modes[0])),), holds=held)
