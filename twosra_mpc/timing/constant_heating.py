"""Heater and state for constant transition times: a curve drawn through their events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.segment import Heater
from twosra_mpc.timing.transitions import SegmentHeating, Transition

Knot = tuple[float, float]  # time [s], temperature [C]

_NEVER = np.inf


@dataclass(frozen=True)
class ConstantHeating(SegmentHeating):
    """Full current until liquid, then hold; between transitions the metal relaxes to the air.

    Metal that is liquid at t = 0 is as if it had been molten for as long as heats it up so far.

    Attributes:
        heater: Heater description.
        ambient_C: Temperature of the air.
        temperature_C: Temperature at t = 0.
        superheat_s: Full current after a melt, up to the set-point.
        coasting_s: Cooling from the set-point to the plateau on which the metal changes; None: a
            melt ends at the set-point, and a freeze is nothing but cooling.
    """

    heater: Heater
    ambient_C: float
    temperature_C: float
    superheat_s: float = 0.0
    coasting_s: float | None = None

    def event_times(self) -> list[float]:
        changes = [t for item in self.transitions for t in item[2:]]
        return changes + [max(0.0, hot) for _, hot, _ in self._heated()]

    def _heated(self) -> list[tuple[float, float, float]]:
        """(heater on, at the set-point, heater off) of every dwell [s]."""
        periods: list[tuple[float, float, float]] = []
        if self.molten_at_start == 1:
            left = (self.heater.soft_setpoint_C - self.temperature_C) / self._span_K
            periods.append((0.0, self.superheat_s * left, _NEVER))
        for item in self.transitions:
            if item.to == "soft":
                periods.append((item.heater_s, item.done_s + self.superheat_s, _NEVER))
            elif periods:
                on, hot, _ = periods[-1]
                periods[-1] = (on, hot, item.heater_s)
        return periods

    @property
    def _span_K(self) -> float:
        """Temperature of the set-point above that of melting."""
        return self.heater.soft_setpoint_C - self.heater.melting_point_C

    def setpoint_C(self, t: Array) -> Array:
        value = np.full(t.shape, self.heater.rigid_setpoint_C)
        for on, _, off in self._heated():
            value[(t >= on) & (t < off)] = self.heater.soft_setpoint_C
        return value

    def current_A(self, t: Array) -> Array:
        value = np.zeros(t.shape)
        for on, hot, off in self._heated():
            value[(t >= on) & (t < min(hot, off))] = self.heater.melt_current_A
            value[(t >= hot) & (t < off)] = self.heater.hold_current_A
        return value

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        """Temperature through the events of the transitions, relaxing in between; linear melts."""
        knots, cooling = self._curve()
        temperature: Array = np.interp(t, *np.array(knots).T)
        for since, until in cooling:
            inside = (t >= since[0]) & (t < until)
            temperature[inside] = self._relaxed(since, t[inside])
        melts = [(0.0, self.molten_at_start)]
        for item in self.transitions:
            melts += [(item.onset_s, melts[-1][1]), (item.done_s, float(item.to == "soft"))]
        return temperature, np.interp(t, *np.array(melts).T)

    def energy_J(self, until_s: float) -> float:
        times = np.unique([0.0, until_s, *(t for t in self.event_times() if 0 < t < until_s)])
        squared = self.current_A(times[:-1]) ** 2
        return float(self.heater.resistance_ohm * (squared @ np.diff(times)))

    def _curve(self) -> tuple[list[Knot], list[tuple[Knot, float]]]:
        """Knots of the temperature, and from which of them it relaxes to the air until when."""
        knots, cooling = [(0.0, self.temperature_C)], []
        liquid = self.molten_at_start == 1
        for item in self.transitions:
            was_liquid, liquid = liquid, item.to == "soft"
            if liquid:
                cooling.append((knots[-1], item.heater_s))
                warm = self._relaxed(knots[-1], np.array(item.heater_s))
                knots.append((item.heater_s, float(warm)))
            elif was_liquid:
                knots += self._liquid(knots[-1], self._peak_C(item), until=item.heater_s)
            knots += self._changing(item)
        if liquid:
            knots += self._liquid(knots[-1], self.heater.soft_setpoint_C, until=_NEVER)
        else:
            cooling.append((knots[-1], _NEVER))
        return knots, cooling

    def _relaxed(self, since: Knot, t: Array) -> Array:
        decay: Array = np.exp((since[0] - t) / self.heater.cooling_time_constant_s)
        return self.ambient_C + (since[1] - self.ambient_C) * decay

    def _changing(self, item: Transition) -> list[Knot]:
        """The curve while the metal melts or freezes."""
        if self.coasting_s is None:
            return [(item.done_s, self.heater.soft_setpoint_C)] if item.to == "soft" else []
        melting_C = self.heater.melting_point_C
        return [(item.onset_s, melting_C), (item.done_s, melting_C)]

    def _peak_C(self, freeze: Transition) -> float:
        """Temperature from which cooling to the plateau takes as long as a freeze says."""
        if not self.coasting_s:
            return self.heater.soft_setpoint_C
        share = min(1.0, (freeze.onset_s - freeze.heater_s) / self.coasting_s)
        return self.heater.melting_point_C + self._span_K * share

    def _liquid(self, since: Knot, target: float, until: float) -> list[Knot]:
        """Heat or cool liquid metal to ``target`` and hold it there until its heater is off."""
        start, before = since
        if before <= target:
            needed = self.superheat_s * (target - before) / self._span_K
            knots = [(min(start + needed, until), target)]
        else:
            above, over = before - self.ambient_C, target - self.ambient_C
            cooling = self.heater.cooling_time_constant_s * np.log(above / over)
            times = np.linspace(start, min(start + cooling, until), 9)[1:]
            knots = list(zip(times.tolist(), self._relaxed(since, times).tolist(), strict=True))
        if np.isfinite(until):
            knots.append((until, knots[-1][1]))
        return knots
