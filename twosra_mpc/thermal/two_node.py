r"""The two-node model: a heated core and a slower body around it, fitted to a robot's own log.

With duty u = (I / I_full)^2 of the full heater power,

.. math::
    \dot T_c = p\,u - a (T_c - T_b), \qquad
    \dot T_b = (a / \beta) (T_c - T_b) - b (T_b - T_a).

Linear in the state, so a constant current is propagated by the closed-form exponential of a real
2 x 2 matrix. The time to a core temperature is the root of a sum of two exponentials.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twosra_mpc.thermal.model import Array, State, Values, crossing, exponential

_BRIEF_S = 1e-3  # in which a body that its core warms stays as it is
_HORIZON_S = 1e5  # a threshold not passed in a day is never passed


@dataclass(frozen=True)
class TwoNode:
    """Segment of two nodes, its heater and the air around it. A state is (T_c, T_b) [C].

    Attributes:
        power_K_per_s: p, full heater power per heat capacity of the core.
        coupling_per_s: a, conductance from core to body per heat capacity of the core.
        body_ratio: beta, heat capacity of the body over that of the core.
        body_loss_per_s: b, conductance to the air per heat capacity of the body.
        core_heat_J_per_K: Heat capacity of the core.
        full_current_A: Current of full power.
        solid_level: Core temperature up to which the segment is solid [C].
        liquid_level: Core temperature from which on it is liquid [C].
        ambient_C: T_a.
    """

    replay_tolerance: ClassVar[float] = 1e-4  # the body warms while its core is held

    power_K_per_s: float
    coupling_per_s: float
    body_ratio: float
    body_loss_per_s: float
    core_heat_J_per_K: float
    full_current_A: float
    solid_level: float
    liquid_level: float
    ambient_C: float

    def level(self, state: tuple[Values, ...]) -> Values:
        """Return what rises and falls through the thresholds: the core temperature [C]."""
        return state[0]

    def level_at(self, temperature_C: float) -> float:
        """Level at a core temperature: itself [C]."""
        return temperature_C

    def initial(
        self, temperature_C: float, melt_fraction: float | None = None, body_C: float | None = None
    ) -> State:
        """State of a segment whose core has this temperature, and its body unless told."""
        del melt_fraction  # the core's temperature tells
        return (temperature_C, temperature_C if body_C is None else body_C)

    def extremes(self, state: State) -> tuple[State, State]:
        """All of it as cold, and as warm, as any part or the air."""
        every = (*state, self.ambient_C)
        return self.initial(min(every)), self.initial(max(every))

    def at_level(self, state: State, level: float) -> State:
        """State with the core at this temperature and the body as in ``state``."""
        return (level, state[1])

    def warmed(self, state: State, by_K: float) -> State:
        """State with a warmer core."""
        return (state[0] + by_K, state[1])

    def temperature_C(self, state: tuple[Values, ...]) -> Values:
        """Temperature of the core [C]."""
        return state[0]

    def melt_fraction(self, state: tuple[Values, ...]) -> Values:
        """Melt fraction of the core, between the two thresholds, from 0 (solid) to 1 (liquid)."""
        share = (state[0] - self.solid_level) / (self.liquid_level - self.solid_level)
        if isinstance(share, np.ndarray):
            return np.clip(share, 0.0, 1.0)
        return min(1.0, max(0.0, share))

    def temperature_in(self, other: TwoNode, state: tuple[Array, ...]) -> Array:
        """Temperature of the core, which is the same in another model [C]."""
        del other
        return state[0]

    def rates_in(
        self, other: TwoNode, state: tuple[Array, ...], here_C: Array, current_A: Array | float
    ) -> tuple[Array, ...]:
        """Rates of both temperatures, which are the same in another model [K/s]."""
        del other, here_C
        flow = self.coupling_per_s * (state[0] - state[1])
        body = flow / self.body_ratio - self.body_loss_per_s * (state[1] - self.ambient_C)
        return self.power_K_per_s * (current_A / self.full_current_A) ** 2 - flow, body

    def power_W(self, current_A: float, temperature_C: float) -> float:
        """Heater power at this current; its coil is taken to keep its resistance."""
        del temperature_C
        return self.core_heat_J_per_K * self._heating(current_A)

    def propagate(self, state: State, current_A: float, duration_s: Values) -> tuple[Values, ...]:
        """State after a constant current, exactly."""
        a = self.coupling_per_s
        core, body, fast, slow, c_fast, c_slow = self._course(state, current_A)
        left_fast = c_fast * exponential(fast * duration_s)
        left_slow = c_slow * exponential(slow * duration_s)
        b = left_fast * (1 + fast / a) + left_slow * (1 + slow / a)
        return core + (left_fast + left_slow), body + b

    def hold(self, state: State, duration_s: Values) -> tuple[Values, ...]:
        """State after the core has been held at its temperature by an ideal controller."""
        core, body = state
        leave = self.coupling_per_s / self.body_ratio
        settled = (leave * core + self.body_loss_per_s * self.ambient_C) / (
            leave + self.body_loss_per_s
        )
        decay = exponential(-(leave + self.body_loss_per_s) * duration_s)
        return (core + 0.0 * decay, settled + (body - settled) * decay)

    def holding_current_A(self, state: State, duration_s: float = 0.0) -> float:
        """Current that keeps the core at its temperature now, or brings it back after so long."""
        full_A = self.full_current_A
        if duration_s < _BRIEF_S:
            share = self.coupling_per_s * (state[0] - state[1]) / self.power_K_per_s
        else:
            cold, hot = (self.propagate(state, amps, duration_s)[0] for amps in (0.0, full_A))
            share = (state[0] - cold) / (hot - cold)
        return full_A * math.sqrt(max(0.0, share))

    def holding_energy_J(self, state: State, duration_s: float) -> float:
        """Heat that holding the core at its temperature takes, while the body warms up."""
        body = self.hold(state, duration_s)[1]
        leave, loss = self.coupling_per_s / self.body_ratio, self.body_loss_per_s
        # Integral of T_b' = leave (T_c - T_b) - loss (T_b - T_a) over the time held.
        gained = (loss * (state[0] - self.ambient_C) * duration_s + body - state[1]) / (
            leave + loss
        )
        return max(0.0, self.core_heat_J_per_K * self.coupling_per_s * gained)

    def time_until(self, state: State, current_A: float, level: float) -> float:
        """Time at constant current until the core first reaches ``level`` [s]; inf if never."""
        away = state[0] - level
        if away == 0.0:
            return 0.0

        core, _, fast, slow, c_fast, c_slow = self._course(state, current_A)
        side = math.copysign(1, away)

        def excess(duration: float) -> float:
            left = c_fast * math.exp(fast * duration) + c_slow * math.exp(slow * duration)
            return (core + left - level) * side

        # The core turns round where fast c_fast e^(fast t) + slow c_slow e^(slow t) is 0.
        ratio = -fast * c_fast / (slow * c_slow) if c_slow else 0.0
        turn = max(0.0, math.log(ratio) / (slow - fast)) if ratio > 0 else 0.0
        for low, high in ((0.0, turn), (turn, _HORIZON_S)):
            if (before := excess(low)) <= 0:  # by rounding
                return low
            if high > low and (after := excess(high)) <= 0:
                return crossing(excess, (low, before), (high, after))
        return math.inf

    def energy_J(self, state: State, current_A: float, duration_s: float) -> float:
        """Heat the coil gives off at constant current."""
        return self.power_W(current_A, state[0]) * duration_s

    def _heating(self, current_A: float) -> float:
        return self.power_K_per_s * (current_A / self.full_current_A) ** 2

    def _course(self, state: State, current_A: float) -> tuple[float, ...]:
        """Course of the core at constant current, core + c_fast e^(fast t) + c_slow e^(slow t).

        Returns:
            Core and body in the end, fast and slow (both negative), c_fast and c_slow.
        """
        a, b, beta = self.coupling_per_s, self.body_loss_per_s, self.body_ratio
        heating = self._heating(current_A)
        body = self.ambient_C + heating / (beta * b)
        core = body + heating / a
        middle = -(a + a / beta + b) / 2
        root = math.sqrt(middle**2 - a * b)
        fast, slow = middle - root, middle + root
        c = state[0] - core
        rate = -a * c + a * (state[1] - body)
        c_fast, c_slow = (rate - slow * c) / (fast - slow), (fast * c - rate) / (fast - slow)
        return core, body, fast, slow, c_fast, c_slow
