"""Two-node segments that follow a log step by step.

A state is (core, body), K above the air. Duties are shares of full power, constant over a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.thermal.two_node import TwoNode

State = tuple[float, float]
Step = Callable[[State, float], State]


@dataclass(frozen=True)
class TwoNodePlant:
    """Core and body, exact over a step.

    Attributes:
        model: The segment, with 1 A as full current and air of 0 C.
        step_s: Length of a step.
    """

    model: TwoNode
    step_s: float

    def resting(self, core_K: float) -> State:
        """State with this core after long cooling: only the slow mode is left."""
        core, body = self.model.propagate((1.0, 1.0), 0.0, 20 / self.model.coupling_per_s)
        return core_K, core_K * body / core

    def stepper(self) -> Step:
        """Function from a state and a duty to the state a step later; it is linear."""
        (cc, bc), (cb, bb), (cu, bu) = (
            self.model.propagate(state, current, self.step_s)
            for state, current in (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((0.0, 0.0), 1.0))
        )

        def step(state: State, u: float) -> State:
            core, body = state
            return cc * core + cb * body + cu * u, bc * core + bb * body + bu * u

        return step

    def led(self, body_K: float, core_K: Array) -> Array:
        """States (n, 2) of a given core (n,); the body follows its mean over each step."""
        from_core = self.model.hold((1.0, 0.0), self.step_s)[1]
        from_body = self.model.hold((0.0, 1.0), self.step_s)[1]
        bodies = [body_K]
        for core in ((core_K[1:] + core_K[:-1]) / 2).tolist():
            bodies.append(from_core * core + from_body * bodies[-1])
        return np.stack([core_K, bodies], axis=1)


def driven(plant: TwoNodePlant, start: State, duty: Array) -> Array:
    """States (n + 1, 2) from ``start`` on under the duties (n,) of n steps."""
    step, states = plant.stepper(), [start]
    for u in duty.tolist():
        states.append(step(states[-1], u))
    return np.array(states)
