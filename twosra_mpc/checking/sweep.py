"""Sweep of a plan: the robot at fine times, how far its points travel in between, and its stages.

A stage says what the robot must keep clear of, may touch and holds, from task to task of a mission.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.checking.heat import course
from twosra_mpc.checking.reintegration import between, reintegrate
from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import Carried, carried, object_poses
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import TIME_TOLERANCE_S
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry

CHORDS = 24  # drawn for a segment; they stray from it by 0.03 mm at most
_ACCURACY_M = 1.6e-4  # to which the least distance of what is drawn is proved
_RIGID_CUT, _SOFT_CUT = 1e-4, 2e-5  # m or rad that inputs move between fine times
_BEGUN = 32  # intervals with which the search begins


class Sweep(NamedTuple):
    """The robot at fine times.

    Attributes:
        t_s: Times [s], (m,).
        q: Configurations, integrated from the inputs alone, (m, 3 + n).
        travelled_m: Bound on how far any point of the robot has travelled since t = 0, (m,).
    """

    t_s: Array
    q: Array
    travelled_m: Array

    def carried_m(self, radius_m: float) -> Array:
        """Bound on how far points that move with b0, no further from it than a radius, go, (m,)."""
        d = np.diff(self.q[:, :POSE], axis=0)
        arcs = np.hypot(d[:, 0], d[:, 1]) / np.sinc(
            d[:, 2] / math.tau
        )  # chords of a constant twist
        return np.append(0.0, np.cumsum(arcs + radius_m * np.abs(d[:, 2])))

    def over(self, from_s: float, to_s: float) -> tuple[int, int]:
        """First and last of the fine times that hold a span of time between them."""
        first = int(np.searchsorted(self.t_s, from_s + SAME_TIME_S, side="right")) - 1
        last = int(np.searchsorted(self.t_s, to_s - SAME_TIME_S))
        return max(first, 0), max(first, min(last, len(self.t_s) - 1))


@dataclass(frozen=True, eq=False)
class Clearance:
    """Closest approach of the robot, or of what it carries, to an obstacle.

    Attributes:
        least_m: Least distance found [m]; negative: how deep the two overlap, by the deepest point
            of either in the other.
        proved_m: Less than this it is at no time, samples or not [m]; 0 if they overlap.
        at_s: When [s].
        configuration: Where the robot is then, (3 + n,).
        obstacle: Number of the obstacle, from 0; those of objects follow.
        name: Its name.
        points_m: The nearest points, of the robot and of the obstacle, (2, 2) [m].
        of: Name of the object that it carries and that is nearest; empty: the robot itself.
    """

    least_m: float
    proved_m: float
    at_s: float
    configuration: Array
    obstacle: int
    name: str
    points_m: Array
    of: str = ""


class Least(NamedTuple):
    """A least distance: at which fine time, how much, and what is proved for all times [m]."""

    at: int
    distance_m: float
    proved_m: float


def swept(problem: Problem, samples: Samples) -> Sweep | None:
    """Integrate what the samples send; None where a curvature runs away.

    While all is rigid a point at a radius up to rho from b0 is as fast as |(u, v)| + rho |r| at
    most, which is convex in time. While something is soft it travels what b0 does, rho |dphi| and
    R_j |dkappa_j| for the segments j between b0 and the point. With one direction of the input
    every curvature changes one way only, as all soft segments follow one bending coordinate W whose
    rate depends on the shape alone; for the other coordinates the second difference is added, four
    times what a smooth path can be longer than its chord.
    """
    soft = samples.mode[:-1].max(axis=1) > 0
    fine, at = between(samples, np.where(soft, _SOFT_CUT, _RIGID_CUT), least=3)
    q = reintegrate(problem, fine)
    if not np.isfinite(q).all():
        return None
    geometry, rows = problem.robot.geometry, at[:-1]
    first = np.searchsorted(at, np.arange(len(samples)))  # of the fine times of each sample
    reach = bending_reach_m2(geometry)
    off = np.abs(q[:-1, POSE:] - q[first[rows], POSE:]) @ reach
    rho = outermost_m(geometry, q[first])[rows] + off
    d = np.diff(q, axis=0)
    d[:, :POSE] = np.abs(d[:, :POSE]) + _beyond_chord(d[:, :POSE], rows)
    left = geometry.inner_link_of_b0
    bent = np.abs(d[:, POSE:]) * reach
    one_side = np.maximum(bent[:, :left].sum(axis=1), bent[:, left:].sum(axis=1))
    dt = np.diff(fine.t_s)
    ends = fine.v[:-1], fine.v[:-1] + fine.a[:-1] * dt[:, None]
    fast = sum(np.hypot(v[:, 2], v[:, 3]) + rho * np.abs(v[:, 4]) for v in ends)
    driven = fast * dt / 2
    travel = np.where(soft[rows], np.hypot(d[:, 0], d[:, 1]) + rho * d[:, 2] + one_side, driven)
    return Sweep(fine.t_s, q, np.append(0.0, np.cumsum(travel)))


def _beyond_chord(d: Array, rows: NDArray[np.intp]) -> Array:
    """Largest second difference of each coordinate beside each difference d (m, k), (m, k)."""
    second, beside = np.diff(d, axis=0), np.zeros_like(d)
    np.abs(second, out=second)[rows[1:] != rows[:-1]] = 0.0
    beside[1:] = second
    np.maximum(beside[:-1], second, out=beside[:-1])
    return beside


@lru_cache(maxsize=32)
def bending_reach_m2(geometry: Geometry) -> Array:
    """R_j: how far any point moves, as seen from b0, when segment j bends by 1/m, (n,) [m2].

    A point at arc length s of a segment moves by at most s^2 / 2 per 1/m, as its tangents turn by
    their arc length; what is beyond, at a distance up to e from the segment's end, turns by l_j.
    However the fibre bends, e is no more than along the fibre to its end and from there straight.
    """
    straight = robot_shape(geometry, np.zeros(POSE + geometry.segments), 2)
    reach = []
    for j, length in enumerate(geometry.lengths_m):
        unit, outward = (0, 0) if j < geometry.inner_link_of_b0 else (1, -1)
        tip = straight.ends[unit, :2]
        body = [straight.units[unit], *straight.wheels[2 * unit : 2 * unit + 2]]
        hung = np.linalg.norm(np.concatenate(body) - tip, axis=1).max()
        along = np.linalg.norm(straight.segments[j, outward] - tip)
        reach.append(length * (length / 2 + max(along + hung, geometry.fibre_radius_m)))
    return np.array(reach)


def uncertain_m(problem: Problem) -> float:
    """Error of a point's place, curvatures known to ``curvature_uncertainty_per_m`` [m]."""
    geometry = problem.robot.geometry
    reach, left = bending_reach_m2(geometry), geometry.inner_link_of_b0
    worst = max(reach[:left].sum(), reach[left:].sum())
    return float(worst * problem.curvature_uncertainty_per_m)


def sagitta_m(geometry: Geometry, q: Array) -> float:
    """Largest sagitta of a segment's chords over configurations (m, 3 + n) [m]."""
    chords = np.array(geometry.lengths_m) / CHORDS
    return float((np.abs(q[:, POSE:]) * chords**2 / 8).max(initial=0.0))


def outermost_m(geometry: Geometry, q: Array) -> Array:
    """Largest distance of a point of the robot from b0, (m,) [m]."""
    shape, thick = robot_shape(geometry, q, CHORDS + 1), geometry.fibre_radius_m
    fibre = [part.reshape(len(q), -1, 2) for part in (shape.segments, shape.links)]
    solid = [part.reshape(len(q), -1, 2) for part in (shape.units, shape.wheels)]
    most = [
        np.linalg.norm(np.concatenate(parts, axis=1) - q[:, None, :2], axis=2).max(axis=1)
        for parts in (fibre, solid)
    ]
    return np.maximum(most[0] + thick + sagitta_m(geometry, q), most[1])


def least(
    distances: Callable[[NDArray[np.intp]], Array],
    travelled_m: Array,
    first: int,
    last: int,
    enough_m: float = math.inf,
    accuracy_m: float = _ACCURACY_M,
) -> Least:
    """Least distance between fine times ``first`` and ``last``, proved to within an accuracy.

    Between times a and b no distance is less than (d_a + d_b - travel) / 2. Intervals that may
    undercut the least one found by more than the accuracy are cut in half, all of a level at once.

    Args:
        distances: Fine times (k,) -> distances there (k,) [m].
        travelled_m: Of the sweep, (m,).
        first: First fine time.
        last: Last one.
        enough_m: More than this need not be proved.
        accuracy_m: To which it is proved as far as fine times are apart.
    """
    even = np.linspace(travelled_m[first], travelled_m[last], _BEGUN + 1)
    marks = np.clip(np.searchsorted(travelled_m, even), first, last)
    marks = np.array(sorted({first, last, *marks.tolist()}))
    charge(Cost.OUTLINE, len(marks))
    d = distances(marks)
    at, best, proved = int(marks[d.argmin()]), float(d.min()), float(d.min())
    a, b, d_a, d_b = marks[:-1], marks[1:], d[:-1], d[1:]
    while len(a):
        low = (d_a + d_b - (travelled_m[b] - travelled_m[a])) / 2
        cut = (low < min(best - accuracy_m, enough_m)) & (b - a > 1)
        proved = min(proved, float(low[~cut].min(initial=proved)))
        a, b, d_a, d_b = a[cut], b[cut], d_a[cut], d_b[cut]
        if not len(a):
            break
        middle = np.searchsorted(travelled_m, (travelled_m[a] + travelled_m[b]) / 2)
        middle = np.clip(middle, a + 1, b - 1)
        charge(Cost.OUTLINE, len(middle))
        d_m = distances(middle)
        if d_m.min() < best:
            at, best = int(middle[d_m.argmin()]), float(d_m.min())
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
        d_a, d_b = np.concatenate([d_a, d_m]), np.concatenate([d_m, d_b])
    return Least(at, best, proved)


class Stage(NamedTuple):
    """Time span of a task, from the end of the task before; after the last one, until the end.

    Attributes:
        first: First fine time of the sweep.
        last: Last one.
        world: Obstacles to keep clear of.
        resting: Objects to keep clear of, where they are.
        touched: What the robot may touch, where it is.
        held: What it carries, if anything.
        taken: Whether that begins here.
    """

    first: int
    last: int
    world: World
    resting: tuple[Obstacle, ...] = ()
    touched: tuple[Obstacle, ...] = ()
    held: Carried | None = None
    taken: bool = False


def stages(trajectory: Trajectory, sweep: Sweep) -> list[Stage]:
    """Every stage in order; a plan that only reaches a goal is one."""
    problem, world = trajectory.problem, trajectory.problem.world
    found, taken = list[Stage](), iter(carried(trajectory))
    held = held_before = None
    if problem.start.holding is not None:
        held = next(taken)
    ends = (0.0, *trajectory.done_s, trajectory.duration_s)
    for i, (from_s, to_s) in enumerate(itertools.pairwise(ends)):
        if found and to_s - from_s <= SAME_TIME_S and i == len(problem.tasks):
            break
        task = problem.tasks[i] if i < len(problem.tasks) else None
        if task is not None and task.lets_go:
            held = None
        names = touched_in(problem, i)
        poses = object_poses(trajectory, np.array([(from_s + to_s) / 2]))[0]
        things = [
            item.at(pose)
            for k, (item, pose) in enumerate(zip(problem.objects, poses, strict=True))
            if held is None or k != held.object
        ]
        touched = tuple(o for o in (*problem.obstacles, *things) if o.name and o.name in names)
        apart = tuple(item for item in problem.obstacles if item not in touched)
        resting = tuple(item for item in things if item not in touched)
        around = world if len(apart) == len(world.obstacles) else world.with_values(obstacles=apart)
        span, begins = sweep.over(from_s, to_s), held is not held_before
        found.append(Stage(*span, around, resting, touched, held, begins))
        held_before = held
        if task is not None and task.takes:
            held = next(taken)
    return found


def touched_in(problem: Problem, stage: int) -> set[str]:
    """Names of what may be touched until task ``stage`` is done, numbered from 0.

    It is what that task takes hold of, lets go or lies along, and what the one before lay along.
    """
    own, before = problem.tasks[stage : stage + 1], problem.tasks[stage - 1 : stage]
    names = {task.about for task in own if task.touches}
    names |= {task.about for task in before if task.lies_along}
    return {name for name in names if name}


def stiffness(trajectory: Trajectory, at_s: float) -> tuple[int | None, ...]:
    """Stiffness of each segment at a time; what changes within the tolerance has changed."""
    found = list[int | None]()
    for j in range(len(trajectory.problem.start_mode)):
        for since, _, now in course(trajectory, j):
            if since <= at_s + (-TIME_TOLERANCE_S if now is None else TIME_TOLERANCE_S):
                last = now
        found.append(last)
    return tuple(found)
