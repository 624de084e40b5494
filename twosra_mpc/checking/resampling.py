"""A plan with more samples: a plan file is denser where it must be, and stays a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.checking.verification import verify
from twosra_mpc.errors import NoPlanError
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import wheel_travels
from twosra_mpc.model.motion import FINE_STEPS
from twosra_mpc.plans.heating import segment_heating
from twosra_mpc.plans.plan import Plan, Samples
from twosra_mpc.plans.setpoints import SAME_TIME_S, check_rate

Array = NDArray[np.float64]


def refined(plan: Plan, rate_Hz: float) -> Plan:
    """Add samples at a regular rate; those that the plan has stay, since its inputs change there.

    Inputs hold from a sample to the next, as in every plan: what is added repeats the inputs in
    force, on the plan's path and at the temperatures expected there. The outcome is verified anew.

    Raises:
        NoPlanError: If the plan has no samples.
        InputError: If the rate is not positive, or beyond 1000 Hz.
    """
    check_rate(rate_Hz)
    if plan.samples is None:
        raise NoPlanError(plan.status, plan.message)
    samples = _refined(plan, plan.samples, rate_Hz)
    checked = verify(plan.problem, samples, plan.phases, plan.transitions)
    return replace(plan, samples=samples, verification=checked)


def _refined(plan: Plan, samples: Samples, rate_Hz: float) -> Samples:
    known = samples.t_s
    regular = np.arange(int(np.floor(known[-1] * rate_Hz)) + 1) / rate_Hz
    after = np.searchsorted(known, regular).clip(1, len(known) - 1)
    nearest = np.minimum(np.abs(regular - known[after - 1]), np.abs(regular - known[after]))
    t = np.sort(np.concatenate([known, regular[nearest > SAME_TIME_S]]))
    at = np.searchsorted(known, t, side="right") - 1
    q, v, mode = _on_the_path(plan, samples, t, at), samples.v[at], samples.mode[at]
    wheels = wheel_travels(plan.robot, len(t))(q.T, v.T, mode.T).full().T
    heating = segment_heating(plan.problem, plan.transitions)
    metal = [item.temperature_and_melt_fraction(t) for item in heating]
    return Samples(
        t_s=t,
        q=q,
        v=v,
        mode=mode,
        wheel_rad_s=np.where(v.any(axis=1, keepdims=True), wheels, 0.0),
        temperature_C=np.column_stack([temperature for temperature, _ in metal]),
        melt_fraction=np.column_stack([fraction for _, fraction in metal]),
        heater_setpoint_C=samples.heater_setpoint_C[at],
        heater_current_A=samples.heater_current_A[at],
    )


def _on_the_path(plan: Plan, samples: Samples, t: Array, at: NDArray[np.int_]) -> Array:
    """Configuration at each time, from the sample before it with its input."""
    q = samples.q[at].copy()
    travel = samples.v[at] * (t - samples.t_s[at])[:, None]
    moving = np.flatnonzero(travel.any(axis=1))
    if len(moving):
        flow = interval_flow(plan.robot, FINE_STEPS).map(len(moving))
        q[moving] = flow(q[moving].T, travel[moving].T, samples.mode[at][moving].T).full().T
    return q
