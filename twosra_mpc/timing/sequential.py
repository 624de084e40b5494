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

Molten = tuple[float, ...]  # how much of each segment is molten; a mode is one


@model_of.register(SequentialTiming)
@dataclass(frozen=True)
class Sequential(TransitionModel):
    """Fixed waits: to soft, to rigid, and from one soft mode to another, cooled in between.

    Of a change that is under way at t = 0, what is left takes its share of a wait. Before anything
    is heated, all cools by as much as freezes what is to be rigid, and makes alike what is not.
    """

    times: SequentialTiming

    @property
    def words(self) -> str:
        named = f"timing “{self.problem.timing}”"
        return f"the fixed waits of {named}, through which the robot stands still"

    def _waits(self, before: Molten, after: Mode) -> tuple[float, float]:
        """Times for which what is molten cools, and what becomes soft is heated then [s]."""
        times = self.times
        if is_rigid(after):
            return times.freeze_s * max(before), 0.0
        kept = [share for share, soft in zip(before, after, strict=True) if soft]
        frozen = [share for share, soft in zip(before, after, strict=True) if not soft]
        cooled = max(max(kept) - min(kept), *frozen, 0.0)
        heated = min(1.0, 1.0 - min(kept) + cooled)
        anew_s = times.reconfigure_s - times.reconfigure_cool_s
        heat_s = (1.0 - cooled) * times.heat_s + cooled * anew_s
        return times.reconfigure_cool_s * cooled, heat_s * heated

    def _gaps(self, sequence: ModeSequence, last: Mode) -> list[tuple[Molten, Mode]]:
        first: Molten = tuple(self.problem.melt_fractions)
        return list(zip((first, *sequence), (*sequence, last), strict=True))

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
            least[layout.end(gap - 1), layout.start(gap)] = sum(self._waits(before, after))
            transitions += self._changes(before, after)
            energy_J += self._energy_J(before, after)
        return TemporalNetwork(sequence, last, least, transitions, energy_J)

    def _energy_J(self, before: Molten, after: Mode) -> float:
        """Heater energy of one change of mode, or of none."""
        heater, (_, heated_s) = self.problem.robot.heater, self._waits(before, after)
        return sum(after) * heated_s * heater.power_W(heater.melt_current_A)

    def _changes(self, before: Molten, after: Mode) -> int:
        """Number of melts and freezes in a change of mode."""
        cooled_s, heated_s = self._waits(before, after)
        return sum(map(bool, before)) * (cooled_s > 0) + sum(after) * (heated_s > 0)

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
                step = sum(self._waits(here, after))
                step += weights.transition_s * self._changes(here, after)
                step += weights.energy_s_per_J * self._energy_J(here, after)
                heapq.heappush(queue, (cost + step, next(order), after, left, end))
        return math.inf

    def settle(self, network: TemporalNetwork, times: Sequence[float]) -> TemporalNetwork | None:
        del network, times
        return None

    def made(self, network: TemporalNetwork, times: Sequence[float]) -> Iterator[Transition]:
        layout = network.layout
        for gap, (before, after) in enumerate(self._gaps(network.sequence, network.last)):
            begin, (cooled_s, heated_s) = times[layout.end(gap - 1)], self._waits(before, after)
            cooled = begin + cooled_s
            freeze, melt = (begin, begin, cooled), (cooled, cooled, cooled + heated_s)
            if cooled_s:
                molten = (j for j, share in enumerate(before) if share)
                yield from (Transition(j + 1, "rigid", *freeze) for j in molten)
            if heated_s:
                yield from (Transition(j + 1, "soft", *melt) for j in soft_segments(after))

    def segment_heating(self, segment: int, own: tuple[Transition, ...]) -> ConstantHeating:
        molten, now = self.problem.melt_fractions[segment], self.problem.temperatures[segment]
        heater, air = self.problem.robot.heater, self.problem.ambient
        return ConstantHeating(molten, own, heater, air, now)

    def violations(
        self, item: Transition, before: Transition | None, others: Sequence[Transition]
    ) -> Iterator[str]:
        """A freeze that ends as melts begin may be the first half of a reconfiguration.

        Nothing moves through either, and between them everything is rigid.
        """
        if item.onset_s > item.heater_s + TIME_TOLERANCE_S:
            yield f"the robot waits from then on, not from {item.onset_s:z.3f} s"
        melts, lasted = item.to == "soft", item.done_s - item.heater_s
        joint = item.heater_s if melts else item.done_s
        for j, soft in enumerate(self.problem.start_mode):
            for other in own_transitions(others, j):
                if other.heater_s < joint - TIME_TOLERANCE_S:
                    soft = int(other.to == "soft")
            if soft and j != item.segment - 1:
                yield f"segment {j + 1} is left soft, but all freeze before any melts"
        least = self.times.heat_s if melts else self.times.freeze_s
        if before is None:
            least *= self.left(item.segment - 1, item.to)
        halves = [(other, item) if melts else (item, other) for other in others]
        reconfigures = any(self._reconfigures(*pair, others) for pair in halves)
        if lasted < least - TIME_TOLERANCE_S and not reconfigures:
            yield f"changes in {lasted:z.3f} s instead of {least:zg} s"

    def _reconfigures(
        self, freeze: Transition, melt: Transition, others: Sequence[Transition]
    ) -> bool:
        """True if a freeze and a melt are the halves of a long enough reconfiguration."""
        cool_s, whole_s = self.times.reconfigure_cool_s, self.times.reconfigure_s
        joint = freeze.done_s
        if (freeze.to, melt.to) != ("rigid", "soft"):
            return False
        if freeze.heater_s <= TIME_TOLERANCE_S:  # of what is molten at t = 0
            together = [t for t in others if abs(t.heater_s - joint) <= TIME_TOLERANCE_S]
            soft = {t.segment - 1 for t in together if t.to == "soft"}
            after = tuple(int(j in soft) for j in range(len(self.first)))
            cool_s, heat_s = self._waits(tuple(self.problem.melt_fractions), after)
            whole_s = cool_s + heat_s
        return (
            abs(melt.heater_s - joint) <= TIME_TOLERANCE_S
            and joint - freeze.heater_s >= cool_s - TIME_TOLERANCE_S
            and melt.done_s - freeze.heater_s >= whole_s - TIME_TOLERANCE_S
        )
