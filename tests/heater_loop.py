"""Closed loop of one heater: segment, sensor and stiffness controller, for a profile of set-points.

The plant is any segment model, propagated exactly between the controller's steps; it need not be
the model that the controller was built for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.control.heated_segment import HeatedSegment
from twosra_mpc.control.stiffness import StiffnessController
from twosra_mpc.control.thermistor import NtcDivider, TemperatureSensor
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import SegmentModel

Profile = Sequence[tuple[float, Stiffness]]

SETTLED_K = 2.0  # settled: this close to the set-point from then on


@dataclass(frozen=True)
class LinearMap(NtcDivider):
    """The paper's idealised sensor: voltage rises in a straight line with temperature."""

    range_C: tuple[float, float] = (0.0, 85.0)
    range_V: tuple[float, float] = (1.1, 3.3)

    def voltage_V(self, temperature_C: float) -> float:
        """Voltage on the line, or its extension."""
        (cold, hot), (low, high) = self.range_C, self.range_V
        return low + (high - low) * (temperature_C - cold) / (hot - cold)

    def temperature_C(self, voltage_V: float) -> float:
        """Temperature on the line, or its extension."""
        (cold, hot), (low, high) = self.range_C, self.range_V
        return cold + (hot - cold) * (voltage_V - low) / (high - low)


@dataclass(frozen=True, eq=False)
class HeaterRun:
    """Record of a run, sample by sample; arrays of one length, read-only.

    A sample is taken right after the controller has decided: its current holds until the next.

    """

    time_s: Array
    temperature_C: Array
    melt_fraction: Array
    measured_C: Array
    estimated_melt_fraction: Array
    current_A: Array
    soft_setpoint: NDArray[np.bool_]
    integrator: Array
    heat_J: Array
    stiffness: NDArray[np.str_]
    protection: NDArray[np.str_]

    @property
    def kinds(self) -> list[str]:
        """What the controller says of the segment, whenever that changes."""
        words = np.where(self.protection == "none", self.stiffness, self.protection)
        return words[1:][words[1:] != words[:-1]].tolist()


@dataclass(frozen=True)
class Stretch:
    """One set-point of a run, from the command to the next or to the end."""

    setpoint: Stiffness
    start_s: float
    end_s: float
    changed_s: float
    told_s: float
    settled_s: float
    peak_C: float
    heat_J: float


def simulate_heater(
    plant: SegmentModel,
    sensor: TemperatureSensor,
    controller: StiffnessController,
    profile: Profile,
    duration_s: float,
    *,
    start_temperature_C: float | None = None,
    step_s: float = 0.1,
    seed: int = 0,
) -> HeaterRun:
    """Run the closed loop: segment as it is, its sensor, and the controller."""
    start_C = plant.ambient_C if start_temperature_C is None else start_temperature_C
    steps = math.ceil(round(duration_s / step_s, 9))
    times = np.arange(steps + 1, dtype=np.float64) * np.float64(step_s)
    since, asked = zip(*profile, strict=True)
    setpoints = [asked[i] for i in np.searchsorted(since, times + 1e-9, side="right") - 1]
    rng = np.random.default_rng(seed)
    segment = HeatedSegment(
        plant, sensor, controller, start_C, rng.standard_normal, rigid_setpoint_C=-math.inf
    )
    rows = [_sample(segment)]
    for setpoint in setpoints[1:]:
        asked_C = controller.soft_setpoint_C if setpoint == "soft" else -math.inf
        segment.advance(asked_C, step_s)
        rows.append(_sample(segment))
    sampled = zip(_SAMPLED, zip(*rows, strict=True), strict=True)
    columns = {name: np.array(column) for name, column in sampled}
    soft = np.array(setpoints) == "soft"
    return HeaterRun(time_s=times, soft_setpoint=soft, **columns)


_SAMPLED = (
    *("temperature_C", "melt_fraction", "measured_C", "estimated_melt_fraction"),
    *("current_A", "integrator", "heat_J", "stiffness", "protection"),
)


def _sample(segment: HeatedSegment) -> tuple[object, ...]:
    """Values of a sample, in the order of `_SAMPLED`."""
    memory, observed = segment.memory, segment.controller.rule.observer.model
    estimated = observed.melt_fraction(memory.known.estimate.state)
    true = segment.temperature_C, segment.melt_fraction, segment.measured_C, estimated
    told = segment.heat_J, memory.stiffness, memory.protection
    return *true, memory.current_A, memory.integrator, *told


def stretches(run: HeaterRun, soft_setpoint_C: float) -> tuple[Stretch, ...]:
    """Sum up a run, set-point by set-point."""
    changes = (np.flatnonzero(np.diff(run.soft_setpoint)) + 1).tolist()
    ends = [0, *changes, len(run.time_s) - 1]
    return tuple(_stretch(run, low, high, soft_setpoint_C) for low, high in pairwise(ends))


def _stretch(run: HeaterRun, low: int, high: int, soft_setpoint_C: float) -> Stretch:
    """Sum up the samples from ``low`` to ``high``, which is the first of the next stretch."""
    inside = slice(low, high + 1)
    since = run.time_s[inside] - run.time_s[low]
    soft = bool(run.soft_setpoint[low])
    setpoint: Stiffness = "soft" if soft else "rigid"
    melted, off = run.melt_fraction[inside], run.temperature_C[inside] - soft_setpoint_C
    return Stretch(
        setpoint=setpoint,
        start_s=float(run.time_s[low]),
        end_s=float(run.time_s[high]),
        changed_s=_first(since, melted >= 1.0 if soft else melted <= 0.0),
        told_s=_first(since, run.stiffness[inside] == setpoint),
        settled_s=_for_good(since, np.abs(off) <= SETTLED_K) if soft else math.nan,
        peak_C=float(run.temperature_C[inside].max()),
        heat_J=float(run.heat_J[high] - run.heat_J[low]),
    )


def _first(since: Array, fulfilled: NDArray[np.bool_]) -> float:
    """First time at which something holds, NaN if there is none."""
    return float(since[fulfilled.argmax()]) if fulfilled.any() else math.nan


def _for_good(since: Array, fulfilled: NDArray[np.bool_]) -> float:
    """First time from which on something holds to the end, NaN if it does not at the end."""
    last = np.flatnonzero(~fulfilled)
    return _first(since, np.arange(len(since)) > (last[-1] if len(last) else -1))
