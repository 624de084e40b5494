"""Independent check of a plan's transitions: against constants, or by replaying the currents."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from twosra_mpc.plans.trajectory import Samples, Trajectory
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import segment_model
from twosra_mpc.thermal.model import SegmentModel, State
from twosra_mpc.thermal.uncertainty import windows
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.transitions import TIME_TOLERANCE_S, own_transitions

_TEMPERATURE_TOLERANCE_C = 0.02
_LEVEL_TOLERANCE = 1e-3  # of the way from solid to liquid


def transition_problems(trajectory: Trajectory) -> Iterator[str]:
    """Order and duration of the transitions of each segment, and the stiffness at the end."""
    problem, transitions = trajectory.problem, trajectory.transitions
    for earlier, after in itertools.pairwise(trajectory.phases):
        if after.start_s < earlier.end_s - TIME_TOLERANCE_S:
            yield f"the phase at {after.start_s:.3f} s starts before the one before it has ended"
    timing = transition_model(problem)
    for j, stiffness in enumerate(problem.start_mode):
        before: Transition | None = None
        for item in own_transitions(transitions, j):
            name = f"segment {j + 1} to {item.to} at {item.heater_s:.3f} s"
            if (item.to == "soft") == bool(stiffness):
                yield f"{name}: it is {item.to} already"
            if item.heater_s < (before.done_s if before else 0.0) - TIME_TOLERANCE_S:
                yield f"{name}: before the transition before it is done"
            if not item.heater_s - TIME_TOLERANCE_S <= item.onset_s <= item.done_s:
                yield f"{name}: heater, onset and done are out of order"
            for text in timing.violations(item, before, transitions):
                yield f"{name}: {text}"
            stiffness, before = int(item.to == "soft"), item
        if not problem.ends_anywhere and stiffness != problem.goal.mode[j]:
            wanted = "soft" if problem.goal.mode[j] else "rigid"
            yield f"segment {j + 1} does not end {wanted}"
        if problem.transition_times.needs_segment:
            yield from _replay_problems(trajectory, j)


def _replay_problems(trajectory: Trajectory, segment: int) -> Iterator[str]:
    """Propagate the sampled heater currents and see whether the metal does what the plan says."""
    problem, samples = trajectory.problem, trajectory.samples
    model = segment_model(problem.robot, problem.ambient, segment)
    states = replayed(problem, samples, segment, model)
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
    moving = samples.moves[:-1]
    soft = samples.mode[:-1, segment] == 1
    wrong = moving & np.where(
        soft,
        lowest < model.liquid_level - _LEVEL_TOLERANCE * span,
        highest > model.solid_level + _LEVEL_TOLERANCE * span,
    )
    if wrong.any():
        yield f"{name}: its currents leave it changing at {samples.t_s[:-1][wrong][0]:.3f} s"
    mine = own_transitions(trajectory.transitions, segment)
    for item in mine:
        at = int(np.argmin(np.abs(samples.t_s - item.heater_s)))
        yield from _window_problems(problem, model, item, states[at])
    ends: list[tuple[str, float]] = [(item.to, item.done_s) for item in mine]
    if not problem.ends_anywhere:
        goal = "soft" if problem.goal.mode[segment] else "rigid"
        ends.append((goal, float(samples.t_s[-1])))
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


def replayed(problem: Problem, samples: Samples, segment: int, model: SegmentModel) -> list[State]:
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
    robot, heater = problem.robot, problem.robot.heater
    ranges = tuple(robot.thermal_segment(item.segment - 1).ranges.items())
    currents_and_setpoint = heater.melt_current_A, heater.soft_setpoint_C
    window = windows(model, ranges, *currents_and_setpoint, problem.transition_quantile)
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
