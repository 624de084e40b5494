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
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

from twosra_mpc.thermal.first_cycle import FirstCycle
from twosra_mpc.thermal.heating import HeatingPlan
from twosra_mpc.thermal.model import SegmentModel, State

_FOR_EVER_S = 1e9  # 30 years


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
