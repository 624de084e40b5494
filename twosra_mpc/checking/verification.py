"""Independent check of a plan: it is integrated anew, and every rule is tested on the outcome.

Nothing here uses the transcription, the roll-out or the schedule: only the samples and transitions
as they will be written to the file, the kinematics, and the robot description.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple

import numpy as np

from twosra_mpc.checking.heat import course, heating_problems
from twosra_mpc.checking.levers import lever_margin
from twosra_mpc.checking.reintegration import between, reintegrate, turns_aside
from twosra_mpc.checking.surroundings import NOTHING_AROUND, examine_around
from twosra_mpc.effort import Cost, charge
from twosra_mpc.plans.plan import Cost as PlanCost
from twosra_mpc.plans.plan import Verification
from twosra_mpc.plans.trajectory import Samples, Trajectory, flown
from twosra_mpc.problem.limits import BEND_LEVER, CURRENT, TEMPERATURE, WHEEL_SPEED, settled
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.speeds import Driven, driven, margins
from twosra_mpc.problem.tolerances import (
    DEFECT_TOLERANCE,
    GOAL_TOLERANCE,
    JUMP_TOLERANCE,
    TIME_TOLERANCE_S,
    WHEEL_TOLERANCE_RAD_S,
)
from twosra_mpc.robot.coordinates import Array, Coordinates
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.transitions import own_transitions


def transition_problems(trajectory: Trajectory) -> Iterator[str]:
    """Order and duration of the transitions of each segment, and the stiffness at the end."""
    problem, transitions = trajectory.problem, trajectory.transitions
    for earlier, after in itertools.pairwise(trajectory.phases):
        if after.start_s < earlier.end_s - TIME_TOLERANCE_S:
            yield f"the phase at {after.start_s:z.3f} s starts before the one before it has ended"
    for first, then in itertools.pairwise(transitions):
        if then.heater_s < first.heater_s - TIME_TOLERANCE_S:
            yield f"the transition at {then.heater_s:z.3f} s stands after a later one"
    timing, known = transition_model(problem), trajectory.samples.t_s[:, None]
    for j, stiffness in enumerate(problem.start_stiffness):
        before: Transition | None = None
        for item in own_transitions(transitions, j):
            name = f"segment {j + 1} to {item.to} at {item.heater_s:z.3f} s"
            if int(item.to == "soft") == stiffness:
                yield f"{name}: it is {item.to} already"
            if before is None and stiffness is None and item.heater_s > TIME_TOLERANCE_S:
                yield f"{name}: it changes at t = 0, and goes on or turns back from then on"
            if item.heater_s < (before.done_s if before else 0.0) - TIME_TOLERANCE_S:
                yield f"{name}: before the transition before it is done"
            if not item.heater_s - TIME_TOLERANCE_S <= item.onset_s <= item.done_s:
                yield f"{name}: heater, onset and done are out of order"
            if np.abs(known - np.array([item[2:]])).min(axis=0).max() > TIME_TOLERANCE_S:
                yield f"{name}: heater, onset or done is at no sample"
            for text in timing.violations(item, before, transitions):
                yield f"{name}: {text}"
            stiffness, before = int(item.to == "soft"), item
        if not problem.ends_anywhere and stiffness != problem.goal.mode[j]:
            wanted = "soft" if problem.goal.mode[j] else "rigid"
            yield f"segment {j + 1} does not end {wanted}"


class Findings(NamedTuple):
    """Findings of the verification of a plan.

    Attributes:
        verification: The outcome, as it stands in a plan file.
        rules: Rules that have no margin; for each the problems that break it.
    """

    verification: Verification
    rules: dict[str, tuple[str, ...]]


def verify(trajectory: Trajectory) -> Verification:
    """Re-integrate a plan and check limits, transitions and goal."""
    return examine(trajectory).verification


def examine(trajectory: Trajectory) -> Findings:
    """Verify a plan, and say of every rule whether it holds."""
    problem, samples = trajectory.problem, trajectory.samples
    grid = {"time grid": tuple(_grid_problems(samples))}
    if unusable := grid["time grid"]:  # nothing can be integrated on such a grid
        unknown = (np.inf,) * problem.robot.coordinates.size
        return Findings(Verification(np.inf, unknown, {}, ok=False, problems=unusable), grid)
    reached = reintegrate(problem, samples)
    charge(Cost.SAMPLE, len(samples))
    defect = float(np.abs(reached - samples.q).max())
    goal_error = problem.goal.error(reached[-1].copy())
    around = NOTHING_AROUND
    if problem.obstacles or problem.objects or problem.tasks or problem.workspace is not None:
        around = examine_around(trajectory, reached)
    moving = trajectory.driven
    limits = _margins(problem, samples, moving) | {BEND_LEVER.name: lever_margin(trajectory)}
    limits = {name: margin for name, margin in limits.items() if np.isfinite(margin)}
    limits |= around.margins
    rules = grid | {
        "stiffness while moving": tuple(_stiffness_problems(trajectory)),
        "steady speeds": tuple(_speed_problems(trajectory, moving)),
        "samples and phases": tuple(_coverage_problems(trajectory)),
        "wheels": tuple(_wheel_problems(samples, moving)),
        "transitions": tuple(transition_problems(trajectory)),
        "heating policy": tuple(heating_problems(trajectory)),
    }
    if problem.tasks or problem.objects:
        rules["tasks in order"] = around.tasks
    problems = [
        *_motion_problems(problem.robot.coordinates, defect, goal_error),
        *(
            around.words.get(name) or f"limit {name} exceeded by {-m:z.3g}"
            for name, m in limits.items()
            if m < 0
        ),
        *itertools.chain.from_iterable(rules.values()),
    ]
    verification = Verification(
        max_defect=defect,
        goal_error=tuple(float(error) for error in goal_error),
        limits=limits,
        ok=not problems,
        problems=tuple(problems),
    )
    return Findings(verification, rules)


def _grid_problems(samples: Samples) -> Iterator[str]:
    """The samples are numbers on a growing time axis."""
    for item in fields(samples):
        if not np.isfinite(getattr(samples, item.name)).all():
            yield f"samples.{item.name} has a value that is not finite"
    if not (np.diff(samples.t_s) > 0).all():
        yield "the time of the samples does not grow"


def _coverage_problems(trajectory: Trajectory) -> Iterator[str]:
    """The samples last as long as the plan, and move exactly in its phases, in their modes."""
    samples, phases = trajectory.samples, trajectory.phases
    ends = (*(phase.end_s for phase in phases), *(item.done_s for item in trajectory.transitions))
    last = max(ends, default=0.0)
    if samples.t_s[-1] < last - TIME_TOLERANCE_S:
        yield f"the samples end at {samples.t_s[-1]:z.3f} s, before the plan does at {last:z.3f} s"
    for phase in phases:
        apart = np.abs(samples.t_s[:, None] - np.array([phase.start_s, phase.end_s]))
        if apart.min(axis=0).max() > TIME_TOLERANCE_S:
            yield f"the phase at {phase.start_s:z.3f} s does not begin and end with a sample"
    middle = (samples.t_s[1:] + samples.t_s[:-1]) / 2
    moving = samples.moves[:-1]
    inside = np.zeros(len(middle), dtype=bool)
    for phase in phases:
        here = (middle > phase.start_s) & (middle < phase.end_s)
        inside |= here
        if (samples.mode[:-1][here] != phase.mode).any():
            yield f"the samples have another mode than the phase at {phase.start_s:z.3f} s"
    if (inside != moving).any():
        when = middle[inside != moving][0]
        yield f"at {when:z.3f} s the samples move outside of a phase, or rest in one"


def _wheel_problems(samples: Samples, moving: Driven) -> Iterator[str]:
    """Wheels turn as v asks."""
    wheels = np.zeros_like(samples.wheel_rad_s)
    wheels[moving.rows] = moving.wheel_rad_s[0]
    apart = np.abs(samples.wheel_rad_s - wheels).max(axis=1)
    if apart.max() > WHEEL_TOLERANCE_RAD_S:
        worst = int(np.argmax(apart))
        yield f"at {samples.t_s[worst]:z.3f} s the wheels do not turn as v asks"


def _speed_problems(trajectory: Trajectory, moving: Driven) -> Iterator[str]:
    """Inputs that bend change along themselves only; where accelerations are limited, none jumps.

    Then every phase goes from rest to rest as well, and is as long as the robot needs for one.
    """
    problem, samples = trajectory.problem, trajectory.samples
    wrong = turns_aside(samples) & samples.mode[:-1].any(axis=1)
    if wrong.any():
        yield f"at {samples.t_s[:-1][wrong][0]:z.3f} s the input changes its direction on the way"
    most = problem.robot.limits.wheel_acceleration_rad_s2
    if most is None:
        return
    after, before = samples.wheel_rad_s, trajectory.wheel_rad_s_before
    jump = np.abs(after[1:] - before).max(axis=1)
    if jump.sum() > JUMP_TOLERANCE * problem.robot.limits.wheel_speed_rad_s:  # many small ones, too
        when, by = samples.t_s[1:][int(jump.argmax())], jump.max()
        yield f"at {when:z.3f} s a wheel's speed jumps by {by:z.3g} rad/s"
    for phase in trajectory.phases:
        ends = phase.start_s, phase.end_s
        first, last = np.searchsorted(samples.t_s + TIME_TOLERANCE_S, ends)
        if np.abs([after[first], before[max(last - 1, 0)]]).max() > WHEEL_TOLERANCE_RAD_S:
            yield f"the phase at {phase.start_s:z.3f} s does not go from rest to rest"
        shortest = problem.robot.limits.phase_s
        if ends[1] - ends[0] < shortest - TIME_TOLERANCE_S and samples.v[first:last].any():
            lasting = f"lasts {ends[1] - ends[0]:z.3f} s, less than three control periods"
            yield f"the phase at {phase.start_s:z.3f} s {lasting}, {shortest:z.3f} s"


def _motion_problems(coordinates: Coordinates, defect: float, goal_error: Array) -> Iterator[str]:
    if not defect <= DEFECT_TOLERANCE:
        yield f"re-integration departs from the samples by {defect:z.3g} (m, rad or 1/m)"
    for i in np.flatnonzero(~(np.abs(goal_error) <= GOAL_TOLERANCE)).tolist():
        missed = f"missed by {goal_error[i]:z.3g} {coordinates.units[i]}"
        yield f"goal.{coordinates.names[i]} is {missed}"


def _margins(problem: Problem, samples: Samples, moving: Driven) -> dict[str, float]:
    """Distance to each limit; rounding at an active limit counts as zero."""
    left = dict(margins(problem.robot, samples.q, samples.v, samples.a, moving))
    used = {  # wheel speeds: also what is sent, whatever the model says
        WHEEL_SPEED: np.abs(samples.wheel_rad_s).max(),
        TEMPERATURE: samples.temperature_C.max(),
        CURRENT: samples.heater_current_A.max(),
    }
    for limit, value in used.items():
        most = limit.asked(problem) or 0.0
        left[limit.name] = min(left.get(limit.name, np.inf), settled(float(most - value), most))
    return left


def _stiffness_problems(trajectory: Trajectory) -> Iterator[str]:
    """Moving needs every segment to be what the mode says, and none to be changing.

    At rest the mode is what the metal is: soft from the end of a melt to a freeze's onset.
    """
    samples = trajectory.samples
    moving = np.flatnonzero(samples.moves)
    if len(moving) and moving[-1] == len(samples) - 1:
        yield "the last sample still moves"
        return
    begin, end = samples.t_s[moving], samples.t_s[moving + 1]
    just_after = samples.t_s + 2 * TIME_TOLERANCE_S
    lasting = np.append(np.diff(samples.t_s), np.inf) >= 4 * TIME_TOLERANCE_S
    for j in range(len(trajectory.problem.start_mode)):
        soft, resting = np.zeros(len(moving), dtype=int), np.zeros(len(samples), dtype=int)
        for since, until, now in course(trajectory, j):
            resting[just_after >= since] = now == 1
            if now is not None:
                soft[begin >= since - TIME_TOLERANCE_S] = now
                continue
            clash = (begin < until - TIME_TOLERANCE_S) & (end > since + TIME_TOLERANCE_S)
            if clash.any():
                when = f"{begin[clash][0]:z.3f} s"
                yield f"the robot moves at {when} while segment {j + 1} is changing"
        wrong = soft != samples.mode[moving, j]
        if wrong.any():
            row = moving[np.flatnonzero(wrong)[0]]
            mode = mode_name(tuple(samples.mode[row].tolist()))
            when = f"at {samples.t_s[row]:z.3f} s"
            yield f"{when} the mode is {mode} but segment {j + 1} is not so yet"
        wrong = (samples.mode[:, j] != resting) & ~samples.moves & lasting
        if wrong.any():
            when, said = samples.t_s[wrong][0], "rigid" if resting[wrong][0] else "soft"
            yield f"at {when:z.3f} s the robot rests in a mode in which segment {j + 1} is {said}"
    rigid = samples.mode[moving].max(axis=1, initial=0) == 0
    acting = (samples.v[moving] != 0) | (samples.a[moving] != 0)
    if acting[rigid][:, :2].any() or acting[~rigid][:, 2:].any():
        yield "an input acts that the mode does not have"


_CUT = 1e-2  # m: what an input moves at most from one of the quadrature's cuts to the next


def cost_of(trajectory: Trajectory) -> PlanCost:
    """Cost of a trajectory [s], and what it is made of."""
    problem, samples = trajectory.problem, trajectory.samples
    weights, time_s = problem.cost_weights, float(samples.t_s[-1])
    count = len(trajectory.transitions)
    energy, effort = energy_J(trajectory), effort_s(trajectory)
    total = time_s + weights.energy_s_per_J * energy + weights.transition_s * count
    return PlanCost(total + weights.effort * effort, time_s, energy, count, effort)


def effort_s(trajectory: Trajectory) -> float:
    """Integral of the sum of (wheel speed / largest wheel speed)^2 over the samples [s].

    By Simpson's rule, corrected by the derivatives at the ends of intervals: exact for rigid
    motion, else to 1e-7. Intervals are cut where soft segments bend.
    """
    samples, robot, moving = trajectory.samples, trajectory.problem.robot, trajectory.driven
    t_s = samples.t_s
    fine, at = between(samples, np.where(samples.mode[:-1].any(axis=1), _CUT, np.inf), least=0)
    if len(fine) > len(samples):
        since, t_s = (fine.t_s - samples.t_s[at])[:, None], fine.t_s
        change = samples.a[at] * since**2
        q = flown(robot, samples.q[at], samples.v[at] * since + change / 2, change, fine.mode)
        moving = driven(robot, q, fine.v, fine.a, np.append(np.diff(t_s), 0.0), fine.mode)
    lasting = np.append(np.diff(t_s), 0.0)[moving.rows]
    squares = (moving.wheel_rad_s**2).sum(axis=2)
    growth = 2 * (moving.wheel_rad_s * moving.wheel_rad_s2).sum(axis=2)
    mean = (7 * squares[0] + 16 * squares[1] + 7 * squares[2]) / 30
    mean += lasting * (growth[0] - growth[2]) / 60
    return float(mean @ lasting) / robot.limits.wheel_speed_rad_s**2


def energy_J(trajectory: Trajectory) -> float:
    """Heat that the sampled currents give off in all coils [J]."""
    problem, t = trajectory.problem, trajectory.samples.t_s
    currents = trajectory.samples.heater_current_A
    if not problem.transition_times.needs_segment:
        squares = np.diff(t) @ currents[:-1] ** 2
        return problem.robot.heater.resistance_ohm * float(squares.sum())
    total = 0.0
    for model, states, own in zip(
        problem.segment_models, trajectory.metal, currents.T, strict=True
    ):
        turns = [0, *(np.flatnonzero(np.diff(own[:-1])) + 1).tolist(), len(t) - 1]
        for begin, end in itertools.pairwise(turns):
            if own[begin]:
                state = tuple(float(values[begin]) for values in states)
                lasting = float(t[end] - t[begin])
                total += model.energy_J(state, float(own[begin]), lasting)
    return total
