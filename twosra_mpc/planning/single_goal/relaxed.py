"""What the search must know of a problem, worked out from the model: its tree, its relaxation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

import numpy as np

from twosra_mpc.model.bending import bending, from_rest_to_rest
from twosra_mpc.model.flow import Motion
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.nlp.guess import guess_motion
from twosra_mpc.planning.search.bends import BendingTask, Conserved, Intervals
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.drive_bound import least_drive_time
from twosra_mpc.planning.search.mode_tree import InTheWay, ModeTree
from twosra_mpc.planning.search.pose_phases import PoseTask
from twosra_mpc.planning.search.rigid_motion import least_time
from twosra_mpc.problem.limits import (
    CURVATURE,
    interval_durations,
    most_gaps_m,
    overlap_in_words,
    rigid_ramp_s,
    rigid_rows,
    rigid_rows_between,
)
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import BEYOND_PER_M, GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, ModeSequence
from twosra_mpc.timing import TemporalNetwork, transition_model

Solution = TypeVar("Solution")

_CLOSE_M, _LOOKS = 0.01, 2  # gaps in which to look closer, and how often


def mode_tree(
    problem: Problem,
    solver: Callable[[TemporalNetwork, SequenceBound], Iterable[tuple[float, Solution] | None]],
    excluded: frozenset[ModeSequence] = frozenset(),
    in_the_way: InTheWay | None = None,
) -> ModeTree[Solution]:
    """Build the tree of mode sequences of ``problem``; ``solver`` makes plans of one of them."""
    return ModeTree(
        first=problem.start_mode,
        last=problem.goal.mode,
        modes=problem.modes,
        max_phases=problem.max_phases,
        timing=transition_model(problem),
        task=bending_task(problem),
        weights=problem.cost_weights,
        rigid_time=partial(rigid_time, problem),
        solver=solver,
        excluded=excluded,
        in_the_way=in_the_way or InTheWay(),
    )


def bending_task(problem: Problem) -> BendingTask:
    """What the plan must do to the bending coordinates, from start, goal and path model."""
    facts, limit = bending(problem.robot), problem.robot.limits.curvature_per_m
    here = problem.start.configuration
    start, low, high = np.array([here, *problem.goal.box(here)])[:, POSE:]
    least, most = np.clip([low, high], -limit, limit)
    outside = least - GOAL_TOLERANCE, most + GOAL_TOLERANCE
    origin, least_w, most_w, under, over = facts.coordinates([start, least, most, *outside])
    top = np.array([facts.coordinate(limit + BEYOND_PER_M, j) for j in range(len(start))])
    met = zip((low - GOAL_TOLERANCE).tolist(), (high + GOAL_TOLERANCE).tolist(), strict=True)
    asked = enumerate(zip(*(each.tolist() for each in (start, low, high)), strict=True), start=1)

    def forbidden(mode: Mode, before: tuple[tuple[float, float], ...], bend: float) -> str | None:
        begin, end = 0.0, bend
        for _ in range(_LOOKS):
            shapes = facts.shapes_on_the_way(mode, before, end, begin)
            gaps_m = most_gaps_m(problem.robot, *shapes)
            least, last = int(gaps_m.argmin()), len(gaps_m) - 1
            if gaps_m[least] < 0:
                return overlap_in_words(problem.robot, shapes[0][least])
            if gaps_m[least] > _CLOSE_M:
                break
            step = (end - begin) / last
            begin, end = begin + max(least - 1, 0) * step, begin + min(least + 1, last) * step
        return None

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
        beyond=f"beyond {CURVATURE.name} = {limit:g} {CURVATURE.unit}",
        shape=", ".join(_asked(f"kappa{j}", *numbers) for j, numbers in asked),
        conserved=Conserved(*path_model(problem.robot).conserved),
        curvature=facts.curvatures,
        pose=pose_task(problem),
    )


def _intervals(low: Array, high: Array) -> Intervals:
    """(low, high) of each segment, from (n,) each."""
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


def _asked(name: str, start: float, low: float, high: float) -> str:
    """What a goal asks of a curvature, in words."""
    if not math.isfinite(high - low):
        return f"{name} free"
    box = f" (+- {(high - low) / 2:g})" if high > low else ""
    return f"{name} from {start:g} to {(low + high) / 2:g}{box} 1/m"


def pose_task(problem: Problem) -> PoseTask | None:
    """What the plan must do to the pose; None where the goal leaves all of it free."""
    start = problem.start.configuration
    low, high = (end[:POSE] - start[:POSE] for end in problem.goal.box_met(start))
    given = np.isfinite(high - low)
    if not given.any():
        return None
    low, high = np.where(given, [low, high], 0.0)
    guess = guess_motion(problem.robot, start, problem.goal, (problem.robot.rigid,), np.zeros(1), 1)
    reach = np.where(given, (high - low) / 2, math.inf)
    return PoseTask(
        heading=float(start[2]),
        shift=(low + high)[:2] / 2,
        reach=reach[:2],
        turn=float(low[2] + high[2]) / 2,
        turn_reach=min(float(reach[2]), math.pi),
        known_s=_known_s(guess),
        speed_rows=partial(rigid_rows_between, problem.robot),
        soft_motions=bending(problem.robot).motions_between,
    )


def rigid_time(problem: Problem, enough: float = 0.0) -> float:
    """Proved lower bound on the duration of a plan that drives rigidly from start to goal [s].

    Where the quick bound is less than ``enough`` [s], takes up to a third of a second more.
    """
    start = problem.start.configuration
    low, high = (end[:POSE] - start[:POSE] for end in problem.goal.box_met(start))
    guess = guess_motion(problem.robot, start, problem.goal, (problem.robot.rigid,), np.zeros(1), 1)
    rows = rigid_rows(problem.robot, start[POSE:])
    c, s = math.cos(start[2]), math.sin(start[2])
    given = np.isfinite(high - low)
    ends = np.where(given, [low, high], math.nan)
    shift, box = ends[:, :2].mean(axis=0), np.where(given, (ends[1] - ends[0]) / 2, 0.0)
    if given[:2].all() and box[:2].max() <= 2 * GOAL_TOLERANCE:  # nearly round
        box = math.sqrt(2) * box
        shift = np.array([c * shift[0] + s * shift[1], -s * shift[0] + c * shift[1]])
    else:  # boxes and free coordinates are aligned with the world: turn the wheels instead
        rows = rows @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    asked = rows, shift, box[:2], (float(low[2]), float(high[2])), problem.goal.phi_modulo
    known_s, ramp_s = _known_s(guess), rigid_ramp_s(problem.robot, start[POSE:])
    at_speed = least_time(*asked, known_s)
    if from_rest_to_rest(at_speed, ramp_s) < enough:
        until_s = enough - ramp_s if enough >= 2 * ramp_s else enough**2 / (4 * ramp_s)
        at_speed = max(at_speed, least_drive_time(*asked, min(until_s * (1 + 1e-6), known_s)))
    shortest = 0.0 if problem.goal.met_at(start) else problem.robot.limits.phase_s
    return max(from_rest_to_rest(at_speed, ramp_s), shortest)


def _known_s(guess: Motion) -> float:
    """How long a rigid drive takes at full speed, as guessed: by a screw, or straight and a turn.

    The screw of nearly a full turn leads far away.
    """
    screw_s = float(interval_durations(guess).sum())
    first, last = guess.states[0, 0], guess.states[-1, -1]
    turn = float(last[2] - first[2])
    if abs(turn) <= math.pi:
        return screw_s
    rows, far = rigid_rows(guess.robot, first[POSE:]), float(np.hypot(*(last - first)[:2]))
    straight_s = far * float(np.linalg.norm(rows[:, :2], axis=1).max())
    return min(screw_s, straight_s + abs(turn) * float(np.abs(rows[:, 2]).max()))
