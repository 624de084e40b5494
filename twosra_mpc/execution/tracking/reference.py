"""The plan's path in one phase, ready to be looked up at any time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.plans.trajectory import Phase, Trajectory

Array = NDArray[np.float64]

PARTS = 8  # grid points per sampling period; in between, the reference is interpolated linearly


class PhaseReference:
    """Outputs along a phase, resting at its start before it and at its end after it.

    A tracker asks for a horizon of them within a millisecond: so the trajectory is asked once.
    """

    def __init__(
        self,
        trajectory: Trajectory,
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
        outputs = trajectory.configuration(t) @ selection.T
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
