"""From a timed motion to samples, and from samples to set-point rows at any rate."""

from __future__ import annotations

import bisect
import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError, NoPlanError
from twosra_mpc.files import write_text
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import wheel_travels
from twosra_mpc.model.motion import FINE_STEPS, Motion
from twosra_mpc.plans.heating import segment_heating
from twosra_mpc.plans.plan import Plan, Samples
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.timing import Transition

Array = NDArray[np.float64]

HOLD_SAMPLE_S = 5.0  # while the robot waits, temperatures are sampled at least this often
HIGHEST_RATE_HZ = 1000.0
SAME_TIME_S = 1e-6  # events closer than this are one sample

COLUMNS = [
    *("t_s", "mode1", "mode2"),
    *("wheel1_rad_s", "wheel2_rad_s", "wheel3_rad_s", "wheel4_rad_s"),
    *("heater1_C", "heater2_C", "current1_A", "current2_A"),
    *("x_m", "y_m", "phi_rad", "kappa1_per_m", "kappa2_per_m"),
    *("temperature1_C", "temperature2_C"),
    *("melt_fraction1", "melt_fraction2"),
]


class _Knot(NamedTuple):
    """From ``t`` to the next knot the robot moves with input ``v`` in ``mode``, or holds (None)."""

    t: float
    q: Array
    v: Array
    mode: Mode | None


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
    heating = segment_heating(problem, transitions)
    times = [0.0, finish_s, *np.arange(0.0, finish_s, HOLD_SAMPLE_S)]
    times += [time for item in heating for time in item.event_times() if time <= finish_s]
    knots = _with_times(_moving(motion, durations, phase_starts), sorted(times), motion)
    t = np.array([knot.t for knot in knots])
    q = np.array([knot.q for knot in knots])
    v = np.array([knot.v for knot in knots])
    just_after = t + 2 * SAME_TIME_S
    metal = [item.temperature_and_melt_fraction(t) for item in heating]
    mode = np.column_stack([item.soft(just_after) for item in heating]).astype(np.int64)
    for row, knot in enumerate(knots):
        if knot.mode is not None:
            mode[row] = knot.mode
    return Samples(
        t_s=t,
        q=q,
        v=v,
        mode=mode,
        wheel_rad_s=_wheel_speeds(motion.robot, q, v, mode),
        temperature_C=np.column_stack([temperature for temperature, _ in metal]),
        melt_fraction=np.column_stack([fraction for _, fraction in metal]),
        heater_setpoint_C=np.column_stack([item.setpoint_C(just_after) for item in heating]),
        heater_current_A=np.column_stack([item.current_A(just_after) for item in heating]),
    )


def _moving(motion: Motion, durations: Array, phase_starts: Sequence[float]) -> list[_Knot]:
    """Knots of the motion alone: the start of every interval, and a stop after every phase."""
    still = np.zeros(5)
    knots = [_Knot(0.0, motion.states[0, 0], still, None)]
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
        knots.append(_Knot(t, motion.states[i, -1], still, None))
    return knots


def _with_times(knots: list[_Knot], times: Sequence[float], motion: Motion) -> list[_Knot]:
    """Add knots at further times, on the path."""
    flow = interval_flow(motion.robot, FINE_STEPS)
    known = [knot.t for knot in knots]
    merged: list[_Knot] = list(knots)
    last = -1.0
    for t in times:
        place = bisect.bisect_right(known, t)
        nearest = min(abs(t - near) for near in known[max(0, place - 1) : place + 1])
        if min(nearest, t - last) <= SAME_TIME_S:
            continue
        last = t
        before = knots[place - 1]
        q = before.q
        if before.mode is not None:
            q = flow(before.q, before.v * (t - before.t), before.mode).full().ravel()
        merged.append(_Knot(float(t), q, before.v, before.mode))
    return sorted(merged, key=lambda knot: knot.t)


def _wheel_speeds(robot: Robot, q: Array, v: Array, mode: NDArray[np.int64]) -> Array:
    speeds: Array = wheel_travels(robot, len(q))(q.T, v.T, mode.T).full().T
    return np.where(np.abs(v).max(axis=1, keepdims=True) > 0, speeds, 0.0)


def rows(samples: Samples, rate_Hz: float | None, robot: Robot) -> tuple[list[str], Array]:
    """Set-points as a table: (column names, rows), on the plan's grid or at a regular rate.

    At a regular rate, inputs are those in force at each time; the configuration follows the path.

    Raises:
        InputError: If the rate is not positive, or beyond 1000 Hz.
    """
    if rate_Hz is not None:
        samples = resampled(samples, rate_Hz, robot)
    table = np.column_stack(
        [
            samples.t_s,
            samples.mode,
            samples.wheel_rad_s,
            samples.heater_setpoint_C,
            samples.heater_current_A,
            samples.q,
            samples.temperature_C,
            samples.melt_fraction,
        ]
    )
    return COLUMNS.copy(), table


def check_rate(rate_Hz: float) -> None:
    """Check a rate of set-points.

    Raises:
        InputError: If it is not positive, or beyond 1000 Hz.
    """
    if not 0 < rate_Hz <= HIGHEST_RATE_HZ:
        raise InputError("rate", rate_Hz, f"more than 0 and at most {HIGHEST_RATE_HZ:g} Hz")


def resampled(samples: Samples, rate_Hz: float, robot: Robot) -> Samples:
    """Samples at a regular rate: inputs in force at each time, configurations on the path.

    Raises:
        InputError: If the rate is not positive, or beyond 1000 Hz.
    """
    check_rate(rate_Hz)
    end = float(samples.t_s[-1])
    t = np.arange(int(np.floor(end * rate_Hz + 1e-9)) + 1) / rate_Hz
    if t[-1] < end - SAME_TIME_S:
        t = np.append(t, end)
    at = np.searchsorted(samples.t_s, t + SAME_TIME_S, side="right") - 1
    travel = samples.v[at] * np.maximum(t - samples.t_s[at], 0.0)[:, None]
    q = samples.q[at].copy()
    moving = np.flatnonzero(travel.any(axis=1))
    if len(moving):
        flow = interval_flow(robot, FINE_STEPS).map(len(moving))
        modes = samples.mode[at][moving]
        q[moving] = flow(q[moving].T, travel[moving].T, modes.T).full().T
    temperature = [np.interp(t, samples.t_s, samples.temperature_C[:, j]) for j in (0, 1)]
    fraction = [np.interp(t, samples.t_s, samples.melt_fraction[:, j]) for j in (0, 1)]
    return Samples(
        t_s=t,
        q=q,
        v=samples.v[at],
        mode=samples.mode[at],
        wheel_rad_s=samples.wheel_rad_s[at],
        temperature_C=np.column_stack(temperature),
        melt_fraction=np.column_stack(fraction),
        heater_setpoint_C=samples.heater_setpoint_C[at],
        heater_current_A=samples.heater_current_A[at],
    )


def save_setpoints(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write the set-points of a plan as CSV, one row a sample, atomically.

    Raises:
        NoPlanError: If the plan has no samples.
        InputError: If the rate or the path is not acceptable.
    """
    if plan.samples is None:
        raise NoPlanError(plan.status, plan.message)
    names, table = rows(plan.samples, rate_Hz, plan.robot)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in table:
        writer.writerow(
            [int(value) if i in (1, 2) else float(value) for i, value in enumerate(row)]
        )
    write_text(path, text.getvalue())
