"""The ways to do a mission: which touch of each object, in which order of tasks.

A touch gives a shape and a place at its object. Ways with the same shapes are one variant: the
search tells variants apart, and within one the places are tried, the nearest ones first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twosra_mpc.contact.grip import caged, pushing_cone
from twosra_mpc.contact.touch import Touch, TouchSet, conform_touches, grasp_touches
from twosra_mpc.effort import Cost, charge, out_of_effort
from twosra_mpc.errors import InputError
from twosra_mpc.planning.missions.ends import HEADINGS, Ends, placed, spread
from twosra_mpc.planning.missions.stages import Stage, Variant
from twosra_mpc.problem.goals import Anywhere, Goal, GoalSet, Tolerance
from twosra_mpc.problem.objects import Object
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import (
    Carry,
    Conform,
    Grasp,
    Pass,
    Release,
    Task,
    carries,
    orders,
)
from twosra_mpc.problem.tolerances import TOUCHING_M
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.robot.modes import Mode
from twosra_mpc.space.contour import Contour, apart_m, parts
from twosra_mpc.space.convex import eroded, quadrangles
from twosra_mpc.space.footprint import kept_m

GRASP_GAP_M = 5e-4  # between the robot and what it closes around
_OVERLAP_M = 4e-4  # with what is touched, of what is drawn around the robot
_PUT_HEADINGS = 8  # of an object that is put down at any
_MOST_TOUCHES, _MOST_TESTED = 6, 16  # of a shape, and of an object
_OPEN = (0.7, 0.4, 0.0)  # of their curvatures segments have at most when they have let go
_STRAIGHT_PER_M = 1.0
_ALIKE = 6  # decimals of m and 1/m


class Hold(NamedTuple):
    """How an object is held: its number, the robot's shape, and its pose in b0."""

    number: int
    kappa: Array
    pose_in_b0: Array
    caged: bool


class State(NamedTuple):
    """What has been done so far: stages, where objects are, what is held, what was touched."""

    stages: tuple[Stage, ...]
    poses: tuple[Array, ...]
    hold: Hold | None
    touched: str | None = None
    passes: tuple[Pass, ...] = ()
    key: tuple[float, ...] = ()


class Ways:
    """Makes the variants of a mission; why there are none is kept in ``refused``."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.refused: list[str] = []
        self._known: dict[object, tuple[Touch, ...]] = {}
        self._rigid = (problem.robot.rigid,)

    def variants(self) -> list[Variant] | None:
        """Every variant; None if the effort is over first, as no bound holds for some of them."""
        found: list[Variant] = []
        for order in self._orders():
            if out_of_effort():
                return None
            problem = self._in_order(order)
            groups: dict[tuple[float, ...], list[tuple[Stage, ...]]] = {}
            for state in self._from(problem, self._begin(), 0):
                groups.setdefault(state.key, []).append(state.stages)
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
        problem = self.problem
        poses = tuple(item.pose.pose for item in problem.objects)
        name = problem.start.holding
        if name is None:
            return State((), poses, None)
        number = self._number(name)
        q = problem.start.configuration
        pose_in_b0 = composed(inverse(q[:POSE]), poses[number])
        thing = problem.objects[number]
        try:
            proved = caged(problem.robot.geometry, q[POSE:], thing, pose_in_b0).proved
        except InputError:
            allowed = f"where {name} is in the robot's hand; here they overlap, or are apart"
            where = tuple(poses[number].tolist())
            raise InputError(f"objects.{number}.pose", where, allowed) from None
        if not proved and not any(task.lets_go for task in problem.tasks[:1]):
            self._check_pushed(thing, q[POSE:], pose_in_b0)
        return State((), poses, Hold(number, q[POSE:], pose_in_b0, proved))

    def _check_pushed(self, thing: Object, kappa: Array, pose_in_b0: Array) -> None:
        """Refuse an object that the start holds neither by a cage nor by friction where it touches.

        Raises:
            InputError: Naming the object, and how far it is from touching.
        """
        geometry, contour = self.problem.robot.geometry, Contour.of(thing.at(pose_in_b0))
        still = np.concatenate([np.zeros(POSE), kappa])[None]
        moved = (None, *range(geometry.segments))
        found = [np.min(apart_m(geometry, contour, parts(geometry, still, j))) for j in moved]
        if (nearest_m := float(min(found))) > TOUCHING_M:
            why = f"it is {1e3 * nearest_m:z.3g} mm from touching, and no cage is proved"
        elif thing.friction is None:
            why = "no cage is proved, and it has no friction to be pushed by"
        else:
            return
        held = f"an object in a cage, or one that touches and has friction; {thing.name}: {why}"
        raise InputError("start.holding", thing.name, held)

    def _number(self, name: str) -> int:
        return [item.name for item in self.problem.objects].index(name)

    def _from(self, problem: Problem, state: State, task: int) -> Iterator[State]:
        """Every way to do the tasks from a number on, and to reach the goal."""
        if task == len(problem.tasks):
            over = problem.ends_anywhere and not state.passes
            yield from [state] if over else self.reached(problem.goal, problem.goal.mode, state)
            return
        for after in problem.tasks[task].accept(self, state):
            yield from self._from(problem, after, task + 1)

    def passed(self, task: Pass, at: State) -> Iterator[State]:
        """The box is left to the stage that follows."""
        yield at._replace(passes=(*at.passes, task))

    def _after(self, state: State, stage: Stage) -> State:
        """What comes after a stage; boxes to pass belonged to it, and what was held moved."""
        charge(Cost.STAGE)
        stage, poses = replace(stage, passes=state.passes), list(state.poses)
        if (hold := state.hold) is not None:
            stage = self._holding(stage, hold)
            pose = stage.ends[0] if stage.ends is not None else stage.goal.configuration[:POSE]
            poses[hold.number] = composed(pose, hold.pose_in_b0)
        stages = (*state.stages, stage)
        return state._replace(stages=stages, poses=tuple(poses), touched=None, passes=())

    def _holding(self, stage: Stage, hold: Hold) -> Stage:
        """The stage with an object in hand: nothing bends."""
        thing, robot = self.problem.objects[hold.number], self.problem.robot
        pieces = quadrangles(thing.at(hold.pose_in_b0))
        may = None
        if not hold.caged:
            where = robot.geometry, hold.kappa, thing, hold.pose_in_b0
            may = pushing_cone(*where, thing.friction or 0.0).holds
        return replace(stage, modes=self._rigid, held=pieces, may=may)

    def _world(self, state: State, touched: str | None = None) -> World:
        """What is around the robot; what may be touched is smaller, as much as keeps away."""
        problem = self.problem
        held = None if state.hold is None else state.hold.number
        around = problem.world_with([None if i == held else p for i, p in enumerate(state.poses)])
        off_m = kept_m(around, problem.robot.geometry) + _OVERLAP_M
        kept = [
            part
            for thing in around.obstacles
            for part in ((thing,) if not touched or thing.name != touched else eroded(thing, off_m))
        ]
        return around.with_values(obstacles=tuple(kept))

    def reached(self, goal: GoalSet, mode: Mode | None, at: State) -> Iterator[State]:
        """The stage that ends in a goal set."""
        world, touches = self._world(at, at.touched), at.touched is not None
        yield self._after(at, Stage(goal, mode, self.problem.modes, world, touches=touches))

    def grasped(self, task: Grasp, at: State) -> Iterator[State]:
        """The stages that end in each touch that holds an object as asked."""
        number = self._number(task.object)
        thing = self.problem.objects[number]
        for touch in self._grasps(thing, task):
            ends = placed(touch, at.poses[number], thing, task.directions_rad)
            if not len(ends.poses):
                continue
            stage = self._touching(at, task.object, _shape(touch.kappa), ends)
            if task.hold == "caged":  # it gets in no more than out
                entries = tuple(self._opened(touch.kappa, share) for share in _OPEN)
                stage = replace(stage, reshapes=True, entries=entries)
            apart = thing.disc is not None and self._turned_as_asked(task.object)
            for some in [end[None] for end in ends.poses] if apart else [ends.poses]:
                after = self._after(at, replace(stage, ends=some))
                where = composed(inverse(some[0]), at.poses[number]) if apart else None
                pose_in_b0 = touch.pose_in_b0 if where is None else where
                hold = Hold(number, touch.kappa, pose_in_b0, task.hold == "caged")
                yield after._replace(hold=hold, key=(*after.key, *touch.kappa.round(2).tolist()))

    def _touching(self, state: State, name: str, shape: Goal, ends: Ends) -> Stage:
        """The stage that ends in touch with a thing: there it bends, and drives no more."""
        return Stage(
            shape,
            self.problem.robot.rigid,
            self.problem.modes,
            self._world(state, name),
            ends=ends.poses,
            within_m=ends.within_m,
            drives_last=False,
            touches=True,
        )

    def _turned_as_asked(self, name: str) -> bool:
        """Whether an object is to be carried to a heading."""
        own = (task for task in carries(self.problem.tasks).values() if task.object == name)
        return any(task.phi_rad is not None for task in own)

    def _grasps(self, thing: Object, task: Grasp) -> tuple[Touch, ...]:
        """Touches that hold an object as asked, a few of each shape."""
        key = thing.with_values(pose={"x_m": 0.0, "y_m": 0.0}), task.hold
        if key in self._known:
            return self._known[key]
        found = grasp_touches(self.problem.robot, thing, GRASP_GAP_M)
        touches = list(found.touches)
        if task.hold == "caged":
            geometry = self.problem.robot.geometry
            touches, known = [], dict[object, bool]()
            for number, each in enumerate(found.touches):
                if touches and number >= _MOST_TESTED:
                    break
                corners = thing.at(each.pose_in_b0).corners_m.round(_ALIKE)
                alike = tuple(each.kappa.round(_ALIKE)), frozenset(map(tuple, corners))
                if alike not in known:
                    known[alike] = caged(geometry, each.kappa, thing, each.pose_in_b0).proved
                if known[alike]:
                    touches.append(each)
        if not touches:
            self.refused.append(_no_grasp(task, found))
        self._known[key] = tuple(_a_few(touches))
        return self._known[key]

    def carried(self, task: Carry, at: State) -> Iterator[State]:
        """The stages that end with what is held at a pose."""
        hold = at.hold
        assert hold is not None, "checked with the problem"
        thing = self.problem.objects[hold.number]
        headings, step_rad = np.array([task.phi_rad or 0.0]), 0.0
        if task.phi_rad is None:
            count = HEADINGS if thing.disc is not None else _PUT_HEADINGS
            headings, step_rad = spread((-math.pi, math.pi), count)
        poses = np.column_stack(
            [np.full_like(headings, task.x_m), np.full_like(headings, task.y_m), headings]
        )
        ends = composed(poses, inverse(hold.pose_in_b0))
        together = thing.disc is not None and task.phi_rad is None
        for some in [ends] if together else [end[None] for end in ends]:
            stage = Stage(
                _shape(hold.kappa),
                self.problem.robot.rigid,
                self._rigid,
                self._world(at),
                ends=some,
                within_m=step_rad * float(np.hypot(*hold.pose_in_b0[:2])),
            )
            yield self._after(at, stage)

    def released(self, task: Release, at: State) -> Iterator[State]:
        """Let go: a caged object by opening all around it, by so much at least."""
        hold = at.hold
        assert hold is not None, "checked with the problem"
        free = at._replace(hold=None)
        first, *others = (
            (self._opened(hold.kappa, share) for share in _OPEN)
            if hold.caged
            else [Anywhere(mode=self.problem.robot.rigid)]
        )
        stage = Stage(
            first,
            None,
            self.problem.modes,
            self._world(free, task.object),
            drives_first=False,
            reshapes=hold.caged,
            openings=tuple(others),
            away=self._world(free),
            touches=True,
        )
        yield self._after(free, stage)

    def _opened(self, kappa: Array, share: float) -> Goal:
        """Shapes in which bent segments have no more than a share of their curvature."""
        limit = self.problem.robot.limits.curvature_per_m
        middle, width = list[float | None]([None] * len(kappa)), [0.0] * len(kappa)
        for j in np.flatnonzero(np.abs(kappa) > _STRAIGHT_PER_M).tolist():
            ends = sorted((share * float(kappa[j]), -math.copysign(limit, kappa[j])))
            middle[j], width[j] = sum(ends) / 2, (ends[1] - ends[0]) / 2
        return Goal(kappa_per_m=tuple(middle), tolerance=Tolerance(kappa_per_m=tuple(width)))

    def conformed(self, task: Conform, at: State) -> Iterator[State]:
        """The stages that end with segments along a thing."""
        names = [item.name for item in self.problem.objects]
        if task.object in names:
            number = names.index(task.object)
            thing, pose = self.problem.objects[number].own, at.poses[number]
        else:
            world = self.problem.world
            thing = world.obstacles[world.names.index(task.object)]
            pose = np.zeros(POSE)
        found = conform_touches(self.problem.robot, thing, task.segments, task.gap_m)
        if not found.touches:
            reasons = "; ".join(found.refused)
            self.refused.append(f"nothing conforms to {task.object}: {reasons}")
        for touch in _a_few(found.touches):
            ends = placed(touch, pose, thing, task.directions_rad)
            if not len(ends.poses):
                continue
            shape = _shape(touch.kappa, touch.slack_per_m)
            stage = self._touching(at, task.object, shape, ends)
            after = self._after(at, stage)._replace(touched=task.object)
            yield after._replace(key=(*after.key, *np.nan_to_num(touch.kappa).round(2).tolist()))

    def _length_m(self, stages: Sequence[Stage]) -> float:
        """About how far the robot drives."""
        here, far = self.problem.start.configuration[None, :POSE], 0.0
        for stage in stages:
            if stage.ends is not None:
                apart = np.linalg.norm(here[:, None, :2] - stage.ends[None, :, :2], axis=-1)
                far += float(apart.min())
                here = stage.ends
        return far


def _shape(kappa: Array, slack_per_m: Array | float = 0.0) -> Goal:
    """A shape to end in, wherever; by how much less each segment may bend."""
    looser = kappa - np.sign(kappa) * slack_per_m
    middle = [None if math.isnan(k) else k for k in ((kappa + looser) / 2).tolist()]
    width = tuple(np.nan_to_num(np.abs(kappa - looser) / 2).tolist())
    return Goal(kappa_per_m=tuple(middle), tolerance=Tolerance(kappa_per_m=width))


def _a_few(touches: Sequence[Touch]) -> Iterator[Touch]:
    """At most so many of each shape, evenly."""
    groups: dict[tuple[float, ...], list[Touch]] = {}
    for touch in touches:
        groups.setdefault(tuple(np.nan_to_num(touch.kappa).round(2).tolist()), []).append(touch)
    for group in groups.values():
        yield from group[:: max(1, -(-len(group) // _MOST_TOUCHES))]


def _no_grasp(task: Grasp, found: TouchSet) -> str:
    """Why an object cannot be held as asked."""
    if not found.touches:
        return f"nothing closes around {task.object}: {', '.join(found.refused)}"
    wrap = math.degrees(found.best_wrap_rad)
    return (
        f"nothing cages {task.object}; the best touch embraces {wrap:z.0f} degrees of it: "
        'ask for hold = "pushed"'
    )
