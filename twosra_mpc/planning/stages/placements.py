"""Stages placed in the world: in which shape and where each ends, and what is around it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.problem.goals import Goal, GoalSet, Tolerance
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.stages import Stage
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.space.footprint import SAGITTA_M

_TOUCHING_SAGITTA_M = 1e-4


@dataclass(frozen=True, eq=False)
class Placement:
    """One way to do a stage; boxes to pass belong to what follows them.

    Attributes:
        stage: What is asked.
        goal: Shapes to end in and, where there are no ``ends``, the poses.
        world: Surroundings of the robot.
        passes: Boxes to pass on the way.
        ends: Poses of b0 to end in, one of these, (m, 3); None: those of the goal.
        within_m: How far from one of these any other end is that the task allows, at most.
        held: Convex pieces of what is carried, in b0, (pieces, 4, 2).
        drives_first: Whether it may begin with a drive.
        drives_last: Whether it may drive once it has its last shape.
        reshapes: Whether it must reshape, as is proved.
        openings: Goals that may do instead, as this one does not say how far to bend.
        entries: Shapes from which it gets around what it grasps, as far open as ``openings``.
        away: Surroundings at its end; those of all of it where None.
        may: Twists (m, 3) -> which of them drives may have, where not all.
    """

    stage: Stage
    goal: GoalSet
    world: World
    passes: tuple[Pass, ...] = ()
    ends: Array | None = None
    within_m: float = 0.0
    held: Array = field(default_factory=lambda: np.zeros((0, 4, 2)))
    drives_first: bool = True
    drives_last: bool = True
    reshapes: bool = False
    openings: tuple[GoalSet, ...] = ()
    entries: tuple[Goal, ...] = ()
    away: World | None = None
    may: Callable[[Array], NDArray[np.bool_]] | None = None

    @property
    def reaches(self) -> bool:
        """Whether it ends in any pose and shape of its goal."""
        return self.ends is None and self.away is None

    @property
    def sagitta_m(self) -> float:
        """By which what is drawn around the robot may stray from it."""
        return _TOUCHING_SAGITTA_M if self.stage.touches else SAGITTA_M

    def box(self, near: Array) -> tuple[Array, Array]:
        """(low, high) of a box that holds every end that counts, next to ``near``, (3 + n,)."""
        low, high = self.goal.box_met(near)
        if self.ends is not None:
            low[:POSE], high[:POSE] = self.ends.min(axis=0), self.ends.max(axis=0)
            low[:2], high[:2] = low[:2] - self.within_m, high[:2] + self.within_m
        return low, high


@dataclass(frozen=True, eq=False)
class Variant:
    """Ways to solve a problem with the same shapes.

    Attributes:
        problem: The problem with its tasks in the order of the variant.
        members: The stages of each way, the shortest one first.
    """

    problem: Problem
    members: tuple[tuple[Placement, ...], ...]

    def reaching(self, stage: Placement) -> Problem:
        """The problem of coming from the start to the goal of a stage alone."""
        problem = self.problem
        if stage.goal is problem.goal and stage.passes == problem.tasks and not problem.objects:
            return problem
        return problem.with_values(
            start=problem.start.with_values(holding=None),
            goal=stage.goal,
            tasks=stage.passes,
            objects=(),
            obstacles=stage.world.obstacles,
        )

    def aimed(self) -> Variant:
        """The same with the goals that plans are looked for in first, narrower than all of them."""
        if not any(stage.openings for stage in self.members[0]):
            return self
        members = tuple(
            tuple(
                replace(stage, goal=goal)
                for stage, goal in zip(stages, next(goals_of(stages)), strict=True)
            )
            for stages in self.members
        )
        return replace(self, members=members)


def goals_of(stages: Sequence[Placement]) -> Iterator[tuple[GoalSet, ...]]:
    """Goals of the stages; those that do not say how far to bend ask for more and more.

    What is opened just before something is grasped is opened for that, too.
    """
    count = max((len(stage.openings) + 1 for stage in stages if stage.openings), default=1)
    for k in range(count):
        found = list[GoalSet]()
        for stage, then in zip(stages, [*stages[1:], None], strict=True):
            opened = [stage.goal, *stage.openings][min(k, len(stage.openings))]
            if stage.openings and then is not None and then.entries:
                opened = _in_both(opened, then.entries[min(k, len(then.entries) - 1)])
            found.append(opened)
        yield tuple(found)


def _in_both(opened: GoalSet, entry: GoalSet) -> GoalSet:
    """The shapes of two sets; those of the first, where there are none."""
    nothing = np.zeros(POSE + len(opened.mode))
    (low, high), (least, most) = opened.box(nothing), entry.box(nothing)
    low, high = np.maximum(low, least)[POSE:], np.minimum(high, most)[POSE:]
    if (low > high).any():
        return opened
    free = ~np.isfinite(high - low)
    middle = [None if f else m for f, m in zip(free, ((low + high) / 2).tolist(), strict=True)]
    width = np.where(free, 0.0, (high - low) / 2)
    return Goal(kappa_per_m=tuple(middle), tolerance=Tolerance(kappa_per_m=tuple(width.tolist())))
