"""Constant transition times that overlap each other and the motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from twosra_mpc.problem.tolerances import TIME_TOLERANCE_S
from twosra_mpc.robot.modes import Mode, ModeSequence
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.timing.constant_heating import ConstantHeating
from twosra_mpc.timing.network import (
    Dwell,
    Event,
    EventLayout,
    Hold,
    TemporalNetwork,
    events_of,
    handovers,
    unheated,
)
from twosra_mpc.timing.transitions import Transition, TransitionModel, model_of


@model_of.register(OverlappedTiming)
@dataclass(frozen=True)
class Overlapped(TransitionModel):
    """Constant times; heating and cooling outside the plateau overlap with everything.

    ``melt_s`` is counted from the temperature of the air.
    """

    times: OverlappedTiming

    @property
    def words(self) -> str:
        return f"the constant melt and freeze times of timing “{self.problem.timing}”"

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
        heater, now = self.problem.robot.heater, self.problem.temperatures[segment]
        if now > heater.melting_point_C:
            span = heater.soft_setpoint_C - heater.melting_point_C
            return self._freeze_lead * (now - heater.melting_point_C) / span
        span = heater.melting_point_C - self.problem.ambient
        return self._melt_lead * (heater.melting_point_C - now) / span

    def _molten_s(self, segment: int) -> float:
        """Since when a segment that is liquid at t = 0 is, had it been heated all the time [s]."""
        heater, now = self.problem.robot.heater, self.problem.temperatures[segment]
        span = heater.soft_setpoint_C - heater.melting_point_C
        return -self.times.superheat_s * min(1.0, (now - heater.melting_point_C) / span)

    def _lead(self, melt: Event) -> float:
        """Heater on to onset: from where the segment is at t = 0, or as far as it has frozen."""
        if melt.number == 0:
            return self._first_lead(melt.segment)
        begun = melt.number == 1 and self.first[melt.segment] is None
        return self._melt_lead * (self.left(melt.segment, "rigid") if begun else 1.0)

    def _is_under_way(self, event: Event) -> bool:
        """True if a change of metal that is changing at t = 0 goes on, or back, from then on."""
        return event.number == 0 and self.first[event.segment] is None

    def _plateau(self, event: Event) -> float:
        soft = event.to == "soft"
        whole = self.times.melt_changing_s if soft else self.times.freeze_changing_s
        return whole if event.number else whole * self.left(event.segment, event.to)

    def coasts(self, liquid: Dwell, other: Dwell) -> bool:
        """True if a segment may stay liquid without heat while the other one melts."""
        if liquid.freeze is None or other.melt is None:
            return False
        needed_s = self._lead(other.melt) + self.times.melt_changing_s
        return liquid.melts_before(other) and self._freeze_lead >= needed_s

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        del least_durations  # these times depend on nothing
        layout = EventLayout(len(sequence), len(last))
        least, holds, heated, changing_s = layout.phase_order(), [], 0.0, 0.0
        previous = layout.origin
        heater = self.problem.robot.heater
        melt_W = heater.power_W(heater.melt_current_A)
        # Least mean power from molten to the onset of the freeze: the heater is on for a share of a
        # short liquid period, and afterwards holds.
        liquid_W = min(heater.power_W(heater.hold_current_A), self.times.superheat_share * melt_W)
        events = tuple(events_of(sequence, self.first, last))
        for event in events:
            onset = layout.onset_of(event)
            least[layout.end(event.gap - 1), onset] = 0.0
            least[onset, layout.start(event.gap)] = self._plateau(event)
            if event.number == 0:
                least[layout.origin, onset] = self._first_lead(event.segment)
            else:
                lead_s = self._lead(event) if event.to == "soft" else 0.0
                least[previous, onset] = changing_s + lead_s
            if event.to == "soft":
                heated += self._lead(event) + self._plateau(event)
            elif event.number:
                heated -= liquid_W * changing_s / melt_W
                holds.append(Hold(previous, onset, liquid_W))
            changing_s = self._plateau(event)
            previous = layout.origin if self._is_under_way(event) else onset
        energy_J = heated * melt_W
        made = TemporalNetwork(sequence, last, least, len(events), energy_J, tuple(holds), events)
        if self.problem.heaters_at_once == 1:
            for freeze, left in unheated(sequence, self.first, last):
                least[layout.end(freeze.gap - 1), layout.origin] = -max(map(self._first_lead, left))
            for _, off, on in handovers(sequence, self.first, last):
                ends = layout.onset_of(off), layout.onset_of(on)
                least[ends] = self._lead(on) - self._freeze_lead
            for turns in filter(None, self.sharing(made)):
                melt, off, on = turns[0]
                changing_s = self.times.melt_changing_s
                if melt is None or melt.gap < on.gap:
                    least |= self._shared(made, melt, off, on, changing_s)
                elif melt.number == on.number == 0:  # each cold, one after the other
                    waits = [self._lead(a) + self._heated(b, changing_s) for a, _, b in turns if a]
                    least[layout.origin, layout.start(on.gap)] = min(waits) + 2 * changing_s
        return made

    def _shared(
        self, network: TemporalNetwork, melt: Event | None, off: Event, on: Event, coasting_s: float
    ) -> dict[tuple[int, int], float]:
        """Constraints to coast while another melts, and for so long after that began to melt."""
        onset_of = network.layout.onset_of
        least = {(onset_of(off), onset_of(on)): self._lead(on) - self._freeze_lead}
        if melt is not None:
            heated = self._heated(on, coasting_s)
            least[onset_of(melt), onset_of(on)] = self.times.melt_changing_s + heated
        return least

    def _heated(self, on: Event, coasting_s: float) -> float:
        """Time from molten to the onset of another melt after which the metal coasts for so long.

        Metal that coasts was heated for its share of the time it was liquid.
        """
        share, lead = self.times.superheat_share, self._lead(on)
        return (lead + coasting_s) * share / (1 - share) + lead

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        """Constant times need nothing else, but that the metal stores enough heat to coast."""
        if self.problem.heaters_at_once > 1:
            return None
        layout, raised = network.layout, dict(network.least)
        heater_s = {(t.segment, t.onset_s): t.heater_s for t in self.made(network, times)}
        for _, off, on in handovers(network.sequence, self.first, network.last):
            events = layout.onset_of(off), layout.onset_of(on)
            off_s, on_s = (times[event] for event in events)
            lag = off_s - heater_s[off.segment + 1, off_s]
            needed = self._lead(on) - lag
            if on_s - off_s < needed - 1e-9:
                raised[events] = needed
        for melt, off, on in (turns[0] for turns in self.sharing(network) if turns):
            coasting_s = times[layout.onset_of(off)] - times[layout.onset_of(on)]
            shared = self._shared(network, melt, off, on, coasting_s).items()
            raised |= {(u, v): s for (u, v), s in shared if times[v] - times[u] < s - 1e-9}
        return None if raised == network.least else replace(network, least=raised)

    def made(self, network: TemporalNetwork, times: Sequence[float]) -> Iterator[Transition]:
        molten = {j: self._molten_s(j) for j, soft in enumerate(self.first) if soft == 1}
        for event in network.events:
            onset = times[network.layout.onset_of(event)] * (not self._is_under_way(event))
            done = onset + self._plateau(event)
            if event.to == "soft":
                lead = self._lead(event)
                heater = max(0.0, onset - lead)  # not before the start by rounding
                molten[event.segment] = done
            else:
                heater = max(0.0, onset - self._freeze_lead)
                since = molten.get(event.segment)
                if since is not None:  # a short liquid period: the metal must store enough heat
                    heater = max(heater, since + self.times.superheat_share * (onset - since))
            yield Transition(event.segment + 1, event.to, heater, onset, done)

    def segment_heating(self, segment: int, own: tuple[Transition, ...]) -> ConstantHeating:
        molten, now = self.problem.melt_fractions[segment], self.problem.temperatures[segment]
        heater, air = self.problem.robot.heater, self.problem.ambient
        superheat_s, coasting_s = self.times.superheat_s, self._freeze_lead
        return ConstantHeating(molten, own, heater, air, now, superheat_s, coasting_s)

    def violations(
        self, item: Transition, before: Transition | None, others: Sequence[Transition]
    ) -> Iterator[str]:
        del others
        heater, now = self.problem.robot.heater, self.problem.temperatures[item.segment - 1]
        melting_C, lag = heater.melting_point_C, item.onset_s - item.heater_s
        if item.to == "soft":
            least = self.times.melt_s - (plateau := self.times.melt_changing_s)
            if before is None:
                least *= (melting_C - now) / (melting_C - self.problem.ambient)
            elif before.heater_s <= TIME_TOLERANCE_S and self.first[item.segment - 1] is None:
                least *= self.left(item.segment - 1, "rigid")
            if abs(lag - least) > TIME_TOLERANCE_S:
                yield f"heated for {lag:z.3f} s before melting instead of {least:z.3f} s"
        else:
            longest = self.times.freeze_s - (plateau := self.times.freeze_changing_s)
            since = before.done_s if before else self._molten_s(item.segment - 1)
            stored = min(1.0, (item.heater_s - since) / self.times.superheat_s)
            if before is None:
                least = longest * (now - melting_C) / (heater.soft_setpoint_C - melting_C)
                if item.onset_s < least - TIME_TOLERANCE_S:
                    until = f"is still too hot until {least:z.3f} s"
                    yield f"freezes at {item.onset_s:z.3f} s, but {until}"
            if lag > stored * longest + TIME_TOLERANCE_S:
                yield f"liquid for {lag:z.3f} s after its heater is off: it would freeze earlier"
        if before is None:
            plateau *= self.left(item.segment - 1, item.to)
        if item.done_s - item.onset_s < plateau - TIME_TOLERANCE_S:
            lasts = item.done_s - item.onset_s
            yield f"on the plateau for {lasts:z.3f} s instead of {plateau:zg} s"
