"""Transition times from the segments' thermal state.

What a transition takes depends on how warm the segment is, hence on all that happened before. The
network holds what no history can undercut (``thermal.least_times``); ``settle`` raises it to what
a given schedule needs. Problems of one robot that begin alike, in the same state of the metal and
with the same heaters, share their networks, whatever else differs: they are made once.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache

from twosra_mpc.control.heated_segment import confirming_windows
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness, Stiffness
from twosra_mpc.robot.timing import ThermalTiming
from twosra_mpc.thermal.heating import (
    HeatingPlan,
    KeepWarm,
    SegmentTransition,
    TemperatureTrajectory,
)
from twosra_mpc.thermal.least_times import LeastTimes
from twosra_mpc.thermal.model import State
from twosra_mpc.timing.network import (
    Delay,
    Dwell,
    Event,
    EventLayout,
    Hold,
    TemporalNetwork,
    events_of,
    handovers,
    longest_paths,
    unheated,
)
from twosra_mpc.timing.transitions import SegmentHeating, Transition, TransitionModel, model_of

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
        """Least times of each segment, whatever its history; one for segments that are alike."""
        return tuple(map(cache(LeastTimes), self.plans, self.states))

    def coasts(self, liquid: Dwell, other: Dwell) -> bool:
        """True if a segment might stay liquid without heat while the other one melts."""
        if other.melt is None or not liquid.melts_before(other):
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
                    done_s = least.get((previous, begin), 0.0)  # of another segment
                    least[previous, begin] = max(done_s, history.first_freezing_s)
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
        """Network in which the times at which transitions begin tell how long they take.

        The metal of a melt waits liquid for its freeze as long as all that is in between takes, and
        the first melt and freeze of a segment end as late as its first heating says.
        """
        layout, least, molten = network.layout, dict(network.least), dict[int, int]()
        for event in sorted(network.events, key=lambda event: event.gap):
            history, cycle = self.least[event.segment], self.least[event.segment].first_cycle
            if cycle.is_known:
                continue
            so_far = _lasting(replace(network, least=least), least_durations)
            if (times := so_far.earliest) is None:
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
        if (times := lasting.earliest) is None:
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
        layout, added = network.layout, dict[tuple[int, int], float]()
        for freeze, left in unheated(network.sequence, self.first, network.last):
            longest = max(self.least[segment].first_coasting_s for segment in left)
            added[layout.end(freeze.gap - 1), layout.origin] = -longest
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


KEEP_WARM_BELOW_C = 3.0  # how far below its threshold a solid segment is kept warm
_LONGER = 0.1  # heat for longer by so much at least: metal held for ever coasts no longer
_SETTLED_S = 1e-9  # rounding of sums of times
_KEPT = 128  # heatings of segments

Onsets = tuple[tuple[Stiffness, float], ...]
Heated = tuple[TemperatureTrajectory, list[SegmentTransition]]


@model_of.register(ThermalTiming)
@dataclass(frozen=True)
class Thermal(TransitionModel):
    """Melting and freezing by the thermal model of each segment, heated late."""

    times: ThermalTiming

    @property
    def words(self) -> str:
        problem = self.problem
        words = (
            f"melt and freeze times from the thermal model (timing “{problem.timing}”, air of"
            f" {problem.ambient:zg} °C)"
        )
        if problem.transition_quantile is not None:
            share = 100 * problem.transition_quantile
            words += f", windows that hold {share:zg} % of all transitions"
        return words

    @cached_property
    def plans(self) -> tuple[HeatingPlan, ...]:
        """Heating plan of each segment."""
        return tuple(self._plan(j) for j in range(len(self.first)))

    def _plan(self, segment: int) -> HeatingPlan:
        problem, heater = self.problem, self.problem.robot.heater
        solid_below_C, _ = problem.segment_thresholds_C[segment]
        warm = KeepWarm(solid_below_C - KEEP_WARM_BELOW_C, problem.cost_weights.energy_s_per_J)
        # A heater that the segments share may be needed elsewhere.
        may_keep_warm = problem.heaters_at_once == len(self.first)
        return HeatingPlan(
            model=problem.segment_models[segment],
            melt_current_A=heater.melt_current_A,
            soft_setpoint_C=heater.soft_setpoint_C,
            rigid_setpoint_C=heater.rigid_setpoint_C,
            windows=self.problem.windows[segment],
            keep_warm=warm if problem.heating == "keep_warm" and may_keep_warm else None,
        )

    @cached_property
    def start(self) -> ThermalStart:
        """Bounds that problems that begin alike share."""
        problem = self.problem
        return thermal_start(self.plans, problem.start_states, self.first, problem.heaters_at_once)

    @cached_property
    def kinds(self) -> Sequence[int]:
        known = [*zip(map(id, self.start.least), self.first, strict=True)]
        return [known.index(each) for each in known]

    def coasts(self, liquid: Dwell, other: Dwell) -> bool:
        return self.start.coasts(liquid, other)

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        return self.start.network(sequence, last, tuple(least_durations))

    def with_delays(
        self, network: TemporalNetwork, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        return self.start.with_delays(network, least_durations)

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        layout, raised = network.layout, dict(network.least)
        made, previous = self._made(network, times), layout.origin
        for event, item in made.items():
            onset, begin = layout.onset_of(event), layout.start(event.gap)
            if event.number == 0:
                previous = layout.origin
            if item.onset_s > times[onset] + _SETTLED_S:
                raised[previous, onset] = item.onset_s - times[previous]
            if item.done_s - item.onset_s > times[begin] - times[onset] + _SETTLED_S:
                raised[onset, begin] = item.done_s - item.onset_s
            previous = onset
        if self.problem.heaters_at_once == 1:
            sharing = [next(iter(turns), None) for turns in self.sharing(network)]
            if None in sharing or self._many_heated(made):
                raised[layout.finish, layout.origin] = 1.0  # not refused, but not planned either
            follow = handovers(network.sequence, self.first, network.last)
            turns = *((None, *turn[1:]) for turn in follow), *filter(None, sharing)
            for melt, off, on in turns:
                late = made[off].heater_s - made[on].heater_s
                if late > _SETTLED_S:
                    coasts_s = made[off].onset_s - made[off].heater_s
                    longer_s = self.start.least[off.segment].longest_coasting_s - coasts_s
                    since = melt if melt and late <= longer_s else off  # heat for longer, or wait
                    events = layout.onset_of(since), layout.onset_of(on)
                    apart_s = times[events[1]] - times[events[0]]
                    raised[events] = apart_s + max(late, _LONGER * apart_s)
        return None if raised == network.least else replace(network, least=raised)

    def _many_heated(self, made: Mapping[Event, SegmentTransition]) -> bool:
        """True if several segments that are liquid at t = 0 are held so."""
        held = {j for j, soft in enumerate(self.first) if soft == 1}
        held -= {event.segment for event, item in made.items() if item.heater_s <= _SETTLED_S}
        return len(held) > 1

    def made(self, network: TemporalNetwork, times: Sequence[float]) -> Iterator[Transition]:
        for event, item in self._made(network, times).items():
            yield Transition(event.segment + 1, *item)

    def segment_heating(self, segment: int, own: tuple[Transition, ...]) -> ThermalHeating:
        made, _ = self._heated(segment, tuple((item.to, item.onset_s) for item in own))
        molten = self.problem.melt_fractions[segment]
        return ThermalHeating(molten, own, made.model, made.pieces)

    def _made(
        self, network: TemporalNetwork, times: Sequence[float]
    ) -> dict[Event, SegmentTransition]:
        """Transitions as the segments' heating makes them when they should be at ``times``."""
        made: dict[Event, SegmentTransition] = {}
        for segment in range(len(self.first)):
            own = [event for event in network.events if event.segment == segment]
            onsets = tuple((event.to, times[network.layout.onset_of(event)]) for event in own)
            made |= zip(own, self._heated(segment, onsets)[1], strict=True)
        return made

    @cached_property
    def _heated(self) -> Callable[[int, Onsets], Heated]:
        """Heating of a segment that melts and freezes at some onsets; asked over and over.

        Also asked for the onsets as they are made, which differ by rounding.
        """
        known: dict[tuple[int, Onsets], Heated] = {}

        def heated(segment: int, onsets: Onsets) -> Heated:
            if (found := known.get((segment, onsets))) is None:
                soft, now = self.first[segment] == 1, self.problem.start_states[segment]
                found = self.plans[segment].heated(now, soft, onsets)
                if len(known) >= _KEPT:
                    known.clear()
                as_made = tuple((item.to, item.onset_s) for item in found[1])
                known[segment, onsets] = known[segment, as_made] = found
            return found

        return heated


@dataclass(frozen=True)
class Confirmed(Thermal):
    """Melting and freezing by the thermal model of each segment, until a run goes on with it."""

    def _plan(self, segment: int) -> HeatingPlan:
        windows = confirming_windows(self.problem.robot, self.problem.ambient, segment)
        return replace(super()._plan(segment), windows=windows)


def confirmed_model(problem: Problem) -> Confirmed | None:
    """Transition model of a problem as it is confirmed; None if segments are not described.

    Where a problem names constant times, those of the robot's first thermal timing: that is what
    its metal does.
    """
    if not problem.transition_times.needs_segment:
        named = problem.robot.timing.items()
        thermal = next((name for name, times in named if times.needs_segment), None)
        if thermal is None or not problem.robot.describes_heat:
            return None
        problem = problem.with_values(timing=thermal)
    return Confirmed(ThermalTiming(overlap="thermal"), problem)


@dataclass(frozen=True)
class ThermalHeating(TemperatureTrajectory, SegmentHeating):
    """Heater and state by the thermal model, piece by piece."""

    def body_C(self, t: Array) -> Array | None:
        states = self.states_at(t)
        return states[1] if len(states) > 1 else None

    def event_times(self) -> list[float]:
        changes = [t for item in self.transitions for t in item[2:]]
        return changes + [t for t in super().event_times() if t > 0]
