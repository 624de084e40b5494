"""Heating plans: a segment passes its onsets exactly when a schedule says.

Heat as late as the schedule allows: a solid segment loses all the sooner what it is given early, so
among heatings that reach the plateau at the same time the late one, at full current, takes the
least energy. Before a freeze likewise: heat up to the set-point at first, then hold, and switch off
as early as the metal still stays liquid until its onset.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.thermal.model import Array, SegmentModel, State, Values, crossing
from twosra_mpc.thermal.uncertainty import Windows

Stiffness = Literal["soft", "rigid"]

_ROUNDING_S = 1e-6  # what is saved must be more
_SAME_S = 1e-12  # times that differ by rounding
_SURELY_S = 1e-8  # after a transition's end the segment is beyond its threshold, not rounded to it


class Piece(NamedTuple):
    """Piece from ``start_s`` on: state then, current (None: what holds it), set-point [C]."""

    start_s: float
    state: State
    current_A: float | None
    setpoint_C: float


@dataclass(frozen=True)
class TemperatureTrajectory:
    """Heater and state of a segment over time; the last of its pieces has no end.

    Attributes:
        model: The segment model.
        pieces: At least one, the first from t = 0.
    """

    model: SegmentModel
    pieces: tuple[Piece, ...]

    def switched(self, time_s: float, *pieces: Piece) -> TemperatureTrajectory:
        """Return the same trajectory with other pieces from a time on."""
        kept = (piece for piece in self.pieces if piece.start_s < time_s)
        return replace(self, pieces=(*kept, *pieces))

    def state_at(self, time_s: float) -> State:
        """State of the segment."""
        piece = self.pieces[max(0, bisect_right(self._starts, time_s) - 1)]
        return self._since(piece, max(0.0, time_s - piece.start_s))

    def temperature_and_melt_fraction(self, t: Array) -> tuple[Array, Array]:
        """Temperature [C] and melt fraction at each time."""
        states = self.states_at(t)
        return self.model.temperature_C(states), self.model.melt_fraction(states)

    def states_at(self, t: Array) -> tuple[Array, ...]:
        """Values of the segment's state, each at every time."""
        number, found = self._numbers(t), np.empty((len(self.pieces[0].state), len(t)))
        for k in set(number.tolist()):
            during, piece = number == k, self.pieces[k]
            found[:, during] = self._since(piece, np.maximum(t[during] - piece.start_s, 0.0))
        return tuple(found)

    def setpoint_C(self, t: Array) -> Array:
        """Temperature set-point from each time to the next [C]."""
        return np.array([piece.setpoint_C for piece in self.pieces])[self._numbers(t)]

    def current_A(self, t: Array) -> Array:
        """Heater current from each time to the next, of the right energy where it varies [A]."""
        currents: Array = np.array([piece.current_A for piece in self.pieces], dtype=float)
        found, after = currents[self._numbers(t)], np.append(t[1:], np.inf)
        lasting = np.where(np.isfinite(after), after - t, 0.0)
        for k in np.flatnonzero(np.isnan(found)).tolist():
            found[k] = self.model.holding_current_A(self.state_at(float(t[k])), float(lasting[k]))
        return found

    def event_times(self) -> list[float]:
        """Times at which set-point or current change [s]."""
        return self._starts

    def energy_J(self, until_s: float) -> float:
        """Heater energy from t = 0."""
        total = 0.0
        for piece, end in zip(self.pieces, [*self._starts[1:], until_s], strict=True):
            duration = min(end, until_s) - piece.start_s
            if duration <= 0 or piece.current_A == 0.0:
                continue
            if piece.current_A is None:
                total += self.model.holding_energy_J(piece.state, duration)
            else:
                total += self.model.energy_J(piece.state, piece.current_A, duration)
        return total

    @cached_property
    def _starts(self) -> list[float]:
        return [piece.start_s for piece in self.pieces]

    def _numbers(self, t: Array) -> NDArray[np.intp]:
        """Number of the piece that each time is in."""
        return np.maximum(np.searchsorted(self._starts, t, side="right") - 1, 0)

    def _since(self, piece: Piece, duration_s: Values) -> tuple[Values, ...]:
        """State so long after a piece began."""
        if piece.current_A is None:
            return self.model.hold(piece.state, duration_s)
        return self.model.propagate(piece.state, piece.current_A, duration_s)


class KeepWarm(NamedTuple):
    """Temperature at which a solid segment is kept warm, and the price of the energy."""

    temperature_C: float
    energy_s_per_J: float


class SegmentTransition(NamedTuple):
    """Transition as a heating makes it [s]."""

    to: Stiffness
    heater_s: float
    onset_s: float
    done_s: float


@dataclass(frozen=True)
class HeatingPlan:
    """Heating of one segment.

    Attributes:
        model: The segment model.
        melt_current_A: Full current.
        soft_setpoint_C: Temperature at which it is held liquid.
        rigid_setpoint_C: Set-point while its heater is off.
        windows: How far real transitions may differ from the model's.
        keep_warm: Where to keep a segment warm if that pays; None: never.
    """

    model: SegmentModel
    melt_current_A: float
    soft_setpoint_C: float
    rigid_setpoint_C: float
    windows: Windows
    keep_warm: KeepWarm | None

    def heated(
        self, start: State, soft: bool, onsets: Sequence[tuple[Stiffness, float]]
    ) -> tuple[TemperatureTrajectory, list[SegmentTransition]]:
        """Heat a segment so that it melts and freezes at these onsets, or as soon as it can.

        Args:
            start: State at t = 0.
            soft: Whether it is liquid then, and its heater on.
            onsets: (soft or rigid, onset [s]) in order.
        """
        pieces = self._from("soft" if soft else "rigid", 0.0, start)
        trajectory = TemperatureTrajectory(self.model, pieces)
        done, made = 0.0, list[SegmentTransition]()
        changing = self.model.solid_level < self.model.level(start) < self.model.liquid_level
        for to, onset in onsets:
            changed = self._melted if to == "soft" else self._switched
            goes_on = changing and not made  # or turns back: at t = 0
            trajectory, item = changed(trajectory, to, done, 0.0 if goes_on else onset)
            made.append(item)
            done = item.done_s
        return trajectory, made

    def unheated_courses(self, start: State) -> tuple[TemperatureTrajectory, ...]:
        """Courses from t = 0 of a segment that is not liquid until it is melted: one of these."""
        passive = TemperatureTrajectory(self.model, self._from("rigid", 0.0, start))
        if self.keep_warm is None:
            return (passive,)
        return passive, self._kept_warm(passive, self.keep_warm.temperature_C)

    def lead_s(self, state: State) -> float:
        """Earliest onset of melting after heater on."""
        return self.windows.melt_early * self.heating_s(state, self.model.solid_level)

    def melting_s(self, state: State) -> float:
        """Latest end of melting after heater on."""
        return self.windows.melt_late * self.heating_s(state, self.model.liquid_level) + _SURELY_S

    def heating_s(self, state: State, level: float) -> float:
        """Time from heater on to a level; none where the segment is beyond it."""
        if self.model.level(state) >= level:
            return 0.0
        return self.model.time_until(state, self.melt_current_A, level)

    def coasting_s(self, state: State) -> float:
        """Earliest onset of freezing after heater off."""
        if self.model.level(state) <= self.model.liquid_level:  # it freezes already
            return 0.0
        until = self.model.time_until(state, 0.0, self.model.liquid_level)
        return self.windows.freeze_early * until

    def freezing_s(self, state: State) -> float:
        """Latest end of freezing after heater off."""
        until = self.model.time_until(state, 0.0, self.model.solid_level)
        return self.windows.freeze_late * until + _SURELY_S

    def _from(self, to: Stiffness, start_s: float, state: State) -> tuple[Piece, ...]:
        """Bring a segment to the soft set-point and hold it there, or switch its heater off."""
        if to == "rigid":
            return (Piece(start_s, state, 0.0, self.rigid_setpoint_C),)
        level = self.model.level_at(self.soft_setpoint_C)
        current = 0.0 if self.model.level(state) > level else self.melt_current_A
        needed = self.model.time_until(state, current, level)
        pieces = (Piece(start_s, state, current, self.soft_setpoint_C),)
        if needed == math.inf:
            return pieces
        there = self.model.propagate(state, current, needed)
        held = Piece(start_s + needed, there, None, self.soft_setpoint_C)
        return (held,) if needed == 0.0 else (*pieces, held)

    def _switched(
        self, trajectory: TemperatureTrajectory, to: Stiffness, since: float, onset: float
    ) -> tuple[TemperatureTrajectory, SegmentTransition]:
        """Switch the heater as late (on) or as early (off) as the onset allows, after ``since``."""
        early_s, late_s = self.coasting_s, self.freezing_s
        if to == "soft":
            early_s, late_s = self.lead_s, self.melting_s

        def late(switch: float) -> float:
            by = switch + early_s(trajectory.state_at(switch)) - onset
            return by if abs(by) > _SAME_S else 0.0

        heater = since
        if (at_once := late(since)) < 0:
            lag = late(onset)  # of a switch at the onset; all others alike if the state rests
            heater = crossing(late, (since, at_once), (onset, lag), max(since, onset - lag))
        state = trajectory.state_at(heater)
        made = SegmentTransition(to, heater, heater + early_s(state), heater + late_s(state))
        return trajectory.switched(heater, *self._from(to, heater, state)), made

    def _melted(
        self, trajectory: TemperatureTrajectory, to: Stiffness, since: float, onset: float
    ) -> tuple[TemperatureTrajectory, SegmentTransition]:
        """Heat late, after the segment was kept warm if that pays."""
        passive, made = self._switched(trajectory, to, since, onset)
        if self.keep_warm is None:
            return passive, made
        kept_warm = self._kept_warm(trajectory, self.keep_warm.temperature_C)
        warm, sooner = self._switched(kept_warm, to, since, onset)
        saved = min(
            made.done_s - sooner.done_s,
            self._refrozen_s(passive, made.done_s) - self._refrozen_s(warm, sooner.done_s),
        )
        energy = warm.energy_J(sooner.done_s) - passive.energy_J(made.done_s)
        pays = saved > self.keep_warm.energy_s_per_J * energy + _ROUNDING_S
        return (warm, sooner) if pays else (passive, made)

    def _refrozen_s(self, trajectory: TemperatureTrajectory, off: float) -> float:
        """End of a freeze with the heater off from then on: what is warmer may freeze later."""
        return off + self.freezing_s(trajectory.state_at(off))

    def _kept_warm(self, trajectory: TemperatureTrajectory, warm_C: float) -> TemperatureTrajectory:
        """Let a segment whose heater is off cool to ``warm_C``, then hold it there."""
        start_s, state, *_ = trajectory.pieces[-1]
        needed = self.model.time_until(state, 0.0, self.model.level_at(warm_C))
        if needed == math.inf:
            return trajectory
        held = Piece(start_s + needed, self.model.propagate(state, 0.0, needed), None, warm_C)
        return trajectory.switched(held.start_s, held)
