"""Independent check of heaters and metal: heaters follow the policy, and the metal the currents.

What is proved of plans is proved of one heating policy: ``melt_current_A`` from heater on until the
set-point, then what holds it, and nothing from heater off on. Where a problem asks to keep warm, a
solid segment may be held below melting until its next melt. Constant times come with a curve.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.plans.trajectory import Samples, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import (
    COMMAND_TOLERANCE,
    FRACTION_TOLERANCE,
    HOLD_TOLERANCE_C,
    LEVEL_TOLERANCE,
    TEMPERATURE_TOLERANCE_C,
    TIME_TOLERANCE_S,
)
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.thermal.model import SegmentModel, State
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.thermal import KEEP_WARM_BELOW_C
from twosra_mpc.timing.transitions import own_transitions

# times -> set-points [C], currents [A]; NaN: hold
Commands = Callable[[Array], tuple[Array, Array]]


def heating_problems(trajectory: Trajectory) -> Iterator[str]:
    """Heaters against the policy, and temperatures that do not follow from their currents."""
    problem, samples = trajectory.problem, trajectory.samples
    check = _by_model if problem.transition_times.needs_segment else _by_curve
    for j, first in enumerate(problem.start_stiffness):
        own = own_transitions(trajectory.transitions, j)
        turns = [first, *(int(item.to == "soft") for item in own)]
        turn = all(before != after for before, after in itertools.pairwise(turns))
        least = np.diff([0.0, *(time for item in own for time in item[2:])]).min(initial=0.0)
        if turn and least >= -TIME_TOLERANCE_S:  # else it is told of already
            yield from check(trajectory, j, own)
    count = (samples.heater_current_A > 0).sum(axis=1)
    lasting = np.append(np.diff(samples.t_s), np.inf) >= 4 * TIME_TOLERANCE_S
    many = (count > problem.heaters_at_once) & lasting
    if many.any():
        hot = "both" if count[many][0] == 2 else count[many][0]
        yield f"at {samples.t_s[many][0]:z.3f} s {hot} heaters are on"


def _by_curve(trajectory: Trajectory, segment: int, own: tuple[Transition, ...]) -> Iterator[str]:
    """Constant times: the samples are those of the curve drawn through the transitions."""
    samples = trajectory.samples
    heating = transition_model(trajectory.problem).segment_heating(segment, own)

    def commands(t: Array) -> tuple[Array, Array]:
        return heating.setpoint_C(t), heating.current_A(t)

    yield from _command_problems(samples, segment, commands, 2 * TIME_TOLERANCE_S)
    expected = heating.temperature_and_melt_fraction(samples.t_s)
    yield from _metal_problems(samples, segment, *expected)


def _by_model(trajectory: Trajectory, segment: int, own: tuple[Transition, ...]) -> Iterator[str]:
    """Propagate the sampled heater currents and see whether the metal does what the plan says."""
    problem, samples = trajectory.problem, trajectory.samples
    model, states = problem.segment_models[segment], trajectory.metal[segment]
    metal = model.temperature_C(states), model.melt_fraction(states)
    yield from _metal_problems(samples, segment, *metal)
    yield from _policy_problems(trajectory, segment, own)
    level = model.level(states)
    missed = _missed(model)
    lowest, highest = np.minimum(level[:-1], level[1:]), np.maximum(level[:-1], level[1:])
    soft = samples.mode[:-1, segment] == 1
    wrong = samples.moves[:-1] & np.where(
        soft, lowest < model.liquid_level - missed, highest > model.solid_level + missed
    )
    name = f"segment {segment + 1}"
    if wrong.any():
        yield f"{name}: its currents leave it changing at {samples.t_s[:-1][wrong][0]:z.3f} s"
    for item in own:
        yield from _window_problems(problem, model, item, _at(states, samples, item.heater_s))
    ends = {(item.to, item.done_s) for item in own}
    if not problem.ends_anywhere:
        ends.add(("soft" if problem.goal.mode[segment] else "rigid", float(samples.t_s[-1])))
    for to, when in sorted(ends, key=lambda end: end[1]):
        here = model.level(_at(states, samples, when))
        missing = model.liquid_level - here if to == "soft" else here - model.solid_level
        if missing > missed:
            yield f"{name}: its currents do not make it {to} until {when:z.3f} s"


def _metal_problems(
    samples: Samples, segment: int, temperature: Array, fraction: Array
) -> Iterator[str]:
    """The samples have the temperatures and melt fractions that follow from the heating."""
    warmer = np.abs(temperature - samples.temperature_C[:, segment])
    softer = np.abs(fraction - samples.melt_fraction[:, segment])
    for apart, most, verb, what in (
        (warmer, TEMPERATURE_TOLERANCE_C, "make it", "C warmer or colder"),
        (softer, FRACTION_TOLERANCE, "melt", "more or less of it"),
    ):
        if apart.max() > most:
            told = f"{verb} {apart.max():z.3g} {what} at {samples.t_s[int(apart.argmax())]:z.3f} s"
            yield f"segment {segment + 1}: its currents {told}"


def _command_problems(
    samples: Samples, segment: int, commands: Commands, off_s: float
) -> Iterator[str]:
    """Set-points and currents are those of the policy, whose events may be ``off_s`` off."""
    t, heater = samples.t_s, f"heater {segment + 1}"
    held = np.append((t[1:] + t[:-1]) / 2, t[-1] + 2 * off_s)  # amid what each row is in force for
    given = samples.heater_setpoint_C[:, segment], samples.heater_current_A[:, segment]
    sides = [commands(held - off_s), commands(held + off_s)]
    setpoint, current = (
        np.all([np.abs(side[i] - given[i]) > COMMAND_TOLERANCE for side in sides], axis=0)
        for i in range(2)
    )
    if setpoint.any():
        yield f"at {t[setpoint][0]:z.3f} s {heater} does not do what the transitions say"
    if current.any():
        row = int(np.argmax(current))
        asked = f"{sides[0][1][row]:z.3g} A of the heating policy"
        yield f"at {t[row]:z.3f} s {heater} gives {given[1][row]:z.3g} A, not the {asked}"


class _Span(NamedTuple):
    """State of a heater from a time on: current [A], NaN where it holds, and set-point [C]."""

    start_s: float
    current_A: float
    setpoint_C: float


def _policy_problems(
    trajectory: Trajectory, segment: int, own: tuple[Transition, ...]
) -> Iterator[str]:
    """The heater follows the policy, given what its currents have made of the metal."""
    samples, model = trajectory.samples, trajectory.problem.segment_models[segment]
    spans = list(_policy(trajectory, segment, own))
    starts, current, setpoint = (np.array(column) for column in zip(*spans, strict=True))

    def commands(t: Array) -> tuple[Array, Array]:
        at = np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)
        return setpoint[at], current[at]

    yield from _command_problems(samples, segment, commands, TIME_TOLERANCE_S)
    asked, holds = commands(samples.t_s - TIME_TOLERANCE_S)
    held = np.isnan(holds) & np.isnan(commands(samples.t_s + TIME_TOLERANCE_S)[1])
    off_C = HOLD_TOLERANCE_C + model.replay_tolerance * np.abs(asked - trajectory.problem.ambient)
    wrong = held & (np.abs(model.temperature_C(trajectory.metal[segment]) - asked) > off_C)
    if wrong.any():
        held_C = f"hold the {asked[wrong][0]:zg} C of the heating policy"
        yield f"at {samples.t_s[wrong][0]:z.3f} s heater {segment + 1} does not {held_C}"


def _policy(trajectory: Trajectory, segment: int, own: tuple[Transition, ...]) -> Iterator[_Span]:
    """Course of the policy for a heater that is switched at these transitions."""
    problem, samples = trajectory.problem, trajectory.samples
    model, states = problem.segment_models[segment], trajectory.metal[segment]
    heater, first = problem.robot.heater, "soft" if problem.start_mode[segment] else "rigid"
    warm_C = problem.segment_thresholds_C[segment][0] - KEEP_WARM_BELOW_C
    warms = problem.heating == "keep_warm" and problem.heaters_at_once == len(problem.start_mode)
    switched = [(0.0, first), *((item.heater_s, item.to) for item in own), (math.inf, "rigid")]
    for (since, to), (until, then) in itertools.pairwise(switched):
        state, target_C = _at(states, samples, since), heater.soft_setpoint_C
        current = 0.0
        if to == "soft":
            hot = model.level(state) > model.level_at(target_C)
            current = 0.0 if hot else heater.melt_current_A
            yield _Span(since, current, target_C)
        else:
            yield _Span(since, 0.0, heater.rigid_setpoint_C)
            inside = (samples.t_s >= since) & (samples.t_s < until - TIME_TOLERANCE_S)
            target_C = warm_C
            if then == "rigid" or not (warms and samples.heater_current_A[inside, segment].any()):
                continue
        there = since + model.time_until(state, current, model.level_at(target_C))
        if there < until:
            yield _Span(there, math.nan, target_C)


def _missed(model: SegmentModel) -> float:
    """Tolerance of a level that replayed currents reach."""
    share = LEVEL_TOLERANCE + model.replay_tolerance
    return share * (model.liquid_level - model.solid_level)


def _at(states: Sequence[Array], samples: Samples, when: float) -> State:
    """The state at the sample nearest to a time."""
    row = int(np.argmin(np.abs(samples.t_s - when)))
    return tuple(float(values[row]) for values in states)


def _window_problems(
    problem: Problem, model: SegmentModel, item: Transition, state: State
) -> Iterator[str]:
    """Nothing may move from the earliest onset to the latest end that the state allows."""
    window, levels = problem.windows[item.segment - 1], (model.solid_level, model.liquid_level)
    if item.to == "soft":
        current, (begin, end) = problem.robot.heater.melt_current_A, levels
        early, late = window.melt_early, window.melt_late
    else:
        current, (end, begin) = 0.0, levels
        early, late = window.freeze_early, window.freeze_late
    onset = item.heater_s + early * _until(model, state, current, begin)
    done = item.heater_s + late * model.time_until(state, current, end)
    name = f"segment {item.segment} to {item.to} at {item.heater_s:z.3f} s"
    off_s = TIME_TOLERANCE_S + model.replay_tolerance * (item.done_s - item.heater_s)
    if abs(item.onset_s - onset) > off_s:
        yield f"{name}: begins to change at {onset:z.3f} s{_than(item.onset_s, onset)}"
    if abs(item.done_s - done) > off_s:
        yield f"{name}: has changed at {done:z.3f} s{_than(item.done_s, done)}"


def _until(model: SegmentModel, state: State, current_A: float, level: float) -> float:
    """Time to the onset of a change [s]; none where the metal changes already, or all but does."""
    found, beyond = model.time_until(state, current_A, level), model.level(state) - level
    begun = (beyond if current_A else -beyond) >= -_missed(model)
    return 0.0 if begun and math.isinf(found) else found


def _than(said: float, true: float) -> str:
    """Compare a time with what is said of it."""
    return f", before {said:z.3f} s" if true < said else f" only, after {said:z.3f} s"
