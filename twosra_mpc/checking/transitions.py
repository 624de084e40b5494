"""Independent check of a plan's transitions: constant durations, or the currents replayed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.plans.trajectory import Phase, Samples
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming
from twosra_mpc.thermal.model import SegmentModel, State, segment_model
from twosra_mpc.thermal.uncertainty import EXACT, windows
from twosra_mpc.timing import Transition

Array = NDArray[np.float64]

TIME_TOLERANCE_S = 1e-5
_TEMPERATURE_TOLERANCE_C = 0.02
_LEVEL_TOLERANCE = 1e-3  # of the way from solid to liquid


def transition_problems(
    problem: Problem,
    samples: Samples,
    phases: Sequence[Phase],
    transitions: Sequence[Transition],
) -> Iterator[str]:
    """Order and duration of the transitions of each segment, and the stiffness at the end."""
    for before, after in itertools.pairwise(phases):
        if after.start_s < before.end_s - TIME_TOLERANCE_S:
            yield f"the phase at {after.start_s:.3f} s starts before the one before it has ended"
    for j in (0, 1):
        stiffness, free = problem.start_mode[j], 0.0
        for item in (item for item in transitions if item.segment == j + 1):
            name = f"segment {j + 1} to {item.to} at {item.heater_s:.3f} s"
            if (item.to == "soft") == bool(stiffness):
                yield f"{name}: it is {item.to} already"
            if item.heater_s < free - TIME_TOLERANCE_S:
                yield f"{name}: before the transition before it is done"
            if not item.heater_s - TIME_TOLERANCE_S <= item.onset_s <= item.done_s:
                yield f"{name}: heater, onset and done are out of order"
            opposite = [
                other.done_s if other.to == "rigid" else other.heater_s
                for other in transitions
                if other.to != item.to
            ]
            found = _duration_problems(problem, item, None if free == 0 else free, opposite)
            yield from (f"{name}: {text}" for text in found)
            stiffness, free = int(item.to == "soft"), item.done_s
        if stiffness != problem.goal.mode[j]:
            wanted = "soft" if problem.goal.mode[j] else "rigid"
            yield f"segment {j + 1} does not end {wanted}"
        if isinstance(problem.transition_times, ThermalTiming):
            yield from _replay_problems(problem, samples, transitions, j)


def _duration_problems(
    problem: Problem, item: Transition, previous_s: float | None, opposite: Sequence[float]
) -> Iterator[str]:
    """``previous_s`` is when the transition before it was done, None for a segment's first one.

    ``opposite`` are the ends of all freezes for a melt, the starts of all melts for a freeze: where
    one joins the other they may be the halves of a reconfiguration.
    """
    match problem.transition_times:
        case OverlappedTiming() as times if item.to == "soft":
            yield from _melt_problems(problem, times, item, first=previous_s is None)
        case OverlappedTiming() as times:
            yield from _freeze_problems(problem, times, item, previous_s)
        case ThermalTiming():
            pass  # told by replaying the currents
        case SequentialTiming() as times:
            joint = item.done_s if item.to == "rigid" else item.heater_s
            least, half = (
                (times.freeze_s, times.reconfigure_cool_s)
                if item.to == "rigid"
                else (times.heat_s, times.reconfigure_s - times.reconfigure_cool_s)
            )
            if any(abs(joint - when) <= TIME_TOLERANCE_S for when in opposite):
                least = min(least, half)
            if item.done_s - item.heater_s < least - TIME_TOLERANCE_S:
                yield f"changes in {item.done_s - item.heater_s:.3f} s instead of {least:g} s"


def _melt_problems(
    problem: Problem, times: OverlappedTiming, item: Transition, first: bool
) -> Iterator[str]:
    heater, least = problem.robot.heater, times.melt_s - times.melt_changing_s
    if first:
        now = problem.temperatures[item.segment - 1]
        span = heater.melting_point_C - problem.ambient
        least *= (heater.melting_point_C - now) / span
    if item.onset_s - item.heater_s < least - TIME_TOLERANCE_S:
        lead = item.onset_s - item.heater_s
        yield f"heated for {lead:.3f} s before melting instead of {least:.3f} s"
    yield from _plateau_problems(item, times.melt_changing_s)


def _freeze_problems(
    problem: Problem, times: OverlappedTiming, item: Transition, previous_s: float | None
) -> Iterator[str]:
    heater, whole = problem.robot.heater, times.freeze_s - times.freeze_changing_s
    lag, stored = item.onset_s - item.heater_s, 1.0
    if previous_s is not None:
        stored = min(1.0, (item.heater_s - previous_s) / times.superheat_s)
    if lag > stored * whole + TIME_TOLERANCE_S:
        yield f"liquid for {lag:.3f} s after its heater is off: it would freeze earlier"
    if previous_s is None:
        above = problem.temperatures[item.segment - 1] - heater.melting_point_C
        least = whole * above / (heater.soft_setpoint_C - heater.melting_point_C)
        if item.onset_s < least - TIME_TOLERANCE_S:
            yield f"freezes at {item.onset_s:.3f} s, but is still too hot until {least:.3f} s"
    yield from _plateau_problems(item, times.freeze_changing_s)


def _plateau_problems(item: Transition, least: float) -> Iterator[str]:
    changing = item.done_s - item.onset_s
    if changing < least - TIME_TOLERANCE_S:
        yield f"on the plateau for {changing:.3f} s instead of {least:g} s"


def _replay_problems(
    problem: Problem, samples: Samples, transitions: Sequence[Transition], segment: int
) -> Iterator[str]:
    """Propagate the sampled heater currents and see whether the metal does what the plan says."""
    model = segment_model(problem.robot, problem.ambient)
    states = _replayed(problem, samples, segment, model)
    name = f"segment {segment + 1}"
    temperature = np.array([model.temperature_C(state) for state in states])
    apart = np.abs(temperature - samples.temperature_C[:, segment])
    if apart.max() > _TEMPERATURE_TOLERANCE_C:
        when = samples.t_s[int(np.argmax(apart))]
        yield f"{name}: its currents make it {apart.max():.3g} C warmer or colder at {when:.3f} s"
    fraction = np.array([model.melt_fraction(state) for state in states])
    apart = np.abs(fraction - samples.melt_fraction[:, segment])
    if apart.max() > 2 * _LEVEL_TOLERANCE:
        when = samples.t_s[int(np.argmax(apart))]
        yield f"{name}: its currents melt {apart.max():.3g} more or less of it at {when:.3f} s"
    level = np.array([model.level(state) for state in states])
    span = model.liquid_level - model.solid_level
    lowest, highest = np.minimum(level[:-1], level[1:]), np.maximum(level[:-1], level[1:])
    moving = samples.v[:-1].any(axis=1)
    soft = samples.mode[:-1, segment] == 1
    wrong = moving & np.where(
        soft,
        lowest < model.liquid_level - _LEVEL_TOLERANCE * span,
        highest > model.solid_level + _LEVEL_TOLERANCE * span,
    )
    if wrong.any():
        yield f"{name}: its currents leave it changing at {samples.t_s[:-1][wrong][0]:.3f} s"
    mine = [item for item in transitions if item.segment == segment + 1]
    for item in mine:
        at = int(np.argmin(np.abs(samples.t_s - item.heater_s)))
        yield from _window_problems(problem, model, item, states[at])
    goal = "soft" if problem.goal.mode[segment] else "rigid"
    ends = [*((item.to, item.done_s) for item in mine), (goal, float(samples.t_s[-1]))]
    found = (_unreached(samples, model, level, to, when) for to, when in ends)
    yield from (f"{name}: its currents {text}" for text in dict.fromkeys(filter(None, found)))


def _unreached(
    samples: Samples, model: SegmentModel, level: Array, to: str, when: float
) -> str | None:
    """Say that the metal is not at the level it should have reached at a time."""
    here = float(level[int(np.argmin(np.abs(samples.t_s - when)))])
    missing = model.liquid_level - here if to == "soft" else here - model.solid_level
    if missing <= _LEVEL_TOLERANCE * (model.liquid_level - model.solid_level):
        return None
    return f"do not make it {to} until {when:.3f} s"


def _replayed(problem: Problem, samples: Samples, segment: int, model: SegmentModel) -> list[State]:
    """State of a segment at every sample."""
    states = [model.initial(problem.temperatures[segment])]
    currents = samples.heater_current_A[:-1, segment].tolist()
    for current, duration in zip(currents, np.diff(samples.t_s).tolist(), strict=True):
        states.append(model.propagate(states[-1], current, duration))
    return states


def _window_problems(
    problem: Problem, model: SegmentModel, item: Transition, state: State
) -> Iterator[str]:
    """Nothing may move from the earliest onset to the latest end that the state allows."""
    quantile, heater = problem.transition_quantile, problem.robot.heater
    window = EXACT if quantile is None else windows(problem.robot, problem.ambient, quantile)
    levels = (model.solid_level, model.liquid_level)
    if item.to == "soft":
        current, (begin, end) = heater.melt_current_A, levels
        early, late = window.melt_early, window.melt_late
    else:
        current, (end, begin) = 0.0, levels
        early, late = window.freeze_early, window.freeze_late
    slack = TIME_TOLERANCE_S + _LEVEL_TOLERANCE * (item.done_s - item.onset_s)
    onset = item.heater_s + early * model.time_until(state, current, begin)
    done = item.heater_s + late * model.time_until(state, current, end)
    name = f"segment {item.segment} to {item.to} at {item.heater_s:.3f} s"
    if item.onset_s > onset + slack:
        yield f"{name}: begins to change at {onset:.3f} s, before {item.onset_s:.3f} s"
    if item.done_s < done - slack:
        yield f"{name}: has changed at {done:.3f} s only, after {item.done_s:.3f} s"
