"""Transition times from the segments' thermal state.

What a transition takes depends on how warm the segment is, hence on all that happened before. The
network holds what no history can undercut (``thermal.least_times``); ``settle`` raises it to what
a given schedule needs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from twosra_mpc.robot.modes import Mode, ModeSequence
from twosra_mpc.thermal.heating import HeatingPlan, Timed
from twosra_mpc.thermal.least_times import LeastTimes
from twosra_mpc.thermal.trajectory import Course
from twosra_mpc.timing.constant import ONE_HEATER
from twosra_mpc.timing.network import (
    Event,
    EventLayout,
    Hold,
    TemporalNetwork,
    events_of,
    network_of_events,
    phase_order,
)
from twosra_mpc.timing.one_heater import overlapping, successive
from twosra_mpc.timing.transitions import Transition, number_of

_SETTLED_S = 1e-9


@dataclass(frozen=True)
class Thermal:
    """Melting and freezing by the thermal model, heated late.

    Attributes:
        heating: How a segment is heated.
        first: Stiffness at t = 0.
        temperatures: Temperatures of the segments at t = 0 [C].
        heaters_at_once: How many heaters may be on at a time.
    """

    heating: HeatingPlan
    first: Mode
    temperatures: tuple[float, float]
    heaters_at_once: int

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        if self.heaters_at_once == 2:
            return None
        for one, two in overlapping(sequence, self.first, last):
            if not self._coasts(0, two.melt) and not self._coasts(1, one.melt):
                return ONE_HEATER
        return None

    def _coasts(self, segment: int, melt: Event | None) -> bool:
        """Whether a segment might stay liquid without heat while the other one melts."""
        if melt is None:
            return False
        other = self._histories[melt.segment]
        needed = (
            other.warmest_lead_s + other.first_melting_s if melt.number == 0 else other.melting_s
        )
        return self._histories[segment].longest_coasting_s > needed

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        layout = EventLayout(len(sequence))
        least = phase_order(layout)
        holds: list[Hold] = []
        energy, molten = 0.0, 0
        previous = layout.origin
        before: float | None = None  # least time from the onset of the transition before
        events = tuple(events_of(sequence, self.first, last))
        for event in events:
            history = self._histories[event.segment]
            onset, begin = layout.onset(event.gap, event.segment), layout.start(event.gap)
            least[layout.end(event.gap - 1), onset] = 0.0
            if event.number == 0:
                previous, before = layout.origin, None
            if event.to == "soft":
                energy += history.first_energy_J if before is None else history.energy_J
                least[previous, onset] = history.first_lead_s if before is None else before
                before = history.first_melting_s if before is None else history.melting_s
            else:
                if event.number:
                    holds.append(Hold(layout.start(molten), onset, history.liquid_power_W))
                if before is None:
                    least[previous, onset] = history.first_coasting_s
                    least[previous, begin] = history.first_freezing_s
                else:
                    least[previous, onset] = before + history.coasting_s(event.number)
                held = sum(least_durations[molten : event.gap]) if event.number else 0.0
                before = history.freezing_s(event.number, held)
            least[onset, begin] = before
            previous, molten = onset, event.gap
        if self.heaters_at_once == 1:
            least |= self._least_handovers(sequence, last, least, layout)
        return network_of_events(sequence, last, events, least, holds, energy)

    def _least_handovers(
        self,
        sequence: ModeSequence,
        last: Mode,
        least: dict[tuple[int, int], float],
        layout: EventLayout,
    ) -> dict[tuple[int, int], float]:
        """The earlier heater goes off when its segment is molten, and can coast only so long."""
        added = {}
        for earlier, freeze, melt in self._handovers(sequence, last):
            lead = self._histories[melt.segment].warmest_lead_s if melt.number == 0 else 0.0
            on = layout.onset(melt.gap, melt.segment)
            off = layout.onset(freeze.gap, freeze.segment)
            added[off, on] = lead - self._histories[freeze.segment].longest_coasting_s
            if earlier is not None:
                onset = layout.onset(earlier.gap, earlier.segment)
                added[onset, on] = least[onset, layout.start(earlier.gap)] + lead
        return added

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        layout, raised = network.layout, dict(network.least)
        made: dict[tuple[int, int], Timed] = {}
        for segment in (0, 1):
            previous = layout.origin
            events, timed = self._timed(network, times, segment)
            for event, item in zip(events, timed, strict=True):
                onset, begin = layout.onset(event.gap, segment), layout.start(event.gap)
                made[event.gap, segment] = item
                if item.onset_s > times[onset] + _SETTLED_S:
                    raised[previous, onset] = item.onset_s - times[previous]
                if item.done_s - item.onset_s > times[begin] - times[onset] + _SETTLED_S:
                    raised[onset, begin] = item.done_s - item.onset_s
                previous = onset
        if self.heaters_at_once == 1:
            if any(overlapping(network.sequence, self.first, network.last)):
                raised[layout.finish, layout.origin] = 1.0  # not refused, but not planned either
            for _, freeze, melt in self._handovers(network.sequence, network.last):
                off, on = (layout.onset(e.gap, e.segment) for e in (freeze, melt))
                late = made[freeze.gap, freeze.segment].heater_s
                late -= made[melt.gap, melt.segment].heater_s
                if late > _SETTLED_S:
                    raised[off, on] = times[on] - times[off] + late
        return None if raised == network.least else replace(network, least=raised)

    def transitions(self, network: TemporalNetwork, times: Sequence[float]) -> list[Transition]:
        found: list[Transition] = []
        for segment in (0, 1):
            _, timed = self._timed(network, times, segment)
            found += [Transition(number_of(segment), *item[:4]) for item in timed]
        return sorted(found, key=lambda item: (item.heater_s, item.segment))

    def course(self, segment: int, transitions: Sequence[Transition]) -> Course:
        """Heater and state of a segment (0 or 1) over time, from all transitions of a plan."""
        onsets = [(item.to, item.onset_s) for item in transitions if item.segment == segment + 1]
        soft = bool(self.first[segment])
        return self.heating.course(self.temperatures[segment], soft, onsets)[0]

    def _timed(
        self, network: TemporalNetwork, times: Sequence[float], segment: int
    ) -> tuple[list[Event], list[Timed]]:
        events = [
            event
            for event in events_of(network.sequence, self.first, network.last)
            if event.segment == segment
        ]
        onsets = [(e.to, float(times[network.layout.onset(e.gap, segment)])) for e in events]
        soft = bool(self.first[segment])
        return events, self.heating.course(self.temperatures[segment], soft, onsets)[1]

    def _handovers(
        self, sequence: ModeSequence, last: Mode
    ) -> Iterator[tuple[Event | None, Event, Event]]:
        """(melt, freeze, melt of the other) where one heater goes off before the other goes on."""
        for pair in successive(sequence, self.first, last):
            if pair is not None and pair[0].freeze is not None and pair[1].melt is not None:
                yield pair[0].melt, pair[0].freeze, pair[1].melt

    @cached_property
    def _histories(self) -> tuple[LeastTimes, LeastTimes]:
        first, second = (LeastTimes(self.heating, here) for here in self.temperatures)
        return first, second
