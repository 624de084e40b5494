"""From a timed motion to the samples of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.flow import Motion
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples, flown, new_times, wheel_speeds
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import INPUTS
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.timing import Transition, transition_model

Array = NDArray[np.float64]

HOLD_SAMPLE_S = 5.0  # while the robot waits, temperatures are sampled at least this often


def sample(
    problem: Problem,
    motion: Motion,
    durations: Array,
    phase_starts: Sequence[float],
    finish_s: float,
    transitions: Sequence[Transition],
) -> Samples:
    """Put a motion on the clock: every interval, every heater event, and regular hold samples.

    Args:
        problem: The problem.
        motion: Path of the phases.
        durations: Duration of each interval, (phases, intervals) [s]; empty intervals are left out.
        phase_starts: Start of each phase [s].
        finish_s: End of the plan [s].
        transitions: Melts and freezes.
    """
    heating = transition_model(problem).heating(transitions)
    events = [time for item in heating for time in item.event_times() if time <= finish_s]
    times = np.unique([0.0, finish_s, *np.arange(0.0, finish_s, HOLD_SAMPLE_S), *events])
    t, q, v, mode = _on_path(_knots(motion, durations, phase_starts), times, problem.robot)
    just_after = t + 2 * SAME_TIME_S
    resting = ~v.any(axis=1)
    soft = np.column_stack([item.soft(just_after) for item in heating])
    mode[resting] = soft[resting]
    metal = [item.temperature_and_melt_fraction(t) for item in heating]
    return Samples(
        t_s=t,
        q=q,
        v=v,
        mode=mode,
        wheel_rad_s=wheel_speeds(problem.robot, q, v, mode),
        temperature_C=np.column_stack([temperature for temperature, _ in metal]),
        melt_fraction=np.column_stack([fraction for _, fraction in metal]),
        heater_setpoint_C=np.column_stack([item.setpoint_C(just_after) for item in heating]),
        heater_current_A=np.column_stack([item.current_A(just_after) for item in heating]),
    )


class _Knot(NamedTuple):
    """From ``t`` to the next knot the robot moves with input ``v`` in ``mode``, or rests."""

    t: float
    q: Array
    v: Array
    mode: Mode


def _knots(motion: Motion, durations: Array, phase_starts: Sequence[float]) -> list[_Knot]:
    """The motion alone: the start of every interval, and a stop after every phase."""
    still = np.zeros(INPUTS)
    knots = [_Knot(0.0, motion.states[0, 0], still, motion.sequence[0])]
    for i, mode in enumerate(motion.sequence):
        t = phase_starts[i]
        if durations[i].sum() <= SAME_TIME_S:
            continue
        if t <= knots[-1].t + SAME_TIME_S:
            t = knots.pop().t
        for k, duration in enumerate(durations[i]):
            if duration > 0.0:
                velocity = motion.inputs[i, k] / duration
                knots.append(_Knot(t, motion.states[i, k], velocity, mode))
                t += float(duration)
        knots.append(_Knot(t, motion.states[i, -1], still, mode))
    return knots


def _on_path(
    knots: list[_Knot], times: Array, robot: Robot
) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Times, configurations, inputs and modes of the knots, and at further times between them."""
    known, q, v, mode = (np.array(column) for column in zip(*knots, strict=True))
    further = new_times(times, known)
    at = np.searchsorted(known, further, side="right") - 1
    between = flown(robot, q[at], v[at] * (further - known[at])[:, None], mode[at])
    t = np.concatenate([known, further])
    order = np.argsort(t, kind="stable")
    rows = np.concatenate([np.arange(len(known)), at])[order]
    return t[order], np.concatenate([q, between])[order], v[rows], mode[rows]
