"""The tree of mode sequences that branch and bound searches, and the bounds of its leaves.

A leaf has a sequence of every stage: its bound is their relaxation, raised by what the pose of the
first stage adds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from twosra_mpc.planning.bounds.bends import free_bends, passes_forbidden
from twosra_mpc.planning.bounds.detours import COARSE, FINE, Detours
from twosra_mpc.planning.bounds.motion_bound import least_motion_s
from twosra_mpc.planning.bounds.parts import bound_by_parts
from twosra_mpc.planning.bounds.sequence_bound import (
    Events,
    SequenceBound,
    pose_bound,
)
from twosra_mpc.planning.bounds.stage_bounds import StageBounds, StageRelaxation, Together, Way
from twosra_mpc.planning.search.nodes import InTheWay, Node, Stages, Whole
from twosra_mpc.planning.search.stage_costs import NOTHING_YET, Alone, Past, SoFar, ToGo
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, resting_s

_MANY = 16  # leaves that are bounded without asking how long plans move
_RESTING = 0.9  # share of a bound in which nothing moves, from which on that is of no use


@dataclass
class Leaves:
    """Bounds of sequences of all stages, and what was learnt of them.

    Attributes:
        variants: The stages of every variant.
        so_far: Bounds of what comes first.
        relaxation: Rates and room of the bending coordinates.
        all_modes: Of the first stage.
        bounds: Of sequences of all stages, as far as they were asked for.
        motion_s: Least time in which plans move whose first stage has no other modes [s], once it
            is asked for.
        detours: Of variants of which the bends of a bound have passed a forbidden shape.
    """

    variants: Sequence[Stages]
    so_far: SoFar
    relaxation: StageRelaxation
    all_modes: frozenset[Mode]
    bounds: dict[Whole, SequenceBound] = field(default_factory=dict)
    motion_s: dict[frozenset[Mode], float] = field(default_factory=dict)
    detours: dict[int, Detours] = field(default_factory=dict)
    _first: dict[tuple[int, tuple[ModeSequence, ...]], tuple[float, SequenceBound | None]] = field(
        default_factory=dict
    )

    def relaxed(self, whole: Whole) -> SequenceBound | None:
        """Optimum of the relaxation of all stages; None if it is infeasible."""
        if whole not in self.bounds:
            found = self._lasting(whole, self.so_far.durations(whole))
            if found is None:
                return None
            self.bounds[whole] = found
        return self.bounds[whole]

    def last(self, whole: Whole) -> Mode:
        """Stiffness at the end of a sequence of every stage."""
        return self.variants[whole.variant][-1].settled(whole.sequences[-1])

    def _lasting(self, whole: Whole, durations: Sequence[float]) -> SequenceBound | None:
        """The same with these least durations of the phases [s]."""
        if not all(map(math.isfinite, durations)):
            return None
        network = self.so_far.network(whole, self.last(whole), durations)
        events = Events(network, self.so_far.weights, durations)
        stages = self.variants[whole.variant]
        return Together(events, stages, whole.sequences, self.relaxation).bound()

    def tighter(
        self, whole: Whole, drives_s: Sequence[Sequence[float]], bound: float, enough: float
    ) -> float:
        """Another bound, with more effort: of the drives, and of the motion of the first stage.

        Args:
            whole: The sequences.
            drives_s: Least durations of each stage's phases by what is in the way [s].
            bound: One that is known.
            enough: One that need not be exceeded.
        """
        longer = self._drives(whole, drives_s, enough)
        if any(longer):
            durations = map(max, self.so_far.durations(whole), longer)
            relaxed = self._lasting(whole, list(durations))
            bound = max(bound, math.inf if relaxed is None else relaxed.cost)
        if bound >= enough:
            return bound
        later = self._later(whole)
        return max(bound, self._by_motion(whole, drives_s[0], enough - later) + later)

    def _later(self, whole: Whole) -> float:
        """What all stages but the first add at least."""
        stages, cost = self.variants[whole.variant], self.so_far.to_go.alone.cost
        ends = [sequence[-1] for sequence in whole.sequences]
        return sum(map(cost, stages[1:], ends, whole.sequences[1:]))

    def _drives(
        self, whole: Whole, drives_s: Sequence[Sequence[float]], enough: float
    ) -> list[float]:
        """Least durations of drives, those of stages that are nothing else with more effort [s]."""
        triples = zip(self.variants[whole.variant], whole.sequences, drives_s, strict=True)
        return [
            max(least_s, stage.drive(enough)) if sequence == (stage.rigid,) else least_s
            for stage, sequence, own_s in triples
            for least_s in own_s
        ]

    def _by_motion(self, whole: Whole, drives_s: Sequence[float], enough: float) -> float:
        """Bound of the first stage by parts of what it may do, and by its pose."""
        stage, sequence = self.variants[whole.variant][0], whole.sequences[0]
        if (task := stage.bend) is None:
            return -math.inf
        first = whole.sequences[:1]
        if (whole.variant, first) not in self._first:
            delayed = self._delayed(stage, sequence, drives_s)
            parts = bound_by_parts(delayed, task, enough)
            cost = -math.inf if parts is None else parts.cost
            if cost < enough:
                cost = max(cost, pose_bound(delayed, task, enough))
            self._first[whole.variant, first] = cost, parts
        cost, parts = self._first[whole.variant, first]
        self._take_over(whole, parts)
        return cost

    def _delayed(
        self, stage: StageBounds, sequence: ModeSequence, drives_s: Sequence[float]
    ) -> Events:
        """Events of the first stage by itself."""
        least_s = self.so_far.to_go.alone.durations(stage, sequence)
        longer, timing = list(map(max, least_s, drives_s)), self.so_far.timing
        network = timing.network(sequence, stage.settled(sequence), longer)
        return Events(timing.with_delays(network, longer), self.so_far.weights, longer)

    def first_is_forbidden(self, whole: Whole) -> bool:
        """True if the bends of the first stage's bound pass a forbidden shape."""
        task, first = self.variants[whole.variant][0].bend, whole.sequences[0]
        return task is not None and passes_forbidden(
            first, task, self.bounds[whole].bends[: len(first)]
        )

    def no_way(self, whole: Whole) -> bool:
        """True if it is known that every way of the first stage passes a forbidden shape."""
        return self.detours[whole.variant].none(whole.sequences[0])

    def bend_otherwise(self, whole: Whole, fineness: int) -> None:
        """Look for other bends of the first stage; where that is done on a plane, so finely."""
        stage, sequence = self.variants[whole.variant][0], whole.sequences[0]
        assert stage.bend is not None, "only then it is known what they pass"
        task = stage.bend
        if task.plane is not None and free_bends(sequence, task):
            if whole.variant not in self.detours:
                w, off = np.array(task.origin), np.array(task.origin_within or (0.0, 0.0))
                ends = np.array([w - off, w + off]), w + np.array(task.met).T
                self.detours[whole.variant] = Detours(task.plane, *ends)
            bends = self.detours[whole.variant].bends(sequence, fineness)
            if bends is not None:
                known = self.bounds[whole]
                bends = np.concatenate([bends, known.bends[len(sequence) :]])
                self.bounds[whole] = replace(known, bends=bends, detour=True)
            return
        least_s = [0.0] * len(sequence)
        network = self.so_far.timing.network(sequence, stage.settled(sequence), least_s)
        parts = bound_by_parts(Events(network, self.so_far.weights, least_s), task, math.inf)
        self._take_over(whole, parts)

    def _take_over(self, whole: Whole, parts: SequenceBound | None) -> None:
        """Know what all parts of the first stage prove, and bends where its own are forbidden."""
        if parts is None:
            return
        known = self.bounds[whole]
        bends = known.bends
        if self.first_is_forbidden(whole):
            bends = np.concatenate([parts.bends, bends[len(parts.bends) :]])
        self.bounds[whole] = replace(known, cost=max(parts.cost, known.cost), bends=bends)

    def look_at_motion(self, whole: Whole) -> None:
        """Work out how long every plan moves where driving, or bending, outlasts the metal."""
        task = self.variants[whole.variant][0].bend
        if task is None or task.pose is None or not any(map(any, whole.joined)):
            return
        lasts_s, cost = self.so_far.durations(whole), self.bounds[whole].cost
        asked = max(task.pose.known_s, 2 * sum(lasts_s)) > cost
        if not asked and len(self.bounds) > _MANY:
            network = self.so_far.network(whole, self.last(whole), lasts_s)
            asked = resting_s(network) < _RESTING * cost
        if asked:
            self.ask_motion(whole, self.all_modes)

    def moves_s(self, modes: frozenset[Mode]) -> float:
        """Least time in which plans move whose first stage has no other modes; 0 if not known."""
        return max((s for known, s in self.motion_s.items() if known >= modes), default=0.0)

    def ask_motion(self, whole: Whole, modes: frozenset[Mode]) -> bool:
        """Work out how long plans with these modes move; whether that is known now.

        It is where there is but one variant, in the first stage, whose start is known.
        """
        stage = self.variants[whole.variant][0]
        if stage.bend is None or len(self.variants) > 1:
            return False
        if modes not in self.motion_s:
            self.motion_s[modes] = least_motion_s(stage.bend, sorted(modes))
        return True


Solution = TypeVar("Solution")

_MOVING = 0.05  # share of a bound that lacks from which on it is asked how long plans move

Solver = Callable[[TemporalNetwork, SequenceBound, Whole], Iterable[tuple[float, Solution] | None]]


def tree_of(
    variants: Sequence[Stages],
    first: StartingStiffness,
    timing: TransitionModel,
    weights: Weights,
    relaxation: StageRelaxation,
    solver: Solver[Solution],
    *,
    in_the_way: Sequence[Sequence[InTheWay]] | None = None,
    excluded: Container[ModeSequence] = (),
) -> Tree[Solution]:
    """Build the tree of the stages of variants.

    Args:
        variants: The stages of every variant.
        first: Stiffness at t = 0.
        timing: The transition model.
        weights: Weights of the cost.
        relaxation: Rates and room of the bending coordinates.
        solver: Makes plans of one sequence of each stage.
        in_the_way: What is in the way of each stage of every variant; nothing if left out.
        excluded: Sequences that are not to be used.
    """
    if in_the_way is None:
        in_the_way = [[InTheWay()] * len(stages) for stages in variants]
    to_go = ToGo(variants, Alone(timing), relaxation.soft_travel_m)
    so_far = SoFar(variants, first, timing, weights, to_go)
    leaves = Leaves(variants, so_far, relaxation, frozenset(variants[0][0].modes))
    return Tree(variants, first, leaves, solver, in_the_way, excluded)


@dataclass
class Tree(Generic[Solution]):
    """Stages as a search tree.

    Attributes:
        variants: The stages of every variant.
        first: Stiffness at t = 0.
        leaves: Bounds of stages, and of sequences of all of them.
        solver: Yields attempts at a plan of all stages, given their network and bound.
        in_the_way: What is in the way of each stage of every variant.
        excluded: Complete sequences that are not to be used.
        unreachable: Filled by the search: why sequences were proved infeasible.
    """

    variants: Sequence[Stages]
    first: StartingStiffness
    leaves: Leaves
    solver: Solver[Solution]
    in_the_way: Sequence[Sequence[InTheWay]]
    excluded: Container[ModeSequence] = ()
    unreachable: dict[ModeSequence, str] = field(default_factory=dict)

    def everywhere(self, ask: Callable[[StageBounds, InTheWay], str | None]) -> str | None:
        """Reason why a stage of each variant is impossible: that of the first; None if not all."""
        both = zip(self.variants, self.in_the_way, strict=True)
        found = [next(filter(None, map(ask, *each)), None) for each in both]
        return found[0] if all(found) else None

    def root(self) -> Node:
        """No variant chosen, unless there is but one."""
        return Node(-1) if len(self.variants) > 1 else self.opened(0, ())

    def opened(self, variant: int, sequences: tuple[ModeSequence, ...]) -> Node:
        """The node where the next stage begins, if there is one."""
        stages = self.variants[variant]
        if len(sequences) == len(stages):
            return Node(variant, sequences)
        begins = sequences[-1][-1] if sequences else self.first
        return Node(variant, sequences, stages[len(sequences)].opening(begins))

    def open_stage(self, node: Node) -> tuple[StageBounds, StartingStiffness] | None:
        """The stage that is open, and the stiffness in which it begins; None: all are over."""
        stages = self.variants[node.variant]
        if len(node.sequences) == len(stages):
            return None
        begins = node.sequences[-1][-1] if node.sequences else self.first
        return stages[len(node.sequences)], begins

    def children(self, node: Node) -> list[Node]:
        """The variants, or one more mode, or the next stage."""
        if node.variant < 0:
            return [self.opened(variant, ()) for variant in range(len(self.variants))]
        if (opened := self.open_stage(node)) is None:
            return []
        stage, begins = opened
        found = [Node(*node[:2], head) for head in stage.longer(node.head, begins)]
        closed = None if stage.final else stage.closed(node.head, begins)
        if closed and len(closed) <= stage.most_phases and stage.misfit(closed) is None:
            found.insert(0, self.opened(node.variant, (*node.sequences, closed)))
        return found

    def leaps(self, node: Node, most: int) -> list[Node]:
        """The variants, or the stage that is open with each of its first sequences, short first."""
        if node.variant < 0:
            return self.children(node)
        if (opened := self.open_stage(node)) is None:
            return []
        sequences = itertools.islice(opened[0].sequences(opened[1]), most)
        return [self.opened(node.variant, (*node.sequences, each)) for each in sequences]

    def too_deep(self, node: Node) -> bool:
        """True if the open stage, or its shortest child, has more phases than are opened."""
        if node.variant < 0 or (opened := self.open_stage(node)) is None:
            return False
        stage, begins = opened
        if len(node.head) < stage.most_phases:  # one more closes it
            return False
        return len(stage.closed(node.head, begins) or node.head) > stage.most_phases

    def whole(self, node: Node) -> Whole | None:
        """The sequences of all stages a node stands for; None if another node stands for them."""
        if node.variant < 0:
            return None
        if (opened := self.open_stage(node)) is None:
            return Whole(*node[:2])
        stage, begins = opened
        last = stage.closed(node.head, begins) if stage.final else None
        return None if last is None else Whole(node.variant, (*node.sequences, last))

    def bound(self, node: Node) -> float:
        """Every completion passes through the events of ``node``; what comes then takes longer."""
        if node.variant < 0:
            return 0.0
        past = self._past(Whole(*node[:2])) if node.sequences else NOTHING_YET
        if past.cost == math.inf or (opened := self.open_stage(node)) is None:
            return past.cost
        stage, begins = opened
        whole, done = (*past.phases, *node.head), len(node.sequences)
        reason = self.in_the_way[node.variant][done].blocks(None)
        if (reason := reason or stage.unreachable(frozenset(stage.modes))) is not None:
            return self._infeasible(whole, reason)
        to_go = self.leaves.so_far.to_go
        if done and node.head == stage.opening(begins):
            shapes = self.leaves.so_far.shapes(Whole(*node[:2]))
            assert shapes is not None, "else what is over were impossible"
            begun = past.phases[-1], self._way(node), shapes
            return past.cost + to_go.least(node.variant, done, *begun)
        if not node.head:
            return past.cost
        if (reason := self.leaves.so_far.timing.refusal(whole, stage.rigid)) is not None:
            return self._infeasible(whole, reason)
        moves_s = self.leaves.motion_s.get(self.leaves.all_modes)
        least = self.leaves.so_far.least(stage, whole, past.durations, moves_s)
        return least + to_go.after(node.variant, done + 1)

    def _past(self, over: Whole) -> Past:
        """What stages that are over take, by what is known so far of what is in their way."""
        past = self.leaves.so_far.past(over)
        reason = past.reason or self._blocked(over)
        return past if reason is None else Past(self._infeasible(over.joined, reason))

    def _blocked(self, over: Whole) -> str | None:
        """What is in the way of one of these sequences, as far as it is known."""
        pairs = zip(self.in_the_way[over.variant], over.sequences, strict=False)
        return next(filter(None, (way.blocks(sequence) for way, sequence in pairs)), None)

    def _infeasible(self, sequence: ModeSequence, reason: str) -> float:
        self.unreachable[sequence] = reason
        return math.inf

    def _way(self, node: Node) -> Way:
        """What has moved since the last end of a stage whose place is known."""
        done, stages = len(node.sequences), self.variants[node.variant]
        since = done - stages[done].since + 1
        return Way().then(node.sequences[since:], stages[since:])

    def leaf_bound(self, node: Node) -> float:
        """Optimum of the relaxation of all stages."""
        whole = self.whole(node)
        if whole is None or self.too_deep(node) or whole.joined in self.excluded:
            return math.inf
        leaf, so_far = whole.joined, self.leaves.so_far
        if whole.variant in self.leaves.detours and self.leaves.no_way(whole):
            words = f"{sequence_name(leaf)} cannot get past shapes that are forbidden"
            return self._infeasible(leaf, words)
        reason = so_far.timing.refusal(leaf, self.leaves.last(whole))
        if (reason := reason or so_far.impossible(whole) or self._blocked(whole)) is not None:
            return self._infeasible(leaf, reason)
        bound = self.leaves.relaxed(whole)
        if bound is None or bound.cost == math.inf:
            words = f"{sequence_name(leaf)} cannot reach this shape within the shape limits"
            return self._infeasible(leaf, words)
        self.leaves.look_at_motion(whole)
        return max(bound.cost, self.bound(node)) if self.leaves.motion_s else bound.cost

    def tighter_bound(self, node: Node, enough: float) -> float:
        """Raise the leaf bound by the time the change of pose takes, or by what blocks it."""
        whole = self.whole(node)
        if whole is None:
            return -math.inf
        drives_s = list[list[float]]()
        for way, sequence in zip(self.in_the_way[whole.variant], whole.sequences, strict=True):
            if (reason := way.blocks(sequence)) is not None:
                return self._infeasible(whole.joined, reason)
            drives_s.append(list(way.least_drives_s(sequence)))
        bound = self.bound(node) if self.leaves.motion_s else -math.inf
        bound = self.leaves.tighter(whole, drives_s, bound, enough)
        lacks = max(bound, self.leaves.bounds[whole].cost) < (1 - _MOVING) * enough
        if lacks and any(map(any, whole.joined)):
            self.leaves.ask_motion(whole, self.leaves.all_modes)
            bound = max(bound, self.bound(node))
        return bound

    def solve(self, node: Node) -> Iterator[tuple[float, Solution] | None]:
        """Hand the sequences of all stages to the solver.

        Where its first attempt fails because the bound's bends pass a forbidden shape, again with
        others; after another failure, as by then another leaf may have the least bound. Where it
        is known before that they may, with others at once; at last with those found by fine cells.
        """
        whole, leaves = self.whole(node), self.leaves
        if whole is None:
            return
        if whole.variant in leaves.detours:
            if leaves.no_way(whole):
                return
            if leaves.first_is_forbidden(whole):
                leaves.bend_otherwise(whole, COARSE)
        known, begins = leaves.bounds[whole], [0.0] * len(whole.joined)
        network = leaves.so_far.network(whole, leaves.last(whole), begins)
        attempts = iter(self.solver(network, known, whole))
        first = next(attempts, None)
        yield first
        if first is None and not known.detour and leaves.first_is_forbidden(whole):
            if leaves.bounds[whole] is known:
                leaves.bend_otherwise(whole, COARSE)
            known = leaves.bounds[whole]
            attempts = iter(self.solver(network, known, whole))
            first = next(attempts, None)
            yield first
        if first is None and known.detour and len(whole.sequences) == 1:
            yield None
            leaves.bend_otherwise(whole, FINE)
            yield None
            attempts = iter(self.solver(network, leaves.bounds[whole], whole))
        yield from attempts
