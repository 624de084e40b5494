"""The temporal network: which events a mode sequence implies, and how far apart they must be.

A sequence of p phases has p + 1 gaps: gap g lies before phase g, gap p after the last phase. Where
a segment's stiffness differs on the two sides of a gap, it melts or freezes there; the *onset* is
the moment from which it may be on the plateau. From onset to done nothing may move; before the
onset of a melt the segment is still solid, before the onset of a freeze still liquid, and the robot
may drive or bend. All rules are difference constraints t[v] - t[u] >= w between event times, so the
earliest finish of a sequence is a longest path, and any relaxation of the motion gives a valid
lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from twosra_mpc.robot.modes import Mode, ModeSequence, Stiffness


@dataclass(frozen=True)
class EventLayout:
    """Numbering of the events of a sequence of ``phases`` phases of a robot of ``segments``."""

    phases: int
    segments: int

    @property
    def count(self) -> int:
        """Number of events, the origin included."""
        return 2 * self.phases + self.segments * (self.phases + 1) + 2

    @property
    def finish(self) -> int:
        """The end of the plan."""
        return self.count - 2

    @property
    def origin(self) -> int:
        """Time zero."""
        return self.count - 1

    def start(self, phase: int) -> int:
        """Start of a phase; of the phase after the last: the finish."""
        return 2 * phase if phase < self.phases else self.finish

    def end(self, phase: int) -> int:
        """End of a phase; of the phase before the first: the origin."""
        return 2 * phase + 1 if phase >= 0 else self.origin

    def onset(self, gap: int, segment: int) -> int:
        """Onset of the transition of ``segment`` (from 0) in ``gap``."""
        return 2 * self.phases + self.segments * gap + segment

    def onset_of(self, event: Event) -> int:
        """Onset of a transition."""
        return self.onset(event.gap, event.segment)

    def pairs(self) -> Iterator[tuple[int, int]]:
        """Yield every pair (u, v) that any network of this many phases may constrain."""
        for i in range(self.phases):
            yield self.start(i), self.end(i)
        for gap in range(self.phases + 1):
            yield self.end(gap - 1), self.start(gap)
            if gap > 0:
                yield self.origin, self.start(gap)
            for segment in range(self.segments):
                onset = self.onset(gap, segment)
                yield self.end(gap - 1), onset
                yield onset, self.start(gap)
                yield self.origin, onset
                others = [other for other in range(self.segments) if other != segment]
                for earlier in range(gap + 1):
                    yield from ((self.onset(earlier, other), onset) for other in others)
                    if earlier < gap:
                        yield self.onset(earlier, segment), onset


class Hold(NamedTuple):
    """While a segment is liquid its heater gives at least ``power_W`` from event u to event v."""

    since: int
    until: int
    power_W: float


@dataclass(frozen=True)
class TemporalNetwork:
    """The event times of one mode sequence as difference constraints, and what they cost.

    Attributes:
        sequence: The mode sequence.
        last: Stiffness at the end.
        layout: Numbering of the events.
        least: {(u, v): w} meaning t[v] - t[u] >= w [s].
        holds: Heater power while segments are liquid.
        melt_onsets: Events at which melts begin that heaters may delay.
        freeze_onsets: Events at which freezes begin.
        transitions: Number of melts and freezes.
        melt_energy_J: Least heater energy of all melts.
    """

    sequence: ModeSequence
    last: Mode
    layout: EventLayout
    least: dict[tuple[int, int], float]
    holds: tuple[Hold, ...]
    melt_onsets: tuple[int, ...]
    freeze_onsets: tuple[int, ...]
    transitions: int
    melt_energy_J: float


def earliest_times(network: TemporalNetwork) -> list[float] | None:
    """Earliest time of every event: longest paths from the origin [s].

    None if the constraints contradict each other.
    """
    times = [0.0] * network.layout.count
    constraints = [(u, v, least) for (u, v), least in network.least.items()]
    for _ in range(network.layout.count + 1):
        changed = False
        for u, v, least in constraints:
            if times[u] + least > times[v]:
                times[v] = times[u] + least
                changed = True
        if not changed:
            return times
    return None


def latest_times(network: TemporalNetwork, at_most: Mapping[int, float]) -> list[float]:
    """Latest time of every event with some events not later than given [s]; inf where free.

    The constraints must not contradict each other, nor the times given.
    """
    times = [math.inf] * network.layout.count
    for event, time in at_most.items():
        times[event] = time
    constraints = [(u, v, least) for (u, v), least in network.least.items()]
    changed = True
    while changed:
        changed = False
        for u, v, least in constraints:
            if times[v] - least < times[u]:
                times[u] = times[v] - least
                changed = True
    return times


def phase_order(layout: EventLayout) -> dict[tuple[int, int], float]:
    """Phases follow each other and do not run backwards."""
    least = {(layout.start(i), layout.end(i)): 0.0 for i in range(layout.phases)}
    least |= {(layout.end(g - 1), layout.start(g)): 0.0 for g in range(layout.phases + 1)}
    return least


class Event(NamedTuple):
    """A transition of a segment (from 0) in a gap; ``number`` counts those of the segment."""

    segment: int
    gap: int
    to: Stiffness
    number: int


def events_of(sequence: ModeSequence, first: Mode, last: Mode) -> Iterator[Event]:
    """Yield the transitions of each segment, segment by segment, in order of time."""
    for segment in range(len(first)):
        stiffness, number = first[segment], 0
        for gap, mode in enumerate((*sequence, last)):
            if mode[segment] != stiffness:
                stiffness = mode[segment]
                yield Event(segment, gap, "soft" if stiffness else "rigid", number)
                number += 1


def network_of_events(
    sequence: ModeSequence,
    last: Mode,
    events: Sequence[Event],
    least: dict[tuple[int, int], float],
    holds: Sequence[Hold],
    melt_energy_J: float,
) -> TemporalNetwork:
    """Put together the network of a sequence whose transitions are these events."""
    layout = EventLayout(len(sequence), len(last))
    soft, rigid = (
        tuple(layout.onset(event.gap, event.segment) for event in events if event.to == to)
        for to in ("soft", "rigid")
    )
    return TemporalNetwork(
        sequence=sequence,
        last=last,
        layout=layout,
        least=least,
        holds=tuple(holds),
        melt_onsets=soft,
        freeze_onsets=rigid,
        transitions=len(events),
        melt_energy_J=melt_energy_J,
    )
