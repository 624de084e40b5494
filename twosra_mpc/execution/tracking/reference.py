"""The plan's path in one phase, ready to be looked up at any time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.flow import interval_flow
from twosra_mpc.plans.trajectory import Phase, Samples
from twosra_mpc.robot.description import Robot

Array = NDArray[np.float64]

PARTS = 8  # grid points per sampling period; in between, the reference is interpolated linearly
STEPS = 8  # Runge-Kutta steps from a sample of the plan to a grid point
SAME_TIME_S = 1e-6


class PhaseReference:
    """Outputs along a phase, resting at its start before it and at its end after it."""

    def __init__(
        self,
        robot: Robot,
        samples: Samples,
        phase: Phase,
        selection: Array,
        horizon: int,
        period_s: float,
    ) -> None:
        """Put outputs y = ``selection`` q on a grid that looks ``horizon`` periods either way."""
        self._grid_s = period_s / PARTS
        self._rest = horizon * PARTS
        count = int(np.ceil((phase.end_s - phase.start_s) / self._grid_s)) + 1
        t = np.minimum(phase.start_s + self._grid_s * np.arange(count), phase.end_s)
        outputs = _configurations(robot, samples, phase, t) @ selection.T
        self._outputs = np.pad(outputs, [(self._rest, self._rest + 2), (0, 0)], mode="edge")
        self._slopes = np.diff(self._outputs, axis=0)
        self._start_s = phase.start_s
        self._last = float(count - 1 + self._rest)
        self._span = horizon * PARTS + 1

    def write(self, time_s: float, into: Array) -> None:
        """Write the outputs at ``time_s`` of the plan and at the samples that follow."""
        place = (time_s - self._start_s) / self._grid_s + self._rest
        place = min(max(place, 0.0), self._last)
        first = int(place)
        rows = slice(first, first + self._span, PARTS)
        np.multiply(self._slopes[rows], place - first, out=into)
        into += self._outputs[rows]


def _configurations(robot: Robot, samples: Samples, phase: Phase, t: Array) -> Array:
    """Configurations of the plan at times within a phase, (len(t), 5)."""
    at = np.searchsorted(samples.t_s, t + SAME_TIME_S, side="right") - 1
    travel = samples.v[at] * np.maximum(t - samples.t_s[at], 0.0)[:, None]
    flow = interval_flow(robot, STEPS).map(len(t))
    q: Array = flow(samples.q[at].T, travel.T, np.tile(phase.mode, (len(t), 1)).T).full().T
    return q
