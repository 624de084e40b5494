"""Segment models: what every one of them offers, and what follows from that alone."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

State = tuple[float, ...]
Array = NDArray[np.float64]
# A number, or one for each of many times: what is asked for many times at once is not asked often.
Values = TypeVar("Values", float, NDArray[np.float64])


class SegmentModel(Protocol):
    """A segment with its heater: exact propagation at constant current, and times to thresholds.

    A segment is solid while ``level(state) <= solid_level``, liquid from ``liquid_level`` on, and
    changing in between. At constant current the level rises or falls, and warmer stays warmer:
    of two states the one that is nowhere colder never becomes colder anywhere.

    It is a frozen dataclass whose fields are its parameters, plain numbers.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    replay_tolerance: ClassVar[float]
    """Share of a transition's time by which replayed currents miss it: holding ones are means."""

    def __hash__(self) -> int: ...

    @property
    def solid_level(self) -> float:
        """Level up to which the segment is solid."""

    @property
    def liquid_level(self) -> float:
        """Level from which on it is liquid."""

    @property
    def ambient_C(self) -> float:
        """Temperature of the air."""

    def initial(
        self, temperature_C: float, melt_fraction: float | None = None, body_C: float | None = None
    ) -> State:
        """State of a segment that has this temperature throughout, unless told of its body.

        Where metal of one temperature may be molten more or less, the fraction tells.
        """

    def extremes(self, state: State) -> tuple[State, State]:
        """States nowhere warmer and nowhere colder than any that follows without heat."""

    def level(self, state: tuple[Values, ...]) -> Values:
        """Quantity that rises and falls through the thresholds, in the model's own unit."""

    def level_at(self, temperature_C: float) -> float:
        """Level at a temperature; where the metal melts, of the solid."""

    def at_level(self, state: State, level: float) -> State:
        """State whose level is this, the rest of the segment being as in ``state``."""

    def warmed(self, state: State, by_K: float) -> State:
        """State whose metal is so much warmer; where heat does not warm it, the same."""

    def temperature_C(self, state: tuple[Values, ...]) -> Values:
        """Temperature of the metal; of each, where the state's values are arrays."""

    def melt_fraction(self, state: tuple[Values, ...]) -> Values:
        """Melt fraction, 0 (solid) to 1 (liquid); of each, where the state has arrays."""

    def propagate(self, state: State, current_A: float, duration_s: Values) -> tuple[Values, ...]:
        """State after a constant current; an array of durations gives arrays of values."""

    def hold(self, state: State, duration_s: Values) -> tuple[Values, ...]:
        """State after an ideal controller has kept the temperature, likewise."""

    def time_until(self, state: State, current_A: float, level: float) -> float:
        """Time at constant current until the level is first reached [s]; inf if never."""

    def temperature_in(self, other: Self, state: tuple[Array, ...]) -> Array:
        """Temperature in a state of another model, were its metal of this kind; of arrays, too."""

    def rates_in(
        self, other: Self, state: tuple[Array, ...], here_C: Array, current_A: Array | float
    ) -> tuple[Array, ...]:
        """Rates of a state of another model, were its metal of this kind, and so warm."""

    def power_W(self, current_A: float, temperature_C: float) -> float:
        """Heater power."""

    def energy_J(self, state: State, current_A: float, duration_s: float) -> float:
        """Heater energy at constant current."""

    def holding_current_A(self, state: State, duration_s: float = 0.0) -> float:
        """Current that keeps the temperature now, or has the energy that keeps it for so long."""

    def holding_energy_J(self, state: State, duration_s: float) -> float:
        """Heater energy of keeping the temperature."""


def exponential(values: Values) -> Values:
    """Return e to the power of a number, or of each."""
    return np.exp(values) if isinstance(values, np.ndarray) else math.exp(values)


def replayed(
    model: SegmentModel, state: State, t: NDArray[np.float64], current_A: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Values of a segment's state at every time, each (m,).

    Args:
        model: The segment.
        state: At the first time.
        t: Times in order [s], (m,).
        current_A: Heater current from each time to the next, (m,).
    """
    found = np.tile(np.array(state)[:, None], len(t))
    turns = np.flatnonzero(np.diff(current_A[: len(t) - 1])) + 1
    for begin, end in itertools.pairwise([0, *turns.tolist(), len(t) - 1]):
        since = slice(begin + 1, end + 1)
        here = tuple(found[:, begin].tolist())
        found[:, since] = model.propagate(here, float(current_A[begin]), t[since] - t[begin])
    return tuple(found)


def thresholds_C(model: SegmentModel) -> tuple[float, float]:
    """Temperatures up to which a segment is solid, and from which on liquid; equal on a plateau."""
    cold = model.initial(model.ambient_C)
    solid, liquid = (
        model.temperature_C(model.at_level(cold, level))
        for level in (model.solid_level, model.liquid_level)
    )
    return solid, liquid


class ReferenceTimes(NamedTuple):
    """Times of a melt from the air's temperature and a freeze from the set-point [s]; inf: never.

    Attributes:
        lead_s: Heater on to the onset of melting.
        melt_s: Heater on to molten.
        coasting_s: Heater off to the onset of freezing.
        freeze_s: Heater off to solid.
    """

    lead_s: float
    melt_s: float
    coasting_s: float
    freeze_s: float


def reference_times(
    model: SegmentModel, melt_current_A: float, soft_setpoint_C: float
) -> ReferenceTimes:
    """Transitions of a segment that was cold, at full current and without current."""
    cold = model.initial(model.ambient_C)
    lead, melt, heating = (
        model.time_until(cold, melt_current_A, level)
        for level in (model.solid_level, model.liquid_level, model.level_at(soft_setpoint_C))
    )
    if heating == math.inf:
        return ReferenceTimes(lead, melt, math.inf, math.inf)
    hot = model.propagate(cold, melt_current_A, heating)
    levels = model.liquid_level, model.solid_level
    coasting, freeze = (model.time_until(hot, 0.0, level) for level in levels)
    return ReferenceTimes(lead, melt, coasting, freeze)


_EXACT_S, _UNIT = 1e-12, 2.0**-52  # absolute, and the rounding of a float


Point = tuple[float, float]  # time [s] and value


def crossing(
    function: Callable[[float], float], low: Point, high: Point, first: float | None = None
) -> float:
    """Time at which ``function`` is zero, between two points that it is known at.

    Chandrupatla's method (Advances in Engineering Software 28, 1997): inverse quadratic
    interpolation where that is safe, else bisection. Exact to 1e-12 s and rounding.

    Args:
        function: Of time; its signs differ at the two points.
        low: The earlier one.
        high: The later one.
        first: Where to look first; without, where the secant is zero.
    """
    (a, at_a), (b, at_b) = low, high
    x = a + at_a / (at_a - at_b) * (b - a) if first is None else first
    while True:
        if (at_x := function(x)) == 0:
            return x
        if (at_x < 0) == (at_a < 0):
            c, at_c = a, at_a
        else:
            c, at_c, b, at_b = b, at_b, a, at_a
        a, at_a = x, at_x
        best = a if abs(at_a) < abs(at_b) else b
        least = (_EXACT_S + 4 * _UNIT * abs(best)) / abs(b - a)
        if least > 0.5:
            return best
        part, rise = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        share = 0.5
        if 1 - math.sqrt(1 - part) < rise < math.sqrt(part):
            share = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            share += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
        x = a + min(1 - least, max(least, share)) * (b - a)
