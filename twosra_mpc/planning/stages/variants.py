"""The ways to do the stages of a problem: in which order, with which touch of each object.

A touch gives a shape and a place at its object. Ways with the same shapes are one variant: the
search tells variants apart, and within one the places are tried, the nearest ones first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twosra_mpc.effort import Cost, charge, out_of_effort
from twosra_mpc.planning.stages.placements import Placement, Variant
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.stages import Stage
from twosra_mpc.problem.tasks import Pass, Task, orders
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import POSE, Array, composed

if TYPE_CHECKING:
    from twosra_mpc.planning.stages.handling import Handling

_OVERLAP_M = 4e-4  # with what is touched, of what is drawn around the robot


class Hold(NamedTuple):
    """How an object is held: its number, the robot's shape, and its pose in b0."""

    number: int
    kappa: Array
    pose_in_b0: Array
    caged: bool


class State(NamedTuple):
    """What has been done so far.

    Attributes:
        placements: The stages so far.
        poses: Where objects are.
        hold: How one is held.
        passes: Boxes to pass before the next stage ends.
        touches: What may be touched on the way through them.
        key: Shapes that were chosen.
    """

    placements: tuple[Placement, ...]
    poses: tuple[Array, ...]
    hold: Hold | None = None
    passes: tuple[Pass, ...] = ()
    touches: frozenset[str] = frozenset()
    key: tuple[float, ...] = ()

    def after(self, placement: Placement) -> State:
        """What comes after a stage; boxes to pass belonged to it, and what was held moved."""
        charge(Cost.STAGE)
        placement, poses = replace(placement, passes=self.passes), list(self.poses)
        if (hold := self.hold) is not None:
            ends = placement.ends
            pose = ends[0] if ends is not None else placement.goal.configuration[:POSE]
            poses[hold.number] = composed(pose, hold.pose_in_b0)
        placements = (*self.placements, placement)
        return State(placements, tuple(poses), self.hold, key=self.key)

    def world(self, problem: Problem, touches: frozenset[str] = frozenset()) -> World:
        """Surroundings of the robot; what may be touched is smaller, as much as keeps away."""
        held = None if self.hold is None else self.hold.number
        around = problem.world_with([None if i == held else p for i, p in enumerate(self.poses)])
        if not touches:
            return around
        from twosra_mpc.space.convex import eroded
        from twosra_mpc.space.footprint import kept_m

        off_m = kept_m(around, problem.robot.geometry) + _OVERLAP_M
        kept = list[Obstacle]()
        for thing in around.obstacles:
            kept += eroded(thing, off_m) if thing.name in touches else [thing]
        return around.with_values(obstacles=tuple(kept))


class Ways:
    """Makes the variants of a problem; why there are none is kept in ``refused``."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.refused: list[str] = []

    @cached_property
    def _handling(self) -> Handling:
        from twosra_mpc.planning.stages.handling import Handling  # loads GEOS

        return Handling(self.problem, self.refused)

    def variants(self) -> list[Variant] | None:
        """Every variant; None if the effort is over first, as no bound holds for some of them."""
        found: list[Variant] = []
        for order in self._orders():
            if found and out_of_effort():
                return None
            problem = self._in_order(order)
            groups: dict[tuple[float, ...], list[tuple[Placement, ...]]] = {}
            for state in self._from(problem, problem.stages(), self._begin()):
                groups.setdefault(state.key, []).append(state.placements)
            for members in groups.values():
                members.sort(key=self._length_m)
                found.append(Variant(problem, tuple(members)))
        found.sort(key=lambda variant: self._length_m(variant.members[0]))
        return found

    def _orders(self) -> Iterator[tuple[Task, ...]]:
        """Orders of the tasks: what is done with an object in hand stays together."""
        tasks = self.problem.tasks
        if self.problem.order == "given":
            yield tuple(tasks)
            return
        yield from orders(tasks, self.problem.start.holding)

    def _in_order(self, order: tuple[Task, ...]) -> Problem:
        """The problem with its tasks in an order; a goal that comes last is its goal."""
        goal = order[-1].as_goal if order else None
        if self.problem.ends_anywhere and goal is not None:
            return self.problem.with_values(tasks=order[:-1], goal=goal)
        return self.problem.with_values(tasks=order)

    def _begin(self) -> State:
        poses = tuple(item.pose.pose for item in self.problem.objects)
        held = self.problem.start.holding is not None
        return State((), poses, self._handling.at_start() if held else None)

    def _from(self, problem: Problem, stages: Sequence[Stage], at: State) -> Iterator[State]:
        """Every way to do these stages one after the other."""
        if not stages:
            yield at
            return
        for after in self._ways(problem, stages[0], at):
            yield from self._from(problem, stages[1:], after)

    def _ways(self, problem: Problem, stage: Stage, at: State) -> Iterator[State]:
        """Every way to do a stage; a box is left to the stage that follows."""
        stage = replace(stage, touches=stage.touches | at.touches)
        if stage.through is not None:
            yield at._replace(passes=(*at.passes, stage.through), touches=stage.touches)
        elif stage.goal is None:
            yield from self._handling.ways(stage, at)
        else:
            placed = Placement(stage, stage.goal, at.world(problem, stage.touches))
            yield at.after(self._handling.holding(placed, at.hold) if at.hold else placed)

    def _length_m(self, stages: Sequence[Placement]) -> float:
        """About how far the robot drives."""
        here, far = self.problem.start.configuration[None, :POSE], 0.0
        for stage in stages:
            if stage.ends is not None:
                apart = np.linalg.norm(here[:, None, :2] - stage.ends[None, :, :2], axis=-1)
                far += float(apart.min())
                here = stage.ends
        return far
