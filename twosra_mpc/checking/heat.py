"""Independent check of heaters and metal: heaters follow the policy, and the metal the currents.

What is proved of plans is proved of one heating policy: ``melt_current_A`` from heater on until the
set-point, then what holds it, and nothing from heater off on. Where a problem asks to keep warm, a
solid segment may be held below melting until its next melt. Constant times come with a curve.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

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
from twosra_mpc.thermal.model import State
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.thermal import KEEP_WARM_BELOW_C
from twosra_mpc.timing.transitions import own_transitions

# times -> set-points [C], currents [A]; NaN: hold
Commands = Callable[[Array], tuple[Array, Array]]


Course = list[tuple[float, float, int | None]]  # since when, until when, and what it is then


def course(trajectory: Trajectory, segment: int) -> Course:
    """Stiffness of a segment (from 0) over time: 1 soft, 0 rigid, None while it changes."""
    found, since, now = Course(), -math.inf, trajectory.problem.start_stiffness[segment]
    for item in own_transitions(trajectory.transitions, segment):
        found += [(since, item.onset_s, now), (item.onset_s, item.done_s, None)]
        since, now = item.done_s, int(item.to == "soft")
    return [*found, (since, math.inf, now)]


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
    level, share = model.level(states), LEVEL_TOLERANCE + model.replay_tolerance
    missed = share * (model.liquid_level - model.solid_level)  # of levels that currents reach
    lowest, highest = np.minimum(level[:-1], level[1:]), np.maximum(level[:-1], level[1:])
    soft = samples.mode[:-1, segment] == 1
    wrong = samples.moves[:-1] & np.where(
        soft, lowest < model.liquid_level - missed, highest > model.solid_level + missed
    )
    name = f"segment {segment + 1}"
    if wrong.any():
        yield f"{name}: its currents leave it changing at {samples.t_s[:-1][wrong][0]:z.3f} s"
    for item in own:
        yield from _window_problems(problem, item, _at(states, samples, item.heater_s), missed)
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


def _policy_problems(
    trajectory: Trajectory, segment: int, own: tuple[Transition, ...]
) -> Iterator[str]:
    """The heater follows the policy, given what its currents have made of the metal."""
    problem, samples = trajectory.problem, trajectory.samples
    model, states = problem.segment_models[segment], trajectory.metal[segment]
    heater, first = problem.robot.heater, "soft" if problem.start_mode[segment] else "rigid"
    warm_C = problem.segment_thresholds_C[segment][0] - KEEP_WARM_BELOW_C
    warms = problem.heating == "keep_warm" and problem.heaters_at_once == len(problem.start_mode)
    switched = [(0.0, first), *((item.heater_s, item.to) for item in own), (math.inf, "rigid")]
    spans = list[tuple[float, float, float]]()  # since when, set-point, current (NaN: it holds)
    for (since, to), (until, then) in itertools.pairwise(switched):
        state, target_C, current_A = _at(states, samples, since), heater.soft_setpoint_C, 0.0
        if to == "soft":
            hot = model.level(state) > model.level_at(target_C)
            current_A = 0.0 if hot else heater.melt_current_A
            spans.append((since, target_C, current_A))
        else:
            spans.append((since, heater.rigid_setpoint_C, 0.0))
            inside = (samples.t_s >= since) & (samples.t_s < until - TIME_TOLERANCE_S)
            target_C = warm_C
            if then == "rigid" or not (warms and samples.heater_current_A[inside, segment].any()):
                continue
        there = since + model.time_until(state, current_A, model.level_at(target_C))
        if there < until:
            spans.append((there, target_C, math.nan))
    starts, setpoints, currents = np.array(spans).T

    def commands(t: Array) -> tuple[Array, Array]:
        at = np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)
        return setpoints[at], currents[at]

    yield from _command_problems(samples, segment, commands, TIME_TOLERANCE_S)
    asked, holds = commands(samples.t_s - TIME_TOLERANCE_S)
    held = np.isnan(holds) & np.isnan(commands(samples.t_s + TIME_TOLERANCE_S)[1])
    off_C = HOLD_TOLERANCE_C + model.replay_tolerance * np.abs(asked - problem.ambient)
    wrong = held & (np.abs(model.temperature_C(states) - asked) > off_C)
    if wrong.any():
        held_C = f"hold the {asked[wrong][0]:zg} C of the heating policy"
        yield f"at {samples.t_s[wrong][0]:z.3f} s heater {segment + 1} does not {held_C}"


def _at(states: Sequence[Array], samples: Samples, when: float) -> State:
    """The state at the sample nearest to a time."""
    row = int(np.argmin(np.abs(samples.t_s - when)))
    return tuple(float(values[row]) for values in states)


def _window_problems(
    problem: Problem, item: Transition, state: State, missed: float
) -> Iterator[str]:
    """Nothing may move from the earliest onset to the latest end that the state allows."""
    window, model = problem.windows[item.segment - 1], problem.segment_models[item.segment - 1]
    begin, end = model.solid_level, model.liquid_level
    current, early, late = problem.robot.heater.melt_current_A, window.melt_early, window.melt_late
    if item.to == "rigid":
        current, early, late = 0.0, window.freeze_early, window.freeze_late
        begin, end = end, begin
    lead, beyond = model.time_until(state, current, begin), model.level(state) - begin
    if math.isinf(lead) and (beyond if current else -beyond) >= -missed:
        lead = 0.0  # the metal changes already, or all but does
    onset = item.heater_s + early * lead
    done = item.heater_s + late * model.time_until(state, current, end)
    name = f"segment {item.segment} to {item.to} at {item.heater_s:z.3f} s"
    off_s = TIME_TOLERANCE_S + model.replay_tolerance * (item.done_s - item.heater_s)
    for said, true, words in (
        (item.onset_s, onset, "begins to change"),
        (item.done_s, done, "has changed"),
    ):
        if abs(said - true) > off_s:
            than = f", before {said:z.3f} s" if true < said else f" only, after {said:z.3f} s"
            yield f"{name}: {words} at {true:z.3f} s{than}"
