"""One segment's heater and state over time, piece by piece, from the segment model."""

from __future__ import annotations

import enum
import itertools
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.thermal.model import SegmentModel, State

Array = NDArray[np.float64]


class Heating(enum.Enum):
    """What the heater does during a piece."""

    OFF = "off"
    MELT = "full current"
    HOLD = "hold the temperature"


@dataclass(frozen=True)
class Piece:
    """From ``start_s`` on: state then, what the heater does, and its set-point [C]."""

    start_s: float
    state: State
    heating: Heating
    setpoint_C: float


@dataclass(frozen=True)
class TemperatureTrajectory:
    """A segment's pieces in order; the last one has no end.

    Attributes:
        model: The segment model.
        melt_current_A: Full current.
        pieces: At least one, the first from t = 0.
    """

    model: SegmentModel
    melt_current_A: float
    pieces: tuple[Piece, ...]

    def extended(self, *pieces: Piece) -> TemperatureTrajectory:
        """Return the same trajectory with more pieces."""
        return TemperatureTrajectory(self.model, self.melt_current_A, (*self.pieces, *pieces))

    def state_at(self, time_s: float) -> State:
        """State of the segment."""
        piece = self.pieces[self._index(time_s)]
        return self._advanced(piece, max(0.0, time_s - piece.start_s))

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        """Temperature [C] and melt fraction at each time."""
        states = [self.state_at(time) for time in t.tolist()]
        temperature = [self.model.temperature_C(state) for state in states]
        return np.array(temperature), np.array([self.model.melt_fraction(s) for s in states])

    def setpoint_C(self, t: Array) -> Array:
        """Temperature set-point from each time to the next [C]."""
        return np.array([self.pieces[self._index(time)].setpoint_C for time in t.tolist()])

    def current_A(self, t: Array) -> Array:
        """Heater current from each time to the next, of the right energy where it varies [A]."""
        pairs = itertools.pairwise([*t.tolist(), np.inf])
        return np.array([self._mean_current(a, b) for a, b in pairs])

    def event_times(self) -> list[float]:
        """Times at which set-point or current change [s]."""
        return self._starts

    def energy_J(self, until_s: float) -> float:
        """Heater energy from t = 0."""
        ends = [piece.start_s for piece in self.pieces[1:]] + [until_s]
        total = 0.0
        for piece, end in zip(self.pieces, ends, strict=True):
            duration = min(end, until_s) - piece.start_s
            if duration <= 0:
                continue
            match piece.heating:
                case Heating.MELT:
                    total += self.model.energy_J(piece.state, self.melt_current_A, duration)
                case Heating.HOLD:
                    total += self.model.holding_energy_J(piece.state, duration)
                case Heating.OFF:
                    pass
        return total

    @cached_property
    def _starts(self) -> list[float]:
        return [piece.start_s for piece in self.pieces]

    def _index(self, time_s: float) -> int:
        return max(0, bisect_right(self._starts, time_s) - 1)

    def _advanced(self, piece: Piece, duration_s: float) -> State:
        match piece.heating:
            case Heating.HOLD:
                return self.model.hold(piece.state, duration_s)
            case Heating.MELT:
                return self.model.propagate(piece.state, self.melt_current_A, duration_s)
            case Heating.OFF:
                return self.model.propagate(piece.state, 0.0, duration_s)

    def _mean_current(self, start_s: float, end_s: float) -> float:
        piece = self.pieces[self._index(start_s)]
        match piece.heating:
            case Heating.OFF:
                return 0.0
            case Heating.MELT:
                return self.melt_current_A
            case Heating.HOLD:
                state = self.state_at(start_s)
                steady = self.model.holding_current_A(state)
                duration = end_s - start_s
                if not 0 < duration < np.inf or steady == 0:
                    return steady
                temperature = self.model.temperature_C(state)
                mean = self.model.holding_energy_J(state, duration) / duration
                return float(np.sqrt(mean / self.model.power_W(1.0, temperature)))
