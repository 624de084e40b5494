"""Constant transition times: overlapping each other and the motion, or waited through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from twosra_mpc.robot.heater import Heater
from twosra_mpc.robot.modes import RIGID, SOFT_BOTH, Mode, ModeSequence, Stiffness
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming
from twosra_mpc.timing.network import (
    EventLayout,
    Hold,
    TemporalNetwork,
    events_of,
    network_of_events,
    phase_order,
)
from twosra_mpc.timing.one_heater import successive
from twosra_mpc.timing.transitions import Transition, number_of

ONE_HEATER = "mode [1,1] needs both heaters at once, but heaters_at_once is 1"


@dataclass(frozen=True)
class Overlapped:
    """Constant times; heating and cooling outside the plateau overlap with everything.

    Attributes:
        times: The constants.
        heater: Heater description.
        ambient_C: Temperature of the air, from which ``melt_s`` is counted.
        first: Stiffness at t = 0.
        temperatures: Temperatures of the segments at t = 0 [C].
        heaters_at_once: How many heaters may be on at a time.
    """

    times: OverlappedTiming
    heater: Heater
    ambient_C: float
    first: Mode
    temperatures: tuple[float, float]
    heaters_at_once: int

    @property
    def _melt_lead(self) -> float:
        """Heater on to onset of melting, from ambient [s]."""
        return self.times.melt_s - self.times.melt_changing_s

    @property
    def _freeze_lead(self) -> float:
        """Heater off to onset of freezing, from the soft set-point [s]."""
        return self.times.freeze_s - self.times.freeze_changing_s

    def _first_lead(self, segment: int) -> float:
        """Least time to the first onset of a segment, from its temperature at t = 0 [s]."""
        heater, now = self.heater, self.temperatures[segment]
        if now > heater.melting_point_C:
            span = heater.soft_setpoint_C - heater.melting_point_C
            return self._freeze_lead * (now - heater.melting_point_C) / span
        span = heater.melting_point_C - self.ambient_C
        return self._melt_lead * (heater.melting_point_C - now) / span

    def _lead(self, segment: int, number: int) -> float:
        return self._first_lead(segment) if number == 0 else self._melt_lead

    def _plateau(self, to: Stiffness) -> float:
        return self.times.melt_changing_s if to == "soft" else self.times.freeze_changing_s

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        if self.heaters_at_once == 1 and None in successive(sequence, self.first, last):
            return ONE_HEATER
        return None

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        del least_durations  # these times depend on nothing
        layout = EventLayout(len(sequence))
        least = phase_order(layout)
        holds: list[Hold] = []
        heated = 0.0
        previous = layout.origin
        events = tuple(events_of(sequence, self.first, last))
        for event in events:
            onset = layout.onset(event.gap, event.segment)
            least[layout.end(event.gap - 1), onset] = 0.0
            least[onset, layout.start(event.gap)] = self._plateau(event.to)
            if event.number == 0:
                least[layout.origin, onset] = self._first_lead(event.segment)
            elif event.to == "soft":
                least[previous, onset] = self.times.freeze_changing_s + self._melt_lead
            else:
                least[previous, onset] = self.times.melt_changing_s
            if event.to == "soft":
                heated += self._lead(event.segment, event.number) + self.times.melt_changing_s
            elif event.number:
                heated -= self._power * self.times.melt_changing_s / self._melt_power
                holds.append(Hold(previous, onset, self._power))
            previous = onset
        if self.heaters_at_once == 1:
            least |= self._one_at_a_time(sequence, last, layout)
        energy = heated * self._melt_power
        return network_of_events(sequence, last, events, least, holds, energy)

    @property
    def _melt_power(self) -> float:
        return _power(self.heater, "melt")

    @property
    def _power(self) -> float:
        """Least mean heater power from molten to the onset of the freeze.

        The heater is on for a share of a short liquid period, and afterwards holds.
        """
        return min(_power(self.heater, "hold"), self.times.superheat_share * self._melt_power)

    def _one_at_a_time(
        self, sequence: ModeSequence, last: Mode, layout: EventLayout
    ) -> dict[tuple[int, int], float]:
        """The later spell's heater goes on when the earlier one's is off, at the earliest."""
        least = {}
        for pair in successive(sequence, self.first, last):
            if pair is None or pair[0].freeze is None or pair[1].melt is None:
                continue
            freeze, melt = pair[0].freeze, pair[1].melt
            off, on = (layout.onset(e.gap, e.segment) for e in (freeze, melt))
            least[off, on] = self._lead(melt.segment, melt.number) - self._freeze_lead
        return least

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        """Constant times need nothing else, but that the metal stores enough heat to coast."""
        if self.heaters_at_once == 2:
            return None
        layout, raised = network.layout, dict(network.least)
        found = {(item.segment, item.onset_s): item for item in self.transitions(network, times)}
        violated = False
        for pair in successive(network.sequence, self.first, network.last):
            if pair is None or pair[0].freeze is None or pair[1].melt is None:
                continue
            freeze, melt = pair[0].freeze, pair[1].melt
            off, on = (layout.onset(e.gap, e.segment) for e in (freeze, melt))
            lag = times[off] - found[number_of(freeze.segment), times[off]].heater_s
            needed = self._lead(melt.segment, melt.number) - lag
            if times[on] - times[off] < needed - 1e-9:
                raised[off, on], violated = needed, True
        if not violated:
            return None
        return TemporalNetwork(**{**vars(network), "least": raised})

    def transitions(self, network: TemporalNetwork, times: Sequence[float]) -> list[Transition]:
        layout = network.layout
        found: list[Transition] = []
        molten: list[float | None] = [None, None]
        for event in events_of(network.sequence, self.first, network.last):
            onset = times[layout.onset(event.gap, event.segment)]
            done = onset + self._plateau(event.to)
            if event.to == "soft":
                lead = self._lead(event.segment, event.number)
                heater = max(0.0, onset - lead)  # not before the start by rounding
                molten[event.segment] = done
            else:
                heater = max(0.0, onset - self._freeze_lead)
                since = molten[event.segment]
                if since is not None:  # a short liquid period: the metal must store enough heat
                    heater = max(heater, since + self.times.superheat_share * (onset - since))
            found.append(Transition(number_of(event.segment), event.to, heater, onset, done))
        return sorted(found, key=lambda item: (item.heater_s, item.segment))


@dataclass(frozen=True)
class Sequential:
    """The authors' practice: everything waits through every change of mode."""

    times: SequentialTiming
    heater: Heater
    first: Mode
    heaters_at_once: int

    def _wait(self, before: Mode, after: Mode) -> float:
        if before == after:
            return 0.0
        if before == RIGID:
            return self.times.heat_s
        return self.times.freeze_s if after == RIGID else self.times.reconfigure_s

    def _gaps(self, sequence: ModeSequence, last: Mode) -> list[tuple[Mode, Mode]]:
        return list(zip((self.first, *sequence), (*sequence, last), strict=True))

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        both = SOFT_BOTH in (*sequence, last)
        return ONE_HEATER if self.heaters_at_once == 1 and both else None

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        del least_durations
        layout = EventLayout(len(sequence))
        least = phase_order(layout)
        transitions = 0
        heated = 0.0
        reheat = self.times.reconfigure_s - self.times.reconfigure_cool_s
        for gap, (before, after) in enumerate(self._gaps(sequence, last)):
            least[layout.end(gap - 1), layout.start(gap)] = self._wait(before, after)
            if before != after:
                transitions += sum(before) + sum(after)
                heated += sum(after) * (self.times.heat_s if before == RIGID else reheat)
        return TemporalNetwork(
            sequence=sequence,
            last=last,
            layout=layout,
            least=least,
            holds=(),
            melt_onsets=(),
            freeze_onsets=(),
            transitions=transitions,
            melt_energy_J=heated * _power(self.heater, "melt"),
        )

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        del network, times
        return None

    def transitions(self, network: TemporalNetwork, times: Sequence[float]) -> list[Transition]:
        layout = network.layout
        found: list[Transition] = []
        for gap, (before, after) in enumerate(self._gaps(network.sequence, network.last)):
            begin = times[layout.end(gap - 1)]
            wait = self._wait(before, after)
            if wait == 0.0:
                continue
            cooled = begin + (wait if after == RIGID else self.times.reconfigure_cool_s)
            heat_from = begin if before == RIGID else cooled
            for j in (0, 1):
                if before[j]:
                    found.append(Transition(number_of(j), "rigid", begin, begin, cooled))
                if after[j]:
                    melt = Transition(number_of(j), "soft", heat_from, heat_from, begin + wait)
                    found.append(melt)
        return sorted(found, key=lambda item: (item.heater_s, item.segment))


def _power(heater: Heater, what: Literal["melt", "hold"]) -> float:
    current = heater.melt_current_A if what == "melt" else heater.hold_current_A
    return current**2 * heater.resistance_ohm
