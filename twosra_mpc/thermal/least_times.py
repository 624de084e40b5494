"""Least times that no heating of a segment can undercut, whatever happened to it before.

The proofs rest on comparison: of two states of a segment, the one that is nowhere colder stays
nowhere colder under equal current, so it reaches a warmer level no later, and a colder one no
earlier. A segment may begin in any state; one that is changing at t = 0, on its plateau, makes its
first transition at once or later, from where it is then. Until it is first heated a segment that is
not liquid at t = 0 stays between the coldest and the warmest of all its parts and the air.

* First melt: heating at once from the state at t = 0 reaches the plateau as early as possible.
  When it does, the rest of the segment is no warmer than after heating the warmest start for as
  long as the coldest start needs, or as the warmest does (in between it cools first and then warms,
  so it is warmest at either end), and what is left of the plateau takes least from there.
* First freeze: switching off at once reaches the plateau, and its end, as early as possible. A
  window is counted from heater off: switched off h later, the freeze ends no earlier than
  h + late max(F - h, P), with F from the state at t = 0 and P through the plateau; that is least
  where F - h = P.
* Further melts begin when the freeze before them is done, at best with no heating needed, and with
  the rest of the segment as warm as the hottest soft state can make it, or as the solid metal was.
* Freezes: with the rest as cold as the shortest melt from the coldest start leaves it, warmed
  by metal at its threshold for no longer than the phases in between must take. Where a window is
  reserved, metal that melts when expected is heated on until the window ends; as much of the
  coasting as that surely brings widens the window of the freeze.
* Energy: that of the fastest melt; while liquid, what holds the threshold where the rest is as warm
  as it can be.

The first melt and the freeze after it are known better, by when the segment is heated. Until its
heater first goes on, h after t = 0, a segment that is not liquid follows a known course: it cools
or warms to the air, or is kept warm from some temperature on. Metal that is half molten melts on
from t = 0, so that h is 0. All that matters then is h: metal heated at once is molten first, but
the rest of the segment stays warm, and it freezes slowly. Of two histories the one that is heated
later is nowhere warmer at any time.

* It is molten no earlier than h + M(h), which grows with h. M, the time from heater on, is monotone
  as a segment is that has one temperature at t = 0; of any other it grows by no less than -1 a
  second, so within an interval it is less than at its ends by no more than the interval is long.
* A freeze that begins at u with the metal held liquid for at least some time before it ends no
  earlier than after the latest h with which that is possible: one number again.
* Of all h in an interval [a, b], none is molten before a + M(a) or after b + M(b), and whenever it
  is, the segment is nowhere colder than after heating from b on. The metal of that one, once it is
  warmer than when its heater went on, only warms; so its rest is no colder than with the metal held
  at what it was at a + M(a), which lets the rest rise or fall, but not turn.
* Metal held liquid for longer is solid no sooner. A window adds its share of coasting and freezing.

The least over all h is found by splitting intervals, the one with the least bound first. Where it
hardly depends on h, a limit on the number of splits leaves the bound a second or two lower.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

from twosra_mpc.thermal.heating import HeatingPlan, TemperatureTrajectory
from twosra_mpc.thermal.model import SegmentModel, State
from twosra_mpc.thermal.uncertainty import EXACT

_LATEST_S, _FINEST_S = 1024.0, 1 / 16  # of h: one bound for all that is later; shortest interval
_AT_ANY_TIME = ((0.0, _LATEST_S), (_LATEST_S, math.inf))
_MOST_SPLITS = 1000  # of the intervals of one bound; nearly all take fewer than 500
_FOR_EVER_S = 1e9  # 30 years
_ROUNDED = 128.0  # states are rounded down to such a share of their unit


class _Span(NamedTuple):
    """Bounds on all heatings of one course that begin within an interval.

    Attributes:
        onset_s: Latest onset of the melt, its window included.
        molten_s: Earliest time at which the metal is molten.
        heating_s: Shortest time from heater on to molten.
        done_s: Latest end of the melt, its window included.
        molten: State when molten, nowhere warmer than any; None: nothing is known.
    """

    onset_s: float
    molten_s: float
    heating_s: float
    done_s: float
    molten: State | None


@dataclass(frozen=True)
class FirstCycle:
    """The first melt of a segment that is not liquid at t = 0, and the freeze after it.

    Attributes:
        heating: How it is heated.
        start: Its state at t = 0.
        coldest_s: Least time through the plateau of the freeze, whatever came before [s].
        coasting_s: Least time from heater off to the onset of freezing, as the model has it [s].
    """

    heating: HeatingPlan
    start: State
    coldest_s: float
    coasting_s: float

    @cached_property
    def is_known(self) -> bool:
        """True if constants say it all: nothing stays warm, and windows are those of cold metal."""
        cold = self.start == self.heating.model.initial(self.heating.model.ambient_C)
        return len(self.start) == 1 and (cold or self.heating.windows == EXACT)

    @cached_property
    def _is_even(self) -> bool:
        """True if all of it has one temperature: it only cools, or only warms, until heated."""
        return len(set(self.start)) == 1

    def molten_s(self, onset_s: float) -> float:
        """Least end of a melt that begins at this time at the earliest, its window included."""
        late = self.heating.windows.melt_late - 1

        def bound(course: int, low: float, high: float) -> float:
            span = self._span(course, low, high)
            return span.molten_s + late * span.heating_s if span.onset_s >= onset_s else math.inf

        return self._least(bound, self._first_heated)

    def frozen_s(self, onset_s: float, held_s: float, share: float = 0.0) -> float:
        """Least end of a freeze that begins at this time at the earliest, its window included.

        Args:
            onset_s: Its onset.
            held_s: Least time from the end of the melt to there.
            share: What of the onset is taken off the end.
        """
        windows = self.heating.windows

        def bound(course: int, low: float, high: float) -> float:
            span = self._span(course, low, high)
            held = max(held_s, onset_s - span.done_s)
            if held > held_s and high > low:  # heated later, it is colder
                return math.inf
            onset = held + (span.done_s if high < math.inf else span.molten_s)
            held += (windows.melt_late - 1) * span.heating_s
            return span.molten_s + self._solid_after_s(span.molten, held) - share * onset

        return self._least(bound, self._first_heated)

    def frozen_again_s(self, onset_s: float, melting_s: float, held_s: float) -> float:
        """The same of a later freeze: at no time is the segment colder than had it not been heated.

        Args:
            onset_s: Its onset.
            melting_s: Least time through the plateau of the melt before it, as the model has it.
            held_s: Least time from the end of that melt.
        """
        model = self.heating.model

        def bound(course: int, low: float, high: float) -> float:
            if course > 0 or high + melting_s + held_s < onset_s:
                return math.inf
            coldest = tuple(map(min, self._unheated(low), self._unheated(min(high, _FOR_EVER_S))))
            rest = coldest if self._is_even else model.extremes(coldest)[0]
            solid = model.at_level(rest, model.solid_level)
            molten = model.at_level(model.hold(solid, melting_s), model.liquid_level)
            return low + melting_s + self._solid_after_s(molten, held_s)

        return self._least(bound, _AT_ANY_TIME)

    def _solid_after_s(self, molten: State | None, held_s: float) -> float:
        """Time from the end of a melt to that of its freeze, liquid for so long in between."""
        model, windows = self.heating.model, self.heating.windows
        held_s += (1 - windows.freeze_early) * self.coasting_s  # until the model's metal freezes
        fast = slow = self.coldest_s
        if molten is not None:
            onset = model.hold(molten, held_s)
            fast = self._freezing_s(onset)
            slow = self._freezing_s(tuple(map(min, onset, model.hold(onset, _FOR_EVER_S))))
        return held_s + fast + (windows.freeze_late - 1) * (self.coasting_s + slow)

    @property
    def _first_heated(self) -> tuple[tuple[float, float], ...]:
        """Intervals of h: metal that is changing at t = 0 melts on from then on, or not at all."""
        model = self.heating.model
        changing = model.solid_level < model.level(self.start) < model.liquid_level
        return ((0.0, 0.0),) if changing else _AT_ANY_TIME

    def _least(
        self, bound: Callable[[int, float, float], float], heated: tuple[tuple[float, float], ...]
    ) -> float:
        """Least bound of all courses and times on them in intervals; inf: it is not possible."""
        queue = list[tuple[float, int, float, float]]()
        for course in range(len(self._courses)):
            for low, high in heated:
                queue.append((bound(course, low, high), course, low, high))
        heapq.heapify(queue)
        for _ in range(_MOST_SPLITS):
            least, course, low, high = queue[0]
            if high - low <= _FINEST_S or high == math.inf or least == math.inf:
                break
            middle = (low + high) / 2
            heapq.heapreplace(queue, (bound(course, low, middle), course, low, middle))
            heapq.heappush(queue, (bound(course, middle, high), course, middle, high))
        return queue[0][0]

    @cached_property
    def _courses(self) -> tuple[TemperatureTrajectory, ...]:
        return self.heating.unheated_courses(self.start)

    @cached_property
    def _unheated(self) -> Callable[[float], State]:
        """State at a time without heat."""
        return lru_cache(4096)(self._courses[0].state_at)

    @cached_property
    def _heating_s(self) -> Callable[[int, float, float], float]:
        """Time from heater on at a time to a level, on a course."""

        def heating_s(course: int, on_s: float, level: float) -> float:
            return self.heating.heating_s(self._courses[course].state_at(on_s), level)

        return lru_cache(4096)(heating_s)

    @cached_property
    def _span(self) -> Callable[[int, float, float], _Span]:
        return lru_cache(4096)(self._span_of)

    def _span_of(self, course: int, low: float, high: float) -> _Span:
        model, windows = self.heating.model, self.heating.windows
        first = self._heating_s(course, low, model.liquid_level)
        if high == math.inf:
            _, warmest = model.extremes(self._courses[course].state_at(low))
            warm = first if self._is_even else self.heating.heating_s(warmest, model.liquid_level)
            cold = self._heating_s(course, _FOR_EVER_S, model.liquid_level)
            return _Span(math.inf, low + first, min(warm, cold), math.inf, None)
        last = self._heating_s(course, high, model.liquid_level)
        beyond = 0.0 if self._is_even else high - low
        onset_s = high + windows.melt_early * self._heating_s(course, high, model.solid_level)
        done_s = high + last + (windows.melt_late - 1) * (max(first, last) + beyond)
        molten = self._molten(course, high, low + first, high + last)
        return _Span(onset_s, low + first, max(0.0, min(first, last) - beyond), done_s, molten)

    def _molten(self, course: int, on_s: float, since_s: float, until_s: float) -> State | None:
        """State of heating from a time on: nowhere warmer than between two times, but molten."""
        model, state = self.heating.model, self._courses[course].state_at(on_s)
        if since_s <= on_s or not math.isfinite(until_s):
            return None
        heated = model.propagate(state, self.heating.melt_current_A, since_s - on_s)
        if model.level(heated) <= model.level(state):  # it may still be falling
            return None
        onset = tuple(map(min, heated, model.hold(heated, until_s - since_s)))
        return model.at_level(onset, model.liquid_level)

    @cached_property
    def _frozen(self) -> Callable[[State], float]:
        model = self.heating.model
        return lru_cache(4096)(lambda onset: model.time_until(onset, 0.0, model.solid_level))

    def _freezing_s(self, onset: State) -> float:
        """Least time through the plateau of a freeze from a state, rounded to be asked again."""
        rounded = tuple(math.floor(_ROUNDED * value) / _ROUNDED for value in onset)
        return self._frozen(self.heating.model.at_level(rounded, self.heating.model.liquid_level))


@dataclass(frozen=True)
class LeastTimes:
    """Proved least times, powers and energies of one segment.

    Attributes:
        heating: How it is heated.
        start: Its state at t = 0.
    """

    heating: HeatingPlan
    start: State

    @property
    def _model(self) -> SegmentModel:
        return self.heating.model

    @property
    def _coldest(self) -> State:
        return self._model.extremes(self.start)[0]

    @property
    def _warmest(self) -> State:
        return self._model.extremes(self.start)[1]

    @property
    def _held(self) -> State:
        """Metal at the set-point for ever."""
        return self._model.hold(self._model.initial(self.heating.soft_setpoint_C), _FOR_EVER_S)

    @property
    def _at_first(self) -> State:
        """Nowhere colder than any state without heat, where that is warmer than held metal."""
        return tuple(map(max, self.start, self._model.hold(self.start, _FOR_EVER_S)))

    @property
    def _hottest_again(self) -> State:
        """Nowhere colder than any state after the segment was solid once, or is not liquid first.

        Without heat no part of it is warmer than the metal.
        """
        model, level = self._model, self._model.level(self.start)
        changing = model.solid_level < level < model.liquid_level
        onset = model.at_level(self.start, level if changing else model.solid_level)
        metal = model.initial(model.temperature_C(onset))
        return tuple(map(max, self._held, map(min, self._at_first, metal)))

    def _plateau_s(self, onset: State) -> float:
        """Time through the plateau."""
        return self.heating.heating_s(onset, self._model.liquid_level)

    @cached_property
    def _again(self) -> State:
        """Nowhere colder than any state at the onset of a further melt."""
        return self._model.at_level(self._hottest_again, self._model.solid_level)

    @cached_property
    def first_lead_s(self) -> float:
        """Heater on at t = 0 to the onset of melting."""
        return self.heating.lead_s(self.start)

    @cached_property
    def warmest_lead_s(self) -> float:
        """Heater on to the onset of a first melt, whenever it is switched on."""
        return self.heating.lead_s(self._warmest)

    @cached_property
    def _first_onset(self) -> State:
        """Nowhere colder than any state at the onset of the first melt."""
        current, level = self.heating.melt_current_A, self._model.solid_level
        spans = (self.heating.heating_s(state, level) for state in (self._warmest, self._coldest))
        ends = (self._model.propagate(self._warmest, current, span) for span in spans)
        rest, begun = tuple(map(max, *ends)), self._model.level(self._warmest)
        return self._model.at_level(rest, max(level, begun))

    @cached_property
    def first_melting_s(self) -> float:
        """Onset to end of a first melt."""
        windows = self.heating.windows
        spread = windows.melt_late * self.heating.heating_s(self._warmest, self._model.solid_level)
        spread -= self.warmest_lead_s
        return windows.melt_late * self._plateau_s(self._first_onset) + spread

    @cached_property
    def melting_s(self) -> float:
        """Onset to end of any further melt."""
        return self.heating.windows.melt_late * self._plateau_s(self._again)

    @cached_property
    def first_energy_J(self) -> float:
        """Heater energy of a first melt."""
        lead = self.heating.heating_s(self._warmest, self._model.solid_level)
        current = self.heating.melt_current_A
        return self._model.energy_J(self._warmest, current, lead) + self._plateau_J(
            self._first_onset
        )

    @cached_property
    def energy_J(self) -> float:
        """Heater energy of any further melt."""
        return self._plateau_J(self._again)

    def _plateau_J(self, onset: State) -> float:
        return self._model.energy_J(onset, self.heating.melt_current_A, self._plateau_s(onset))

    @cached_property
    def liquid_power_W(self) -> float:
        """Mean heater power from the end of a melt to the onset of the next freeze."""
        model = self._model
        state = model.at_level(self._hottest_again, model.liquid_level)
        return model.power_W(model.holding_current_A(state), model.temperature_C(state))

    @cached_property
    def first_coasting_s(self) -> float:
        """Heater off at t = 0 to the onset of freezing."""
        return self.heating.coasting_s(self.start)

    @cached_property
    def first_freezing_s(self) -> float:
        """Least end of a first freeze; its window adds no less than it adds to the plateau."""
        fastest = self._model.time_until(self.start, 0.0, self._model.solid_level)
        return fastest + (self.heating.windows.freeze_late - 1) * self._frozen_s(0, 0.0)

    @cached_property
    def longest_coasting_s(self) -> float:
        """Longest time from heater off to the onset of freezing."""
        return self.heating.coasting_s(tuple(map(max, self._held, self._at_first)))

    @cached_property
    def first_cycle(self) -> FirstCycle:
        """The first melt and the freeze after it of a segment that is not liquid at t = 0."""
        return self._cycle(1)

    @cached_property
    def _later_cycle(self) -> FirstCycle:
        return self._cycle(3)

    def _cycle(self, number: int) -> FirstCycle:
        coldest_s, coasting_s = self._frozen_s(number, 0.0), self._coasting_s(number)
        return FirstCycle(self.heating, self.start, coldest_s, coasting_s)

    def frozen_s(self, number: int, onset_s: float, held_s: float) -> float:
        """Least end of a freeze of a number that begins at ``onset_s`` at the earliest.

        It may be less than with ``freezing_s``. The metal was liquid for ``held_s`` before.
        """
        if number == 1:
            return self.first_cycle.frozen_s(onset_s, held_s)
        if self._warmest == self._model.initial(self._model.ambient_C):
            return 0.0
        return self._later_cycle.frozen_again_s(onset_s, self._melting_s(number), held_s)

    @cached_property
    def freezing_s(self) -> Callable[[int, float], float]:
        """Onset to end of a freeze, of its number and ``held_s``; asked over and over.

        The number is that of the transitions the segment made before, ``held_s`` the least time
        since the melt before it was done; 0 if none came before.
        """
        return lru_cache(4096)(self._freezing_s)

    def _freezing_s(self, number: int, held_s: float) -> float:
        windows = self.heating.windows
        spread = (windows.freeze_late - windows.freeze_early) * self._coasting_s(number)
        return windows.freeze_late * self._frozen_s(number, held_s) + spread

    def _frozen_s(self, number: int, held_s: float) -> float:
        """Least time through the plateau of a freeze, as the model has it."""
        model = self._model
        if number == 0:
            start = model.at_level(self.start, min(model.level(self.start), model.liquid_level))
            onset = tuple(map(min, start, model.hold(start, _FOR_EVER_S)))
        else:
            onset = model.hold(self._molten(number), held_s)
        return model.time_until(onset, 0.0, model.solid_level)

    def coasting_s(self, number: int) -> float:
        """End of a melt to the earliest onset of the freeze after it."""
        return self.heating.windows.freeze_early * self._coasting_s(number)

    def _melting_s(self, number: int) -> float:
        """Least time from heater on to the end of the melt before transition ``number``."""
        if number == 1:
            return self.heating.heating_s(self._warmest, self._model.liquid_level)
        return self._plateau_s(self._again)

    def _molten(self, number: int) -> State:
        """State at the liquid threshold, nowhere warmer than any at the end of that melt."""
        current = self.heating.melt_current_A
        molten = self._model.propagate(self._coldest, current, self._melting_s(number))
        return self._model.at_level(molten, self._model.liquid_level)

    def _coasting_s(self, number: int) -> float:
        """Least time to freezing without heat, once the window of the melt has ended."""
        beyond = self.heating.windows.melt_late - 1
        if number == 0 or beyond == 0:
            return 0.0
        model, current, molten = self._model, self.heating.melt_current_A, self._molten(number)
        setpoint = model.level_at(self.heating.soft_setpoint_C)
        heated = beyond * self._melting_s(number)
        heated = min(heated, model.time_until(molten, current, setpoint))
        after = model.propagate(molten, current, heated)
        if (
            model.level(after) <= model.liquid_level
        ):  # colder than any real one: it is not heated up
            return 0.0
        return model.time_until(after, 0.0, model.liquid_level)
