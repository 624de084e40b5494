"""Heater and state for constant transition times: a curve drawn through their events."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twosra_mpc.robot.heater import Heater
from twosra_mpc.timing.transitions import Array, SegmentHeating, Transition

Knot = tuple[float, float]  # time [s], temperature [C]

_NEVER = np.inf


@dataclass(frozen=True)
class ConstantHeating(SegmentHeating):
    """Full current until liquid, then hold; between transitions the metal relaxes to the air.

    Attributes:
        heater: Heater description.
        ambient_C: Temperature of the air.
        temperature_C: Temperature at t = 0.
    """

    heater: Heater
    ambient_C: float
    temperature_C: float

    @property
    @abstractmethod
    def _superheat_s(self) -> float:
        """Full current after a melt [s]."""

    @abstractmethod
    def _melt_knots(self, item: Transition) -> list[Knot]:
        """The temperature curve from heater on to molten."""

    @abstractmethod
    def _freeze_knots(self, item: Transition, since: float, before: float) -> list[Knot]:
        """The curve to solid, of metal that is liquid and ``before`` C warm ``since`` some time."""

    @abstractmethod
    def _cools_from(self, item: Transition, knots: list[Knot]) -> Knot:
        """When, and how warm, a segment begins to relax to the temperature of the air."""

    def event_times(self) -> list[float]:
        changes = [t for item in self.transitions for t in item[2:]]
        return changes + [molten + self._superheat_s for _, molten, _ in self._heated()]

    def _heated(self) -> list[tuple[float, float, float]]:
        """(heater on, molten, heater off) of every dwell [s]."""
        periods: list[tuple[float, float, float]] = []
        if self.soft_at_start:
            periods.append((0.0, 0.0, _NEVER))
        for item in self.transitions:
            if item.to == "soft":
                periods.append((item.heater_s, item.done_s, _NEVER))
            else:
                on, molten, _ = periods[-1]
                periods[-1] = (on, molten, item.heater_s)
        return periods

    def setpoint_C(self, t: Array) -> Array:
        value = np.full(t.shape, self.heater.rigid_setpoint_C)
        for on, _, off in self._heated():
            value[(t >= on) & (t < off)] = self.heater.soft_setpoint_C
        return value

    def current_A(self, t: Array) -> Array:
        value = np.zeros(t.shape)
        for on, molten, off in self._heated():
            hot = molten + self._superheat_s if molten > on else molten
            value[(t >= on) & (t < min(hot, off))] = self.heater.melt_current_A
            value[(t >= hot) & (t < off)] = self.heater.hold_current_A
        return value

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        """Temperature through the events of the transitions, relaxing in between; linear melts."""
        knots = self._knots()
        temperature: Array = np.interp(t, *np.array(knots).T)
        for start, end, initial in self._cooling(knots):
            inside = (t >= start) & (t < end)
            temperature[inside] = self._relaxed(initial, t[inside] - start)
        melts = [(0.0, float(self.soft_at_start))]
        for item in self.transitions:
            soft = float(item.to == "soft")
            melts += [(item.onset_s, 1.0 - soft), (item.done_s, soft)]
        return temperature, np.interp(t, *np.array(melts).T)

    def energy_J(self, until_s: float) -> float:
        times = np.unique([0.0, until_s, *(t for t in self.event_times() if 0 < t < until_s)])
        squared = self.current_A(times[:-1]) ** 2
        return float(self.heater.resistance_ohm * (squared @ np.diff(times)))

    def _relaxed(self, initial: float, elapsed: Array) -> Array:
        ambient = self.ambient_C
        decay: Array = np.exp(-elapsed / self.heater.cooling_time_constant_s)
        return ambient + (initial - ambient) * decay

    def _knots(self) -> list[Knot]:
        knots = [(0.0, self.temperature_C)]
        liquid = self.soft_at_start
        for item in self.transitions:
            since, before = knots[-1]
            liquid = item.to == "soft"
            if liquid:
                warm = float(self._relaxed(before, np.array(item.heater_s - since)))
                knots += [(item.heater_s, warm), *self._melt_knots(item)]
            else:
                knots += self._freeze_knots(item, since, before)
        if liquid:
            knots += self._liquid(self.heater.soft_setpoint_C, *knots[-1], until=_NEVER)
        return knots

    def _liquid(self, target: float, since: float, before: float, until: float) -> list[Knot]:
        """Heat or cool liquid metal to ``target`` and hold it there until its heater is off."""
        if before <= target:
            reached = min(since + self._superheat_s, until)
            knots = [(reached, target)]
        else:
            above, over = before - self.ambient_C, target - self.ambient_C
            cooling = self.heater.cooling_time_constant_s * float(np.log(above / over))
            times = np.linspace(0.0, min(cooling, until - since), 9)
            knots = [(since + float(t), float(self._relaxed(before, t))) for t in times[1:]]
        if np.isfinite(until):
            knots.append((until, knots[-1][1]))
        return knots

    def _cooling(self, knots: list[Knot]) -> list[tuple[float, float, float]]:
        """(start, end, initial temperature) of the periods without heater."""
        periods: list[tuple[float, float, float]] = []
        start, initial = (_NEVER, 0.0) if self.soft_at_start else (0.0, self.temperature_C)
        for item in self.transitions:
            if item.to == "soft":
                periods.append((start, item.heater_s, initial))
                start = _NEVER
            else:
                start, initial = self._cools_from(item, knots)
        return [*periods, (start, _NEVER, initial)]


def power_W(heater: Heater, what: Literal["melt", "hold"]) -> float:
    """Heater power at full current, or at that which holds, of a coil whose resistance is kept."""
    current = heater.melt_current_A if what == "melt" else heater.hold_current_A
    return current**2 * heater.resistance_ohm
