"""Transition times from the segments' thermal state.

What a transition takes depends on how warm the segment is, hence on all that happened before. The
network holds what no history can undercut (``thermal.least_times``); ``settle`` raises it to what
a given schedule needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, ModeSequence, Stiffness
from twosra_mpc.robot.timing import ThermalTiming
from twosra_mpc.thermal.heating import (
    HeatingPlan,
    KeepWarm,
    SegmentTransition,
    TemperatureTrajectory,
)
from twosra_mpc.thermal.least_times import LeastTimes
from twosra_mpc.timing.network import Event, TemporalNetwork, handovers, overlaps
from twosra_mpc.timing.thermal_start import ThermalStart, thermal_start
from twosra_mpc.timing.transitions import SegmentHeating, Transition, TransitionModel, model_of

KEEP_WARM_BELOW_C = 3.0  # how far below its threshold a solid segment is kept warm
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
        """How each segment is heated."""
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
            windows=problem.windows(segment),
            keep_warm=warm if problem.heating == "keep_warm" and may_keep_warm else None,
        )

    @cached_property
    def start(self) -> ThermalStart:
        """What problems that begin alike share."""
        problem = self.problem
        return thermal_start(self.plans, problem.start_states, self.first, problem.heaters_at_once)

    @property
    def least(self) -> tuple[LeastTimes, ...]:
        """What no history of each segment can undercut."""
        return self.start.least

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        return self.start.refusal(sequence, last)

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
            if self._many_heated(made) or any(overlaps(network.sequence, self.first, network.last)):
                raised[layout.finish, layout.origin] = 1.0  # not refused, but not planned either
            for _, off, on in handovers(network.sequence, self.first, network.last):
                late = made[off].heater_s - made[on].heater_s
                if late > _SETTLED_S:
                    events = layout.onset_of(off), layout.onset_of(on)
                    raised[events] = times[events[1]] - times[events[0]] + late
        return None if raised == network.least else replace(network, least=raised)

    def _many_heated(self, made: Mapping[Event, SegmentTransition]) -> bool:
        """Whether several segments that are liquid at t = 0 are held so."""
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
        """How a segment is heated to melt and freeze at some onsets; asked over and over.

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
class ThermalHeating(TemperatureTrajectory, SegmentHeating):
    """Heater and state by the thermal model, piece by piece."""

    def body_C(self, t: Array) -> Array | None:
        states = self.states_at(t)
        return states[1] if len(states) > 1 else None

    def event_times(self) -> list[float]:
        changes = [t for item in self.transitions for t in item[2:]]
        return changes + [t for t in super().event_times() if t > 0]
