"""When to heat: a segment passes its onsets exactly when a schedule says.

Heat as late as the schedule allows: a solid segment loses all the sooner what it is given early, so
among heatings that reach the plateau at the same time the late one, at full current, takes the
least energy. Before a freeze likewise: heat up to the set-point at first, then hold, and switch off
as early as the metal still stays liquid until its onset.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from scipy.optimize import brentq

from twosra_mpc.thermal.model import SegmentModel, State
from twosra_mpc.thermal.trajectory import Heating, Piece, TemperatureTrajectory
from twosra_mpc.thermal.uncertainty import Windows

_ROUNDING_S = 1e-6  # what is saved must be more


class KeepWarm(NamedTuple):
    """Temperature at which a solid segment is kept warm, and the price of the energy."""

    temperature_C: float
    energy_s_per_J: float


class SegmentTransition(NamedTuple):
    """One transition as a heating makes it [s].

    ``earliest_s`` is the earliest onset that the state before it allows.
    """

    to: Literal["soft", "rigid"]
    heater_s: float
    onset_s: float
    done_s: float
    earliest_s: float


@dataclass(frozen=True)
class HeatingPlan:
    """How one segment is heated.

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
        self,
        temperature_C: float,
        soft: bool,
        onsets: Sequence[tuple[Literal["soft", "rigid"], float]],
    ) -> tuple[TemperatureTrajectory, list[SegmentTransition]]:
        """Heat a segment so that it melts and freezes at these onsets, or as soon as it can.

        Args:
            temperature_C: Temperature at t = 0.
            soft: Whether it is liquid at t = 0.
            onsets: (soft or rigid, onset [s]) in order.
        """
        state = self.model.initial(temperature_C)
        pieces = self.held_soft(0.0, state) if soft else (self._off(0.0, state),)
        trajectory = TemperatureTrajectory(self.model, self.melt_current_A, pieces)
        done, all_made = 0.0, []
        for to, onset in onsets:
            trajectory, made = (
                self._melted(trajectory, done, onset)
                if to == "soft"
                else self._frozen(trajectory, done, onset)
            )
            all_made.append(made)
            done = made.done_s
        return trajectory, all_made

    def held_soft(self, start_s: float, state: State) -> tuple[Piece, ...]:
        """Bring a segment to the soft set-point and hold it there."""
        level = self.model.level_at(self.soft_setpoint_C)
        hotter = self.model.level(state) > level
        current = 0.0 if hotter else self.melt_current_A
        needed = self.model.time_until(state, current, level)
        way = Heating.OFF if hotter else Heating.MELT
        pieces = (Piece(start_s, state, way, self.soft_setpoint_C),)
        if needed == math.inf:
            return pieces
        there = self.model.propagate(state, current, needed)
        held = Piece(start_s + needed, there, Heating.HOLD, self.soft_setpoint_C)
        return (held,) if needed == 0.0 else (*pieces, held)

    def lead_s(self, state: State) -> float:
        """Earliest onset of melting after heater on."""
        if self.model.level(state) >= self.model.solid_level:  # by rounding, after a freeze
            return 0.0
        until = self.model.time_until(state, self.melt_current_A, self.model.solid_level)
        return self.windows.melt_early * until

    def melting_s(self, state: State) -> float:
        """Latest end of melting after heater on."""
        until = self.model.time_until(state, self.melt_current_A, self.model.liquid_level)
        return self.windows.melt_late * until

    def coasting_s(self, state: State) -> float:
        """Earliest onset of freezing after heater off."""
        if self.model.level(state) <= self.model.liquid_level:  # by rounding, after a melt
            return 0.0
        return self.windows.freeze_early * self.model.time_until(
            state, 0.0, self.model.liquid_level
        )

    def freezing_s(self, state: State) -> float:
        """Latest end of freezing after heater off."""
        return self.windows.freeze_late * self.model.time_until(state, 0.0, self.model.solid_level)

    def _off(self, start_s: float, state: State) -> Piece:
        return Piece(start_s, state, Heating.OFF, self.rigid_setpoint_C)

    def _melted(
        self, trajectory: TemperatureTrajectory, since: float, onset: float
    ) -> tuple[TemperatureTrajectory, SegmentTransition]:
        passive, made = self._heated_late(trajectory, since, onset)
        if self.keep_warm is None:
            return passive, made
        kept_warm = self._kept_warm(trajectory, self.keep_warm.temperature_C)
        warm, sooner = self._heated_late(kept_warm, since, onset)
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

    def _heated_late(
        self, trajectory: TemperatureTrajectory, since: float, onset: float
    ) -> tuple[TemperatureTrajectory, SegmentTransition]:
        def late(heater: float) -> float:
            return heater + self.lead_s(trajectory.state_at(heater)) - onset

        earliest = late(since) + onset
        heater = since if late(since) >= 0 else float(brentq(late, since, onset, xtol=1e-12))
        state = trajectory.state_at(heater)
        onset = heater + self.lead_s(state)
        done = heater + self.melting_s(state)
        kept = [piece for piece in trajectory.pieces if piece.start_s < heater]
        pieces = (*kept, *self.held_soft(heater, state))
        made = SegmentTransition("soft", heater, onset, done, earliest)
        return TemperatureTrajectory(self.model, self.melt_current_A, pieces), made

    def _kept_warm(self, trajectory: TemperatureTrajectory, warm_C: float) -> TemperatureTrajectory:
        """Let a segment whose heater is off cool to ``warm_C``, then hold it there."""
        off = trajectory.pieces[-1]
        needed = self.model.time_until(off.state, 0.0, self.model.level_at(warm_C))
        if needed == math.inf:
            return trajectory
        there = self.model.propagate(off.state, 0.0, needed)
        return trajectory.extended(Piece(off.start_s + needed, there, Heating.HOLD, warm_C))

    def _frozen(
        self, trajectory: TemperatureTrajectory, since: float, onset: float
    ) -> tuple[TemperatureTrajectory, SegmentTransition]:
        def late(off: float) -> float:
            return off + self.coasting_s(trajectory.state_at(off)) - onset

        earliest = late(since) + onset
        off = since if late(since) >= 0 else float(brentq(late, since, onset, xtol=1e-12))
        state = trajectory.state_at(off)
        made = SegmentTransition(
            "rigid", off, off + self.coasting_s(state), off + self.freezing_s(state), earliest
        )
        kept = tuple(piece for piece in trajectory.pieces if piece.start_s < off)
        pieces = (*kept, self._off(off, state))
        return TemperatureTrajectory(self.model, self.melt_current_A, pieces), made
