"""The ways to handle objects: where to touch, grasp, put down and let go of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twosra_mpc.contact.grip import SURELY, Pulls, PushingCone, caged, pushing_cone
from twosra_mpc.contact.touch import Touch, TouchSet, conform_touches, grasp_touches
from twosra_mpc.errors import InputError
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.stages.along import (
    BEGUN_RAD,
    Along,
    drives_along,
    easy_headings,
    late,
    least_time_s,
)
from twosra_mpc.planning.stages.variants import Hold, Placement, State
from twosra_mpc.problem.goals import Anywhere, Goal, GoalSet, Tolerance
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import (
    Carry,
    Conform,
    Follow,
    Grasp,
    Release,
    Stage,
    carries,
    follows,
    part_in_b0,
)
from twosra_mpc.problem.tolerances import TOUCHING_M
from twosra_mpc.problem.world import Object, Obstacle
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.space.contour import Contour, apart_m, parts
from twosra_mpc.space.convex import quadrangles
from twosra_mpc.space.footprint import footprint

GRASP_GAP_M = 5e-4  # between the robot and what it closes around
_PUT_HEADINGS = 8  # of an object that is put down at any
_MOST_TOUCHES, _MOST_TESTED = 6, 16  # of a shape, and of an object
_OPEN = (0.7, 0.4, 0.0)  # of their curvatures segments have at most when they have let go
_STRAIGHT_PER_M = 1.0
_AS_IT_IS_PER_M = 0.1  # from a shape that touches: 0.1 mm over 40 mm
_STILL_M = 1e-12  # of an object in an interval
_ALIKE = 6  # decimals of m and 1/m


class Handling:
    """Ways to do stages that end at an object or obstacle, or lead along a path.

    ``refused`` says why there are none, and whether that is proved.
    """

    def __init__(self, problem: Problem, refused: dict[str, bool]) -> None:
        self.problem, self.refused = problem, refused
        self._known: dict[object, tuple[tuple[Touch, float], ...]] = {}
        self._grips: dict[object, tuple[PushingCone | None, Pulls]] = {}

    def ways(self, stage: Stage, at: State) -> Iterator[State]:
        """Every way to do a stage."""
        if stage.grasps is not None:
            yield from self._grasped(stage, stage.grasps, at)
        if stage.along is not None:
            yield from self._conformed(stage, stage.along, at)
        if stage.carries is not None:
            yield from self._carried(stage, stage.carries, at)
        if stage.follows is not None:
            yield from self._followed(stage, stage.follows, at)
        if stage.releases is not None:
            yield from self._released(stage, stage.releases, at)

    def at_start(self) -> Hold:
        """Hold of the object that the start holds.

        Raises:
            InputError: If it is neither caged nor pushed.
        """
        problem, name = self.problem, self.problem.start.holding
        assert name is not None, "only then anyone asks"
        poses = tuple(item.pose.pose for item in problem.objects)
        number = self._number(name)
        q = problem.start.configuration
        pose_in_b0 = composed(inverse(q[:POSE]), poses[number])
        thing = problem.objects[number]
        try:
            cage = caged(problem.robot.geometry, q[POSE:], thing, pose_in_b0)
        except InputError:
            allowed = f"where {name} is in the robot's hand; here they overlap, or are apart"
            where = tuple(poses[number].tolist())
            raise InputError(f"objects.{number}.pose", where, allowed) from None
        if not cage.proved and not any(task.lets_go for task in problem.tasks[:1]):
            self._check_pushed(thing, q[POSE:], pose_in_b0)
        return Hold(number, q[POSE:], pose_in_b0, cage.room_m)

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

    def holding(self, placement: Placement, hold: Hold) -> Placement:
        """The stage with an object in hand."""
        held = quadrangles(self.problem.objects[hold.number].at(hold.pose_in_b0))
        cone, pulls = self._grip(hold)
        return replace(placement, held=held, cone=cone, pulls=pulls, most=self._most)

    def _grip(self, hold: Hold) -> tuple[PushingCone | None, Pulls]:
        """What friction moves with the robot, None in a cage, and what its wheels pull for it."""
        key = hold.number, hold.kappa.tobytes(), hold.pose_in_b0.tobytes()
        if key not in self._grips:
            thing, robot, cone = self.problem.objects[hold.number], self.problem.robot, None
            if not hold.caged:
                where = robot.geometry, hold.kappa, thing, hold.pose_in_b0
                cone = pushing_cone(*where, SURELY * (thing.friction or 0.0))
            self._grips[key] = cone, Pulls.of(robot, hold.kappa, thing, hold.pose_in_b0)
        return self._grips[key]

    def _grasped(self, stage: Stage, task: Grasp, at: State) -> Iterator[State]:
        """The stages that end in each touch that holds an object as asked."""
        number = self._number(task.object)
        thing = self.problem.objects[number]
        for touch, room_m in self._grasps(thing, task):
            now = self._shape_at(at)
            if task.closes:
                touch, room_m = self._together(touch, room_m, task, now)
            elif np.abs(touch.kappa - now).max() < _AS_IT_IS_PER_M:
                touch = replace(touch, configuration=np.append(touch.configuration[:POSE], now))
            ends = placed(touch, at.poses[number], thing, task.directions_rad)
            if not len(ends.poses):
                continue
            placement = self._touching(at, stage, _shape(touch.kappa), ends)
            placement = replace(placement, drives_last=not task.closes)  # up to it
            if task.closes:  # it gets in no more than out
                entries = tuple(self._opened(touch.kappa, share) for share in _OPEN)
                outside = bool(at.placements) or self._apart(touch.kappa, thing, at.poses[number])
                placement = replace(placement, reshapes=outside, entries=entries)
            apart = thing.disc is not None and self._turned_as_asked(task.object)
            for some in [end[None] for end in ends.poses] if apart else [ends.poses]:
                after = at.after(replace(placement, ends=some))
                there = composed(inverse(some[0]), at.poses[number]) if apart else touch.pose_in_b0
                hold = Hold(number, touch.kappa, there, room_m)
                yield after._replace(hold=hold, key=(*after.key, *touch.kappa.round(2).tolist()))

    def _together(
        self, touch: Touch, room_m: float, task: Grasp, now: Array
    ) -> tuple[Touch, float]:
        """Where all segments come that close at once until one touches, and the room of that cage.

        If it is one, and as near to the touch as a robot bends; else one has to bend alone before.
        """
        robot, thing = self.problem.robot, self.problem.objects[self._number(task.object)]
        model = bending(robot)
        bent = model.coordinates(now)
        left = model.coordinates(touch.kappa) - bent
        kappa = model.curvature(bent + left[np.abs(left).argmin()])
        if np.abs(kappa - touch.kappa).max() > robot.ends_within.curvature_per_m:
            return touch, room_m
        try:
            cage = caged(robot.geometry, kappa, thing, touch.pose_in_b0)
        except InputError:
            return touch, room_m
        made = replace(touch, configuration=np.append(touch.configuration[:POSE], kappa))
        return (made, cage.room_m) if cage.room_m < self._most_room_m(task) else (touch, room_m)

    def _most_room_m(self, task: Grasp) -> float:
        """Room of a cage in which an object is not led as exactly as its paths ask; inf: none."""
        led = follows(self.problem.tasks, task.object).values()
        return min((each.position_tolerance_m for each in led), default=math.inf)

    def _apart(self, kappa: Array, thing: Object, pose: Array) -> bool:
        """True if at the start the object is too far away to be in a robot of that shape."""
        away = composed(inverse(self.problem.start.configuration[:POSE]), pose)
        size_m = np.linalg.norm(thing.own.corners_m, axis=1).max()
        reach_m = footprint(self.problem.robot.geometry, kappa).radius_m + size_m
        return bool(np.hypot(*away[:2]) > reach_m)

    def _touching(self, at: State, stage: Stage, shape: Goal, ends: Ends) -> Placement:
        """The stage that ends in touch with a thing: there it bends, and drives no more."""
        made = Placement(stage, shape, at.world(self.problem, stage.touches), drives_last=False)
        return replace(made, ends=ends.poses, within_m=ends.within_m)

    def _turned_as_asked(self, name: str) -> bool:
        """True if an object is to be carried to a heading."""
        own = (task for task in carries(self.problem.tasks).values() if task.object == name)
        return any(task.phi_rad is not None for task in own)

    def _grasps(self, thing: Object, task: Grasp) -> tuple[tuple[Touch, float], ...]:
        """Touches that hold an object as asked, a few of each shape, and the room of their cages.

        Where it is led along a path, in those whose room is within the tolerance of the path.
        """
        most_m = self._most_room_m(task)
        key = thing.with_values(pose={"x_m": 0.0, "y_m": 0.0}), task.hold, most_m
        if key in self._known:
            return self._known[key]
        found = grasp_touches(self.problem.robot, thing, GRASP_GAP_M)
        touches, rooms_m = list(found.touches), dict[object, float]()
        if task.hold == "caged":
            touches, geometry = [], self.problem.robot.geometry
            for number, each in enumerate(found.touches):
                if touches and number >= _MOST_TESTED:
                    break
                alike = _alike(thing, each)
                if alike not in rooms_m:
                    rooms_m[alike] = caged(geometry, each.kappa, thing, each.pose_in_b0).room_m
                if rooms_m[alike] < most_m:
                    touches.append(each)
        if not touches:
            least_m = min(rooms_m.values(), default=math.inf)
            self.refused[_no_grasp(task, found, least_m, most_m)] = True
        few = ((each, rooms_m.get(_alike(thing, each), math.inf)) for each in _a_few(touches))
        self._known[key] = tuple(few)
        return self._known[key]

    def _carried(self, stage: Stage, task: Carry, at: State) -> Iterator[State]:
        """The stages that end with what is held at a pose."""
        hold = at.hold
        assert hold is not None, "checked with the problem"
        thing, (_, pulls) = self.problem.objects[hold.number], self._grip(hold)
        ahead = np.column_stack([np.cos(BEGUN_RAD), np.sin(BEGUN_RAD), 0 * BEGUN_RAD])
        if words := self._weak(task, float(pulls(ahead).min())):
            self.refused[f"{task.said(len(at.placements) + 1)}: {words}"] = False
            return
        headings, step_rad = np.array([task.phi_rad or 0.0]), 0.0
        if task.phi_rad is None:
            count = HEADINGS if thing.disc is not None else _PUT_HEADINGS
            headings, step_rad = spread((-math.pi, math.pi), count)
            paths = follows(self.problem.tasks, task.object).values()
            for path in (each for each in paths if not each.asks_heading):
                easy = easy_headings(path.left, pulls)
                headings = np.append(headings, easy + hold.pose_in_b0[2])
        poses = np.array([(task.x_m, task.y_m, heading) for heading in headings.tolist()])
        ends = composed(poses, inverse(hold.pose_in_b0))
        together = thing.disc is not None and task.phi_rad is None
        within_m = step_rad * float(np.hypot(*hold.pose_in_b0[:2]))
        made = self.holding(Placement(stage, _shape(hold.kappa), at.world(self.problem)), hold)
        for some in [ends] if together else [end[None] for end in ends]:
            yield at.after(replace(made, ends=some, within_m=within_m))

    def _followed(self, stage: Stage, task: Follow, at: State) -> Iterator[State]:
        """The stages that lead along a path, from each place where the one before may end."""
        robot, hold, kappa = self.problem.robot, at.hold, self._shape_at(at)
        in_b0, room_m = part_in_b0(robot, kappa, task.part), 0.0
        if task.object is not None:
            assert hold is not None, "checked with the problem"
            disc = self.problem.objects[hold.number].disc
            in_b0 = hold.pose_in_b0 * [1, 1, disc is None]
            room_m = hold.room_m if hold.caged else 0.0
            if room_m >= task.position_tolerance_m:
                self.refused[_too_loose(task.object, room_m, task.position_tolerance_m)] = True
                return
        least_s = max(stage.least_s, least_time_s(robot, kappa, task, in_b0))
        made = Placement(replace(stage, least_s=least_s), _shape(kappa), at.world(self.problem))
        made = made if hold is None else self.holding(made, hold)
        before, whys, clear = at.placements, dict[str, _Why](), False
        for begin in self._begins(task, at, in_b0):
            astray = task.astray(composed(begin, in_b0), room_m)
            drives, q = list[Along](), np.append(begin, kappa)
            if astray is None:
                drives = drives_along(robot, q, task, in_b0, room_m)
            reasons = [self._hindered(task, made, along, in_b0) for along in drives]
            if before:
                before = (*before[:-1], replace(before[-1], ends=begin[None]))
            for along, _ in (each for each in zip(drives, reasons, strict=True) if not each[1]):
                own, clear = replace(made, ends=along.motion.end[None, :POSE], along=along), True
                yield at._replace(placements=before).after(own)
            for why in [*reasons, astray and _Why("begin", 0.0, *astray)]:
                if why and not (why.kind in whys and whys[why.kind].far >= why.far):
                    whys[why.kind] = why
        said = task.said(len(before) + 1)
        for why in () if clear else whys.values():
            self.refused[f"{said}: {why.words}"] = why.proved and not before

    def _hindered(self, task: Follow, made: Placement, along: Along, in_b0: Array) -> _Why | None:
        """Reason why a drive does not lead along a path, if there is one."""
        if made.cone is not None and not made.cone.holds(along.twists).all():
            gone_m, words = _slides(made.cone, along, in_b0)
            return _Why("slides", gone_m, f"{task.object} {words}", proved=False)
        if (slow := late(self.problem.robot, task, along, in_b0)) is not None:
            return _Why("late", 0.0, *slow)
        share, name = self._met(along.motion.states[0])
        if name is not None:
            where = f"the robot meets {name} {share * task.left.length_m[-1]:z.2f} m along its path"
            return _Why("meets", share, where, self._blocked(task))
        pull = 0.0 if made.pulls is None else float(made.pulls(along.twists).max())
        words = self._weak(task, pull)
        return _Why("weak", -pull, words, proved=False) if words else None

    @cached_property
    def _most(self) -> float:
        """Most that a wheel pulls, over the friction of what is held; inf where nobody knows."""
        robot, physics = self.problem.robot, self.problem.robot.true_physics
        return physics.pull_N(robot.geometry) / physics.drag_N if robot.physics else math.inf

    def _weak(self, task: Follow | Carry, pull: float) -> str:
        """Say that wheels cannot pull so much, over an object's friction; empty: they can."""
        if pull <= self._most:
            return ""
        drag_N = self.problem.robot.true_physics.drag_N
        words = f"so that {task.object} slides a wheel would pull with {pull * drag_N:z.2f} N"
        return f"{words}, and it can with {self._most * drag_N:z.2f} N"

    def _blocked(self, task: Follow) -> bool:
        """True if an obstacle covers some of a path, and all that is within its tolerance."""
        around = (Contour.of(item).off_m(task.left.points) for item in self.problem.obstacles)
        return any((off_m < -task.position_tolerance_m).any() for off_m in around)

    def _met(self, q: Array) -> tuple[float, str | None]:
        """Share of a drive (m, 3 + n) that is free of obstacles, and what it meets then, if any."""
        geometry, share, name = self.problem.robot.geometry, 1.0, None
        moved = (None, *range(geometry.segments)) if self.problem.obstacles else ()
        own = [parts(geometry, q, j) for j in moved]
        for item in self.problem.obstacles:
            contour = Contour.of(item)
            overlap = np.any([np.minimum(*apart_m(geometry, contour, each)) < 0 for each in own], 0)
            if overlap.any() and (until := float(overlap.argmax()) / len(q)) < share:
                share, name = until, item.name or "an obstacle"
        return share, name

    def _shape_at(self, at: State) -> Array:
        """Shape (n,) in which what was done so far ends."""
        shapes = [each.goal.configuration[POSE:] for each in at.placements]
        known = [shape for shape in shapes if np.isfinite(shape).all()]
        return known[-1] if known else self.problem.start.configuration[POSE:]

    def _begins(self, task: Follow, at: State, in_b0: Array) -> Array:
        """Poses of b0 (m, 3) from which a path may be followed: in a box, the nearest to it."""
        start, last = self.problem.start.configuration, at.placements[-1:]
        if not last:
            return start[None, :POSE]
        if last[0].ends is not None:
            return last[0].ends
        (x_m, y_m), phi_rad = task.left.points[0], task.left.headings[0]
        phi_rad = start[2] + in_b0[2] if math.isnan(phi_rad) else phi_rad
        pose = composed(np.array([x_m, y_m, phi_rad]), inverse(in_b0))
        low, high = last[0].goal.box(np.concatenate([pose, start[POSE:]]))
        return np.clip(pose, low[:POSE], high[:POSE])[None]

    def _released(self, stage: Stage, task: Release, at: State) -> Iterator[State]:
        """Let go: a caged object by opening all around it, by so much at least."""
        hold, free = at.hold, at._replace(hold=None)
        assert hold is not None, "checked with the problem"
        anywhere: list[GoalSet] = [Anywhere(mode=self.problem.robot.rigid)]
        opened = (self._opened(hold.kappa, share) for share in _OPEN)
        first, *others = opened if hold.caged else anywhere
        around = free.world(self.problem, stage.touches)
        made = Placement(stage, first, around, drives_first=not hold.caged)
        made = replace(made, reshapes=hold.caged, openings=tuple(others))
        away = free.world(self.problem)
        if task.clearance_m is not None:
            away = away.with_values(clearance_m=task.clearance_m)
        yield free.after(replace(made, away=away))

    def _opened(self, kappa: Array, share: float) -> Goal:
        """Shapes in which bent segments have no more than a share of their curvature."""
        limit = self.problem.robot.limits.curvature_per_m
        middle, width = list[float | None]([None] * len(kappa)), [0.0] * len(kappa)
        for j in np.flatnonzero(np.abs(kappa) > _STRAIGHT_PER_M).tolist():
            ends = sorted((share * float(kappa[j]), -math.copysign(limit, kappa[j])))
            middle[j], width[j] = sum(ends) / 2, (ends[1] - ends[0]) / 2
        return Goal(kappa_per_m=tuple(middle), tolerance=Tolerance(kappa_per_m=tuple(width)))

    def _conformed(self, stage: Stage, task: Conform, at: State) -> Iterator[State]:
        """The stages that end with segments along a thing."""
        names = [item.name for item in self.problem.objects]
        if task.object in names:
            number = names.index(task.object)
            thing, pose = self.problem.objects[number].own, at.poses[number]
        else:
            world = self.problem.world
            thing, pose = world.obstacles[world.names.index(task.object)], np.zeros(POSE)
        found = conform_touches(self.problem.robot, thing, task.segments, task.gap_m)
        if not found.touches:
            self.refused[f"nothing conforms to {task.object}: {'; '.join(found.refused)}"] = True
        for touch in _a_few(found.touches):
            ends = placed(touch, pose, thing, task.directions_rad)
            if not len(ends.poses):
                continue
            shape = _shape(touch.kappa, touch.slack_per_m)
            after = at.after(self._touching(at, stage, shape, ends))
            yield after._replace(key=(*after.key, *np.nan_to_num(touch.kappa).round(2).tolist()))


class _Why(NamedTuple):
    """Reason why a path is not led along: its kind, how far it is led, words, whether proved."""

    kind: str
    far: float
    words: str
    proved: bool


def _slides(cone: PushingCone, along: Along, pose_in_b0: Array) -> tuple[float, str]:
    """How far along a path friction holds what is pushed [m], and what bends there, in words."""
    kept, (x, y) = cone.holds(along.twists), pose_in_b0[:2].tolist()
    number = int(kept.reshape(2, -1).all(axis=0).argmin())
    gone_m = float(np.hypot(*np.diff(along.poses[: number + 1, :2], axis=0).T).sum())
    u, v, r = along.twists[~kept].T
    moved = np.column_stack([u - r * y, v + r * x])
    sizes = np.maximum(np.hypot(*moved.T), _STILL_M)
    worst = int(np.abs(r / sizes).argmax())
    turned, size = float(r[worst]), float(sizes[worst])
    bends = cone.bends(moved[worst] / size, pose_in_b0[:2])
    where = f"is held by friction for {gone_m:z.2f} m of its path, then not"
    if bends is None:
        return gone_m, f"{where}: it is pushed aside; have it grasped on another side"
    left, right = (f"{1e3 / k:z.0f} mm" if k > 0 else "none" for k in (bends[1], -bends[0]))
    radius = f"one of {1e3 * size / abs(turned):z.0f} mm" if turned else "none there"
    least = f"of a radius of {left} to the left and {right} to the right at least"
    return gone_m, f"{where}: pushed so it follows bends {least}, and the path has {radius}"


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


def _alike(thing: Object, touch: Touch) -> object:
    """What is the same for touches of which one cages if another does."""
    corners = thing.at(touch.pose_in_b0).corners_m.round(_ALIKE)
    return tuple(touch.kappa.round(_ALIKE)), frozenset(map(tuple, corners))


def _no_grasp(task: Grasp, found: TouchSet, least_m: float, most_m: float) -> str:
    """Reason why an object cannot be held as asked, or not as tightly as its path asks."""
    if not found.touches:
        return f"nothing closes around {task.object}: {', '.join(found.refused)}"
    if math.isfinite(least_m):
        return _too_loose(task.object, least_m, most_m)
    best = f"the best touch embraces {math.degrees(found.best_wrap_rad):z.0f} degrees of it"
    return f'nothing cages {task.object}; {best}: ask for hold = "pushed"'


def _too_loose(name: str, room_m: float, tolerance_m: float) -> str:
    """Reason why a cage is not tight enough for a path."""
    asked = f"position_tolerance_m = {tolerance_m:zg} m of its path must be more than that"
    return f"{name} has {1e3 * room_m:z.3g} mm of room in its cage: {asked}"


HEADINGS = 24  # of the robot around a disc


class Ends(NamedTuple):
    """Poses of b0 to end in, (m, 3), and how far from one of them any other that may be used is."""

    poses: Array
    within_m: float


def spread(range_rad: tuple[float, float], count: int) -> tuple[Array, float]:
    """Headings of a range, evenly, and how far any other of it is from the nearest, at most."""
    low, high = range_rad
    around = high - low >= math.tau
    headings = np.linspace(low, low + math.tau if around else high, count, endpoint=not around)
    return headings, min(high - low, math.tau) / (count - 1)


def placed(
    touch: Touch, pose: Array, thing: Object | Obstacle, directions_rad: tuple[float, float]
) -> Ends:
    """Poses of b0 at a thing in the world with a heading that may be used."""
    ends = composed(pose[None], touch.configuration[:POSE])
    low, high = directions_rad
    if thing.disc is None:
        return Ends(ends[np.mod(ends[:, 2] - low, math.tau) <= high - low], 0.0)
    headings, step_rad = spread(directions_rad, HEADINGS)
    own = [thing.disc.x_m, thing.disc.y_m, 0.0] if isinstance(thing, Obstacle) else [0.0] * POSE
    middle = composed(pose[None], np.array(own))
    from_b0 = composed(inverse(ends), middle)
    from_b0[:, 2] = 0.0
    turned = np.repeat(middle, len(headings), axis=0)
    turned[:, 2] = headings
    poses = composed(turned, inverse(from_b0))
    return Ends(poses, step_rad * float(np.hypot(*from_b0[0, :2])))
