"""What a thermal start allows: networks that no history of melts and freezes can undercut.

Problems of one robot that begin alike, in the same state of the metal and with the same heaters,
share their networks, whatever else differs: they are made once.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache

from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness
from twosra_mpc.thermal.heating import HeatingPlan
from twosra_mpc.thermal.least_times import LeastTimes
from twosra_mpc.thermal.model import State
from twosra_mpc.timing.network import (
    Delay,
    Dwell,
    EventLayout,
    Hold,
    TemporalNetwork,
    earliest_times,
    events_of,
    handovers,
    longest_paths,
)

_LATER_S = 4.0  # over which it is seen how much sooner a freeze is that begins later
_NETWORKS = 512  # that are kept: 3 MiB


@dataclass(frozen=True, eq=False)
class ThermalStart:
    """Segments as a plan finds them, and what heats them.

    Attributes:
        plans: How each segment is heated.
        states: Of the metal at t = 0.
        first: Stiffness at t = 0.
        heaters_at_once: How many heaters may be on at a time.
    """

    plans: tuple[HeatingPlan, ...]
    states: tuple[State, ...]
    first: StartingStiffness
    heaters_at_once: int

    @cached_property
    def least(self) -> tuple[LeastTimes, ...]:
        """What no history of each segment can undercut; one for segments that are alike."""
        return tuple(map(cache(LeastTimes), self.plans, self.states))

    def coasts(self, liquid: Dwell, other: Dwell) -> bool:
        """Whether a segment might stay liquid without heat while the other one melts."""
        if other.melt is None:
            return False
        least, again = self.least[other.segment], other.melt.number > 0
        needed = least.melting_s if again else least.warmest_lead_s + least.first_melting_s
        return self.least[liquid.segment].longest_coasting_s > needed

    @lru_cache(maxsize=_NETWORKS)  # noqa: B019  # bounded; all starts share it
    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: tuple[float, ...]
    ) -> TemporalNetwork:
        """Difference constraints that every plan of a mode sequence satisfies."""
        layout = EventLayout(len(sequence), len(last))
        least, holds, energy, molten = layout.phase_order(), [], 0.0, 0
        previous = layout.origin
        before: float | None = None  # least time from the onset of the transition before
        events = tuple(events_of(sequence, self.first, last))
        for event in events:
            history = self.least[event.segment]
            onset, begin = layout.onset_of(event), layout.start(event.gap)
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
        network = TemporalNetwork(sequence, last, least, len(events), energy, tuple(holds), events)
        if self.heaters_at_once == 1:
            network = replace(network, least=least | self._least_handovers(network))
        return self._tightened(network, least_durations)

    def _tightened(
        self, network: TemporalNetwork, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        """What the network says of when transitions begin, used for how long they take.

        The metal of a melt waits liquid for its freeze as long as all that is in between takes, and
        the first melt and freeze of a segment end as late as its first heating says.
        """
        layout, least, molten = network.layout, dict(network.least), dict[int, int]()
        for event in sorted(network.events, key=lambda event: event.gap):
            history, cycle = self.least[event.segment], self.least[event.segment].first_cycle
            if cycle.is_known:
                continue
            so_far = _lasting(replace(network, least=least), least_durations)
            if (times := earliest_times(so_far)) is None:
                continue
            onset, begin = layout.onset_of(event), layout.start(event.gap)
            done_s = 0.0
            if event.to == "soft":
                molten[event.segment] = begin
                done_s = cycle.molten_s(times[onset]) if event.number == 0 else 0.0
            elif event.number:
                held_s = longest_paths(so_far, molten[event.segment])[onset]
                least[onset, begin] = history.freezing_s(event.number, held_s)
                done_s = history.frozen_s(event.number, times[onset], held_s)
            if done_s > max(times[onset] + least[onset, begin], times[begin]):
                least[layout.origin, begin] = done_s
        return replace(network, least=least)

    def with_delays(
        self, network: TemporalNetwork, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        """Return the network with how much longer first freezes take the earlier they begin."""
        lasting = _lasting(network, least_durations)
        if (times := earliest_times(lasting)) is None:
            return network
        layout, found = network.layout, list[Delay]()
        for melt, freeze in itertools.pairwise(network.events):
            cycle = self.least[melt.segment].first_cycle
            if melt.segment != freeze.segment or melt.number or freeze.to == "soft":
                continue
            if cycle.is_known:
                continue
            onset, begin = layout.onset_of(freeze), layout.start(freeze.gap)
            held_s = longest_paths(lasting, layout.start(melt.gap))[onset]
            now_s, later_s = (cycle.frozen_s(times[onset] + s, held_s) for s in (0.0, _LATER_S))
            share = min(1.0, (later_s - now_s) / _LATER_S)
            least = cycle.frozen_s(times[onset], held_s, share)
            found.append(Delay(onset, begin, share, least))
        return replace(network, delays=tuple(found))

    def _least_handovers(self, network: TemporalNetwork) -> dict[tuple[int, int], float]:
        """The earlier heater goes off when its segment is molten, and can coast only so long."""
        layout, added = network.layout, {}
        for melt, off, on in handovers(network.sequence, self.first, network.last):
            lead = self.least[on.segment].warmest_lead_s if on.number == 0 else 0.0
            coasting = self.least[off.segment].longest_coasting_s
            added[layout.onset_of(off), layout.onset_of(on)] = lead - coasting
            if melt is not None:
                onset = layout.onset_of(melt)
                molten = network.least[onset, layout.start(melt.gap)]
                added[onset, layout.onset_of(on)] = molten + lead
        return added


def _lasting(network: TemporalNetwork, durations: Sequence[float]) -> TemporalNetwork:
    """The network with these least durations of its phases [s]."""
    layout = network.layout
    phases = {(layout.start(i), layout.end(i)): least for i, least in enumerate(durations)}
    return replace(network, least=network.least | phases)


# One object for equal values, so that what it was asked is found by who it is.
thermal_start = lru_cache(maxsize=64)(ThermalStart)
