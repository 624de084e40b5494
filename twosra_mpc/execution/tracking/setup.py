"""Everything the quadratic program of one mode is made from, as one value."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.tracking.outputs import Outputs, outputs_of
from twosra_mpc.execution.tracking.settings import TrackerLimits, TrackerWeights
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Setup:
    """Robot, mode, horizon N, period h and what deviations cost; the numbers that follow."""

    robot: Robot
    mode: Mode
    horizon: int
    period_s: float
    weights: TrackerWeights
    limits: TrackerLimits

    @property
    def outputs(self) -> Outputs:
        """What the mode tracks."""
        return outputs_of(self.mode)

    @property
    def variables(self) -> int:
        """Variables of the program: the deviations, and in soft modes a slack."""
        return self.outputs.count * self.horizon + (1 if self.outputs.bending else 0)

    @property
    def scale(self) -> Array:
        """Deviation of each output that costs one, (m,) [m, m, rad or rad, 1/m]."""
        weights = self.weights
        return self._of_outputs(weights.position_m, weights.heading_rad, weights.curvature_per_m)

    @property
    def largest_deviation(self) -> Array:
        """Deviation of each output at which a prediction starts at most, (m,)."""
        limits = self.limits
        return self._of_outputs(limits.deviation_m, limits.deviation_rad, limits.deviation_per_m)

    def _of_outputs(self, position: float, heading: float, curvature: float) -> Array:
        each = self.robot.coordinates.each(position, heading, curvature)
        values: Array = self.outputs.selection @ each
        return values

    @property
    def rho(self) -> float:
        """Cost of a change of the deviation per period, relative to the deviation itself."""
        return (self.weights.response_s / self.period_s) ** 2

    @property
    def terminal(self) -> float:
        """Cost of the last deviation, for all the periods beyond the horizon."""
        return (1 + math.sqrt(1 + 4 * self.rho)) / 2

    @property
    def decay(self) -> float:
        """What is left of a deviation after one period while no limit is active."""
        return self.rho / (self.rho + self.terminal)

    @property
    def wheel_change(self) -> float:
        """Largest change of a wheel command from one period to the next [rad/s]."""
        return self.limits.wheel_rate_rad_s2 * self.period_s
