"""How much of a segment is molten, from the heater's known current and a lagging sensor.

On the melting plateau the temperature says nothing about the melt fraction, so a model of the
segment is propagated with the current that was applied, and a model of its sensor with it. Two
corrections keep it honest. Off the plateau, the gap between real and predicted reading pulls the
temperature. And metal is all liquid only if a reading clearly above the plateau says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from twosra_mpc.control.thermistor import Lag, follow
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.two_node import TwoNode

State = tuple[float, ...]

_CORRECTION_PER_S = 0.05  # a tenth of where it turns unstable, with lags of 4 s and 4 s


class Estimate(NamedTuple):
    """State of the segment's model, and of its sensor's two lags [C]."""

    state: State
    lag: Lag


class MeltObserver(Protocol):
    """Estimates the state of a segment."""

    @property
    def model(self) -> Lumped | TwoNode:
        """The segment as the observer knows it."""

    def start(self, measured_C: float) -> Estimate:
        """Estimate of a segment that has rested at this temperature."""

    def predict(self, estimate: Estimate, current_A: float, duration_s: float) -> Estimate:
        """Estimate after a constant current."""

    def correct(self, estimate: Estimate, measured_C: float, duration_s: float) -> Estimate:
        """Pull the estimate towards a reading that stands for the last ``duration_s``."""

    def found(self, stiffness: Stiffness, estimate: Estimate) -> Estimate:
        """Estimate once the segment is known to be all liquid, or all solid."""


@dataclass(frozen=True)
class LumpedObserver:
    """Observer of a segment with a melting plateau.

    Attributes:
        model: The segment.
        lags_s: Time constants of its sensor.
        liquid_above_C: A reading up to here does not prove that all metal is liquid.
    """

    model: Lumped
    lags_s: tuple[float, float]
    liquid_above_C: float

    def start(self, measured_C: float) -> Estimate:
        """Take metal about its melting point as half molten: its temperature does not tell."""
        state, melting_C = self.model.initial(measured_C), self.model.melting_point_C
        if abs(measured_C - melting_C) <= self.liquid_above_C - melting_C:
            state = (self.model.latent_J / 2,)
        return Estimate(state, (measured_C, measured_C))

    def predict(self, estimate: Estimate, current_A: float, duration_s: float) -> Estimate:
        """Propagate segment and sensor."""
        return _predicted(self.model, self.lags_s, estimate, current_A, duration_s)

    def correct(self, estimate: Estimate, measured_C: float, duration_s: float) -> Estimate:
        """Pull solid and liquid metal; a reading not above the plateau proves no liquid."""
        (h,), model = estimate.state, self.model
        pull_K = _CORRECTION_PER_S * duration_s * (measured_C - estimate.lag[1])
        if h < 0:
            h += model.heat_solid_J_per_K * pull_K
        elif h > model.latent_J:
            h += model.heat_liquid_J_per_K * pull_K
        if measured_C <= self.liquid_above_C:
            h = min(h, model.latent_J)
        return Estimate((h,), estimate.lag)

    def found(self, stiffness: Stiffness, estimate: Estimate) -> Estimate:
        """Move the heat to that end of the plateau, unless it is beyond."""
        (h,) = estimate.state
        h = max(h, self.model.latent_J) if stiffness == "soft" else min(h, 0.0)
        return Estimate((h,), estimate.lag)


@dataclass(frozen=True)
class TwoNodeObserver:
    """Observer of a segment whose stiffness is a matter of its core temperature.

    Attributes:
        model: The segment.
        lags_s: Time constants of its sensor.
    """

    model: TwoNode
    lags_s: tuple[float, float]

    def start(self, measured_C: float) -> Estimate:
        """Take core and body as equally warm."""
        return Estimate(self.model.initial(measured_C), (measured_C, measured_C))

    def predict(self, estimate: Estimate, current_A: float, duration_s: float) -> Estimate:
        """Propagate segment and sensor."""
        return _predicted(self.model, self.lags_s, estimate, current_A, duration_s)

    def correct(self, estimate: Estimate, measured_C: float, duration_s: float) -> Estimate:
        """Pull the core."""
        core, body = estimate.state
        pull_K = _CORRECTION_PER_S * duration_s * (measured_C - estimate.lag[1])
        return Estimate((core + pull_K, body), estimate.lag)

    def found(self, stiffness: Stiffness, estimate: Estimate) -> Estimate:
        """Move the core to that threshold, unless it is beyond."""
        (core, body), model = estimate.state, self.model
        soft = stiffness == "soft"
        core = max(core, model.liquid_level) if soft else min(core, model.solid_level)
        return Estimate((core, body), estimate.lag)


def _predicted(
    model: Lumped | TwoNode,
    lags_s: tuple[float, float],
    estimate: Estimate,
    current_A: float,
    duration_s: float,
) -> Estimate:
    state = model.propagate(estimate.state, current_A, duration_s)
    before, after = model.temperature_C(estimate.state), model.temperature_C(state)
    return Estimate(state, follow(estimate.lag, lags_s, before, after, duration_s))
