"""Wheel speeds of a phase at the rate of the controller."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.plans.trajectory import Phase, Samples

Array = NDArray[np.float64]

_WHOLE = 1e-9  # rounding of a number of periods


class WheelCommand(NamedTuple):
    """Wheel speeds [rad/s], (4,), for one period, and the plan's time at its start and end [s]."""

    wheel_rad_s: Array
    start_s: float
    end_s: float


def wheel_commands(samples: Samples, phase: Phase, rate_Hz: float) -> list[WheelCommand]:
    """Divide a phase into equal parts, one a period of the controller.

    In each period the wheels turn exactly as far as in that part of the phase. A phase that does
    not last a whole number of periods is stretched to the next: the robot follows the same path a
    little slower, never faster.

    Args:
        samples: Of the plan.
        phase: The phase.
        rate_Hz: Rate of the controller.
    """
    count = max(1, math.ceil((phase.end_s - phase.start_s) * rate_Hz - _WHOLE))
    ends = np.linspace(phase.start_s, phase.end_s, count + 1)
    turned = np.diff(_turned_rad(samples, ends), axis=0)
    return [
        WheelCommand(turned[k] * rate_Hz, float(ends[k]), float(ends[k + 1])) for k in range(count)
    ]


def _turned_rad(samples: Samples, t: Array) -> Array:
    """How far the wheels have turned since the start of the plan, (n, 4)."""
    steps = samples.wheel_rad_s[:-1] * np.diff(samples.t_s)[:, None]
    turned = np.concatenate([np.zeros((1, 4)), np.cumsum(steps, axis=0)])
    return np.column_stack([np.interp(t, samples.t_s, wheel) for wheel in turned.T])
