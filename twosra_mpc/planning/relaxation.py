"""The relaxation of stages that the search works with, worked out from the model."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Container, Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial
from typing import TypeVar

import numpy as np

from twosra_mpc.effort import Cost, charge, remembered
from twosra_mpc.model.bending import bending, from_rest_to_rest, unit_ramp_s
from twosra_mpc.model.flow import Motion
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.bounds.bends import BendingTask, Conserved, Intervals
from twosra_mpc.planning.bounds.drive_bound import least_drive_time
from twosra_mpc.planning.bounds.pose_phases import PoseTask
from twosra_mpc.planning.bounds.rigid_motion import PoseChange, least_time, rows_of_any
from twosra_mpc.planning.bounds.stage_bounds import StageBounds, StageRelaxation
from twosra_mpc.planning.search.nodes import InTheWay
from twosra_mpc.planning.search.tree import Solver, Tree, tree_of
from twosra_mpc.planning.solver.guess import clipped_w, guess_motion
from twosra_mpc.planning.solver.shape_plane import cells_of
from twosra_mpc.planning.stages.variants import Placement, Variant
from twosra_mpc.problem.ends import look_for_shape
from twosra_mpc.problem.goals import Goal, Tolerance
from twosra_mpc.problem.limits import (
    CURVATURE,
    WHEEL_SPEED,
    most_gaps_m,
    overlap_in_words,
    singular_bend,
)
from twosra_mpc.problem.problem import Alone, Problem, Start
from twosra_mpc.problem.speeds import (
    drive_rows,
    interval_durations,
    rigid_rows,
    rigid_rows_between,
)
from twosra_mpc.problem.tasks import MOST_PHASES
from twosra_mpc.problem.tolerances import BEYOND_PER_M, GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid
from twosra_mpc.timing import TransitionModel, transition_model

_CLOSE_M, _LOOKS = 0.01, 2  # gaps in which to look closer, and how often
_NARROW_PER_M = 3.0  # half-width of a box of shapes whose bends are looked at more closely
_NEAR = 0.1  # m and rad: widths of boxes in which drives begin of which more is proved
_SAME_BEND = 1e-3  # share by which bends differ that end in the same shape
_WIDE_PER_M = 7.0  # boxes of shapes of which halves are bounded one by one
_MOST_TO_ANY = 3  # phases of a stage of several that may end in any stiffness

_TWO = 2  # segments

Box = tuple[Array, Array]
Solution = TypeVar("Solution")


def stage_tree(
    problem: Problem,
    variants: Sequence[Variant],
    solver: Solver[Solution],
    excluded: Container[ModeSequence] = (),
    in_the_way: Sequence[Sequence[InTheWay]] | None = None,
    timing: TransitionModel | None = None,
) -> Tree[Solution]:
    """Build the tree of the variants of a problem and of the mode sequences of their stages.

    Args:
        problem: The problem.
        variants: The ways to do it.
        solver: Makes plans of one sequence of each stage.
        excluded: Sequences that are not to be used.
        in_the_way: What is in the way of each stage of every variant; nothing if left out.
        timing: The transition model, if it is not the problem's.
    """
    return tree_of(
        [stage_bounds(each) for each in variants],
        problem.start_stiffness,
        timing or transition_model(problem),
        problem.cost_weights,
        relaxation(problem),
        solver,
        in_the_way=in_the_way,
        excluded=excluded,
    )


def relaxation(problem: Problem) -> StageRelaxation:
    """Rates, speeds and room of a problem's robot."""
    robot, facts = problem.robot, bending(problem.robot)
    around = problem.obstacles or problem.objects
    n, limits = robot.coordinates.segments, robot.limits

    @lru_cache(1)
    def room() -> Intervals:
        here = facts.coordinates(problem.start.kappa_per_m).tolist()
        most = [facts.coordinate(limits.curvature_per_m, j) for j in range(n)]
        return tuple((-w - at, w - at) for w, at in zip(most, here, strict=True))

    def speed_m_s(mode: Mode) -> float:
        driving = limits.speed_m_s or math.inf
        return driving if is_rigid(mode) else facts.largest_speed_m_s(mode)

    return StageRelaxation(
        room=room,
        rate=cache(lambda mode: facts.fastest(mode, (None,) * n)),
        speed_m_s=cache(speed_m_s),
        soft_travel_m=limits.soft_travel_m if around else math.inf,
    )


@remembered(64)  # of a few problems, each with a few variants
def stage_bounds(variant: Variant) -> tuple[StageBounds, ...]:
    """Bounds of each stage, for all members of a variant."""
    problem, members = variant.problem, variant.members
    start, several = problem.start.configuration, len(members[0]) > 1
    before, whole = (start, start), (problem.robot, problem.start)
    here = replace(members[0][0], ends=start[None, :POSE], within_m=0.0)
    known, begins, since = before, [here] * len(members), 1
    found, speed_m_s = list[StageBounds](), problem.robot.limits.speed_m_s or math.inf
    for same in zip(*members, strict=True):
        first, asked = same[0], same[0].stage
        longest = _MOST_TO_ANY if asked.last is None else MOST_PHASES
        boxes = [each.box(before[0]) for each in same]
        after = np.min([low for low, _ in boxes], axis=0), np.max([top for _, top in boxes], axis=0)
        far_m = min(_apart_m(known, after, *pair) for pair in zip(begins, same, strict=True))
        known_start = first.reaches and not found
        alone = Alone(*whole, first.goal, problem.workspace) if known_start else None
        bend = bending_task(alone) if alone else _bend(problem, before, after)
        found.append(
            StageBounds(
                change=bend.met if alone and bend else _changes(problem, after),
                bend=bend,
                modes=asked.modes,
                last=asked.last,
                most_phases=longest if several else problem.max_phases,
                final=len(found) + 1 == len(members[0]),
                drives_first=first.drives_first,
                drives_last=first.drives_last,
                distance_m=0.0 if alone else far_m,
                since=since,
                drive=_drive(problem, before, same, far_m / speed_m_s if since == 1 else 0.0),
                least_s=min(each.stage.least_s for each in same),
                reshapes=first.reshapes,
            )
        )
        before, since = after, since + 1
        if np.isfinite([end[:2] for end in after]).all():
            known, begins, since = after, list(same), 1
    return tuple(found)


def _drive(
    problem: Problem, before: Box, same: Sequence[Placement], far_s: float
) -> Callable[[float], float]:
    """What is proved of drives from poses and shapes; more than ``far_s`` where they are near."""
    most, begins = problem.robot.limits.curvature_per_m + BEYOND_PER_M, np.array(before)
    if not (same[0].reaches and np.ptp(begins[:, :POSE], axis=0).max() <= _NEAR):
        return lambda enough: far_s
    begins[:, POSE:] = begins[:, POSE:].clip(-most, most)
    x, y, phi, *kappa = begins.mean(axis=0).tolist()
    start = Start(x_m=x, y_m=y, phi_rad=phi, kappa_per_m=tuple(kappa))
    alone = Alone(problem.robot, start, same[0].goal, problem.workspace)
    return remembered(8)(partial(rigid_time, alone, begins=begins))


def _changes(problem: Problem, after: Box) -> Intervals:
    """Changes of W since t = 0 that lead into a box."""
    here, low, high = clipped_w(problem, problem.start.configuration, *after)
    return _intervals(low - here, high - here)


def _bend(problem: Problem, before: Box, after: Box) -> BendingTask | None:
    """Bend of a stage, where the shapes at both of its ends are nearly known."""
    widths = np.array([high[POSE:] - low[POSE:] for low, high in (before, after)])
    if not widths.max() <= 2 * _NARROW_PER_M:
        return None
    middle, shape = ((low[POSE:] + high[POSE:]) / 2 for low, high in (before, after))
    tolerance = Tolerance(kappa_per_m=tuple((widths[1] / 2).tolist()))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=tuple(middle.tolist()))
    goal = Goal(kappa_per_m=tuple(shape.tolist()), tolerance=tolerance)
    task = bending_task(Alone(problem.robot, start, goal, None))
    within = np.abs(clipped_w(problem, *before) - task.origin).max(axis=0)
    return replace(
        task,
        change=_wider(task.change, within),
        room=_wider(task.room, within),
        origin_within=tuple(within.tolist()),
    )


def _wider(intervals: Intervals, within: Array) -> Intervals:
    pairs = zip(intervals, within.tolist(), strict=True)
    return tuple((low - by, high + by) for (low, high), by in pairs)


def _apart_m(before: Box, after: Box, begin: Placement, end: Placement) -> float:
    """Least distance of b0's positions where two stages end."""
    if begin.ends is not None and end.ends is not None:
        apart = np.linalg.norm(begin.ends[:, None, :2] - end.ends[None, :, :2], axis=-1)
        return max(0.0, float(apart.min()) - begin.within_m - end.within_m)
    gaps = np.maximum(after[0][:2] - before[1][:2], before[0][:2] - after[1][:2])
    return float(np.linalg.norm(np.maximum(gaps, 0.0)))


def bending_task(problem: Problem | Alone) -> BendingTask:
    """Task in the bending coordinates, from start, goal and path model."""
    facts, limit = bending(problem.robot), problem.robot.limits.curvature_per_m
    here = problem.start.configuration
    start, low, high = np.array([here, *problem.goal.box(here)])[:, POSE:]
    least, most = np.clip([low, high], -limit, limit)
    outside = least - GOAL_TOLERANCE, most + GOAL_TOLERANCE
    origin, least_w, most_w, under, over = facts.coordinates([start, least, most, *outside])
    top = np.array([facts.coordinate(limit + BEYOND_PER_M, j) for j in range(len(start))])
    met = zip((low - GOAL_TOLERANCE).tolist(), (high + GOAL_TOLERANCE).tolist(), strict=True)
    asked = enumerate(zip(*(each.tolist() for each in (start, low, high)), strict=True), start=1)

    def forbidden(mode: Mode, before: Intervals, bend: float, most: float) -> str | None:
        begin, end, last = 0.0, bend, None
        if sum(mode) == 1 and abs(most - bend) <= _SAME_BEND * abs(bend):
            last = facts.shapes_on_the_way(mode, before, most, most)[0][-1]
        for look in range(_LOOKS):
            charge(Cost.BEND)
            shapes = facts.shapes_on_the_way(mode, before, end, begin)
            if not look and (words := singular_bend(problem.robot, mode, *shapes, last)):
                return words
            gaps_m = most_gaps_m(problem.robot, *shapes)
            least, last = int(gaps_m.argmin()), len(gaps_m) - 1
            if gaps_m[least] < 0:
                return overlap_in_words(problem.robot, shapes[0][least])
            if gaps_m[least] > _CLOSE_M:
                break
            step = (end - begin) / last
            begin, end = begin + max(least - 1, 0) * step, begin + min(least + 1, last) * step
        return None

    @lru_cache(64)  # many sequences lead through the same shapes
    def shapeless(within: Intervals) -> bool:
        ends = [facts.curvature(np.array(w), j) for j, w in enumerate(within)]
        least, most = np.stack(ends, axis=-1)
        return look_for_shape(problem.robot, least - BEYOND_PER_M, most + BEYOND_PER_M).forbidden

    return BendingTask(
        change=_intervals(least_w - origin, most_w - origin),
        within=tuple(np.maximum(least_w - under, over - most_w).tolist()),
        room=_intervals(-top - origin, top - origin),
        start=tuple(start.tolist()),
        goal=tuple(each if math.isfinite(each[1] - each[0]) else None for each in met),
        rate=facts.fastest,
        origin=tuple(origin.tolist()),
        least_time=facts.least_time,
        least_time_of_more=facts.least_time_of_more,
        least_effort=facts.least_effort_s2,
        forbidden=forbidden,
        shapeless=shapeless,
        beyond=f"beyond {CURVATURE.name} = {limit:zg} 1/m",
        shape=", ".join(_asked(f"kappa{j}", *numbers) for j, numbers in asked),
        conserved=Conserved(*path_model(problem.robot).conserved),
        curvature=facts.curvatures,
        pose=pose_task(problem),
        plane=partial(cells_of, problem.robot.body) if len(start) == _TWO else None,
    )


def _intervals(low: Array, high: Array) -> Intervals:
    """(low, high) of each segment, from (n,) each."""
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


def _asked(name: str, start: float, low: float, high: float) -> str:
    """Words for what a goal asks of a curvature."""
    if not math.isfinite(high - low):
        return f"{name} free"
    box = f" (+- {(high - low) / 2:zg})" if high > low else ""
    return f"{name} from {start:zg} to {(low + high) / 2:zg}{box} 1/m"


def pose_task(problem: Problem | Alone) -> PoseTask | None:
    """Task of the pose; None where the goal leaves all of it free."""
    robot, start = problem.robot, problem.start.configuration
    low, high = (end[:POSE] - start[:POSE] for end in problem.goal.box_met(start))
    given, lengths_m = np.isfinite(high - low), np.array(robot.geometry.lengths_m)
    if not given.any():
        return None
    low, high = np.where(given, [low, high], 0.0)
    guess = guess_motion(robot, start, problem.goal, (robot.rigid,), np.zeros(1), 1)
    reach = np.where(given, (high - low) / 2, math.inf)
    return PoseTask(
        heading=float(start[2]),
        shift=(low + high)[:2] / 2,
        reach=reach[:2],
        turn=float(low[2] + high[2]) / 2,
        turn_reach=min(float(reach[2]), math.pi),
        known_s=_known_s(guess),
        speed_rows=partial(rigid_rows_between, robot),
        ramp_s=unit_ramp_s(robot),
        wheel_ramp_s=WHEEL_SPEED.most(robot) / (robot.limits.wheel_acceleration_rad_s2 or math.inf),
        soft_motions=bending(robot).motions_between,
        changes=bending(robot).changes_around,
        bend_rates_per_m_s=(robot.limits.bend_rate_rad_s or math.inf) / lengths_m,
        overlaps=lambda middles, half: most_gaps_m(robot, middles, half) < 0,
    )


def rigid_time(problem: Problem | Alone, enough: float = 0.0, begins: Array | None = None) -> float:
    """Proved lower bound on the duration of a plan that drives rigidly from start to goal [s].

    Where the quick bound is less than ``enough`` [s], takes up to a third of a second more for each
    of a few boxes of shapes. With ``begins`` it may begin anywhere in a box around the start.
    """
    robot, start = problem.robot, problem.start.configuration
    ends, (first, last) = problem.goal.box_met(start), (start, start) if begins is None else begins
    shapes = np.sort([np.maximum(ends[0], first)[POSE:], np.minimum(ends[1], last)[POSE:]], axis=0)
    low, high = (end[:POSE] - start[:POSE] for end in ends)
    off = (last - first)[:POSE] / 2
    if off[2]:  # turned so that it begins as in the middle, it ends elsewhere
        off[:2] += off[2] * (np.hypot(*np.maximum(-low, high)[:2]) + np.hypot(*off[:2]))
    low, high = low - off, high + off
    given, (c, s) = np.isfinite(high - low), (math.cos(start[2]), math.sin(start[2]))
    apart_m = np.where(given, [low, high], math.nan)[:, :2]
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # boxes are the world's
    around = apart_m.mean(axis=0), np.nan_to_num(np.ptp(apart_m, axis=0)) / 2
    asked = PoseChange(*around, (float(low[2]), float(high[2])), problem.goal.phi_modulo)
    guess = guess_motion(robot, start, problem.goal, (robot.rigid,), np.zeros(1), 1)
    most = robot.limits.wheel_acceleration_rad_s2
    known_s = _known_s(guess, drive_rows(robot, start[POSE:])[1] / (most or math.inf))

    def least_s(shapes: Array, more: bool) -> float:
        rows, off = rigid_rows_between(robot, *shapes)
        speeds = rows_of_any(rows, off) @ axes
        if more and most is None:
            return least_drive_time(speeds, asked, min(enough * (1 + 1e-6), known_s))
        per_s = WHEEL_SPEED.most(robot) / (most or math.inf)  # rows of wheels come first
        gained = rows_of_any(rows[:WHEELS] * per_s, off[:WHEELS] * per_s) @ axes
        return least_time(speeds, asked, known_s, gained, priced=more)

    if (found := least_s(shapes, False)) < enough:
        sides = map(np.linspace, *shapes, np.where(np.ptp(shapes, axis=0) > _WIDE_PER_M, 3, 2))
        boxes = itertools.product(*map(itertools.pairwise, sides))
        found = max(found, min(least_s(np.transpose(box), True) for box in boxes))
    shortest = 0.0 if off.any() or problem.goal.met_at(start) else robot.limits.phase_s
    return max(found, shortest)


def _known_s(guess: Motion, gained: Array | None = None) -> float:
    """Duration of a rigid drive, as guessed: by a screw, or straight and a turn.

    At full speed; or from rest to rest, where wheels ``gained`` (4, 3) of a displacement, over
    their largest acceleration. The screw of nearly a full turn leads far away.
    """
    first, last = guess.states[0, 0], guess.states[-1, -1]
    wheels, s = np.zeros((1, 3)) if gained is None else gained, guess.inputs[0, :, 2:].sum(axis=0)
    screw_s = _lasting_s(float(interval_durations(guess).sum()), np.abs(wheels @ s))
    turn = abs(float(last[2] - first[2]))
    if turn <= math.pi:
        return screw_s
    rows, far = rigid_rows(guess.robot, first[POSE:]), float(np.hypot(*(last - first)[:2]))
    straight, turned = (np.linalg.norm(of[:, :2], axis=1) * far for of in (rows, wheels))
    straight_s = _lasting_s(float(straight.max()), turned)
    turn_s = _lasting_s(turn * float(np.abs(rows[:, 2]).max()), turn * np.abs(wheels[:, 2]))
    return min(screw_s, straight_s + turn_s)


def _lasting_s(at_speed_s: float, gained_s2: Array) -> float:
    return from_rest_to_rest(at_speed_s, float(gained_s2.max()) / max(at_speed_s, 1e-300))
