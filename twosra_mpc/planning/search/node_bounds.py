"""Lower bounds of nodes: every completion takes at least so long.

What a node's stages take is a longest path through the network of their phases. Stages that are
still to come take no less than alone, whatever came before: as all segments can be as warm as they
ever get, that is the least over their sequences of the longest path from the end of the stage
before, with no heating to wait for. Both add up, as every plan passes through that end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.search.mission_bound import MissionRelaxation, reachable
from twosra_mpc.planning.search.nodes import Node, Nodes, Whole
from twosra_mpc.planning.search.schedule import with_durations
from twosra_mpc.planning.search.stage_task import StageTask, Way
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, earliest_times, resting_s

_LATE_S = 1e6  # later than anything that happens before a stage


class SoFar(NamedTuple):
    """What the first stages of a variant take: infinite where they are proved impossible."""

    cost: float
    phases: ModeSequence = ()
    durations: tuple[float, ...] = ()


@dataclass(kw_only=True)
class NodeBounds(Nodes):
    """Nodes with their lower bounds.

    Attributes:
        timing: The transition model.
        weights: Weights of the cost.
        relaxation: Rates and room of the bending coordinates.
        unreachable: Filled by the search: why sequences were proved infeasible.
    """

    timing: TransitionModel
    weights: Weights
    relaxation: MissionRelaxation
    unreachable: dict[ModeSequence, str] = field(default_factory=dict)
    _alone: dict[tuple[Hashable, Mode, ModeSequence], float] = field(default_factory=dict)
    _rest: dict[tuple[int, int, Mode, Way], float] = field(default_factory=dict)
    _known: dict[tuple[Hashable, ModeSequence], list[float]] = field(default_factory=dict)
    _bending: dict[tuple[int, tuple[ModeSequence, ...]], bool] = field(default_factory=dict)
    _further: dict[tuple[Hashable, Mode], float] = field(default_factory=dict)
    _onwards: dict[tuple[StageTask, Mode, frozenset[int]], float | None] = field(
        default_factory=dict
    )
    _passed: dict[Whole, SoFar] = field(default_factory=dict)
    _motion_s: float | None = None  # least time in which every plan moves, once it is asked for

    def bound(self, node: Node) -> float:
        """Every completion passes through the events of ``node``; what comes then takes longer."""
        if node.variant < 0:
            return 0.0
        so_far = self._so_far(Whole(*node[:2]))
        if so_far.cost == math.inf or (opened := self._open(node)) is None:
            return so_far.cost
        stage, begins = opened
        whole, done = (*so_far.phases, *node.head), len(node.sequences)
        reason = stage.in_the_way.blocks(None) or stage.impossible
        if reason is not None:
            self.unreachable[whole] = reason
            return math.inf
        several = len(self.variants[node.variant]) > 1
        if several and node.head == stage.opening(begins):
            return so_far.cost + self._to_go(*node[:1], done, begins, self._way(node))
        if not node.head:
            return so_far.cost
        if (reason := self.timing.refusal(whole, stage.rigid)) is not None:
            self.unreachable[whole] = reason
            return math.inf
        later = self._later(node.variant, done + 1) if several else 0.0
        return self._least(stage, whole, so_far.durations) + later

    def _least(self, stage: StageTask, whole: ModeSequence, durations: Sequence[float]) -> float:
        """Transitions alone, of all phases up to those of the stage that is open.

        ``durations`` are those of the first phases.
        """
        missing = [j for j in range(len(self.first)) if self._must_still_soften(stage, whole, j)]
        onward = self._onward(stage, whole[-1], frozenset(missing))
        if onward is not None:
            network = self.timing.network(whole, whole[-1], [0.0] * len(whole))
            times = earliest_times(_timed(network, durations))
            assert times is not None, "what is not refused has a schedule"
            return times[network.layout.finish] + self._fixed_cost(network) + onward
        least = self._least_time(stage, whole, durations)
        for j in missing:
            first = [
                self._least_time(stage, (*whole, mode), durations)
                for mode in stage.modes
                if mode[j]
            ]
            least = max(least, min(first, default=math.inf))
        return least + self._least_fixed_cost(stage, whole, missing)

    def _onward(self, stage: StageTask, mode: Mode, missing: frozenset[int]) -> float | None:
        """Least cost of the melts and freezes on to the end of a stage, if it can be told."""
        key = (stage, mode, missing)
        if key not in self._onwards:
            rigid, timing = stage.rigid, self.timing
            usable = tuple(m for m in stage.modes if timing.refusal((m,), rigid) is None)
            found = [timing.onward(mode, missing, usable, last) for last in stage.endings]
            known = (each for each in found if each is not None)
            self._onwards[key] = min(known, default=None)
        return self._onwards[key]

    def _must_still_soften(self, stage: StageTask, whole: ModeSequence, segment: int) -> bool:
        """Whether every completion melts a segment that was solid all the time."""
        if stage.bend is None or self.first[segment] or any(mode[segment] for mode in whole):
            return False
        return stage.bend.must_bend(segment)

    def _network(self, stage: StageTask, sequence: ModeSequence) -> TemporalNetwork:
        charge(Cost.NETWORK, len(sequence))
        settled = stage.rigid if stage.last == stage.rigid else sequence[-1]
        return self.timing.network(sequence, settled, [0.0] * len(sequence))

    def _least_time(
        self, stage: StageTask, sequence: ModeSequence, durations: Sequence[float]
    ) -> float:
        """Duration of the transitions of ``sequence``, which every completion has to make too.

        And of the motion of every plan, while none of them is on its plateau, if that is known.

        Completions of a node append phases. Those before the melt of a segment that was solid so
        far delay it, and the freeze after it; the other segment has to freeze in any case.
        """
        if self.timing.refusal(sequence, stage.rigid) is not None:
            return math.inf
        network = self._network(stage, sequence)
        times = earliest_times(_timed(network, durations))
        if times is None:
            return math.inf
        least = times[network.layout.finish]
        return max(least, self._motion_s + resting_s(network)) if self._motion_s else least

    def _least_fixed_cost(
        self, stage: StageTask, sequence: ModeSequence, missing: list[int]
    ) -> float:
        """Cost of the melts and freezes of a node and of those that must still follow."""
        cost, last = self._fixed_cost(self._network(stage, sequence)), stage.last
        for j in missing:  # no melt of it came before: what it takes is that from t = 0
            mode = tuple(int(k == j) for k in range(len(self.first)))
            melt = self.timing.network((mode,), mode, [0.0])
            cost += self.weights.energy_s_per_J * melt.melt_energy_J
            cost += self.weights.transition_s * (1 + (last is not None and last[j] == 0))
        return cost

    def _fixed_cost(self, network: TemporalNetwork) -> float:
        """Cost of melts and freezes besides the time they take."""
        energy = self.weights.energy_s_per_J * network.melt_energy_J
        return energy + self.weights.transition_s * network.transitions

    # --- What the first stages of a variant take

    def _so_far(self, over: Whole) -> SoFar:
        """What stages that are over take, worked out once."""
        if over not in self._passed:
            self._passed[over] = self._passes(over) if over.sequences else SoFar(0.0)
        return self._passed[over]

    def _passes(self, over: Whole) -> SoFar:
        joined, durations = over.joined, self._durations(over)
        charge(Cost.NETWORK, len(joined))
        network, reason = None, None
        if not self._bends(over):
            reason = f"{sequence_name(joined)} cannot bend as the tasks ask"
        elif self._stranded(over):
            reason = "without a drive it does not come so far"
        elif not all(map(math.isfinite, durations)):
            reason = "a stage must pass shapes that are forbidden"
        elif (reason := self.timing.refusal(joined, joined[-1])) is None:
            network = self.timing.network(joined, joined[-1], [0.0] * len(joined))
        if reason is not None:
            self.unreachable[joined] = reason
        if network is None:
            return SoFar(math.inf)
        times = earliest_times(with_durations(network, durations))
        if times is None:
            return SoFar(math.inf)
        cost = times[network.layout.finish] + self._fixed_cost(network)
        return SoFar(cost, joined, tuple(durations))

    def _bends(self, over: Whole) -> bool:
        """Whether the modes can bring about the shapes of the stages."""
        modes = tuple(tuple(sorted(set(filter(any, each)))) for each in over.sequences)
        key = over.variant, modes
        if key not in self._bending:
            stages = self.variants[over.variant][: len(modes)]
            self._bending[key] = reachable([stage.change for stage in stages], modes)
        return self._bending[key]

    def _stranded(self, over: Whole) -> bool:
        """Whether the last stage is too far away for blocks alone, and there is no drive."""
        done, stages = len(over.sequences), self.variants[over.variant]
        since = slice(done - stages[done - 1].since, done)
        return self._too_far(stages[done - 1], Way().then(over.sequences[since], stages[since]))

    def _too_far(self, stage: StageTask, way: Way) -> bool:
        """Whether blocks alone do not come as far as a stage must, and there is no drive."""
        by_blocks = way.blocks * self.relaxation.soft_travel_m if way.blocks else 0.0
        return not way.drives and stage.distance_m > by_blocks

    def _way(self, node: Node) -> Way:
        """What has moved since the last end of a stage whose place is known."""
        done, stages = len(node.sequences), self.variants[node.variant]
        since = done - stages[done].since + 1
        return Way().then(node.sequences[since:], stages[since:])

    def _durations(self, over: Whole) -> list[float]:
        stages = self.variants[over.variant]
        pairs = zip(stages, over.sequences, strict=False)
        return [time for stage, sequence in pairs for time in self._lasting(stage, sequence)]

    def _lasting(self, stage: StageTask, sequence: ModeSequence) -> list[float]:
        """Least durations of a stage's phases, worked out once."""
        key = (stage.alike, sequence)
        if key not in self._known:
            found = list(stage.durations(sequence))
            if sequence == (stage.rigid,):
                found[0] = max(found[0], stage.drive_s)
            self._known[key] = found
        return self._known[key]

    # --- What stages that are still to come take

    def _later(self, variant: int, done: int) -> float:
        """What the stages from a number on add at least, whatever the one before does."""
        if done == len(self.variants[variant]):
            return 0.0
        before = self.variants[variant][done - 1]
        way = Way(drives=True)
        return min(self._to_go(variant, done, mode, way) for mode in before.endings)

    def _to_go(self, variant: int, done: int, begins: Mode, way: Way) -> float:
        """What the stages from a number on add at least, whatever came before.

        ``way`` is what has moved since the last end of a stage whose place is known.
        """
        stages = self.variants[variant]
        if done == len(stages):
            return 0.0
        key = (variant, done, begins, way)
        if key not in self._rest:
            stage = stages[done]
            best = self._beyond(stage, begins) + self._later(variant, done + 1)
            known = done + 1 == len(stages) or stages[done + 1].since == 1
            for sequence in stage.sequences(begins):
                least = self._alone_s(stage, begins, sequence)
                after = way.then([sequence], [stage])
                if least < best and not self._too_far(stage, after):
                    after = Way() if known else after
                    best = min(best, least + self._to_go(variant, done + 1, sequence[-1], after))
            self._rest[key] = best
        return self._rest[key]

    def _alone_s(self, stage: StageTask, begins: Mode, sequence: ModeSequence) -> float:
        """What a stage adds at least with a sequence, whatever came before it."""
        key = (stage.alike, begins, sequence)
        if key not in self._alone:
            durations, settled = self._lasting(stage, sequence), stage.settled(sequence)
            self._alone[key] = self._from_warm(begins, sequence, durations, settled)
        return self._alone[key]

    def _beyond(self, stage: StageTask, begins: Mode) -> float:
        """What a stage adds at least with sequences longer than are opened."""
        key = (stage.alike, begins)
        if key not in self._further:
            self._further[key] = self._least_prefix(stage, begins)
        return self._further[key]

    def _least_prefix(self, stage: StageTask, begins: Mode) -> float:
        """Least time of what every longer sequence begins with, by depth first search."""
        rigid, best = rigid_mode(len(begins)), math.inf
        settled = rigid if stage.last == rigid else None  # whatever follows, all freezes
        heads = [(stage.opening(begins), 0.0)]
        while heads:
            head, least = heads.pop()
            if least >= best:
                continue
            if len(head) == stage.most_phases:
                best = least
                continue
            longer = [
                (longer, self._from_warm(begins, longer, [0.0] * len(longer), settled))
                for longer in stage.longer(head, begins)
            ]
            heads += sorted(longer, key=lambda each: -each[1])
        return best

    def _from_warm(
        self,
        begins: Mode,
        sequence: ModeSequence,
        durations: Sequence[float],
        settled: Mode | None = None,
    ) -> float:
        """Longest path of a sequence from its beginning, all segments as warm as can be."""
        rigid = rigid_mode(len(begins))
        cycles = [
            (rigid, tuple(int(j == k) for k in range(len(begins)))) for j in range(len(begins))
        ]
        before = (*itertools.chain.from_iterable(cycles), rigid)
        before = before if begins == rigid else (*before, begins)
        if not sequence or not all(map(math.isfinite, durations)):
            return 0.0 if not sequence else math.inf
        whole = (*before, *sequence)
        lasting = [*[0.0] * len(before), *durations]
        charge(Cost.NETWORK, len(whole))
        network = self.timing.network(whole, settled or sequence[-1], [0.0] * len(whole))
        begin = network.layout.origin, network.layout.end(len(before) - 1)
        late = replace(network, least={**network.least, begin: _LATE_S})
        times = earliest_times(with_durations(late, lasting))
        if times is None:
            return math.inf
        return times[network.layout.finish] - _LATE_S


def _timed(network: TemporalNetwork, durations: Sequence[float]) -> TemporalNetwork:
    """The network with least durations of its first phases."""
    return with_durations(network, durations) if any(durations) else network
