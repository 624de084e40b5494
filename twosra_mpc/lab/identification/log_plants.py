"""Segments that follow a log step by step: two nodes, and one node with latent heat to compare.

A state is (core, other), K above the air; what the other is, is the model's own matter. Duties are
shares of full power, constant over a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.thermal.two_node import TwoNode

State = tuple[float, float]
Step = Callable[[State, float], State]


class Plant(Protocol):
    """A heated segment, in steps of equal length."""

    def resting(self, core_K: float) -> State:
        """State with this core that has cooled for a long time."""

    def stepper(self) -> Step:
        """Return what takes a state and a duty to the state a step later."""

    def led(self, other: float, core_K: Array) -> Array:
        """States (n, 2) whose core is given (n,), from another state ``other`` on."""


def driven(plant: Plant, start: State, duty: Array) -> Array:
    """States (n + 1, 2) from ``start`` on under the duties (n,) of n steps."""
    step, states = plant.stepper(), [start]
    for u in duty.tolist():
        states.append(step(states[-1], u))
    return np.array(states)


@dataclass(frozen=True)
class TwoNodePlant:
    """Core and body; the other state is the body's temperature. Exact over a step.

    Attributes:
        model: The segment, with 1 A as full current and air of 0 C.
        step_s: Length of a step.
    """

    model: TwoNode
    step_s: float

    def resting(self, core_K: float) -> State:
        """Take what is left of any state after long cooling: the slow mode."""
        core, body = self.model.propagate((1.0, 1.0), 0.0, 20 / self.model.coupling_per_s)
        return core_K, core_K * body / core

    def stepper(self) -> Step:
        """Propagate; the model is linear, so three of its steps tell all others."""
        (cc, bc), (cb, bb), (cu, bu) = (
            self.model.propagate(state, current, self.step_s)
            for state, current in (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((0.0, 0.0), 1.0))
        )

        def step(state: State, u: float) -> State:
            core, body = state
            return cc * core + cb * body + cu * u, bc * core + bb * body + bu * u

        return step

    def led(self, other: float, core_K: Array) -> Array:
        """Propagate the body; during a step the core is taken as the mean of its ends."""
        from_core = self.model.hold((1.0, 0.0), self.step_s)[1]
        from_body = self.model.hold((0.0, 1.0), self.step_s)[1]
        bodies = [other]
        for core in ((core_K[1:] + core_K[:-1]) / 2).tolist():
            bodies.append(from_core * core + from_body * bodies[-1])
        return np.stack([core_K, bodies], axis=1)


@dataclass(frozen=True)
class OneNodePlant:
    r"""One temperature with latent heat spread over an interval; the other state is the heat.

    With heat H per heat capacity [K], :math:`\dot H = p u - b T(H)`.

    Attributes:
        power_K_per_s: p, full heater power per heat capacity.
        loss_per_s: b.
        latent_K: Latent heat per heat capacity.
        melting_K: Interval of melting, above the air.
        step_s: Length of a step.
    """

    power_K_per_s: float
    loss_per_s: float
    latent_K: float
    melting_K: tuple[float, float]
    step_s: float

    def resting(self, core_K: float) -> State:
        """Return the one state with this temperature."""
        return core_K, float(self._heat(np.array(core_K)))

    def stepper(self) -> Step:
        """Propagate by the midpoint rule."""
        h, p, b = self.step_s, self.power_K_per_s, self.loss_per_s

        def step(state: State, u: float) -> State:
            core, heat = state
            middle = self._temperature(heat + h / 2 * (p * u - b * core))
            heat += h * (p * u - b * middle)
            return self._temperature(heat), heat

        return step

    def led(self, other: float, core_K: Array) -> Array:
        """Return the heat that goes with the temperature."""
        del other
        return np.stack([core_K, self._heat(core_K)], axis=1)

    def _heat(self, core_K: Array) -> Array:
        low, high = self.melting_K
        return core_K + self.latent_K * np.clip((core_K - low) / (high - low), 0.0, 1.0)

    def _temperature(self, heat_K: float) -> float:
        low, high = self.melting_K
        if heat_K <= low:
            return heat_K
        if heat_K >= high + self.latent_K:
            return heat_K - self.latent_K
        return low + (heat_K - low) * (high - low) / (high - low + self.latent_K)
