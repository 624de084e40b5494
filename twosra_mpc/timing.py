"""Transition timing: which events a mode sequence implies, and how far apart they must be.

A sequence of n phases has n + 1 gaps: gap g lies before phase g, gap n after the last phase. Where
a segment's stiffness differs on the two sides of a gap, it melts or freezes there; the *onset* is
the moment it reaches the plateau. Between onset and done nothing may move; before the onset of a
melt the segment is still solid, before the onset of a freeze still liquid, and the robot may drive
or bend. All rules are difference constraints t[v] - t[u] >= w between event times, so the earliest
finish of a sequence is a longest path, and any relaxation of the motion gives a valid lower bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from twosra_mpc.modes import RIGID, Mode, ModeSequence
from twosra_mpc.problem import Problem
from twosra_mpc.robot import Heater, OverlappedTiming, SequentialTiming

Stiffness = Literal["soft", "rigid"]


@dataclass(frozen=True)
class EventLayout:
    """Numbering of the events of a sequence of ``phases`` phases; the same for every sequence."""

    phases: int

    @property
    def count(self) -> int:
        """Number of events, the origin included."""
        return 6 * self.phases + 6

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
        """Onset of the transition of ``segment`` (0 or 1) in ``gap``."""
        return 2 * self.phases + 4 * gap + segment

    def heater_off(self, gap: int, segment: int) -> int:
        """Heater of ``segment`` off, for its freeze in ``gap``."""
        return 2 * self.phases + 4 * gap + 2 + segment

    def pairs(self) -> Iterator[tuple[int, int]]:
        """Yield every pair (u, v) that any network of this many phases may constrain."""
        for phase in range(self.phases):
            yield self.start(phase), self.end(phase)
        for gap in range(self.phases + 1):
            yield self.end(gap - 1), self.start(gap)
            for segment in (0, 1):
                onset, off = self.onset(gap, segment), self.heater_off(gap, segment)
                yield self.end(gap - 1), onset
                yield onset, self.start(gap)
                yield off, onset
                yield onset, off
                if gap > 0:
                    yield self.origin, onset
                for earlier in range(gap):
                    yield self.onset(earlier, segment), onset
                    yield self.onset(earlier, segment), off


@dataclass(frozen=True)
class TemporalNetwork:
    """The event times of one mode sequence as difference constraints, and what they cost.

    Attributes:
        sequence: The mode sequence.
        layout: Numbering of the events.
        least: {(u, v): w} meaning t[v] - t[u] >= w [s].
        holds: (u, v, shift): the heater holds a segment liquid from t[u] + shift to t[v].
        melts: Number of melts.
        freezes: Number of freezes.
        melt_energy_J: Heater energy of all melts.
        hold_power_W: Heater power while a segment is held liquid.
    """

    sequence: ModeSequence
    layout: EventLayout
    least: dict[tuple[int, int], float]
    holds: tuple[tuple[int, int, float], ...]
    melts: int
    freezes: int
    melt_energy_J: float
    hold_power_W: float


def earliest_times(network: TemporalNetwork) -> list[float]:
    """Earliest time of every event if motion took no time: longest paths from the origin [s]."""
    times = [0.0] * network.layout.count
    constraints = [(u, v, least) for (u, v), least in network.least.items()]
    changed = True
    while changed:
        changed = False
        for u, v, least in constraints:
            if times[u] + least > times[v]:
                times[v] = times[u] + least
                changed = True
    return times


class Transition(NamedTuple):
    """One melt or freeze of a segment (1 or 2), times in s."""

    segment: Literal[1, 2]
    to: Stiffness
    heater_s: float
    onset_s: float
    done_s: float


class _Event(NamedTuple):
    """A transition of a segment (0 or 1) in a gap; ``number`` counts those of the segment."""

    segment: int
    gap: int
    to: Stiffness
    number: int


class TransitionModel(Protocol):
    """How long melting and freezing take, and what may happen meanwhile."""

    def network(self, sequence: ModeSequence, last: Mode) -> TemporalNetwork:
        """Return the difference constraints of a mode sequence that ends in stiffness ``last``."""

    def transitions(
        self, sequence: ModeSequence, last: Mode, times: Sequence[float]
    ) -> list[Transition]:
        """Return the melts and freezes of a sequence with these event times, by heater time."""


def transition_model(problem: Problem) -> TransitionModel:
    """Build the transition model that the problem's timing names."""
    match problem.transition_times:
        case OverlappedTiming() as times:
            return Overlapped(
                times,
                problem.robot.heater,
                problem.start_mode,
                problem.temperatures,
            )
        case SequentialTiming() as times:
            return Sequential(times, problem.robot.heater, problem.start_mode)


def _events(sequence: ModeSequence, first: Mode, last: Mode) -> Iterator[_Event]:
    """Yield the transitions of each segment, segment by segment, in order of time."""
    for segment in (0, 1):
        stiffness, number = first[segment], 0
        for gap, mode in enumerate((*sequence, last)):
            if mode[segment] != stiffness:
                stiffness = mode[segment]
                yield _Event(segment, gap, "soft" if stiffness else "rigid", number)
                number += 1


def _phase_order(layout: EventLayout) -> dict[tuple[int, int], float]:
    """Phases follow each other and do not run backwards."""
    least = {(layout.start(i), layout.end(i)): 0.0 for i in range(layout.phases)}
    least |= {(layout.end(g - 1), layout.start(g)): 0.0 for g in range(layout.phases + 1)}
    return least


@dataclass(frozen=True)
class Overlapped:
    """Constant times; heating and cooling outside the plateau overlap with everything."""

    times: OverlappedTiming
    heater: Heater
    first: Mode
    temperatures: tuple[float, float]

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
        span = heater.melting_point_C - heater.ambient_C
        return self._melt_lead * (heater.melting_point_C - now) / span

    def _plateau(self, to: Stiffness) -> float:
        return self.times.melt_changing_s if to == "soft" else self.times.freeze_changing_s

    def network(self, sequence: ModeSequence, last: Mode) -> TemporalNetwork:
        layout = EventLayout(len(sequence))
        least = _phase_order(layout)
        holds: list[tuple[int, int, float]] = []
        melts = freezes = 0
        heated = 0.0
        previous = layout.origin
        for event in _events(sequence, self.first, last):
            onset = layout.onset(event.gap, event.segment)
            least[layout.end(event.gap - 1), onset] = 0.0
            least[onset, layout.start(event.gap)] = self._plateau(event.to)
            if event.number == 0:
                least[layout.origin, onset] = self._first_lead(event.segment)
            elif event.to == "soft":
                least[previous, onset] = self.times.freeze_changing_s + self._melt_lead
            if event.to == "soft":
                melts += 1
                lead = self._first_lead(event.segment) if event.number == 0 else self._melt_lead
                heated += lead + self.times.melt_changing_s
            else:
                freezes += 1
                off = layout.heater_off(event.gap, event.segment)
                liquid = self.times.melt_changing_s if event.number else 0.0
                since = previous if event.number else layout.origin
                least[since, off] = liquid
                least[off, onset] = 0.0
                least[onset, off] = -self._freeze_lead
                holds.append((since, off, liquid))
            previous = onset
        return TemporalNetwork(
            sequence=sequence,
            layout=layout,
            least=least,
            holds=tuple(holds),
            melts=melts,
            freezes=freezes,
            melt_energy_J=heated * _power(self.heater, "melt"),
            hold_power_W=_power(self.heater, "hold"),
        )

    def transitions(
        self, sequence: ModeSequence, last: Mode, times: Sequence[float]
    ) -> list[Transition]:
        layout = EventLayout(len(sequence))
        found: list[Transition] = []
        molten: list[float | None] = [None, None]
        for event in _events(sequence, self.first, last):
            onset = times[layout.onset(event.gap, event.segment)]
            done = onset + self._plateau(event.to)
            if event.to == "soft":
                lead = self._first_lead(event.segment) if event.number == 0 else self._melt_lead
                heater = max(0.0, onset - lead)  # not before the start by rounding
                molten[event.segment] = done
            else:
                heater = times[layout.heater_off(event.gap, event.segment)]
                since = molten[event.segment]
                if since is not None:  # a short liquid period: the metal must store enough heat
                    heater = max(heater, since + self.times.superheat_share * (onset - since))
            found.append(Transition(_number(event.segment), event.to, heater, onset, done))
        return sorted(found, key=lambda item: (item.heater_s, item.segment))


@dataclass(frozen=True)
class Sequential:
    """The authors' practice: everything waits through every change of mode."""

    times: SequentialTiming
    heater: Heater
    first: Mode

    def _wait(self, before: Mode, after: Mode) -> float:
        if before == after:
            return 0.0
        if before == RIGID:
            return self.times.heat_s
        return self.times.freeze_s if after == RIGID else self.times.reconfigure_s

    def _gaps(self, sequence: ModeSequence, last: Mode) -> list[tuple[Mode, Mode]]:
        return list(zip((self.first, *sequence), (*sequence, last), strict=True))

    def network(self, sequence: ModeSequence, last: Mode) -> TemporalNetwork:
        layout = EventLayout(len(sequence))
        least = _phase_order(layout)
        melts = freezes = 0
        heated = 0.0
        reheat = self.times.reconfigure_s - self.times.reconfigure_cool_s
        for gap, (before, after) in enumerate(self._gaps(sequence, last)):
            least[layout.end(gap - 1), layout.start(gap)] = self._wait(before, after)
            if before != after:
                freezes += sum(before)
                melts += sum(after)
                heated += sum(after) * (self.times.heat_s if before == RIGID else reheat)
        return TemporalNetwork(
            sequence=sequence,
            layout=layout,
            least=least,
            holds=(),
            melts=melts,
            freezes=freezes,
            melt_energy_J=heated * _power(self.heater, "melt"),
            hold_power_W=_power(self.heater, "hold"),
        )

    def transitions(
        self, sequence: ModeSequence, last: Mode, times: Sequence[float]
    ) -> list[Transition]:
        layout = EventLayout(len(sequence))
        found: list[Transition] = []
        for gap, (before, after) in enumerate(self._gaps(sequence, last)):
            begin = times[layout.end(gap - 1)]
            wait = self._wait(before, after)
            if wait == 0.0:
                continue
            cooled = begin + (wait if after == RIGID else self.times.reconfigure_cool_s)
            heat_from = begin if before == RIGID else cooled
            for j in (0, 1):
                if before[j]:
                    found.append(Transition(_number(j), "rigid", begin, begin, cooled))
                if after[j]:
                    found.append(Transition(_number(j), "soft", heat_from, heat_from, begin + wait))
        return sorted(found, key=lambda item: (item.heater_s, item.segment))


def _power(heater: Heater, what: Literal["melt", "hold"]) -> float:
    current = heater.melt_current_A if what == "melt" else heater.hold_current_A
    return current**2 * heater.resistance_ohm


def _number(segment: int) -> Literal[1, 2]:
    """Segments are counted from 1 where people read them."""
    return 2 if segment else 1
