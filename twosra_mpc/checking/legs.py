"""Legs: moments that every plan of a problem passes, and which segments melt between them.

Lemma 11 of ``docs/certificate.md``. What tasks ask is read from the problem alone: nothing here
looks for touches or places, so a leg asks for less than a plan must do, never for more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from flint import arb

from twosra_mpc.checking.body import outermost_m
from twosra_mpc.checking.fibre import between
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Conform, Follow, Grasp, orders
from twosra_mpc.problem.tolerances import BEYOND_PER_M, GOAL_TOLERANCE, OVERLAP_M, TOUCHING_M
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode

Choices = tuple[frozenset[int], ...]  # sets of segments, one of which is meant

NOTHING: Choices = (frozenset(),)
_SLACK_M = 2 * GOAL_TOLERANCE  # of places


class Leg(NamedTuple):
    """A stretch of every plan, up to a moment at which no segment is changing.

    Attributes:
        modes: Modes that it may use.
        last: Stiffness at its end; None: any, and segments may be changing.
        shape: Curvature of each segment at its end [1/m], as far as it is known.
        melts: Segments of which all are soft at some time in it, one set or another.
        drive_s: Least duration if it is nothing but a drive [s].
    """

    modes: tuple[Mode, ...]
    last: Mode | None
    shape: tuple[arb, ...]
    melts: Choices
    drive_s: float = 0.0


class Place(NamedTuple):
    """A disc in which b0, or an object, is: its middle and radius [m]."""

    x_m: float
    y_m: float
    within_m: float

    def apart_m(self, other: Place) -> float:
        """Least distance between the two [m]; negative where they may be at one point."""
        between_m = math.hypot(self.x_m - other.x_m, self.y_m - other.y_m)
        return between_m - self.within_m - other.within_m

    def wider(self, by_m: float) -> Place:
        """The same with another radius."""
        return self._replace(within_m=self.within_m + by_m)


ANYWHERE = Place(0.0, 0.0, math.inf)


def in_any_order(problem: Problem) -> Iterator[Problem]:
    """The problem with its tasks in each order that is allowed."""
    if problem.order == "given":
        yield problem
        return
    for tasks in orders(problem.tasks, problem.start.holding):
        yield problem.with_values(tasks=tasks)


class Legs:
    """The legs of a problem whose tasks are done in the order given."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._rigid = problem, problem.robot.rigid
        self._things = {item.name: item for item in problem.objects}
        limit = arb(problem.robot.limits.curvature_per_m + BEYOND_PER_M)
        self._unknown = (between(-limit, limit),) * len(self._rigid)
        self._any = tuple(frozenset([j]) for j in range(len(self._rigid)))
        here = problem.start.configuration.tolist()
        self._at, self._shape = Place(here[0], here[1], _SLACK_M), tuple(map(arb, here[POSE:]))
        self._from, self._speed_m_s = self._at, problem.robot.limits.speed_m_s or math.inf
        self._where = {
            item.name: Place(item.pose.x_m, item.pose.y_m, 0.0) for item in problem.objects
        }
        self._modes, self._melts = list[Mode](), NOTHING
        self._held_m = 0.0  # from b0 to what is in hand, at most
        self._due_s = 0.0  # when what follows a path is at its end, since it set off
        if (held := problem.start.holding) is not None:
            self._held_m = self._at.apart_m(self._where[held]) + 2 * _SLACK_M
        self._caged = self._driven = self._opened = False

    def legs(self) -> Iterator[Leg]:
        """Yield them in turn; boxes to pass belong to what comes after them."""
        stages = self._problem.stages
        for stage in stages:
            self._modes += [mode for mode in stage.modes if mode not in self._modes]
            final, shape = stage is stages[-1], self._unknown
            if stage.grasps is not None:
                yield from self._before_grasp(stage.grasps, stage.modes)
            elif stage.releases is not None:
                self._melts = self._any if self._caged else self._melts
                self._opened, self._caged = self._caged and self._driven, False
            elif stage.carries is not None:
                task, shape = stage.carries, self._shape
                there = Place(task.x_m, task.y_m, task.position_tolerance_m + _SLACK_M)
                self._driven = self._where[task.object].apart_m(there) > 0
                self._where[task.object], self._at = there, there.wider(self._held_m)
            elif stage.follows is not None:
                shape, self._driven = self._shape, True
                self._follow(stage.follows)
            elif stage.goal is not None:
                shape = self._reach(stage.goal, stage.holds)
            elif stage.along is not None:
                segments = (j - 1 for j in stage.along.segments)
                self._also(frozenset(j for j in segments if self._is_flat(j, stage.along)))
            if final or (stage.through is None and stage.releases is None):
                known = stage.grasps or stage.carries or stage.follows or stage.goal
                self._at = self._at if known is not None else ANYWHERE
                yield self._leg(stage.last, shape)

    def _leg(self, last: Mode | None, shape: tuple[arb, ...]) -> Leg:
        drive_s = max(self._at.apart_m(self._from), 0.0) / self._speed_m_s
        drive_s, self._due_s = max(drive_s, self._due_s), 0.0
        leg = Leg(tuple(self._modes), last, shape, self._melts, drive_s)
        self._modes, self._melts, self._shape, self._opened = [], NOTHING, shape, False
        self._from = self._at
        return leg

    def _also(self, segments: frozenset[int]) -> None:
        self._melts = tuple(either | segments for either in self._melts)

    def _before_grasp(self, task: Grasp, modes: Sequence[Mode]) -> Iterator[Leg]:
        """Melts before a grasp: to close around an object, and to open and drive to it before."""
        thing, self._caged = self._things[task.object], task.hold == "caged"
        reach_m = outermost_m(self._problem.robot)
        self._held_m = _caged_m(thing, reach_m) if self._caged else reach_m + _size_m(thing)
        there = self._where[task.object].wider(self._held_m)
        far_m = there.apart_m(self._at) if self._caged else 0.0
        if self._opened and far_m > self._problem.robot.limits.soft_travel_m:
            self._at = ANYWHERE
            yield self._leg(self._rigid, self._unknown)
            self._modes = list(modes)
        self._melts = self._any if far_m > 0 else self._melts
        self._at, self._driven = there, False

    def _follow(self, task: Follow) -> None:
        """Where what follows is at the end of its path, and when; b0 is not far."""
        x, y = task.left.points[-1].tolist()
        self._due_s = float(task.due[:, 1].max(initial=0.0))
        there = Place(x, y, task.position_tolerance_m + _SLACK_M)
        self._at = there.wider(self._held_m if task.object else outermost_m(self._problem.robot))
        if task.object is not None:
            self._where[task.object] = there

    def _reach(self, goal: GoalSet, held: str | None) -> tuple[arb, ...]:
        """Segments whose curvatures must change melt."""
        ends = goal.box(self._problem.start.configuration)
        low, high = (end.tolist() for end in ends)
        limit = self._problem.robot.limits.curvature_per_m + BEYOND_PER_M
        shape = tuple(
            between(max(a - GOAL_TOLERANCE, -limit), min(b + GOAL_TOLERANCE, limit))
            for a, b in zip(low[POSE:], high[POSE:], strict=True)
        )
        pairs = enumerate(zip(self._shape, shape, strict=True))
        self._also(frozenset(j for j, (before, after) in pairs if not before.overlaps(after)))
        width = [high[k] - low[k] for k in range(2)]
        self._at = ANYWHERE
        if all(map(math.isfinite, width)):
            half_m = math.hypot(*width) / 2 + 2 * GOAL_TOLERANCE
            self._at = Place((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, half_m)
        if held is not None:
            self._where[held] = self._at.wider(self._held_m)
        self._driven = False
        return shape

    def _is_flat(self, j: int, task: Conform) -> bool:
        """True if a segment that bends as before surely does not lie along a disc.

        If its ends and its middle are within an annulus, that is as wide as its sagitta asks.
        """
        own = [item for item in self._problem.obstacles if item.name == task.object]
        disc = own[0].disc if own else self._things[task.object].disc
        if disc is None:
            return False
        geometry = self._problem.robot.geometry
        length, middle = geometry.lengths_m[j], arb(disc.radius_m) + geometry.fibre_radius_m
        least, most = middle - OVERLAP_M - _SLACK_M, middle + task.gap_m + _SLACK_M
        half = self._shape[j] * length / 2
        chord, sagitta = length * half.sinc(), abs(length * half / 4 * (half / 2).sinc() ** 2)
        return bool(least > (most**2 - (chord / 2) ** 2).max(arb(0)).sqrt() + sagitta)


def _size_m(thing: Object) -> float:
    """Largest distance of a point of what touches an object from the object's origin [m]."""
    size_m = max(math.hypot(*corner) for corner in thing.own.corners_m.tolist())
    return size_m + TOUCHING_M + GOAL_TOLERANCE


def _caged_m(thing: Object, reach_m: float) -> float:
    """Largest distance from b0 to what cannot leave a robot that reaches so far [m].

    It cannot be moved away from b0: so it is no further out than the robot. Of a disc, what is in
    its way lies as far beside its middle at most as the disc does, and no nearer.
    """
    if thing.disc is None:
        return reach_m + _size_m(thing)
    own_m = max(thing.disc.radius_m - 2 * OVERLAP_M, 0.0)
    return math.sqrt(max(reach_m**2 - own_m**2, 0.0))
