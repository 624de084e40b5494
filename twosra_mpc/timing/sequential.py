"""The authors' practice: everything waits through every change of mode."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from twosra_mpc.problem.tolerances import TIME_TOLERANCE_S
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid, soft_segments
from twosra_mpc.robot.timing import SequentialTiming
from twosra_mpc.timing.constant_heating import ConstantHeating
from twosra_mpc.timing.network import EventLayout, TemporalNetwork, refused
from twosra_mpc.timing.transitions import Transition, TransitionModel, model_of, own_transitions


@model_of.register(SequentialTiming)
@dataclass(frozen=True)
class Sequential(TransitionModel):
    """Fixed waits: to soft, to rigid, and from one soft mode to another, cooled in between."""

    times: SequentialTiming

    @property
    def words(self) -> str:
        named = f"timing “{self.problem.timing}”"
        return f"the fixed waits of {named}, through which the robot stands still"

    def _wait(self, before: Mode, after: Mode) -> float:
        if before == after:
            return 0.0
        if is_rigid(before):
            return self.times.heat_s
        return self.times.freeze_s if is_rigid(after) else self.times.reconfigure_s

    def _gaps(self, sequence: ModeSequence, last: Mode) -> list[tuple[Mode, Mode]]:
        return list(zip((self.first, *sequence), (*sequence, last), strict=True))

    def refusal(self, sequence: ModeSequence, last: Mode) -> str | None:
        if self.problem.heaters_at_once == 1:
            return next((refused(mode) for mode in (*sequence, last) if sum(mode) > 1), None)
        return None

    def network(
        self, sequence: ModeSequence, last: Mode, least_durations: Sequence[float]
    ) -> TemporalNetwork:
        del least_durations
        layout = EventLayout(len(sequence), len(last))
        least, transitions, energy_J = layout.phase_order(), 0, 0.0
        for gap, (before, after) in enumerate(self._gaps(sequence, last)):
            least[layout.end(gap - 1), layout.start(gap)] = self._wait(before, after)
            transitions += _changes(before, after)
            energy_J += self._energy_J(before, after)
        return TemporalNetwork(sequence, last, least, transitions, energy_J)

    def _energy_J(self, before: Mode, after: Mode) -> float:
        """Heater energy of one change of mode, or of none."""
        if before == after:
            return 0.0
        reheat = self.times.reconfigure_s - self.times.reconfigure_cool_s
        heater = self.problem.robot.heater
        heated = sum(after) * (self.times.heat_s if is_rigid(before) else reheat)
        return heated * heater.power_W(heater.melt_current_A)

    def onward(
        self, mode: Mode, missing: frozenset[int], modes: Sequence[Mode], last: Mode
    ) -> float | None:
        """The cheapest way through the modes: to freeze all and melt anew may cost less.

        Dijkstra's shortest path over (mode, segments still missing): each change of mode costs what
        it costs, whatever came before.
        """
        weights = self.problem.cost_weights
        done, order = set[tuple[Mode, frozenset[int]]](), itertools.count()
        queue = [(0.0, next(order), mode, missing, False)]
        while queue:
            cost, _, here, still, ended = heapq.heappop(queue)
            if ended:
                return cost
            if (here, still) in done:
                continue
            done.add((here, still))
            ways = [(after, still - set(soft_segments(after)), False) for after in modes]
            for after, left, end in [*ways, *[(last, still, True)] * (not still)]:
                step = self._wait(here, after) + weights.transition_s * _changes(here, after)
                step += weights.energy_s_per_J * self._energy_J(here, after)
                heapq.heappush(queue, (cost + step, next(order), after, left, end))
        return math.inf

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        del network, times
        return None

    def made(self, network: TemporalNetwork, times: Sequence[float]) -> Iterator[Transition]:
        layout = network.layout
        for gap, (before, after) in enumerate(self._gaps(network.sequence, network.last)):
            begin, wait = times[layout.end(gap - 1)], self._wait(before, after)
            if wait == 0.0:
                continue
            cooled = begin + (wait if is_rigid(after) else self.times.reconfigure_cool_s)
            heat_from = begin if is_rigid(before) else cooled
            freeze, melt = (begin, begin, cooled), (heat_from, heat_from, begin + wait)
            yield from (Transition(j + 1, "rigid", *freeze) for j in soft_segments(before))
            yield from (Transition(j + 1, "soft", *melt) for j in soft_segments(after))

    def segment_heating(self, segment: int, own: tuple[Transition, ...]) -> ConstantHeating:
        soft, now = bool(self.first[segment]), self.problem.temperatures[segment]
        heater, air = self.problem.robot.heater, self.problem.ambient
        return ConstantHeating(soft, own, heater, air, now)

    def violations(
        self, item: Transition, before: Transition | None, others: Sequence[Transition]
    ) -> Iterator[str]:
        """Where a freeze ends as melts begin, they may be the halves of a reconfiguration.

        Nothing moves through either, and between them everything is rigid.
        """
        del before
        if item.onset_s > item.heater_s + TIME_TOLERANCE_S:
            yield f"the robot waits from then on, not from {item.onset_s:z.3f} s"
        melts, lasted = item.to == "soft", item.done_s - item.heater_s
        joint = item.heater_s if melts else item.done_s
        for j, soft in enumerate(map(bool, self.first)):
            for other in own_transitions(others, j):
                if other.heater_s < joint - TIME_TOLERANCE_S:
                    soft = other.to == "soft"
            if soft and j != item.segment - 1:
                yield f"segment {j + 1} is left soft, but all freeze before any melts"
        least = self.times.heat_s if melts else self.times.freeze_s
        halves = [(other, item) if melts else (item, other) for other in others]
        reconfigures = any(self._reconfigures(*pair) for pair in halves)
        if lasted < least - TIME_TOLERANCE_S and not reconfigures:
            yield f"changes in {lasted:z.3f} s instead of {least:zg} s"

    def _reconfigures(self, freeze: Transition, melt: Transition) -> bool:
        """Whether a freeze and a melt are the halves of a long enough reconfiguration."""
        cooled, whole = freeze.done_s - freeze.heater_s, melt.done_s - freeze.heater_s
        return (
            (freeze.to, melt.to) == ("rigid", "soft")
            and abs(melt.heater_s - freeze.done_s) <= TIME_TOLERANCE_S
            and cooled >= self.times.reconfigure_cool_s - TIME_TOLERANCE_S
            and whole >= self.times.reconfigure_s - TIME_TOLERANCE_S
        )


def _changes(before: Mode, after: Mode) -> int:
    """Number of melts and freezes in a change of mode: all that is soft freezes first."""
    return 0 if before == after else sum(before) + sum(after)
