"""Heater set-points, currents and expected temperatures that a list of transitions implies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.heater import Heater
from twosra_mpc.robot.modes import Mode
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming
from twosra_mpc.thermal.trajectory import Course
from twosra_mpc.timing import Transition
from twosra_mpc.timing.choice import thermal_transitions

Array = NDArray[np.float64]

_NEVER = np.inf


class SegmentHeating(Protocol):
    """One segment's heater and state over time; times in s, arrays of the times' shape."""

    def event_times(self) -> list[float]:
        """Times at which set-point, current or state change [s]."""

    def setpoint_C(self, t: Array) -> Array:
        """Temperature set-point from each time to the next [C]."""

    def current_A(self, t: Array) -> Array:
        """Heater current from each time to the next [A]."""

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        """Expected temperature [C] and melt fraction, from 0 (solid) to 1 (liquid)."""

    def soft(self, t: Array) -> NDArray[np.bool_]:
        """Whether the segment is liquid: after a melt is done, before the next freeze begins."""

    def energy_J(self, until_s: float) -> float:
        """Heater energy from t = 0."""


@dataclass(frozen=True)
class ThermalHeating:
    """Heater and state by the thermal model.

    Attributes:
        course: Heater and state, piece by piece.
        soft_at_start: Whether the segment is liquid at t = 0.
        transitions: The segment's transitions in order.
    """

    course: Course
    soft_at_start: bool
    transitions: tuple[Transition, ...]

    def event_times(self) -> list[float]:
        times = [t for item in self.transitions for t in item[2:]]
        return times + [t for t in self.course.event_times() if t > 0]

    def setpoint_C(self, t: Array) -> Array:
        return self.course.setpoint_C(t)

    def current_A(self, t: Array) -> Array:
        return self.course.current_A(t)

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        return self.course.temperature_and_melt_fraction(t)

    def soft(self, t: Array) -> NDArray[np.bool_]:
        return soft_over_time(self.transitions, self.soft_at_start, t)

    def energy_J(self, until_s: float) -> float:
        return self.course.energy_J(until_s)


def soft_over_time(
    transitions: Sequence[Transition], soft_at_start: bool, t: Array
) -> NDArray[np.bool_]:
    """Whether a segment with these transitions is liquid, at each time."""
    value = np.full(t.shape, soft_at_start)
    for item in transitions:
        value[t >= (item.done_s if item.to == "soft" else item.onset_s)] = item.to == "soft"
    return value


@dataclass(frozen=True)
class ConstantHeating:
    """Heater and state for constant transition times: a curve drawn through their events.

    Attributes:
        heater: Heater description.
        times: Transition times of the robot, which shape the temperature curve.
        ambient_C: Temperature of the air.
        soft_at_start: Whether the segment is liquid at t = 0.
        temperature_C: Temperature at t = 0.
        transitions: The segment's transitions in order.
    """

    heater: Heater
    times: OverlappedTiming | SequentialTiming
    ambient_C: float
    soft_at_start: bool
    temperature_C: float
    transitions: tuple[Transition, ...]

    def event_times(self) -> list[float]:
        changes = [t for item in self.transitions for t in item[2:]]
        return changes + [molten + self._superheat_s for _, molten, _ in self._heated()]

    def _heated(self) -> list[tuple[float, float, float]]:
        """(heater on, molten, heater off) of every heating period [s]."""
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

    @property
    def _superheat_s(self) -> float:
        return self.times.superheat_s if isinstance(self.times, OverlappedTiming) else 0.0

    def soft(self, t: Array) -> NDArray[np.bool_]:
        return soft_over_time(self.transitions, self.soft_at_start, t)

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        return self.temperature(t), self._melt_fraction(t)

    def _melt_fraction(self, t: Array) -> Array:
        knots = [(0.0, float(self.soft_at_start))]
        for item in self.transitions:
            soft = float(item.to == "soft")
            knots += [(item.onset_s, 1.0 - soft), (item.done_s, soft)]
        value: Array = np.interp(t, [k[0] for k in knots], [k[1] for k in knots])
        return value

    def energy_J(self, until_s: float) -> float:
        times = np.unique([0.0, until_s, *(t for t in self.event_times() if 0 < t < until_s)])
        squared = self.current_A(times[:-1]) ** 2
        return float(self.heater.resistance_ohm * (squared @ np.diff(times)))

    def temperature(self, t: Array) -> Array:
        """Expected temperature [C]: through the events of the transitions, relaxing in between."""
        knots = self._knots()
        value: Array = np.interp(t, [k[0] for k in knots], [k[1] for k in knots])
        for start, end, initial in self._cooling(knots):
            inside = (t >= start) & (t < end)
            value[inside] = self._relaxed(initial, t[inside] - start)
        return value

    def _relaxed(self, initial: float, elapsed: Array) -> Array:
        ambient = self.ambient_C
        decay: Array = np.exp(-elapsed / self.heater.cooling_time_constant_s)
        return ambient + (initial - ambient) * decay

    def _knots(self) -> list[tuple[float, float]]:
        melting, setpoint = self.heater.melting_point_C, self.heater.soft_setpoint_C
        knots = [(0.0, self.temperature_C)]
        sleeping = isinstance(self.times, SequentialTiming)
        liquid = self.soft_at_start
        for item in self.transitions:
            since, before = knots[-1]
            liquid = item.to == "soft"
            if liquid:
                warm = float(self._relaxed(before, np.array(item.heater_s - since)))
                knots.append((item.heater_s, warm))
                if sleeping:
                    knots.append((item.done_s, setpoint))
                else:
                    knots += [(item.onset_s, melting), (item.done_s, melting)]
            elif sleeping:
                knots += self._liquid(setpoint, since, before, item.heater_s)
                _, held = knots[-1]
                cooled = float(self._relaxed(held, np.array(item.done_s - item.heater_s)))
                knots.append((item.done_s, cooled))
            else:
                knots += self._liquid(self._peak(item), since, before, item.heater_s)
                knots += [(item.onset_s, melting), (item.done_s, melting)]
        if liquid:
            knots += self._liquid(setpoint, *knots[-1], until=_NEVER)
        return knots

    def _peak(self, freeze: Transition) -> float:
        """Temperature from which cooling to the plateau takes as long as the freeze says [C]."""
        assert isinstance(self.times, OverlappedTiming)
        melting, setpoint = self.heater.melting_point_C, self.heater.soft_setpoint_C
        lead = self.times.freeze_s - self.times.freeze_changing_s
        lag = freeze.onset_s - freeze.heater_s
        return melting + (setpoint - melting) * (min(1.0, lag / lead) if lead > 0 else 1.0)

    def _liquid(
        self, target: float, since: float, before: float, until: float
    ) -> list[tuple[float, float]]:
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

    def _cooling(self, knots: list[tuple[float, float]]) -> list[tuple[float, float, float]]:
        """(start, end, initial temperature) of the periods without heater."""
        periods: list[tuple[float, float, float]] = []
        start, initial = (_NEVER, 0.0) if self.soft_at_start else (0.0, self.temperature_C)
        for item in self.transitions:
            if item.to == "soft":
                periods.append((start, item.heater_s, initial))
                start = _NEVER
            elif isinstance(self.times, SequentialTiming):
                start, initial = item.heater_s, float(np.interp(item.heater_s, *np.array(knots).T))
            else:
                start, initial = item.done_s, self.heater.melting_point_C
        return [*periods, (start, _NEVER, initial)]


def segment_heating(
    problem: Problem, transitions: Sequence[Transition]
) -> tuple[SegmentHeating, SegmentHeating]:
    """Split a plan's transitions by segment."""
    start: Mode = problem.start_mode
    times = problem.transition_times
    if isinstance(times, ThermalTiming):
        model = thermal_transitions(problem)
        one, two = (
            ThermalHeating(
                course=model.course(j, transitions),
                soft_at_start=bool(start[j]),
                transitions=tuple(item for item in transitions if item.segment == j + 1),
            )
            for j in (0, 1)
        )
        return one, two
    first, second = (
        ConstantHeating(
            heater=problem.robot.heater,
            times=times,
            ambient_C=problem.ambient,
            soft_at_start=bool(start[j]),
            temperature_C=problem.temperatures[j],
            transitions=tuple(item for item in transitions if item.segment == j + 1),
        )
        for j in (0, 1)
    )
    return first, second
