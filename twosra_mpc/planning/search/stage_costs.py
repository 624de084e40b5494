"""Least costs of stages: of those that are over, of the one that is open, of those to come.

Stages to come add no less than alone, whatever came before: with all segments as warm as they ever
get, a stage adds the longest path of its sequence from the end of the stage before, with no heating
to wait for. The cheapest sequence is found by best-first search over its modes: a sequence costs no
less than what it begins with. Of the stages before, it is known which shapes they may end in, as W
rests while its segment is rigid: so stages whose boxes no one shape meets must reshape.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from twosra_mpc.effort import Cost, charge, once
from twosra_mpc.planning.bounds.bends import least_durations
from twosra_mpc.planning.bounds.schedule import fixed_cost, with_durations
from twosra_mpc.planning.bounds.stage_bounds import Shapes, StageBounds, Way
from twosra_mpc.planning.search.nodes import Stages, Whole
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness, rigid_mode, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, resting_s

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
            bend, found = stage.bend, [0.0] * len(sequence)
            if bend is not None:
                found = list(least_durations(sequence, bend))
            if sequence == (stage.rigid,):
                found[0] = max(found[0], stage.drive(0.0))
            self._durations[key] = found
        return self._durations[key]

    def cost(self, stage: StageBounds, begins: Mode, sequence: ModeSequence) -> float:
        """Least that a stage adds with a sequence, whatever came before it."""
        key = stage.alike, begins, sequence
        if key not in self._costs:
            modes = (begins, *sequence, stage.settled(sequence))
            warm_s = self.from_warm(modes, tuple(self.durations(stage, sequence)))
            self._costs[key] = max(stage.least_s, warm_s)
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
                    modes = self.timing.ordered((begins, *longer, settled or longer[-1]))
                    cost = max(least, self.from_warm(modes))
                    heapq.heappush(heads, (cost, False, next(numbers), longer))
        yield from (Priced(cost, sequence) for cost, _, sequence in sorted(wholes))

    @once
    def onward(self, stage: StageBounds, begins: Mode, count: int) -> float:
        """Lower bound on what a stage adds after a phase with at least so many more phases."""
        settled = stage.rigid if stage.last == stage.rigid else None
        heads: list[tuple[float, ModeSequence]] = [(0.0, (begins,))]
        while len((best := heapq.heappop(heads))[1]) <= count:
            for longer in stage.longer(best[1], begins):
                modes = self.timing.ordered((*longer, settled or longer[-1]))
                heapq.heappush(heads, (self.from_warm(modes), longer))
        return best[0]

    @once
    def from_warm(self, modes: ModeSequence, durations: tuple[float, ...] = ()) -> float:
        """Longest path of a sequence from its beginning, all segments as warm as can be.

        Args:
            modes: The stiffness before it, its modes, the stiffness after it.
            durations: Least durations of its phases [s]; they take no time if left out.
        """
        begins, *sequence, settled = modes
        if not sequence or not all(map(math.isfinite, durations)):
            return 0.0 if not sequence else math.inf
        rigid = rigid_mode(len(begins))
        cycles = [
            (rigid, tuple(int(j == k) for k in range(len(begins)))) for j in range(len(begins))
        ]
        before = (*itertools.chain.from_iterable(cycles), rigid)
        before = before if begins == rigid else (*before, begins)
        whole = (*before, *sequence)
        lasting = [*[0.0] * len(before), *(durations or [0.0] * len(sequence))]
        charge(Cost.NETWORK, len(whole))
        network = self.timing.network(whole, settled, [0.0] * len(whole))
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

    def after(self, variant: int, done: int) -> float:
        """Least that the stages from a number on add, whatever the one before does."""
        last, way = self.variants[variant][done - 1], Way(drives=True)
        return min(self.least(variant, done, mode, way, last.shapes) for mode in last.endings)

    @once
    def least(self, variant: int, done: int, begins: Mode, way: Way, shapes: Shapes) -> float:
        """Least that the stages from a number on add, from a stiffness and one of these shapes on.

        ``way`` is what has moved since the last end of a stage whose place is known.
        """
        stages = self.variants[variant]
        if done == len(stages):
            return 0.0
        stage, best, later = stages[done], math.inf, self.after(variant, done + 1)
        known = done + 1 == len(stages) or stages[done + 1].since == 1
        for cost, sequence in self.alone.cheapest_first(stage, begins):
            if cost + later >= best:
                break
            if sequence is None:
                return cost + later
            after, ends = way.then([sequence], [stage]), stage.ends_in(sequence, shapes)
            if ends is not None and not self.too_far(stage, after):
                begun = sequence[-1], Way() if known else after, ends
                best = min(best, cost + self.least(variant, done + 1, *begun))
            if best <= cost + later:
                break
        return best

    def too_far(self, stage: StageBounds, way: Way) -> bool:
        """True if blocks alone do not come as far as a stage must, and there is no drive."""
        by_blocks = way.blocks * self.soft_travel_m if way.blocks else 0.0
        return not way.drives and stage.distance_m > by_blocks


class Past(NamedTuple):
    """Least cost of the first stages of a variant: infinite where they are proved impossible."""

    cost: float
    phases: ModeSequence = ()
    durations: tuple[float, ...] = ()
    reason: str | None = None


NOTHING_YET = Past(0.0)


@dataclass
class SoFar:
    """Bounds of what comes first in a plan.

    Attributes:
        variants: The stages of every variant.
        first: Stiffness at t = 0.
        timing: The transition model.
        weights: Weights of the cost.
        to_go: What stages alone take.
    """

    variants: Sequence[Stages]
    first: StartingStiffness
    timing: TransitionModel
    weights: Weights
    to_go: ToGo

    # --- Stages that are over

    def durations(self, over: Whole) -> list[float]:
        """Least durations of all phases [s]."""
        pairs = zip(self.variants[over.variant], over.sequences, strict=False)
        return [time for pair in pairs for time in self.to_go.alone.durations(*pair)]

    def network(self, over: Whole, last: Mode, durations: Sequence[float]) -> TemporalNetwork:
        """The network of these stages, each of which lasts no less than its least duration."""
        charge(Cost.NETWORK, len(durations))
        network, done = self.timing.network(over.joined, last, durations), 0
        spans = dict[tuple[int, int], float]()
        stages = self.variants[over.variant]
        for stage, sequence in zip(stages, over.sequences, strict=False):
            begin, done = network.layout.end(done - 1), done + len(sequence)
            if stage.least_s:
                spans[begin, network.layout.end(done - 1)] = stage.least_s
        return replace(network, least=network.least | spans) if spans else network

    @once
    def past(self, over: Whole) -> Past:
        """Least cost of the first stages with these sequences."""
        joined = over.joined
        if (reason := self.impossible(over)) is not None:
            return Past(math.inf, reason=reason)
        durations = self.durations(over)
        if not all(map(math.isfinite, durations)):
            return Past(math.inf, reason="a stage must pass shapes that are forbidden")
        network = self.network(over, joined[-1], [0.0] * len(joined))
        times = with_durations(network, durations).earliest
        if times is None:
            return Past(math.inf)
        cost = times[network.layout.finish] + fixed_cost(network, self.weights)
        return Past(cost, joined, tuple(durations))

    def impossible(self, over: Whole) -> str | None:
        """Reason why these sequences cannot be, as far as that is told without times."""
        pairs = zip(self.variants[over.variant], over.sequences, strict=False)
        misfits = (stage.misfit(sequence) for stage, sequence in pairs)
        if (reason := next(filter(None, misfits), None)) is not None:
            return reason
        done, stages = len(over.sequences), self.variants[over.variant]
        last, since = stages[done - 1], slice(done - stages[done - 1].since, done)
        if (done > 1 or last.bend is None) and self.shapes(over) is None:
            return f"{sequence_name(over.joined)} cannot bend as the tasks ask"
        if last.distance_m:
            way = Way().then(over.sequences[since], stages[since])
            if self.to_go.too_far(last, way):
                return "without a drive it does not come so far"
        return self.timing.refusal(over.joined, over.joined[-1])

    @once
    def shapes(self, over: Whole) -> Shapes | None:
        """Shapes after these stages, as far as the goals and modes tell; None if there are none."""
        *before, last = over.sequences
        stage = self.variants[over.variant][len(before)]
        begun: Shapes | None = ((0.0,) * len(stage.shapes),) * len(stage.shapes)
        begun = self.shapes(over._replace(sequences=tuple(before))) if before else begun
        return begun and stage.ends_in(last, begun)

    # --- The stage that is open

    def least(
        self,
        stage: StageBounds,
        whole: ModeSequence,
        durations: Sequence[float],
        motion_s: float | None = None,
    ) -> float:
        """Transitions alone, of all phases up to those of the stage that is open.

        Args:
            stage: The stage.
            whole: All phases so far.
            durations: Least durations of the first phases [s].
            motion_s: Least time in which every plan moves [s], where that is known.
        """
        so_far = (self.first, *whole)  # every completion melts what was solid all the time
        must_bend = stage.bend.must_bend if stage.bend else ()
        missing = [j for j in must_bend if not any(mode[j] for mode in so_far)]
        onward = self._onward(stage, whole[-1], frozenset(missing))
        if onward is not None:
            network = self.timing.network(whole, whole[-1], [0.0] * len(whole))
            times = with_durations(network, durations).earliest
            assert times is not None, "what is not refused has a schedule"
            return times[network.layout.finish] + fixed_cost(network, self.weights) + onward
        settled = stage.rigid if stage.last == stage.rigid else whole[-1]
        network = self._settling(self.timing.ordered((*whole, settled)))
        times = with_durations(network, durations).earliest
        if times is None:
            return math.inf
        least = times[network.layout.finish]  # every completion makes these transitions too
        if motion_s:  # none of this is on the plateau of a melt or a freeze
            least = max(least, motion_s + resting_s(network))
        if count := stage.lacks(frozenset(filter(any, whole[len(durations) :]))):
            begun_s = times[network.layout.end(len(whole) - 1)]
            least = max(least, begun_s + self.to_go.alone.onward(stage, whole[-1], count))
        return least + self._least_fixed_cost(stage, network, missing)

    @once
    def _onward(self, stage: StageBounds, mode: Mode, missing: frozenset[int]) -> float | None:
        """Least cost of the melts and freezes on to the end of a stage, if it can be told."""
        rigid, timing = stage.rigid, self.timing
        usable = tuple(m for m in stage.modes if timing.refusal((m,), rigid) is None)
        found = [timing.onward(mode, missing, usable, last) for last in stage.endings]
        return min((each for each in found if each is not None), default=None)

    @once
    def _settling(self, modes: ModeSequence) -> TemporalNetwork:
        """Network of modes, the last of which is the stiffness after them."""
        charge(Cost.NETWORK, len(modes) - 1)
        return self.timing.network(modes[:-1], modes[-1], [0.0] * (len(modes) - 1))

    def _least_fixed_cost(
        self, stage: StageBounds, network: TemporalNetwork, missing: list[int]
    ) -> float:
        """Cost of the melts and freezes of a node and of those that must still follow."""
        cost, last = fixed_cost(network, self.weights), stage.last
        for j in missing:  # no melt of it came before: what it takes is that from t = 0
            mode = tuple(int(k == j) for k in range(len(stage.change)))
            melt = self.timing.network((mode,), mode, [0.0])
            cost += self.weights.energy_s_per_J * melt.melt_energy_J
            cost += self.weights.transition_s * (1 + (last is not None and last[j] == 0))
        return cost
