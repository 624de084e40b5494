"""The temporal network: which events a mode sequence implies, and how far apart they must be.

A sequence of p phases has p + 1 gaps: gap g lies before phase g, gap p after the last phase. Where
a segment's stiffness differs on the two sides of a gap, it melts or freezes there; the *onset* is
the moment from which it may be on the plateau. From onset to done nothing may move; before the
onset of a melt the segment is still solid, before the onset of a freeze still liquid, and the robot
may drive or bend. All rules are difference constraints t[v] - t[u] >= w between event times, so the
earliest finish of a sequence is a longest path, and any relaxation of the motion gives a valid
lower bound.

A segment that is changing at t = 0 is neither soft nor rigid until its change is over: it melts or
freezes, as the first phase asks, in the first gap, and from t = 0 on.

A *dwell* is the time from heater on to heater off around one soft period. With at most one heater
at a time, the dwells of different segments must follow each other, those whose soft phases do not
overlap in the order of the phases. A segment that is liquid or melting at t = 0 may have its heater
on then, so its first dwell comes first; of several such, all but one are heated no more, and are
liquid for as long as their heat lasts. Two melted segments that are soft in the same phase need the
metal of the one that melts first to stay liquid without heat for as long as the other's takes to
melt; where that is not so they are refused. All this is said of two segments at a time, whatever
their number: no two heaters are on at once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness, Stiffness, mode_name


@dataclass(frozen=True)
class EventLayout:
    """Numbering of the events of a sequence of ``phases`` phases of a robot of ``segments``."""

    phases: int
    segments: int

    @cached_property
    def count(self) -> int:
        """Number of events, the origin included."""
        return 2 * self.phases + self.segments * (self.phases + 1) + 2

    @cached_property
    def finish(self) -> int:
        """The end of the plan."""
        return self.count - 2

    @cached_property
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

    def phase_order(self) -> dict[tuple[int, int], float]:
        """Phases follow each other and do not run backwards."""
        least = {(self.start(i), self.end(i)): 0.0 for i in range(self.phases)}
        return least | {(self.end(g - 1), self.start(g)): 0.0 for g in range(self.phases + 1)}

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


event_layout = lru_cache(256)(EventLayout)  # the same one for sequences of the same length


class Hold(NamedTuple):
    """While a segment is liquid its heater gives at least ``power_W`` from event u to event v."""

    since: int
    until: int
    power_W: float


class Delay(NamedTuple):
    """The later an event u, the later an event v: t[v] - share t[u] >= least [s], share <= 1."""

    since: int
    until: int
    share: float
    least: float


class Event(NamedTuple):
    """A transition of a segment (from 0) in a gap; ``number`` counts those of the segment."""

    segment: int
    gap: int
    to: Stiffness
    number: int


@dataclass(frozen=True)
class TemporalNetwork:
    """The event times of one mode sequence as difference constraints, and what they cost.

    Attributes:
        sequence: The mode sequence.
        last: Stiffness at the end.
        least: {(u, v): w} meaning t[v] - t[u] >= w [s].
        transitions: Number of melts and freezes.
        melt_energy_J: Least heater energy of all melts.
        holds: Heater power while segments are liquid.
        events: The transitions, if heaters may delay them.
        delays: Further constraints, for bounds.
    """

    sequence: ModeSequence
    last: Mode
    least: dict[tuple[int, int], float]
    transitions: int
    melt_energy_J: float
    holds: tuple[Hold, ...] = ()
    events: tuple[Event, ...] = ()
    delays: tuple[Delay, ...] = ()

    @cached_property
    def layout(self) -> EventLayout:
        """Numbering of the events."""
        return event_layout(len(self.sequence), len(self.last))

    @cached_property
    def earliest(self) -> tuple[float, ...] | None:
        """Earliest time of every event [s]: longest paths from the origin.

        None if the constraints contradict each other.
        """
        constraints = [(u, v, least) for (u, v), least in self.least.items()]
        times = _raised([0.0] * self.layout.count, constraints)
        return None if times is None else tuple(times)

    @cached_property
    def onsets(self) -> dict[Stiffness, list[int]]:
        """Events at which melts and freezes begin that heaters may delay."""
        found: dict[Stiffness, list[int]] = {"soft": [], "rigid": []}
        for event in self.events:
            found[event.to].append(self.layout.onset_of(event))
        return found


def longest_paths(network: TemporalNetwork, since: int) -> list[float]:
    """Least time from an event to every event [s]; -inf where nothing is said.

    The constraints must not contradict each other.
    """
    constraints = [(u, v, least) for (u, v), least in network.least.items()]
    before = [-math.inf] * network.layout.count
    before[since] = 0.0
    times = _raised(before, constraints)
    assert times is not None
    return times


def resting_s(network: TemporalNetwork) -> float:
    """Least time in which segments melt or freeze and nothing moves, in all gaps together [s].

    No less if phases are appended: what has to freeze after the last one does so later.
    """
    layout = network.layout
    gaps, segments = range(layout.phases + 1), range(layout.segments)
    plateaus = [[(layout.onset(gap, j), layout.start(gap)) for j in segments] for gap in gaps]
    return sum(max(0.0, *(network.least.get(pair, 0.0) for pair in gap)) for gap in plateaus)


def latest_times(network: TemporalNetwork, at_most: Mapping[int, float]) -> list[float]:
    """Latest time of every event with some events not later than given [s]; inf where free.

    The constraints must not contradict each other, nor the times given.
    """
    backwards = [(v, u, least) for (u, v), least in network.least.items()]
    before = [-at_most.get(event, math.inf) for event in range(network.layout.count)]
    times = _raised(before, backwards)
    assert times is not None
    return [-time for time in times]


def _raised(times: list[float], constraints: list[tuple[int, int, float]]) -> list[float] | None:
    """Least times from these on with t[v] - t[u] >= w for all (u, v, w); None without any."""
    for _ in range(len(times) + 1):
        changed = False
        for u, v, least in constraints:
            if times[u] + least > times[v]:
                times[v] = times[u] + least
                changed = True
        if not changed:
            return times
    return None


def events_of(sequence: ModeSequence, first: StartingStiffness, last: Mode) -> Iterator[Event]:
    """Yield the transitions of each segment, segment by segment, in order of time."""
    for segment in range(len(first)):
        stiffness, number = first[segment], 0
        for gap, mode in enumerate((*sequence, last)):
            if mode[segment] != stiffness:
                stiffness = mode[segment]
                yield Event(segment, gap, "soft" if stiffness else "rigid", number)
                number += 1


class Dwell(NamedTuple):
    """A soft period of a segment: its melt (None: liquid at t = 0) and freeze (None: never).

    ``turn`` orders melts: -2 liquid at t = 0, -1 melting then, from 0 on the gap.
    """

    segment: int
    melt: Event | None
    freeze: Event | None
    turn: int

    def melts_before(self, other: Dwell) -> bool:
        """True if its heater may be off again before the other one goes on."""
        return self.turn < other.turn or self.turn == other.turn >= 0


def handovers(
    sequence: ModeSequence, first: StartingStiffness, last: Mode
) -> Iterator[tuple[Event | None, Event, Event]]:
    """Yield (melt, freeze, melt of another segment) where one heater goes off before another on."""
    for pair in _pairs(sequence, first, last):
        for earlier, later in (pair, pair[::-1]):
            if earlier.freeze and later.melt and _before(earlier, later):
                yield earlier.melt, earlier.freeze, later.melt


def overlaps(
    sequence: ModeSequence, first: StartingStiffness, last: Mode
) -> Iterator[tuple[Dwell, Dwell, Mode]]:
    """Yield any two dwells that do not follow each other, and the first mode with both soft.

    Of two that are liquid at t = 0 one that freezes may need no heat any more.
    """
    for one, two in _pairs(sequence, first, last):
        unheated = one.melt is two.melt is None and (one.freeze or two.freeze)
        if not (_before(one, two) or _before(two, one) or unheated):
            modes = (*sequence, last)
            yield one, two, next(m for m in modes if m[one.segment] and m[two.segment])


def unheated(
    sequence: ModeSequence, first: StartingStiffness, last: Mode
) -> Iterator[tuple[Event, tuple[int, ...]]]:
    """Yield the first freeze of any two liquid segments, and which of them one heater may leave."""
    for pair in _pairs(sequence, first, last):
        freezes = [dwell.freeze for dwell in pair if dwell.melt is None and dwell.freeze]
        if freezes and all(dwell.melt is None for dwell in pair):
            earliest = min(freezes, key=lambda event: event.gap)
            yield earliest, tuple(event.segment for event in freezes)


def refused(mode: Mode) -> str:
    """Say that a mode needs more heaters than one."""
    count = "both" if sum(mode) == 2 else str(sum(mode))
    return f"mode {mode_name(mode)} needs {count} heaters at once, but heaters_at_once is 1"


def _pairs(
    sequence: ModeSequence, first: StartingStiffness, last: Mode
) -> Iterator[tuple[Dwell, Dwell]]:
    dwells = [[Dwell(j, None, None, -2)] * (soft == 1) for j, soft in enumerate(first)]
    for event in events_of(sequence, first, last):
        mine = dwells[event.segment]
        if event.to == "soft":
            begun = first[event.segment] is None and event.number == 0
            mine.append(Dwell(event.segment, event, None, -1 if begun else event.gap))
        elif mine:
            mine[-1] = mine[-1]._replace(freeze=event)
    for ones, twos in itertools.combinations(dwells, 2):
        yield from itertools.product(ones, twos)


def _before(earlier: Dwell, later: Dwell) -> bool:
    if later.melt is None or earlier.freeze is None:
        return False
    return earlier.turn < min(later.turn, 0) or earlier.freeze.gap <= later.melt.gap
