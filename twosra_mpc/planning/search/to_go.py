"""Stages that are still to come: they add no less than alone, whatever came before.

Alone, with all segments as warm as they ever get, a stage adds the longest path of its sequence
from the end of the stage before, with no heating to wait for. The cheapest sequence is found by
best-first search over its modes: a sequence costs no less than what it begins with.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.bounds.schedule import with_durations
from twosra_mpc.planning.bounds.stage_bounds import StageBounds, Way
from twosra_mpc.planning.search.nodes import Stages
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode
from twosra_mpc.timing import TransitionModel

_LATE_S = 1e6  # later than anything that happens before a stage


class Priced(NamedTuple):
    """A sequence of a stage and what it adds at least; None: all that are longer than opened."""

    cost: float
    sequence: ModeSequence | None


@dataclass
class Alone:
    """Bounds of stages alone, worked out once for all that are alike."""

    timing: TransitionModel
    _durations: dict[tuple[Hashable, ModeSequence], list[float]] = field(default_factory=dict)
    _costs: dict[tuple[Hashable, Mode, ModeSequence], float] = field(default_factory=dict)
    _priced: dict[tuple[Hashable, Mode], tuple[list[Priced], Iterator[Priced]]] = field(
        default_factory=dict
    )

    def durations(self, stage: StageBounds, sequence: ModeSequence) -> list[float]:
        """Least durations of the phases of a sequence [s]."""
        key = stage.alike, sequence
        if key not in self._durations:
            self._durations[key] = stage.durations(sequence)
        return self._durations[key]

    def cost(self, stage: StageBounds, begins: Mode, sequence: ModeSequence) -> float:
        """Least that a stage adds with a sequence, whatever came before it."""
        key = stage.alike, begins, sequence
        if key not in self._costs:
            durations, settled = self.durations(stage, sequence), stage.settled(sequence)
            self._costs[key] = max(
                stage.least_s, self.from_warm(begins, sequence, durations, settled)
            )
        return self._costs[key]

    def cheapest_first(self, stage: StageBounds, begins: Mode) -> Iterator[Priced]:
        """Yield the sequences of a stage, those that add least first."""
        key = stage.alike, begins
        if key not in self._priced:
            self._priced[key] = [], self._by_cost(stage, begins)
        known, more = self._priced[key]
        for number in itertools.count():
            if number == len(known):
                if (found := next(more, None)) is None:
                    return
                known.append(found)
            yield known[number]

    def _by_cost(self, stage: StageBounds, begins: Mode) -> Iterator[Priced]:
        settled = stage.rigid if stage.last == stage.rigid else None  # whatever follows: all freeze
        numbers = itertools.count()
        heads = [(0.0, False, next(numbers), stage.opening(begins))]  # and whether it was closed
        wholes = list[tuple[float, int, ModeSequence]]()
        while heads:
            if wholes and wholes[0][0] <= heads[0][0]:
                cost, _, sequence = heapq.heappop(wholes)
                yield Priced(cost, sequence)
                continue
            least, was_closed, _, head = heapq.heappop(heads)
            if not was_closed:
                whole = stage.closed(head, begins)
                if whole and len(whole) <= stage.most_phases and stage.misfit(whole) is None:
                    cost = self.cost(stage, begins, whole)
                    heapq.heappush(wholes, (max(least, cost), next(numbers), whole))
                heapq.heappush(heads, (least, True, next(numbers), head))
            elif len(head) == stage.most_phases:
                yield Priced(least, None)
                return
            else:
                for longer in stage.longer(head, begins):
                    cost = self.from_warm(begins, longer, [0.0] * len(longer), settled)
                    heapq.heappush(heads, (max(least, cost), False, next(numbers), longer))
        yield from (Priced(cost, sequence) for cost, _, sequence in sorted(wholes))

    def from_warm(
        self,
        begins: Mode,
        sequence: ModeSequence,
        durations: Sequence[float],
        settled: Mode | None = None,
    ) -> float:
        """Longest path of a sequence from its beginning, all segments as warm as can be."""
        if not sequence or not all(map(math.isfinite, durations)):
            return 0.0 if not sequence else math.inf
        rigid = rigid_mode(len(begins))
        cycles = [
            (rigid, tuple(int(j == k) for k in range(len(begins)))) for j in range(len(begins))
        ]
        before = (*itertools.chain.from_iterable(cycles), rigid)
        before = before if begins == rigid else (*before, begins)
        whole = (*before, *sequence)
        lasting = [*[0.0] * len(before), *durations]
        charge(Cost.NETWORK, len(whole))
        network = self.timing.network(whole, settled or sequence[-1], [0.0] * len(whole))
        begin = network.layout.origin, network.layout.end(len(before) - 1)
        late = replace(network, least={**network.least, begin: _LATE_S})
        times = with_durations(late, lasting).earliest
        if times is None:
            return math.inf
        return times[network.layout.finish] - _LATE_S


@dataclass
class ToGo:
    """Least cost to go: what the last stages of variants add at least.

    Attributes:
        variants: The stages of every variant.
        alone: Bounds of stages alone.
        soft_travel_m: How far b0 comes in a block of soft phases, at most.
    """

    variants: Sequence[Stages]
    alone: Alone
    soft_travel_m: float
    _known: dict[tuple[int, int, Mode, Way], float] = field(default_factory=dict)

    def after(self, variant: int, done: int) -> float:
        """Least that the stages from a number on add, whatever the one before does."""
        if done == len(self.variants[variant]):
            return 0.0
        endings = self.variants[variant][done - 1].endings
        return min(self.least(variant, done, mode, Way(drives=True)) for mode in endings)

    def least(self, variant: int, done: int, begins: Mode, way: Way) -> float:
        """Least that the stages from a number on add, from a stiffness on.

        ``way`` is what has moved since the last end of a stage whose place is known.
        """
        stages = self.variants[variant]
        if done == len(stages):
            return 0.0
        key = (variant, done, begins, way)
        if key not in self._known:
            stage, best, later = stages[done], math.inf, self.after(variant, done + 1)
            known = done + 1 == len(stages) or stages[done + 1].since == 1
            for cost, sequence in self.alone.cheapest_first(stage, begins):
                if cost + later >= best:
                    break
                if sequence is None:
                    best = cost + later
                    break
                after = way.then([sequence], [stage])
                if not self.too_far(stage, after):
                    after = Way() if known else after
                    best = min(best, cost + self.least(variant, done + 1, sequence[-1], after))
                if best <= cost + later:
                    break
            self._known[key] = best
        return self._known[key]

    def too_far(self, stage: StageBounds, way: Way) -> bool:
        """True if blocks alone do not come as far as a stage must, and there is no drive."""
        by_blocks = way.blocks * self.soft_travel_m if way.blocks else 0.0
        return not way.drives and stage.distance_m > by_blocks
