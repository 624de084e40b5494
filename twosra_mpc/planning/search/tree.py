"""The tree of mode sequences that branch and bound searches: stage after stage, mode after mode.

A node is a variant of the problem with the sequences of its first stages and the modes of the
stage that is open. Sequences are kept in a canonical form that loses nothing: a rigid phase opens
every stage that begins solid and may drive, and closes every one that must end solid (it may have
zero length and then costs nothing), and no phase repeats the mode before it; the same mode may
follow across the end of a stage.

What a node's stages take is a longest path through the network of their phases. Stages that are
still to come take no less than alone, whatever came before: as all segments can be as warm as they
ever get, that is the least over their sequences of the longest path from the end of the stage
before, with no heating to wait for. Both add up, as every plan passes through that end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, TypeVar

from twosra_mpc.planning.search.bends import passes_forbidden
from twosra_mpc.planning.search.bounds import SequenceBound, pose_bound, sequence_bound
from twosra_mpc.planning.search.mission_bound import (
    MissionRelaxation,
    StageEnd,
    mission_bound,
    reachable,
)
from twosra_mpc.planning.search.motion_bound import least_motion_s
from twosra_mpc.planning.search.parts import bound_by_parts
from twosra_mpc.planning.search.schedule import with_durations
from twosra_mpc.planning.search.stage_task import StageTask, Way
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, earliest_times, resting_s

Solution = TypeVar("Solution")

_LATE_S = 1e6  # later than anything that happens before a stage
_MOVING = 0.05  # share of a bound that lacks from which on it is asked how long plans move


class Node(NamedTuple):
    """A variant (-1: none chosen), the sequences of its first stages, the modes of the next one."""

    variant: int
    sequences: tuple[ModeSequence, ...] = ()
    head: ModeSequence = ()


class Whole(NamedTuple):
    """A sequence of every stage, or of the first stages, of a variant."""

    variant: int
    sequences: tuple[ModeSequence, ...]

    @property
    def joined(self) -> ModeSequence:
        """All phases."""
        if len(self.sequences) == 1:
            return self.sequences[0]
        return tuple(itertools.chain.from_iterable(self.sequences))


class SoFar(NamedTuple):
    """What the first stages of a variant take: infinite where they are proved impossible."""

    cost: float
    phases: ModeSequence = ()
    durations: tuple[float, ...] = ()


Solver = Callable[[TemporalNetwork, SequenceBound, Whole], Iterable[tuple[float, Solution] | None]]


@dataclass
class Tree(Generic[Solution]):
    """Stages as a search tree.

    Attributes:
        variants: The stages of every variant.
        first: Stiffness at t = 0.
        timing: The transition model.
        weights: Weights of the cost.
        relaxation: Rates and room of the bending coordinates.
        solver: Yields attempts at a plan of all stages, given their network and bound.
        excluded: Complete sequences that are not to be used.
        unreachable: Filled by the search: why sequences were proved infeasible.
    """

    variants: Sequence[Sequence[StageTask]]
    first: Mode
    timing: TransitionModel
    weights: Weights
    relaxation: MissionRelaxation
    solver: Solver[Solution]
    excluded: frozenset[ModeSequence] = frozenset()
    unreachable: dict[ModeSequence, str] = field(default_factory=dict)
    _bounds: dict[Whole, SequenceBound] = field(default_factory=dict)
    _alone: dict[tuple[Hashable, Mode, ModeSequence], float] = field(default_factory=dict)
    _rest: dict[tuple[int, int, Mode, Way], float] = field(default_factory=dict)
    _known: dict[tuple[Hashable, ModeSequence], list[float]] = field(default_factory=dict)
    _tight: dict[Whole, float] = field(default_factory=dict)
    _bending: dict[tuple[int, tuple[ModeSequence, ...]], bool] = field(default_factory=dict)
    _further: dict[tuple[Hashable, Mode], float] = field(default_factory=dict)
    _passed: dict[Whole, SoFar] = field(default_factory=dict)
    _motion_s: float | None = None  # least time in which every plan moves, once it is asked for

    # --- Nodes

    @property
    def only(self) -> StageTask | None:
        """The stage, where there is but one in one variant."""
        stages = self.variants[0]
        return stages[0] if len(self.variants) == len(stages) == 1 else None

    @property
    def rigid(self) -> Mode:
        """The mode in which every segment is solid."""
        return rigid_mode(len(self.first))

    def at(self, head: ModeSequence) -> Node:
        """The node of the first variant whose first stage begins with these modes."""
        return Node(0, (), head)

    def root(self) -> Node:
        """No variant chosen, unless there is but one."""
        return Node(-1) if len(self.variants) > 1 else self._opened(0, ())

    def _opened(self, variant: int, sequences: tuple[ModeSequence, ...]) -> Node:
        """The node where the next stage begins, if there is one."""
        stages = self.variants[variant]
        if len(sequences) == len(stages):
            return Node(variant, sequences)
        begins = sequences[-1][-1] if sequences else self.first
        return Node(variant, sequences, stages[len(sequences)].opening(begins))

    def _open(self, node: Node) -> tuple[StageTask, Mode] | None:
        """The stage that is open, and the stiffness in which it begins; None: all are over."""
        stages = self.variants[node.variant]
        if len(node.sequences) == len(stages):
            return None
        begins = node.sequences[-1][-1] if node.sequences else self.first
        return stages[len(node.sequences)], begins

    def children(self, node: Node) -> list[Node]:
        """The variants, or one more mode, or the next stage."""
        if node.variant < 0:
            return [self._opened(variant, ()) for variant in range(len(self.variants))]
        if (opened := self._open(node)) is None:
            return []
        stage, begins = opened
        found = [Node(*node[:2], head) for head in stage.longer(node.head, begins)]
        closed = None if stage.final else stage.closed(node.head, begins)
        if closed and len(closed) <= stage.most_phases and stage.misfit(closed) is None:
            found.insert(0, self._opened(node.variant, (*node.sequences, closed)))
        return found

    def leaps(self, node: Node) -> list[Node]:
        """The variants, or the stage that is open with each of its sequences."""
        if node.variant < 0:
            return self.children(node)
        if (opened := self._open(node)) is None:
            return []
        sequences = opened[0].sequences(opened[1])
        return [self._opened(node.variant, (*node.sequences, each)) for each in sequences]

    def too_deep(self, node: Node) -> bool:
        """Whether the open stage, or its shortest child, has more phases than are opened."""
        if node.variant < 0 or (opened := self._open(node)) is None:
            return False
        stage, begins = opened
        return len(stage.closed(node.head, begins) or node.head) > stage.most_phases

    def whole(self, node: Node) -> Whole | None:
        """The sequences of all stages a node stands for; None if another node stands for them."""
        if node.variant < 0:
            return None
        if (opened := self._open(node)) is None:
            return Whole(*node[:2])
        stage, begins = opened
        last = stage.closed(node.head, begins) if stage.final else None
        return None if last is None else Whole(node.variant, (*node.sequences, last))

    # --- Bounds of nodes

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
        rigid, timing = stage.rigid, self.timing
        usable = tuple(m for m in stage.modes if timing.refusal((m,), rigid) is None)
        found = [timing.onward(mode, missing, usable, last) for last in stage.endings]
        return min((each for each in found if each is not None), default=None)

    def _must_still_soften(self, stage: StageTask, whole: ModeSequence, segment: int) -> bool:
        """Whether every completion melts a segment that was solid all the time."""
        if stage.bend is None or self.first[segment] or any(mode[segment] for mode in whole):
            return False
        return stage.bend.must_bend(segment)

    def _network(self, stage: StageTask, sequence: ModeSequence) -> TemporalNetwork:
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
        network = self.timing.network(whole, settled or sequence[-1], [0.0] * len(whole))
        begin = network.layout.origin, network.layout.end(len(before) - 1)
        late = replace(network, least={**network.least, begin: _LATE_S})
        times = earliest_times(with_durations(late, lasting))
        if times is None:
            return math.inf
        return times[network.layout.finish] - _LATE_S

    # --- Leaves

    def leaf_bound(self, node: Node) -> float:
        """Optimum of the relaxation of all stages."""
        whole = self.whole(node)
        if whole is None or self.too_deep(node) or whole.joined in self.excluded:
            return math.inf
        leaf, stages = whole.joined, self.variants[whole.variant]
        misfits = (a.misfit(b) for a, b in zip(stages, whole.sequences, strict=True))
        reason = next(filter(None, misfits), None) or self.timing.refusal(leaf, self._last(whole))
        if reason is not None:
            self.unreachable[leaf] = reason
            return math.inf
        if len(stages) > 1 and self._so_far(whole).cost == math.inf:
            return math.inf
        bound = self._bounds.get(whole) or self._relaxed(whole)
        if bound is None or bound.cost == math.inf:
            shapes = "these shapes" if len(stages) > 1 else "this shape"
            words = f"{sequence_name(leaf)} cannot reach {shapes} within the shape limits"
            self.unreachable[leaf] = words
            return math.inf
        self._bounds[whole] = bound
        if len(stages) > 1:
            return bound.cost
        if self._only_drives(whole):
            return max(bound.cost, stages[0].drive_s)
        pose = stages[0].bend.pose if stages[0].bend else None
        if self._motion_s is None and pose is not None and pose.known_s > bound.cost:
            self._find_motion_s(stages[0])  # driving outlasts the metal
        return max(bound.cost, self.bound(node)) if self._motion_s else bound.cost

    def _find_motion_s(self, stage: StageTask) -> None:
        """Work out how long every plan moves, where there is but one variant to plan."""
        if len(self.variants) == 1 and stage.bend is not None:
            self._motion_s = least_motion_s(stage.bend, stage.modes)

    def _last(self, whole: Whole) -> Mode:
        """Stiffness at the end."""
        return self.variants[whole.variant][-1].settled(whole.sequences[-1])

    def _only_drives(self, whole: Whole) -> bool:
        """Whether plans of this sequence never melt anything."""
        return not any(map(any, (self.first, self._last(whole), *whole.joined)))

    def _relaxed(
        self, whole: Whole, drives_s: Sequence[float] | None = None
    ) -> SequenceBound | None:
        """The relaxation of all stages; drives may be known to last longer."""
        stages, leaf = self.variants[whole.variant], whole.joined
        alone = len(stages) == 1
        durations = stages[0].durations(leaf) if alone else self._durations(whole)
        if drives_s is not None:
            durations = [max(pair) for pair in zip(durations, drives_s, strict=True)]
        if not all(map(math.isfinite, durations)):
            return None
        network = self.timing.network(leaf, self._last(whole), durations)
        found = None
        if alone and stages[0].bend is not None:
            found = sequence_bound(network, stages[0].bend, self.weights, durations)
            if found is None or not stages[0].distance_m:
                return found
        ends = [0, *itertools.accumulate(map(len, whole.sequences))]
        moving = [
            moves
            for stage, sequence in zip(stages, whole.sequences, strict=True)
            for moves in stage.moving(sequence)
        ]
        placed = mission_bound(
            network,
            self.relaxation,
            self.weights,
            durations,
            [
                StageEnd(ends[k], stage.change, ends[k - stage.since], stage.distance_m)
                for k, stage in enumerate(stages, start=1)
            ],
            [i for i, moves in enumerate(moving) if not moves],
        )
        return placed and max(placed, found or placed, key=lambda bound: bound.cost)

    def tighter_bound(self, node: Node, enough: float) -> float:
        """Raise the leaf bound by the time the change of pose takes, or by what blocks it."""
        whole = self.whole(node)
        if whole is None:
            return -math.inf
        stages, drives_s = self.variants[whole.variant], list[float]()
        for stage, sequence in zip(stages, whole.sequences, strict=True):
            if (reason := stage.in_the_way.blocks(sequence)) is not None:
                self.unreachable[whole.joined] = reason
                return math.inf
            drives_s += stage.in_the_way.least_drives_s(sequence)
        bound = -math.inf
        if len(stages) == 1:
            bound = self._tighter_alone(node, whole, drives_s, enough)
        else:
            drives_s = self._longer_drives(whole, drives_s, enough)
            if bound < enough:
                bound = self._tighter_first(whole, enough)
        if any(drives_s):
            relaxed = self._relaxed(whole, drives_s)
            bound = max(bound, math.inf if relaxed is None else relaxed.cost)
        return bound

    def _tighter_alone(
        self, node: Node, whole: Whole, drives_s: Sequence[float], enough: float
    ) -> float:
        """The same of the only stage, by all that is known of its motion."""
        (stage,), leaf = self.variants[whole.variant], whole.joined
        bound = self.bound(node) if self._motion_s else -math.inf
        if self._only_drives(whole):
            bound = max(bound, stage.drive_time(enough))
        bound = max(bound, self._by_motion(stage, whole, drives_s, bound, enough))
        far = max(bound, self._bounds[whole].cost) < (1 - _MOVING) * enough
        if self._motion_s is None and far and any(map(any, leaf)):
            self._find_motion_s(stage)
            bound = max(bound, self.bound(node))
        return bound

    def _by_motion(
        self,
        stage: StageTask,
        whole: Whole,
        drives_s: Sequence[float],
        bound: float,
        enough: float,
    ) -> float:
        """Bound of a sequence of the first stage, by parts of what it may do and by its pose."""
        if (task := stage.bend) is None or bound >= enough:
            return -math.inf
        leaf = whole.joined
        longer = [max(pair) for pair in zip(stage.durations(leaf), drives_s, strict=True)]
        network = self.timing.network(leaf, stage.settled(leaf), longer)
        delayed = self.timing.with_delays(network, longer)
        bound = self._by_parts(whole, stage, delayed, longer, enough)
        if bound < enough:
            bound = max(bound, pose_bound(delayed, task, self.weights, longer, enough))
        return bound

    def _longer_drives(self, whole: Whole, drives_s: list[float], enough: float) -> list[float]:
        """Durations of drives with those of stages that are nothing else."""
        ends = [0, *itertools.accumulate(map(len, whole.sequences))]
        pairs = zip(self.variants[whole.variant], whole.sequences, strict=True)
        for k, (stage, sequence) in enumerate(pairs):
            if sequence == (stage.rigid,):
                drives_s[ends[k]] = max(drives_s[ends[k]], stage.drive_time(enough))
        return drives_s

    def _tighter_first(self, whole: Whole, enough: float) -> float:
        """The first stage as if it were the only one, and the others no less than alone."""
        stages, sequences = self.variants[whole.variant], whole.sequences
        later = sum(
            self._alone_s(stage, before[-1], sequence)
            for stage, before, sequence in zip(stages[1:], sequences, sequences[1:], strict=False)
        )
        first = Whole(whole.variant, sequences[:1])
        if first not in self._tight:
            drives_s = stages[0].in_the_way.least_drives_s(sequences[0])
            wanted = enough - later
            self._tight[first] = self._by_motion(stages[0], first, drives_s, -math.inf, wanted)
        return self._tight[first] + later

    def _by_parts(
        self,
        whole: Whole,
        stage: StageTask,
        network: TemporalNetwork,
        known_s: Sequence[float],
        enough: float,
    ) -> float:
        """What is proved of all parts of what a sequence may do.

        Its bound takes that over, and the bends, where its own pass a forbidden shape.
        """
        task = stage.bend
        assert task is not None, "only then there are parts"
        found = bound_by_parts(network, task, self.weights, known_s, enough)
        if found is None:
            return -math.inf
        if (known := self._bounds.get(whole)) is not None:
            bends = known.bends
            bends = found.bends if passes_forbidden(whole.joined, task, bends) else bends
            cost = max(found.cost, known.cost)
            self._bounds[whole] = replace(known, cost=cost, bends=bends)
        return found.cost

    def solve(self, node: Node) -> Iterator[tuple[float, Solution] | None]:
        """Hand the sequences of all stages to the solver.

        Where its first attempt fails because the bound's bends pass a forbidden shape, again with
        others; after another failure, as by then another leaf may have the least bound.
        """
        whole = self.whole(node)
        if whole is None:
            return
        leaf, known = whole.joined, self._bounds[whole]
        least_s, stages = [0.0] * len(leaf), self.variants[whole.variant]
        network = self.timing.network(leaf, self._last(whole), least_s)
        attempts = iter(self.solver(network, known, whole))
        first = next(attempts, None)
        yield first
        task = stages[0].bend if len(stages) == 1 else None
        if first is None and task and passes_forbidden(leaf, task, known.bends):
            if self._bounds[whole] is known:
                self._by_parts(whole, stages[0], network, least_s, math.inf)
                yield None
            attempts = iter(self.solver(network, self._bounds[whole], whole))
        yield from attempts


def _timed(network: TemporalNetwork, durations: Sequence[float]) -> TemporalNetwork:
    """The network with least durations of its first phases."""
    return with_durations(network, durations) if any(durations) else network
