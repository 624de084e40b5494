"""From a timed motion to the samples of a plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.flow import Motion
from twosra_mpc.plans.speed_profile import SpeedProfile
from twosra_mpc.plans.trajectory import SAME_TIME_S, Samples, flown, new_times, wheel_speeds
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import INPUTS, WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.timing import Transition, transition_model

HOLD_SAMPLE_S = 5.0  # while the robot waits, temperatures are sampled at least this often


def sample(
    problem: Problem,
    motion: Motion,
    profiles: Sequence[SpeedProfile],
    phase_starts: Sequence[float],
    finish_s: float,
    transitions: Sequence[Transition],
) -> Samples:
    """Put a motion on the clock: every change of speed, heater event, and regular hold samples.

    Args:
        problem: The problem.
        motion: Path of the phases.
        profiles: How fast each phase is travelled.
        phase_starts: Start of each phase [s].
        finish_s: End of the plan [s].
        transitions: Melts and freezes.
    """
    heating = transition_model(problem).heating(transitions)
    events = [time for item in heating for time in item.event_times() if time <= finish_s]
    times = np.array(sorted({0.0, finish_s, *np.arange(0.0, finish_s, HOLD_SAMPLE_S), *events}))
    t, q, v, a, mode, wheel_rad_s = _on_path(
        _knots(motion, profiles, phase_starts), times, problem.robot
    )
    just_after = t + 2 * SAME_TIME_S
    resting = ~(v.any(axis=1) | a.any(axis=1))
    soft = np.column_stack([item.soft(just_after) for item in heating])
    mode[resting] = soft[resting]
    metal = np.stack([item.temperature_and_melt_fraction(t) for item in heating], -1)
    return Samples(
        t_s=t,
        q=q,
        v=v,
        a=a,
        mode=mode,
        wheel_rad_s=wheel_rad_s,
        temperature_C=metal[0],
        melt_fraction=metal[1],
        heater_setpoint_C=np.column_stack([item.setpoint_C(just_after) for item in heating]),
        heater_current_A=np.column_stack([item.current_A(just_after) for item in heating]),
    )


Knots = tuple[Array, Array, Array, Array, NDArray[np.int64], Array]
"""Times, q, v, a, modes and wheel speeds, by rows."""


def _knots(
    motion: Motion, profiles: Sequence[SpeedProfile], phase_starts: Sequence[float]
) -> Knots:
    """The motion alone: the start of every piece of its profiles, and a stop after every phase.

    From each row on the robot moves with input v + a (t' - t) in its mode, or rests.
    """
    still, resting, modes = np.zeros((1, INPUTS)), np.zeros((1, WHEELS)), np.array(motion.sequence)
    found = [(np.zeros(1), motion.states[0, :1], still, still, modes[:1], resting)]
    for i, profile in enumerate(profiles):
        start = phase_starts[i]
        if profile.duration_s <= SAME_TIME_S:
            continue
        stop = float(found[-1][0][-1])
        if start <= stop + SAME_TIME_S:
            start = stop
            t, q, v, a, mode, wheels = found[-1]
            found[-1] = t[:-1], q[:-1], v[:-1], a[:-1], mode[:-1], wheels[:-1]
        k = np.minimum(profile.x[:-1].astype(int), len(motion.inputs[i]) - 1)
        s = motion.inputs[i, k]
        found.append(
            (
                start + profile.time_s,
                np.concatenate([profile.q[:-1], motion.states[i, -1:]]),
                np.concatenate([s * profile.speed[:, None], still]),
                np.concatenate([s * profile.acceleration[:, None], still]),
                np.tile(modes[i], (len(k) + 1, 1)),
                np.concatenate([profile.wheel_rad_s, resting]),
            )
        )
    t, q, v, a, mode, wheels = (np.concatenate(column) for column in zip(*found, strict=True))
    return t, q, v, a, mode, wheels


def _on_path(knots: Knots, times: Array, robot: Robot) -> Knots:
    """The knots, and what is between them at further times."""
    known, q, v, a, mode, wheels = knots
    further = new_times(times, known)
    at = np.searchsorted(known, further, side="right") - 1
    elapsed = (further - known[at])[:, None]
    between = flown(robot, q[at], (v[at] + a[at] * elapsed / 2) * elapsed, mode[at])
    later = v[at] + a[at] * elapsed
    t = np.concatenate([known, further])
    order = np.argsort(t, kind="stable")
    rows = np.concatenate([np.arange(len(known)), at])[order]
    q, v, wheels = (
        np.concatenate(each)[order]
        for each in (
            (q, between),
            (v, later),
            (wheels, wheel_speeds(robot, between, later, mode[at])),
        )
    )
    return t[order], q, v, a[rows], mode[rows], wheels
