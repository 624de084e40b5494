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
        return changes + [molten + self.superheat_s for _, molten, _ in self._heated()]

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
            hot = molten + self.superheat_s if molten > on else molten
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
        melts = [(0.0, float(self.soft_at_start))]
        for item in self.transitions:
            soft = float(item.to == "soft")
            melts += [(item.onset_s, 1.0 - soft), (item.done_s, soft)]
        return temperature, np.interp(t, *np.array(melts).T)

    def energy_J(self, until_s: float) -> float:
        times = np.unique([0.0, until_s, *(t for t in self.event_times() if 0 < t < until_s)])
        squared = self.current_A(times[:-1]) ** 2
        return float(self.heater.resistance_ohm * (squared @ np.diff(times)))

    def _curve(self) -> tuple[list[Knot], list[tuple[Knot, float]]]:
        """Knots of the temperature, and from which of them it relaxes to the air until when."""
        knots, cooling = [(0.0, self.temperature_C)], []
        liquid = self.soft_at_start
        for item in self.transitions:
            liquid = item.to == "soft"
            if liquid:
                cooling.append((knots[-1], item.heater_s))
                warm = self._relaxed(knots[-1], np.array(item.heater_s))
                knots.append((item.heater_s, float(warm)))
            else:
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
        """From where cooling to the plateau takes as long as a freeze says."""
        melting_C, setpoint_C = self.heater.melting_point_C, self.heater.soft_setpoint_C
        if not self.coasting_s:
            return setpoint_C
        share = min(1.0, (freeze.onset_s - freeze.heater_s) / self.coasting_s)
        return melting_C + (setpoint_C - melting_C) * share

    def _liquid(self, since: Knot, target: float, until: float) -> list[Knot]:
        """Heat or cool liquid metal to ``target`` and hold it there until its heater is off."""
        start, before = since
        if before <= target:
            knots = [(min(start + self.superheat_s, until), target)]
        else:
            above, over = before - self.ambient_C, target - self.ambient_C
            cooling = self.heater.cooling_time_constant_s * np.log(above / over)
            times = np.linspace(start, min(start + cooling, until), 9)[1:]
            knots = list(zip(times.tolist(), self._relaxed(since, times).tolist(), strict=True))
        if np.isfinite(until):
            knots.append((until, knots[-1][1]))
        return knots
