"""Course of a two-node segment and its sensor in even steps, from states K above the air."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.thermal.two_node import TwoNode


@dataclass(frozen=True)
class TwoNodePlant:
    """Core and body, exact over a step.

    Attributes:
        model: The segment, with 1 A as full current and air of 0 C.
        step_s: Length of a step.
    """

    model: TwoNode
    step_s: float

    def driven(self, core_K: float, body_K: float, duty: Array) -> Array:
        """States (n + 1, 2) under shares of full power (n,), constant over n steps."""
        (cc, bc), (cb, bb), (cu, bu) = (
            self.model.propagate(state, current, self.step_s)
            for state, current in (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((0.0, 0.0), 1.0))
        )
        states = [(core_K, body_K)]
        for u in duty.tolist():
            core, body = states[-1]
            states.append((cc * core + cb * body + cu * u, bc * core + bb * body + bu * u))
        return np.array(states)

    def led(self, body_K: float, core_K: Array) -> Array:
        """Body (n,) of a given core (n,); it follows the core's mean over each step."""
        from_core = self.model.hold((1.0, 0.0), self.step_s)[1]
        from_body = self.model.hold((0.0, 1.0), self.step_s)[1]
        bodies = [body_K]
        for core in ((core_K[1:] + core_K[:-1]) / 2).tolist():
            bodies.append(from_core * core + from_body * bodies[-1])
        return np.array(bodies)


@dataclass(frozen=True)
class SensorLag:
    """Two equal lags behind a share of the core's temperature above the air.

    Attributes:
        gain: The share.
        lag_s: Time constant of each lag.
        step_s: Time between values.
    """

    gain: float
    lag_s: float
    step_s: float

    def follow(self, core_K: Array, first_K: float, second_K: float) -> Array:
        """Outputs (n, 2) of the first and the second lag behind a core (n,), from these on."""
        first = self._lagged(self.gain * core_K, first_K)
        return np.stack([first, self._lagged(first, second_K)], axis=1)

    def _lagged(self, driver: Array, start: float) -> Array:
        """One lag behind values joined by straight lines, exactly."""
        kept = math.exp(-self.step_s / self.lag_s)
        mean = (1 - kept) * self.lag_s / self.step_s
        state = [(mean - kept) * driver[0] + kept * start]
        later, _ = lfilter([1 - mean, mean - kept], [1.0, -kept], driver[1:], zi=state)
        return np.append(start, later)
