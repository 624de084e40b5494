"""Independent check that every task of a mission is done when the plan says so."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from twosra_mpc.checking.sweep import Sweep
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import Carried, carried, object_poses
from twosra_mpc.plans.trajectory import SAME_TIME_S, Trajectory
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.stages import Stage
from twosra_mpc.problem.tasks import Carry, Conform, Grasp, Pass, Release
from twosra_mpc.problem.tolerances import (
    GOAL_TOLERANCE,
    OVERLAP_M,
    ROUNDING,
    TIME_TOLERANCE_S,
    TOUCHING_M,
    UNSEEN_M,
)
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.timing.transitions import own_transitions
from twosra_mpc.validation import Pair

_POINTS = 201  # along a segment that lies along something
_COARSE_M = 2e-3  # to see whether a robot that has let go is free to leave


class Done(NamedTuple):
    """The end of a task.

    Attributes:
        trajectory: The plan.
        sweep: What it sweeps.
        at_s: When the task is done.
        since_s: When the one before was.
        objects: Pose of every object then, (objects, 3).
    """

    trajectory: Trajectory
    sweep: Sweep
    at_s: float
    since_s: float
    objects: Array

    @property
    def q(self) -> Array:
        """Configuration of the robot then, as integrated, (3 + n,)."""
        found: Array = self.sweep.q[self.sweep.over(self.at_s, self.at_s)[0]]
        return found

    def thing(self, name: str) -> Obstacle:
        """An object or obstacle, where it is then."""
        problem = self.trajectory.problem
        for item, pose in zip(problem.objects, self.objects, strict=True):
            if item.name == name:
                return item.at(pose)
        return next(item for item in problem.obstacles if item.name == name)

    def apart_m(self, name: str) -> float:
        """Distance of the robot to a thing then [m]; negative: how deep they overlap."""
        from twosra_mpc.checking.clearance import touching  # loads GEOS

        around = touching(self.trajectory.problem, self.thing(name))
        return float(around.signed_m(self.q[None])[0])


def times_wrong(trajectory: Trajectory) -> Iterator[str]:
    """Say which tasks are done before those before them, or after the end."""
    ends = (0.0, *trajectory.done_s, trajectory.duration_s)
    if not np.isfinite(ends).all():
        yield "done_s has a time that is not finite"
        return
    for i, (before, after) in enumerate(itertools.pairwise(ends)):
        if after < before - SAME_TIME_S:
            late = i == len(trajectory.done_s)
            yield f"task {i} is done after the end" if late else f"task {i + 1} is done too early"


def mission_problems(trajectory: Trajectory, sweep: Sweep) -> Iterator[str]:
    """Say what is not done of a mission, and what is not held although it is carried."""
    problem, ends = trajectory.problem, (0.0, *trajectory.done_s)
    poses = object_poses(trajectory, np.array(trajectory.done_s))
    spans = itertools.pairwise(ends)
    at_start = np.array([item.pose.pose for item in problem.objects])
    yield from _held_at_start(Done(trajectory, sweep, 0.0, 0.0, at_start))
    for i, (task, (since_s, at_s)) in enumerate(zip(problem.tasks, spans, strict=True)):
        done = Done(trajectory, sweep, at_s, since_s, poses[i])
        named = f"task {i + 1} ({f'{task.do} {task.name}'.strip()}) at {at_s:z.1f} s"
        if task.rests and not _at_rest(trajectory, at_s):
            yield f"{named}: the robot moves"
        yield from (f"{named}: {text}" for text in _not_done(task.stage(problem.modes), done))
    for held in carried(trajectory):
        yield from _let_go(trajectory, held)


def _at_rest(trajectory: Trajectory, at_s: float) -> bool:
    moving = (p for p in trajectory.phases if p.start_s + SAME_TIME_S < at_s)
    return not any(at_s < phase.end_s - SAME_TIME_S for phase in moving)


def stiffness(trajectory: Trajectory, at_s: float) -> tuple[int | None, ...]:
    """Stiffness of each segment at a time: 1 soft, 0 rigid, None while it changes."""
    found = list[int | None]()
    for j, at_start in enumerate(trajectory.problem.start_mode):
        now: int | None = at_start
        for item in own_transitions(trajectory.transitions, j):
            if item.done_s <= at_s + TIME_TOLERANCE_S:
                now = int(item.to == "soft")
            elif item.onset_s < at_s - TIME_TOLERANCE_S:
                now = None
        found.append(now)
    return tuple(found)


def rounded(task: Pass) -> Pass:
    """The box, wider by rounding."""

    def wider(pair: Pair | None) -> Pair | None:
        return None if pair is None else (pair[0] - ROUNDING, pair[1] + ROUNDING)

    return Pass(x_m=wider(task.x_m), y_m=wider(task.y_m), phi_rad=wider(task.phi_rad))


def _heading(asked: Pair, done: Done) -> Iterator[str]:
    """B0 heads into an interval, full turns aside."""
    beyond = np.mod(done.q[2] - asked[0] + GOAL_TOLERANCE, math.tau)
    if beyond > asked[1] - asked[0] + 2 * GOAL_TOLERANCE:
        heading = round(float(done.q[2]), 3)
        yield f"b0 heads to {heading:zg} rad, not within {asked[0]:zg} to {asked[1]:zg} rad"


def _held_at_start(done: Done) -> Iterator[str]:
    """Objects held at the start must be caged, or touched and held by friction while pushed.

    Not asked where it is let go at once.
    """
    problem = done.trajectory.problem
    if problem.start.holding is None or carried(done.trajectory)[0].to_s <= SAME_TIME_S:
        return
    number = [item.name for item in problem.objects].index(problem.start.holding)
    thing, apart = problem.objects[number], done.apart_m(problem.start.holding)
    named = f"start.holding: {thing.name} is not held"
    if apart < -OVERLAP_M - GOAL_TOLERANCE:
        yield f"{named}: the robot overlaps it by {-1e3 * apart:z.3g} mm"
    elif _caged(number, done, apart):
        return
    elif apart > TOUCHING_M + GOAL_TOLERANCE:
        yield f"{named}: it is {1e3 * apart:z.3g} mm from touching, and no cage is proved"
    elif thing.friction is None:
        yield f"{named}: no cage is proved, and it has no friction to be pushed by"
    else:
        yield from _pushed(number, done)


def _caged(number: int, done: Done, apart: float) -> bool:
    """True if it is proved that an object cannot leave the robot."""
    from twosra_mpc.checking.holds import cage_proved

    problem = done.trajectory.problem
    where = problem.objects[number], done.objects[number], done.q
    return cage_proved(problem.robot.geometry, *where, max(-apart, 0.0))


def _pushed(number: int, done: Done) -> Iterator[str]:
    """Friction holds an object through every drive from its grasp to its release."""
    from twosra_mpc.checking.holds import pushes

    problem, samples = done.trajectory.problem, done.trajectory.samples
    held = next(c for c in carried(done.trajectory) if c.object == number and c.from_s == done.at_s)
    rows = (samples.t_s[:-1] >= held.from_s - SAME_TIME_S) & (samples.t_s[:-1] < held.to_s)
    twists = (samples.v[:-1] + samples.a[:-1] * np.diff(samples.t_s)[:, None] / 2)[:, 2:]
    thing = problem.objects[number]
    kept = pushes(problem.robot.geometry, thing, held.pose_in_b0, done.q, twists)
    wrong = rows & samples.moves[:-1] & ~kept
    if wrong.any():
        when = samples.t_s[:-1][wrong][0]
        yield f"{thing.name} is pushed where friction does not hold it at {when:z.1f} s"


def _not_done(stage: Stage, at: Done) -> Iterator[str]:
    """Shortcomings at the end of a stage, in words."""
    if at.at_s - at.since_s < stage.least_s - TIME_TOLERANCE_S:
        yield f"it lasts {at.at_s - at.since_s:z.3g} s, not {stage.least_s:zg} s"
    if stage.last is not None and stiffness(at.trajectory, at.at_s) != stage.last:
        yield f"the segments are not {mode_name(stage.last)}"
    if stage.through is not None:
        yield from _passed(stage.through, at)
    if stage.goal is not None:
        yield from _reached(stage.goal, at)
    if stage.along is not None:
        yield from _conformed(stage.along, at)
    if stage.grasps is not None:
        yield from _grasped(stage.grasps, at)
    if stage.carries is not None:
        yield from _carried(stage.carries, at)
    if stage.releases is not None:
        yield from _released(stage.releases, at)


def _passed(task: Pass, at: Done) -> Iterator[str]:
    """B0 enters the box."""
    first, last = at.sweep.over(at.since_s, at.at_s)
    if not rounded(task).met(at.sweep.q[first : last + 1, :POSE]).any():
        yield "is not done: its box is not entered"


def _reached(goal: GoalSet, at: Done) -> Iterator[str]:
    """The robot is in the goal set."""
    coordinates = at.trajectory.problem.robot.coordinates
    errors = goal.error(at.q.copy())
    for name, unit, error in zip(coordinates.names, coordinates.units, errors, strict=True):
        if not abs(error) <= GOAL_TOLERANCE:
            yield f"its goal's {name} is missed by {error:z.3g} {unit}"


def _conformed(task: Conform, at: Done) -> Iterator[str]:
    """Segments lie along the thing, at its surface."""
    from twosra_mpc.checking.clearance import depths_m  # loads GEOS

    yield from _heading(task.directions_rad, at)
    geometry = at.trajectory.problem.robot.geometry
    lines = robot_shape(geometry, at.q, _POINTS).segments
    for number in task.segments:
        gaps = -depths_m(at.thing(task.object), lines[number - 1]) - geometry.fibre_radius_m
        least, most = 1e3 * gaps.min(), 1e3 * gaps.max()
        if most > 1e3 * (task.gap_m + GOAL_TOLERANCE):
            asked = f"more than gap_m = {1e3 * task.gap_m:zg} mm"
            yield f"segment {number} is up to {most:z.3g} mm away from {task.object}, {asked}"
        if least < -1e3 * (OVERLAP_M + GOAL_TOLERANCE):
            yield f"segment {number} overlaps {task.object} by {-least:z.3g} mm"


def _grasped(task: Grasp, at: Done) -> Iterator[str]:
    """The rigid robot touches the object, and holds it as asked."""
    yield from _heading(task.directions_rad, at)
    apart = at.apart_m(task.object)
    if not -OVERLAP_M - GOAL_TOLERANCE <= apart <= TOUCHING_M + GOAL_TOLERANCE:
        state = (
            f"{1e3 * apart:z.3g} mm away from" if apart > 0 else f"{-1e3 * apart:z.3g} mm within"
        )
        yield f"the robot is {state} {task.object}, it does not touch it"
        return
    number = [item.name for item in at.trajectory.problem.objects].index(task.object)
    if task.hold == "pushed":
        yield from _pushed(number, at)
    elif not _caged(number, at, apart):
        yield f"it is not proved that {task.object} cannot leave"


def _carried(task: Carry, at: Done) -> Iterator[str]:
    """The object is where it is to be."""
    names = [item.name for item in at.trajectory.problem.objects]
    x, y, phi = at.objects[names.index(task.object)].tolist()
    away = math.hypot(x - task.x_m, y - task.y_m)
    if away > task.position_tolerance_m + GOAL_TOLERANCE:
        yield f"{task.object} is {1e3 * away:z.3g} mm from where it should be"
    if task.phi_rad is None:
        return
    turned = abs(math.remainder(phi - task.phi_rad, math.tau))
    if turned > task.heading_tolerance_rad + GOAL_TOLERANCE:
        yield f"{task.object} is turned by {turned:z.3g} rad from where it should be"


def _released(task: Release, at: Done) -> Iterator[str]:
    """The robot is clear of the object, and free to leave."""
    from twosra_mpc.checking.holds import cage_proved

    problem, apart = at.trajectory.problem, at.apart_m(task.object)
    if apart < problem.clearance_m - UNSEEN_M:
        asked = f"clearance_m = {1e3 * problem.clearance_m:zg} mm"
        yield f"the robot is {1e3 * apart:z.3g} mm from {task.object} ({asked})"
        return
    number = [item.name for item in problem.objects].index(task.object)
    geometry, thing = problem.robot.geometry, problem.objects[number]
    if cage_proved(geometry, thing, at.objects[number], at.q, 0.0, finest_m=_COARSE_M):
        yield f"the robot cannot leave: {task.object} is within it"


def _let_go(trajectory: Trajectory, held: Carried) -> Iterator[str]:
    """Say when a segment is not rigid although the robot holds something."""
    name = trajectory.problem.objects[held.object].name
    for j, at_start in enumerate(trajectory.problem.start_mode):
        own = own_transitions(trajectory.transitions, j)
        melts = [(item.onset_s, item.to == "soft") for item in own]
        soft_from = [since for since, soft in melts if soft] + ([-math.inf] if at_start else [])
        rigid_from = [item.done_s for item in own if item.to == "rigid"]
        for since in soft_from:
            until = min((end for end in rigid_from if end > since), default=math.inf)
            if since < held.to_s - TIME_TOLERANCE_S and until > held.from_s + TIME_TOLERANCE_S:
                when = max(since, held.from_s)
                yield f"segment {j + 1} is not rigid at {when:z.1f} s, while {name} is held"
