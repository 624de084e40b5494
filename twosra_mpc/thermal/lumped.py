r"""The lumped enthalpy model: one heat content, one melting plateau, solved in closed form.

With enthalpy H (zero where the solid reaches the melting point T_m), latent heat L, loss G and a
copper coil of resistance R at 25 C,

.. math::
    T(H) = T_m + H / C_s \;(H < 0), \quad T_m \;(0 \le H \le L), \quad
    T_m + (H - L) / C_l \;(H > L),

.. math:: \dot H = I^2 R\,[1 + \alpha (T - 25)] - G (T - T_a).

At constant current I, A = I^2 R [1 + alpha (T_a - 25)] and b = G - alpha I^2 R, the temperature of
a solid or liquid segment follows ``C dT/dt = A - b (T - T_a)``; on the plateau H grows linearly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from twosra_mpc.thermal.model import Array, State, Values


@dataclass(frozen=True)
class Lumped:
    """Segment of one heat content, its heater and the air around it. A state is (H,) [J].

    Attributes:
        heat_solid_J_per_K: C_s.
        heat_liquid_J_per_K: C_l.
        latent_J: L.
        loss_W_per_K: G.
        resistance_ohm: R, at 25 C.
        temperature_coefficient_per_K: alpha of the coil.
        melting_point_C: T_m.
        ambient_C: T_a.
    """

    replay_tolerance: ClassVar[float] = 0.0
    solid_level: ClassVar[float] = 0.0
    """Enthalpy up to which the segment is solid."""

    heat_solid_J_per_K: float
    heat_liquid_J_per_K: float
    latent_J: float
    loss_W_per_K: float
    resistance_ohm: float
    temperature_coefficient_per_K: float
    melting_point_C: float
    ambient_C: float

    @property
    def liquid_level(self) -> float:
        """Enthalpy from which on the segment is liquid."""
        return self.latent_J

    def level(self, state: tuple[Values, ...]) -> Values:
        """Return the heat content that rises and falls through the thresholds: H [J]."""
        return state[0]

    def level_at(self, temperature_C: float) -> float:
        """Enthalpy at a temperature; at the melting point, of the solid [J]."""
        above = temperature_C - self.melting_point_C
        if above > 0:
            return self.latent_J + self.heat_liquid_J_per_K * above
        return self.heat_solid_J_per_K * above

    def initial(
        self, temperature_C: float, melt_fraction: float | None = None, body_C: float | None = None
    ) -> State:
        """State of a segment that has this temperature, and so much of which is molten."""
        del body_C
        if melt_fraction is None:
            return (self.level_at(temperature_C),)
        above = temperature_C - self.melting_point_C
        heat_J_per_K = self.heat_liquid_J_per_K if above > 0 else self.heat_solid_J_per_K
        return (melt_fraction * self.latent_J + heat_J_per_K * above,)

    def extremes(self, state: State) -> tuple[State, State]:
        """Heat content goes to that of the air."""
        rest = self.initial(self.ambient_C)
        return min(state, rest), max(state, rest)

    def at_level(self, state: State, level: float) -> State:
        """State at this enthalpy; there is nothing else to the segment."""
        del state
        return (level,)

    def warmed(self, state: State, by_K: float) -> State:
        """State at more enthalpy; on the plateau the same."""
        (h,) = state
        if 0 <= h <= self.latent_J:
            return state
        return (h + (self.heat_solid_J_per_K if h < 0 else self.heat_liquid_J_per_K) * by_K,)

    def temperature_C(self, state: tuple[Values, ...]) -> Values:
        """Temperature of the metal [C]."""
        (h,) = state
        if isinstance(h, np.ndarray):
            solid, liquid = np.minimum(h, 0.0), np.maximum(h - self.latent_J, 0.0)
            warmer = solid / self.heat_solid_J_per_K + liquid / self.heat_liquid_J_per_K
            return self.melting_point_C + warmer
        if h < 0:
            return self.melting_point_C + h / self.heat_solid_J_per_K
        return self.melting_point_C + max(0.0, h - self.latent_J) / self.heat_liquid_J_per_K

    def temperature_in(self, other: Lumped, state: tuple[Array, ...]) -> Array:
        """Temperature of metal of this kind, as far from melting as in another model [C]."""
        return other.temperature_C(state) + (self.melting_point_C - other.melting_point_C)

    def rates_in(
        self, other: Lumped, state: tuple[Array, ...], here_C: Array, current_A: Array | float
    ) -> tuple[Array, ...]:
        """Rate of metal of this kind, as far from melting as in another model, there [W]."""
        (h,) = state
        coil = self.resistance_ohm * (1 + self.temperature_coefficient_per_K * (here_C - 25.0))
        power_W = current_A**2 * coil - self.loss_W_per_K * (here_C - self.ambient_C)
        liquid_share = other.heat_liquid_J_per_K / self.heat_liquid_J_per_K
        share = np.where(
            h < 0.0,
            other.heat_solid_J_per_K / self.heat_solid_J_per_K,
            np.where(h < other.latent_J, other.latent_J / self.latent_J, liquid_share),
        )
        return (power_W * share,)

    def melt_fraction(self, state: tuple[Values, ...]) -> Values:
        """Share of the metal that is liquid."""
        share = state[0] / self.latent_J
        if isinstance(share, np.ndarray):
            return np.clip(share, 0.0, 1.0)
        return min(1.0, max(0.0, share))

    def power_W(self, current_A: float, temperature_C: float) -> float:
        """Heater power at this current and coil temperature."""
        warmer = self.temperature_coefficient_per_K * (temperature_C - 25.0)
        return current_A**2 * self.resistance_ohm * (1 + warmer)

    def hold(self, state: State, duration_s: Values) -> tuple[Values, ...]:
        """State after an ideal controller has held it: the same."""
        if isinstance(duration_s, np.ndarray):
            return (np.full(duration_s.shape, state[0]),)
        return state

    def holding_current_A(self, state: State, duration_s: float = 0.0) -> float:
        """Current whose heat makes up for the loss, at any time."""
        del duration_s
        lost = max(0.0, -self._regime(state[0], 0.0).rate_W)
        return math.sqrt(lost / self.power_W(1.0, self.temperature_C(state)))

    def holding_energy_J(self, state: State, duration_s: float) -> float:
        """Heat that holding the state takes."""
        return max(0.0, -self._regime(state[0], 0.0).rate_W) * duration_s

    def propagate(self, state: State, current_A: float, duration_s: Values) -> tuple[Values, ...]:
        """State after a constant current, exactly, through however many regimes."""
        if not isinstance(duration_s, np.ndarray):
            (after,) = state
            for _, _, end, _ in self._passed(after, current_A, duration_s):
                after = end
            return (after,)
        each, since = np.full(duration_s.shape, state[0]), 0.0
        longest = float(duration_s.max(initial=0.0))
        for regime, h, _, spent in self._passed(state[0], current_A, longest):
            later = duration_s > since
            each[later] = regime.after(h, duration_s[later] - since)
            since += spent
        return (each,)

    def time_until(self, state: State, current_A: float, level: float) -> float:
        """Time at constant current until H reaches ``level`` [s]; inf if it never does."""
        (h,) = state
        total = 0.0
        while h != level:
            regime = self._regime(h, current_A)
            if regime.rate_W == 0 or (level > h) != (regime.rate_W > 0):
                return math.inf
            edge = regime.edge
            stop = level if edge is None or (level < edge) == (regime.rate_W > 0) else edge
            needed = regime.time_to(h, stop)
            if needed == math.inf:
                return math.inf
            total, h = total + needed, stop
        return total

    def energy_J(self, state: State, current_A: float, duration_s: float) -> float:
        """Heat the coil gives off at constant current."""
        passed = self._passed(state[0], current_A, duration_s)
        return sum((self._energy_within(*each, current_A) for each in passed), start=0.0)

    def _passed(
        self, h: float, current_A: float, duration_s: float
    ) -> Iterator[tuple[_Regime, float, float, float]]:
        """Yield (regime, H before, H after, duration) of each regime passed through."""
        left = duration_s
        while left > 0:
            regime, spent = self._regime(h, current_A), left
            after, edge = regime.after(h, left), regime.edge
            if edge is not None and (after < edge) != (h < edge):
                after, spent = edge, regime.time_to(h, edge)
            yield regime, h, after, spent
            h, left = after, left - spent

    def _regime(self, h: float, current_A: float) -> _Regime:
        """The regime that H moves through at constant current."""
        temperature = self.temperature_C((h,))
        loss = self.loss_W_per_K * (temperature - self.ambient_C)
        rate = self.power_W(current_A, temperature) - loss
        up, liquid = rate > 0, self.latent_J
        if h < 0 or (h == 0 and not up):
            capacity, edge = self.heat_solid_J_per_K, 0.0 if up else None
        elif h > liquid or (h == liquid and up):
            capacity, edge = self.heat_liquid_J_per_K, liquid if rate < 0 else None
        else:
            capacity, edge = 0.0, liquid if up else 0.0 if rate < 0 else None
        warmer = self.temperature_coefficient_per_K * current_A**2 * self.resistance_ohm
        return _Regime(rate, capacity, self.loss_W_per_K - warmer, edge)

    def _energy_within(
        self, regime: _Regime, h: float, after: float, duration_s: float, current_A: float
    ) -> float:
        """Integral of the heater power, from the heat balance E = H' - H + G int (T - T_a)."""
        a, b = self.power_W(current_A, self.ambient_C), regime.slope_W_per_K
        if abs(b) * duration_s < 1e-9 * regime.capacity_J_per_K or not regime.capacity_J_per_K:
            middle = (self.temperature_C((h,)) + self.temperature_C((after,))) / 2
            return self.power_W(current_A, middle) * duration_s
        warm = (a * duration_s - (after - h)) / b
        return after - h + self.loss_W_per_K * warm


class _Regime(NamedTuple):
    """Motion of H at constant current until it runs into an edge: C dT/dt = A - b (T - T_a).

    Attributes:
        rate_W: Heater power less loss where H is now.
        capacity_J_per_K: C; 0 on the plateau.
        slope_W_per_K: b.
        edge: Enthalpy at which the regime ends [J]; None if H never comes to one.
    """

    rate_W: float
    capacity_J_per_K: float
    slope_W_per_K: float
    edge: float | None

    def time_to(self, h: float, to: float) -> float:
        """Time from one enthalpy to another; inf if it is never reached [s]."""
        rate, capacity, b, _ = self
        ratio = b * (to - h) / (capacity * rate) if capacity else 0.0
        if ratio == 0.0:
            return (to - h) / rate
        return -capacity / b * math.log1p(-ratio) if ratio < 1 else math.inf

    def after(self, h: float, duration_s: Values) -> Values:
        """Enthalpy after some time [J]."""
        rate, capacity, b, _ = self
        if capacity == 0.0 or b == 0.0:
            return h + rate * duration_s
        expm1 = np.expm1 if isinstance(duration_s, np.ndarray) else math.expm1
        return h - rate * capacity / b * expm1(-b / capacity * duration_s)
