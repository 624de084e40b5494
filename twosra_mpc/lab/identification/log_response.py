r"""Response of a model to a log: heater by the firmware's law, two-node segment, sensor.

While heating, the firmware gives :math:`v = \mathrm{clip}(v_0 + K_p (54 - y), 0, 1)` of full power
at reading y, which is the model's own, never the measured one; while cooling, nothing. In both the
model runs free. In a hold the power is unknown,
so the core is what the readings say through the inverted sensor, and the model only carries on
what lies behind the core.

The sensor lags, so the readings of a hold do not tell its last seconds. The state that the next
phase starts from is therefore corrected by that phase's first seconds of readings: without, what
the hold's smoothing lacks is put down to the segment (a coupling 17 % too small, on made-up logs).

A state is (core, body), K above the air. Duties are shares of full power, constant over a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded
from scipy.signal import lfilter

from twosra_mpc.lab.identification.heating_log import EvenLog, runs
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


Lags = tuple[float, float]

LAW_REFERENCE_C = 54.0  # reading at which the law's duty is quoted

# Readings scatter by about 0.02 K about the sensor, and the core of a held segment drifts by about
# 0.1 K/s: the square of their ratio weighs smoothness against closeness [s^2].
_ROUGHNESS_S2 = 0.04
# How long readings after a hold are taken to correct its end (the sensor's lags amount to about as
# much), how far core and first lag may be off there, and how far readings scatter.
CORRECTED_S = 6.0
_END_K = (1.0, 0.2)  # of core and first lag
_SCATTER_K = 0.03  # of readings
_RIDGE = 1e-9  # keeps the two values beyond a hold's ends finite where nothing determines them


class HeaterLaw(NamedTuple):
    """Proportional band of the firmware while heating.

    Attributes:
        gain_per_K: K_p, duty per K of raw reading.
        duty_at_54C: v_0, duty at a raw reading of 54 C.
    """

    gain_per_K: float
    duty_at_54C: float

    def duty(self, sensor_C: float) -> float:
        """Share of full power at a raw reading."""
        wanted = self.duty_at_54C + self.gain_per_K * (LAW_REFERENCE_C - sensor_C)
        return min(1.0, max(0.0, wanted))


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

    def follow(self, core_K: Array, lags_K: Array) -> Array:
        """Outputs (n, 2) of the first and the second lag behind a core (n,), from ``lags_K`` on."""
        first = self._lagged(self.gain * core_K, lags_K[0])
        return np.stack([first, self._lagged(first, lags_K[1])], axis=1)

    def stepper(self) -> Callable[[Lags, float, float], Lags]:
        """Return what takes both lags, and the core before and after, to the lags a step later."""
        kept, old, new = self._weights

        def step(lags: Lags, before_K: float, after_K: float) -> Lags:
            first = kept * lags[0] + self.gain * (old * before_K + new * after_K)
            return first, kept * lags[1] + old * lags[0] + new * first

        return step

    @cached_property
    def _weights(self) -> tuple[float, float, float]:
        """Weights of a lag's output, and of its input before and after a step."""
        kept = math.exp(-self.step_s / self.lag_s)
        mean = (1 - kept) * self.lag_s / self.step_s
        return kept, mean - kept, 1 - mean

    def _lagged(self, driver: Array, start: float) -> Array:
        """One lag behind values joined by straight lines, exactly."""
        kept, old, new = self._weights
        state = [old * driver[0] + kept * start]
        later, _ = lfilter([new, old], [1.0, -kept], driver[1:], zi=state)
        return np.append(start, later)

    def core_behind(self, sensor_K: Array) -> tuple[Array, Array, Array]:
        """Invert the sensor: the core (n,) of least change that explains readings (n,).

        Minimises the squared residuals of the readings plus ``_ROUGHNESS_S2`` times the squared
        rates of the core, over sensor values that extend one step beyond both ends. Nothing
        outside the hold is used, so the phase that follows is free of its own readings.

        Returns:
            Core, first and second lag.
        """
        n, ratio = len(sensor_K), self.lag_s / self.step_s
        # (1 + lag d/dt)^2 by central differences over three values, and its first difference.
        inverse = np.array([(ratio - 0.5) ** 2, 0.5 - 2 * ratio**2, (ratio + 0.5) ** 2])
        rate = np.diff(inverse, prepend=0.0, append=0.0) * -1.0 / self.gain / self.step_s
        bands = np.zeros((4, n + 2))
        bands[0] = _RIDGE
        bands[0, 1:-1] += 1.0
        for i in range(4):
            for m in range(4 - i):
                bands[m, i : i + n - 1] += _ROUGHNESS_S2 * rate[i] * rate[i + m]
        target = _RIDGE * np.pad(sensor_K, 1, mode="edge")
        target[1:-1] += sensor_K
        s = solveh_banded(bands, target, lower=True)
        before, at, after = s[:-2], s[1:-1], s[2:]
        core = (inverse[0] * before + inverse[1] * at + inverse[2] * after) / self.gain
        return core, (before + 2 * at + after) / 4 + ratio / 2 * (after - before), at


class Response(NamedTuple):
    """Response of a model to a log, at its n points; temperatures [C].

    Attributes:
        core_C: Core, (n,).
        body_C: Body, (n,).
        sensor_C: Reading, (n,).
        duty: Share of full power from each point on; NaN in a hold, (n - 1,).
    """

    core_C: Array
    body_C: Array
    sensor_C: Array
    duty: Array


def respond(log: EvenLog, plant: TwoNodePlant, sensor: SensorLag, law: HeaterLaw) -> Response:
    """Let a model follow a log.

    The segment starts at the first reading; if that is above the air, as one that has cooled for
    long.
    """
    n, air = len(log.time_s), log.ambient_C
    loop = _ClosedLoop(plant, sensor, law, air)
    reading, share = log.sensor_C - air, log.heating_share
    duty = np.full(n - 1, np.nan)
    states, lags = np.empty((n, 2)), np.empty((n, 2))
    states[0] = plant.resting(float(reading[0]) / sensor.gain)
    lags[0] = reading[0]
    at = 0
    spans = [*runs(log.held), (n - 1, n - 1), (n, n)]
    for (first, end), (next_hold, _) in pairwise(spans):
        free, held = slice(at, first + 1), slice(first, end)
        if first > at:
            free_run = loop.run(states[at], lags[at], share[at:first])
            states[free], lags[free], duty[at:first] = free_run
        if end > first:
            core, *behind = sensor.core_behind(reading[held])
            states[held] = plant.led(float(states[first, 1]), core)
            lags[held] = np.stack(behind, axis=1)
            at, after = end - 1, min(end + round(CORRECTED_S / log.step_s), next_hold + 1)
            states[at, 0], lags[at, 0] = _corrected(
                loop, states[at], lags[at], share[at : after - 1], reading[end:after]
            )
    return Response(states[:, 0] + air, states[:, 1] + air, lags[:, 1] + air, duty)


@dataclass(frozen=True)
class _ClosedLoop:
    """Segment, sensor and firmware, whose law sees what the sensor shows."""

    plant: TwoNodePlant
    sensor: SensorLag
    law: HeaterLaw
    ambient_C: float

    def run(self, state: Array, lags: Array, share: Array) -> tuple[Array, Array, Array]:
        """States and lags (n + 1, 2) and duties (n,) where the heater heats in shares of n steps.

        The law takes the reading in the middle of a step, as it changes at the step's begin.
        """
        if not share.any():
            cooling = driven(self.plant, (float(state[0]), float(state[1])), share)
            return cooling, self.sensor.follow(cooling[:, 0], lags), share
        step, behind = self.plant.stepper(), self.sensor.stepper()
        ahead = self.sensor.step_s / 2 / self.sensor.lag_s
        here, lag = (float(state[0]), float(state[1])), (float(lags[0]), float(lags[1]))
        states, followed, duties = [here], [lag], []
        for heated in share.tolist():
            middle = lag[1] + ahead * (lag[0] - lag[1])
            duties.append(heated * self.law.duty(self.ambient_C + middle))
            before, here = here[0], step(here, duties[-1])
            lag = behind(lag, before, here[0])
            states.append(here)
            followed.append(lag)
        return np.array(states), np.array(followed), np.array(duties)


def _corrected(loop: _ClosedLoop, state: Array, lags: Array, share: Array, reading: Array) -> Array:
    """Core and first lag (2,), corrected by the readings (n,) after each of n steps.

    Least squares, linear about the given state, with ``_END_K`` as the prior's spread.
    """
    if len(share) == 0:
        return np.array([state[0], lags[0]])

    def off(core: float, lag: float) -> Array:
        start, behind = np.add(state, (core, 0.0)), np.add(lags, (lag, 0.0))
        return loop.run(start, behind, share)[1][1:, 1] - reading

    now, small = off(0.0, 0.0), 0.01
    slopes = np.stack([off(small, 0.0) - now, off(0.0, small) - now], axis=1) / small
    prior = np.diag(_SCATTER_K / np.array(_END_K))
    move = np.linalg.lstsq(np.vstack([slopes, prior]), np.append(-now, [0.0, 0.0]), rcond=None)[0]
    return np.array([state[0] + move[0], lags[0] + move[1]])
