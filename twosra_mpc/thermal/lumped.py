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

State = tuple[float, ...]


@dataclass(frozen=True)
class Lumped:
    """One segment, its heater and the air around it. A state is (H,) [J].

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

    heat_solid_J_per_K: float
    heat_liquid_J_per_K: float
    latent_J: float
    loss_W_per_K: float
    resistance_ohm: float
    temperature_coefficient_per_K: float
    melting_point_C: float
    ambient_C: float

    @property
    def solid_level(self) -> float:
        """Enthalpy up to which the segment is solid."""
        return 0.0

    @property
    def liquid_level(self) -> float:
        """Enthalpy from which on the segment is liquid."""
        return self.latent_J

    def level(self, state: State) -> float:
        """Return the heat content that rises and falls through the thresholds: H [J]."""
        return state[0]

    def level_at(self, temperature_C: float) -> float:
        """Enthalpy at a temperature; at the melting point, of the solid [J]."""
        above = temperature_C - self.melting_point_C
        if above > 0:
            return self.latent_J + self.heat_liquid_J_per_K * above
        return self.heat_solid_J_per_K * above

    def initial(self, temperature_C: float) -> State:
        """State of a segment that has this temperature throughout."""
        return (self.level_at(temperature_C),)

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

    def temperature_C(self, state: State) -> float:
        """Temperature of the metal [C]."""
        (h,) = state
        if h < 0:
            return self.melting_point_C + h / self.heat_solid_J_per_K
        return self.melting_point_C + max(0.0, h - self.latent_J) / self.heat_liquid_J_per_K

    def melt_fraction(self, state: State) -> float:
        """Share of the metal that is liquid."""
        return min(1.0, max(0.0, state[0] / self.latent_J))

    def power_W(self, current_A: float, temperature_C: float) -> float:
        """Heater power at this current and coil temperature."""
        warmer = self.temperature_coefficient_per_K * (temperature_C - 25.0)
        return current_A**2 * self.resistance_ohm * (1 + warmer)

    def hold(self, state: State, duration_s: float) -> State:
        """State after an ideal controller has held it: the same."""
        del duration_s
        return state

    def holding_current_A(self, state: State) -> float:
        """Current whose heat makes up for the loss."""
        lost = max(0.0, -self._rate(state[0], 0.0))
        return math.sqrt(lost / self.power_W(1.0, self.temperature_C(state)))

    def holding_energy_J(self, state: State, duration_s: float) -> float:
        """Heat that holding the state takes."""
        return max(0.0, -self._rate(state[0], 0.0)) * duration_s

    def propagate(self, state: State, current_A: float, duration_s: float) -> State:
        """State after a constant current, exactly, through however many regimes."""
        ends = [after for _, after, _ in self._passed(state[0], current_A, duration_s)]
        return (ends[-1],) if ends else state

    def time_until(self, state: State, current_A: float, level: float) -> float:
        """Time at constant current until H reaches ``level`` [s]; inf if it never does."""
        (h,) = state
        total = 0.0
        while h != level:
            rate = self._rate(h, current_A)
            if rate == 0 or (level > h) != (rate > 0):
                return math.inf
            edge = self._next_edge(h, current_A)
            stop = level if edge is None or (level < edge) == (rate > 0) else edge
            needed = self._time_within_regime(h, stop, current_A)
            if not math.isfinite(needed):
                return math.inf
            total, h = total + needed, stop
        return total

    def energy_J(self, state: State, current_A: float, duration_s: float) -> float:
        """Heat the coil gives off at constant current."""
        passed = self._passed(state[0], current_A, duration_s)
        spent = (self._energy_within_regime(h, end, current_A, time) for h, end, time in passed)
        return sum(spent, start=0.0)

    def _passed(
        self, h: float, current_A: float, duration_s: float
    ) -> Iterator[tuple[float, float, float]]:
        """Yield (H before, H after, duration) of each regime passed through."""
        left = duration_s
        while left > 0:
            edge, spent = self._next_edge(h, current_A), left
            after = self._within_regime(h, current_A, left, edge)
            if edge is not None and (after < edge) != (h < edge):
                after, spent = edge, self._time_within_regime(h, edge, current_A)
            yield h, after, spent
            h, left = after, left - spent

    def _rate(self, h: float, current_A: float) -> float:
        """Heater power less loss."""
        temperature = self.temperature_C((h,))
        loss = self.loss_W_per_K * (temperature - self.ambient_C)
        return self.power_W(current_A, temperature) - loss

    def _next_edge(self, h: float, current_A: float) -> float | None:
        """Regime boundary that H runs into, or None."""
        rate = self._rate(h, current_A)
        if rate > 0:
            return 0.0 if h < 0 else self.latent_J if h < self.latent_J else None
        if rate < 0:
            return self.latent_J if h > self.latent_J else 0.0 if h > 0 else None
        return None

    def _regime(self, h: float, toward: float | None, current_A: float) -> float:
        """Heat capacity of the regime that H moves through; 0 on the plateau."""
        up = self._rate(h, current_A) > 0 if toward is None else toward > h
        if h < 0 or (h == 0 and not up):
            return self.heat_solid_J_per_K
        if h > self.latent_J or (h == self.latent_J and up):
            return self.heat_liquid_J_per_K
        return 0.0

    def _slope(self, current_A: float) -> float:
        """Return b of C dT/dt = A - b (T - T_a)."""
        warmer = self.temperature_coefficient_per_K * current_A**2 * self.resistance_ohm
        return self.loss_W_per_K - warmer

    def _time_within_regime(self, h: float, to: float, current_A: float) -> float:
        capacity, rate = self._regime(h, to, current_A), self._rate(h, current_A)
        if capacity == 0.0:
            return (to - h) / rate
        b = self._slope(current_A)
        ratio = b * (to - h) / (capacity * rate)
        if ratio == 0.0:
            return (to - h) / rate
        return -capacity / b * math.log1p(-ratio) if ratio < 1 else math.inf

    def _within_regime(
        self, h: float, current_A: float, duration_s: float, edge: float | None
    ) -> float:
        capacity = self._regime(h, edge, current_A)
        rate = self._rate(h, current_A)
        if capacity == 0.0:
            return h + rate * duration_s
        b = self._slope(current_A)
        slow = -b * duration_s / capacity
        grown = math.expm1(slow) / slow if slow else 1.0
        return h + rate * duration_s * grown

    def _energy_within_regime(
        self, h: float, after: float, current_A: float, duration_s: float
    ) -> float:
        """Integral of the heater power, from the heat balance E = H' - H + G int (T - T_a)."""
        capacity = self._regime(h, after, current_A)
        here = self.temperature_C((h,))
        if capacity == 0.0:
            return self.power_W(current_A, here) * duration_s
        a, b = self.power_W(current_A, self.ambient_C), self._slope(current_A)
        if abs(b) * duration_s < 1e-9 * capacity:
            middle = (here + self.temperature_C((after,))) / 2
            return self.power_W(current_A, middle) * duration_s
        warm = (a * duration_s - (after - h)) / b
        return after - h + self.loss_W_per_K * warm
