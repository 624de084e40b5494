"""Independent check of what a plan does around obstacles, and that its tasks are done in time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from twosra_mpc.checking.followed import followed, follower, tube_problems
from twosra_mpc.checking.heat import course
from twosra_mpc.checking.sweep import Clearance, Sweep, least, stages, stiffness, swept
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import Carried, carried, object_poses
from twosra_mpc.plans.trajectory import SAME_TIME_S, Trajectory
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.limits import CLEARANCE, CONTACT, SOFT_TRAVEL, WORKSPACE, workspace_margins
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Carry, Conform, Follow, Grasp, Pass, Release, Stage
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
from twosra_mpc.validation import Pair

_POINTS = 201  # along a segment that lies along something
_NEAREST_M = 1e-9  # to which the nearest place to an edge is found: its margin is stated
_COARSE_M = 2e-3  # to see whether a robot that has let go is free to leave


class Around(NamedTuple):
    """Findings about a plan's surroundings.

    Attributes:
        margins: Name of each limit -> margin [m]; none without obstacles.
        words: What is wrong, for the limits that are broken.
        tasks: Tasks that are not done, in words.
    """

    margins: dict[str, float]
    words: dict[str, str]
    tasks: tuple[str, ...]


NOTHING_AROUND = Around({}, {}, ())


def examine_around(trajectory: Trajectory, reached: Array) -> Around:
    """Check the clearance to obstacles, the travel while soft, and the tasks before the goal.

    Args:
        trajectory: The plan.
        reached: Configurations at its samples, integrated anew, (rows, 3 + n).
    """
    problem = trajectory.problem
    in_the_way = bool(problem.obstacles or problem.objects)
    sweep: Sweep | None = Sweep(trajectory.samples.t_s, reached, np.full(len(reached), np.inf))
    fine = in_the_way or problem.workspace is not None
    fine |= any(stage.through or stage.follows for stage in problem.stages)
    if fine:  # else samples are enough
        sweep = swept(problem, trajectory.samples)
    if sweep is None or not np.isfinite(sweep.q).all():  # it is anywhere
        lost = "a curvature runs away: where the robot is, is not known"
        where = CLEARANCE if in_the_way else WORKSPACE
        return Around({where.name: -1.0}, {where.name: lost}, ())
    if wrong := tuple(times_wrong(trajectory)):
        return Around({}, {}, wrong)
    found = {WORKSPACE: _within_m(problem, sweep)}
    if in_the_way:
        from twosra_mpc.checking import clearance  # loads GEOS

        of = stages(trajectory, sweep)
        found = {
            CLEARANCE: clearance.kept(trajectory, sweep, of),
            CONTACT: clearance.overlap_left(problem, sweep, of),
            WORKSPACE: itertools.chain(found[WORKSPACE], clearance.within_m(problem, sweep, of)),
            SOFT_TRAVEL: _soft_travel(trajectory, sweep),
        }
    worst = {limit: min(own, key=lambda m: m[0], default=None) for limit, own in found.items()}
    margins = {limit.name: least[0] for limit, least in worst.items() if least}
    words = {limit.name: least[1] for limit, least in worst.items() if least and least[0] < 0}
    return Around(margins, words, tuple(mission_problems(trajectory, sweep)))


def closest_approach(trajectory: Trajectory) -> Clearance | None:
    """Closest approach of a plan to an obstacle, to 0.2 mm; None where there is none.

    Objects count where they must be kept clear of, and what is carried counts as the robot.
    """
    problem = trajectory.problem
    around = problem.obstacles or problem.objects
    if not around or (sweep := swept(problem, trajectory.samples)) is None:
        return None
    from twosra_mpc.checking.clearance import closest  # loads GEOS

    return closest(problem, sweep, stages(trajectory, sweep))


def _within_m(problem: Problem, sweep: Sweep) -> Iterator[tuple[float, str]]:
    """Margin of the robot to the workspace's edges."""
    if problem.workspace is not None:
        found = least(
            lambda at: workspace_margins(problem, sweep.q[at]),
            sweep.travelled_m,
            first=0,
            last=len(sweep.t_s) - 1,
            accuracy_m=_NEAREST_M,
        )
        by = f"{-1e3 * found.distance_m:z.3g} mm at {sweep.t_s[found.at]:z.1f} s"
        yield found.distance_m, f"the robot leaves the workspace by {by}"


def _soft_travel(trajectory: Trajectory, sweep: Sweep) -> Iterator[tuple[float, str]]:
    """Margins of ``limits.soft_travel_m`` from the end of a drive to the next one's beginning.

    Before the first drive counts, too, and after the last one.
    """
    most, samples = trajectory.problem.robot.limits.soft_travel_m, trajectory.samples
    yield most, ""
    moving = np.flatnonzero(samples.moves[:-1])
    soft = samples.mode[moving].max(axis=1, initial=0) > 0
    for bends, run in itertools.groupby(range(len(moving)), key=soft.__getitem__):
        rows = moving[list(run)]
        if not bends:
            continue
        begin, end = samples.t_s[rows[0]], samples.t_s[rows[-1] + 1]
        first, last = np.searchsorted(sweep.t_s, [begin, end])
        moved = float(np.linalg.norm(sweep.q[last, :2] - sweep.q[first, :2]))
        when = f"from {begin:z.1f} s to {end:z.1f} s (soft_travel_m = {most:zg} m)"
        left = 0.0 if abs(most - moved) <= ROUNDING else most - moved
        yield left, f"soft, the middle link moves {moved:z.3g} m {when}"


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
        return self.sweep.q[self.sweep.over(self.at_s, self.at_s)[0]]

    def number(self, name: str) -> int:
        """Number of an object, from 0."""
        return [item.name for item in self.trajectory.problem.objects].index(name)

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
    caged = False
    for i, (task, (since_s, at_s)) in enumerate(zip(problem.tasks, spans, strict=True)):
        done = Done(trajectory, sweep, at_s, since_s, poses[i])
        named = f"task {i + 1} ({f'{task.do} {task.name}'.strip()}) at {at_s:z.1f} s"
        if task.rests and not _at_rest(trajectory, at_s):
            yield f"{named}: the robot moves"
        stage = task.stage(problem.modes)
        yield from (f"{named}: {text}" for text in _not_done(stage, done))
        if caged and stage.releases is not None and not _was_soft(done):
            yield f"{named}: the robot cannot leave: nothing was soft since it caged the object"
        if stage.grasps is not None:
            caged = stage.grasps.hold == "caged"
    for held in carried(trajectory):
        yield from _let_go(trajectory, held)


def _at_rest(trajectory: Trajectory, at_s: float) -> bool:
    moving = (p for p in trajectory.phases if p.start_s + SAME_TIME_S < at_s)
    return not any(at_s < phase.end_s - SAME_TIME_S for phase in moving)


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
    number = done.number(problem.start.holding)
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
    """True if it is proved that an object cannot leave, as deep as plans may overlap it."""
    from twosra_mpc.checking.holds import cage_proved

    problem = done.trajectory.problem
    where = problem.objects[number], done.objects[number], done.q
    return cage_proved(problem.robot.geometry, *where, max(-apart, OVERLAP_M))


def _pushed(number: int, done: Done) -> Iterator[str]:
    """Friction holds an object through every drive from its grasp to its release."""
    from twosra_mpc.checking.holds import pushes

    problem, samples = done.trajectory.problem, done.trajectory.samples
    held = next(c for c in carried(done.trajectory) if c.object == number and c.from_s == done.at_s)
    rows = (samples.t_s[:-1] >= held.from_s - SAME_TIME_S) & (samples.t_s[:-1] < held.to_s)
    mean = samples.v[:-1] + samples.a[:-1] * np.diff(samples.t_s)[:, None] / 2
    twists = np.concatenate([samples.v[:-1], mean])[:, 2:]  # friction holds what is between such
    thing = problem.objects[number]
    held_by = pushes(problem.robot.geometry, thing, held.pose_in_b0, done.q, twists)
    kept = held_by.reshape(2, -1).all(axis=0)
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
    asked: tuple[tuple[Any, Callable[[Any, Done], Iterator[str]]], ...] = (
        *((stage.through, _passed), (stage.goal, _reached), (stage.along, _conformed)),
        *((stage.grasps, _grasped), (stage.carries, _carried), (stage.follows, _followed)),
        (stage.releases, _released),
    )
    for what, shortcomings in asked:
        if what is not None:
            yield from shortcomings(what, at)


def _passed(task: Pass, at: Done) -> Iterator[str]:
    """B0 enters the box."""
    first, last = at.sweep.over(at.since_s, at.at_s)
    if not task.met(at.sweep.q[first : last + 1, :POSE]).any():
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
        state = f"{1e3 * abs(apart):z.3g} mm {'away from' if apart > 0 else 'within'}"
        yield f"the robot is {state} {task.object}, it does not touch it"
        return
    number = at.number(task.object)
    if task.hold == "pushed":
        yield from _pushed(number, at)
    elif not _caged(number, at, apart):
        yield f"it is not proved that {task.object} cannot leave"


def _carried(task: Carry, at: Done) -> Iterator[str]:
    """The object is where it is to be."""
    x, y, phi = at.objects[at.number(task.object)].tolist()
    away = math.hypot(x - task.x_m, y - task.y_m)
    if away > task.position_tolerance_m + GOAL_TOLERANCE:
        yield f"{task.object} is {1e3 * away:z.3g} mm from where it should be"
    if task.phi_rad is None:
        return
    turned = abs(math.remainder(phi - task.phi_rad, math.tau))
    if turned > task.heading_tolerance_rad + GOAL_TOLERANCE:
        yield f"{task.object} is turned by {turned:z.3g} rad from where it should be"


def _followed(task: Follow, at: Done) -> Iterator[str]:
    """What follows the path stays in the tube around it, to its end."""
    first, last = at.sweep.over(at.since_s, at.at_s)
    t_s, q = at.sweep.t_s[first : last + 1], at.sweep.q[first : last + 1]
    objects = object_poses(at.trajectory, t_s, q)
    poses = follower(at.trajectory.problem, task, q, objects)
    yield from tube_problems(task, followed(task, t_s, poses))


def _released(task: Release, at: Done) -> Iterator[str]:
    """The robot is clear of the object, and free to leave."""
    from twosra_mpc.checking.holds import cage_proved

    problem, apart = at.trajectory.problem, at.apart_m(task.object)
    kept_m = problem.clearance_m if task.clearance_m is None else task.clearance_m
    if apart < kept_m - UNSEEN_M:
        asked = f"clearance_m = {1e3 * kept_m:zg} mm"
        yield f"the robot is {1e3 * apart:z.3g} mm from {task.object} ({asked})"
        return
    number = at.number(task.object)
    geometry, thing = problem.robot.geometry, problem.objects[number]
    if cage_proved(geometry, thing, at.objects[number], at.q, 0.0, finest_m=_COARSE_M):
        yield f"the robot cannot leave: {task.object} is within it"


def _was_soft(at: Done) -> bool:
    """True if a segment is soft at some time between the ends of two tasks."""
    return any(
        now == 1 and since < at.at_s and until > at.since_s
        for j in range(len(at.trajectory.problem.start_mode))
        for since, until, now in course(at.trajectory, j)
    )


def _let_go(trajectory: Trajectory, held: Carried) -> Iterator[str]:
    """Say when a segment is not rigid although the robot holds something."""
    name = trajectory.problem.objects[held.object].name
    begin, end = held.from_s + TIME_TOLERANCE_S, held.to_s - TIME_TOLERANCE_S
    for j in range(len(trajectory.problem.start_mode)):
        for since, until, now in course(trajectory, j):
            if now != 0 and since < end and until > begin:
                when = max(since, held.from_s)
                yield f"segment {j + 1} is not rigid at {when:z.1f} s, while {name} is held"
                break
