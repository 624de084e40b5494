"""How much of a segment is molten, from the heater's known current and a lagging sensor.

On the melting plateau the temperature says nothing about the melt fraction, so a model of the
segment is propagated with the current that was applied, and a model of its sensor with it. Two
corrections keep it honest. Where heat warms the metal, the gap between real and predicted reading
pulls the temperature. And metal with a plateau is all liquid only if a reading clearly above it
says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from twosra_mpc.control.thermistor import Lag, follow
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import SegmentModel, State

_CORRECTION_PER_S = 0.05  # a tenth of where it turns unstable, with lags of 4 s and 4 s


class Estimate(NamedTuple):
    """State of the segment's model, and of its sensor's two lags [C]."""

    state: State
    lag: Lag


@dataclass(frozen=True)
class MeltObserver:
    """Estimates the state of a segment.

    Attributes:
        model: The segment.
        lags_s: Time constants of its sensor.
        about_plateau_C: Readings from the one to the other do not tell solid from liquid metal;
            None for a segment whose temperature always tells.
    """

    model: SegmentModel
    lags_s: tuple[float, float]
    about_plateau_C: tuple[float, float] | None

    def start(self, measured_C: float) -> Estimate:
        """Estimate of a segment that has rested at this temperature; half molten on a plateau."""
        state = self.model.initial(measured_C)
        if self.about_plateau_C is not None:
            low, high = self.about_plateau_C
            if low <= measured_C <= high:
                middle = (self.model.solid_level + self.model.liquid_level) / 2
                state = self.model.at_level(state, middle)
        return Estimate(state, (measured_C, measured_C))

    def predict(self, estimate: Estimate, current_A: float, duration_s: float) -> Estimate:
        """Estimate after a constant current: segment and sensor, propagated."""
        model = self.model
        state = model.propagate(estimate.state, current_A, duration_s)
        before, after = model.temperature_C(estimate.state), model.temperature_C(state)
        return Estimate(state, follow(estimate.lag, self.lags_s, before, after, duration_s))

    def correct(self, estimate: Estimate, measured_C: float, duration_s: float) -> Estimate:
        """Pull the estimate towards a reading that stands for the last ``duration_s``."""
        pull_K = _CORRECTION_PER_S * duration_s * (measured_C - estimate.lag[1])
        state = self.model.warmed(estimate.state, pull_K)
        if self.about_plateau_C is not None and measured_C <= self.about_plateau_C[1]:
            state = self._at_most(state, self.model.liquid_level)
        return Estimate(state, estimate.lag)

    def found(self, stiffness: Stiffness, estimate: Estimate) -> Estimate:
        """Estimate once the segment is known to be all liquid, or all solid."""
        state, liquid_level = estimate.state, self.model.liquid_level
        if stiffness == "rigid":
            state = self._at_most(state, self.model.solid_level)
        elif self.model.level(state) < liquid_level:
            state = self.model.at_level(state, liquid_level)
        return Estimate(state, estimate.lag)

    def _at_most(self, state: State, level: float) -> State:
        return state if self.model.level(state) <= level else self.model.at_level(state, level)
