"""The tree of mode sequences that branch and bound searches: its leaves, their bounds and plans."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.search.bends import passes_forbidden
from twosra_mpc.planning.search.bounds import SequenceBound, pose_bound, sequence_bound
from twosra_mpc.planning.search.mission_bound import StageEnd, mission_bound
from twosra_mpc.planning.search.motion_bound import least_motion_s
from twosra_mpc.planning.search.node_bounds import NodeBounds
from twosra_mpc.planning.search.nodes import Node, Whole
from twosra_mpc.planning.search.parts import bound_by_parts
from twosra_mpc.planning.search.stage_task import StageTask
from twosra_mpc.robot.modes import Mode, ModeSequence, sequence_name
from twosra_mpc.timing import TemporalNetwork

Solution = TypeVar("Solution")

_MOVING = 0.05  # share of a bound that lacks from which on it is asked how long plans move

Solver = Callable[[TemporalNetwork, SequenceBound, Whole], Iterable[tuple[float, Solution] | None]]


@dataclass(kw_only=True)
class Tree(NodeBounds, Generic[Solution]):
    """Stages as a search tree.

    Attributes:
        solver: Yields attempts at a plan of all stages, given their network and bound.
        excluded: Complete sequences that are not to be used.
    """

    solver: Solver[Solution]
    excluded: frozenset[ModeSequence] = frozenset()
    _bounds: dict[Whole, SequenceBound] = field(default_factory=dict)
    _tight: dict[Whole, float] = field(default_factory=dict)

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
        charge(Cost.NETWORK, len(leaf))
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
