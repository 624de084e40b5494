"""The tree of mode sequences that branch and bound searches.

Sequences are kept in a canonical form that loses nothing: a rigid phase opens every sequence that
starts solid and closes every sequence that must end solid (it may have zero length and then costs
nothing), and no phase repeats the mode before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, TypeVar

from twosra_mpc.planning.search.bends import (
    BendingTask,
    least_durations,
    passes_forbidden,
    unreachable_reason,
)
from twosra_mpc.planning.search.bounds import (
    SequenceBound,
    pose_bound,
    sequence_bound,
)
from twosra_mpc.planning.search.motion_bound import least_motion_s
from twosra_mpc.planning.search.parts import bound_by_parts
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, earliest_times, resting_s

_MOVING = 0.05  # share of a bound that lacks from which on it is asked how long plans move

Solution = TypeVar("Solution")
SequenceSolver = Callable[[TemporalNetwork, SequenceBound], Iterable[tuple[float, Solution] | None]]


class InTheWay:
    """What is in the robot's way: in free space, nothing."""

    def blocks(self, sequence: ModeSequence | None) -> str | None:
        """Why a complete sequence, or any if None, cannot be carried out, as far as is known."""
        del sequence
        return None

    def least_drives_s(self, sequence: ModeSequence) -> Sequence[float]:
        """Proved least duration of each phase of a complete sequence, for the ways to go [s]."""
        return [0.0] * len(sequence)


@dataclass
class ModeTree(Generic[Solution]):
    """Mode sequences as a search tree; a node is a sequence not yet closed by its last phase.

    Attributes:
        first: Stiffness at t = 0.
        last: Stiffness at the end.
        modes: Modes that may be used.
        max_phases: Longest sequence that is opened.
        timing: The transition model.
        task: What the bending coordinates must do.
        weights: Weights of the cost.
        rigid_time: Proved least duration of a plan that never melts anything [s]; more work is put
            into it where it is less than the argument, what is enough.
        solver: Yields attempts at a plan of one sequence, given its network and bound.
        excluded: Complete sequences that are not to be used.
        in_the_way: What is in the way; asked again and again, as more may be known the next time.
        unreachable: Filled by the search: why leaves were proved infeasible.
    """

    first: Mode
    last: Mode
    modes: Sequence[Mode]
    max_phases: int
    timing: TransitionModel
    task: BendingTask
    weights: Weights
    rigid_time: Callable[[float], float]
    solver: SequenceSolver[Solution]
    excluded: frozenset[ModeSequence] = frozenset()
    in_the_way: InTheWay = field(default_factory=InTheWay)
    unreachable: dict[ModeSequence, str] = field(default_factory=dict)
    _bounds: dict[ModeSequence, SequenceBound] = field(default_factory=dict)
    _motion_s: float | None = None  # least time in which every plan moves, once it is asked for

    @cached_property
    def rigid(self) -> Mode:
        """The mode in which every segment is solid."""
        return rigid_mode(len(self.first))

    def root(self) -> ModeSequence:
        """The opening rigid phase if the robot starts solid and may drive, else nothing."""
        return (self.rigid,) if self.first == self.rigid and self.rigid in self.modes else ()

    def leaf(self, node: ModeSequence) -> ModeSequence | None:
        """The complete sequence a node stands for, or None if another node stands for it."""
        rigid = self.rigid
        opening = node == (rigid,) and self.first == rigid
        if self.last == rigid and rigid in self.modes and not opening:
            return None if node and node[-1] == rigid else (*node, rigid)
        return node or None

    def bound(self, node: ModeSequence) -> float:
        """Transitions alone: every completion passes through the events of ``node``."""
        if (reason := self.in_the_way.blocks(None) or self._beyond_all_modes) is not None:
            self.unreachable[node] = reason
            return math.inf
        if not node:
            return 0.0
        if (reason := self.timing.refusal(node, self.rigid)) is not None:
            self.unreachable[node] = reason
            return math.inf
        missing = [j for j in self.task.segments if self._must_still_soften(node, j)]
        onward = self.timing.onward(node[-1], frozenset(missing), self._usable, self.last)
        if onward is not None:
            network = self.timing.network(node, node[-1], [0.0] * len(node))
            times = earliest_times(network)
            assert times is not None, "what is not refused has a schedule"
            return times[network.layout.finish] + self._fixed_cost(network) + onward
        least = self._least_time(node)
        for j in missing:
            first = [self._least_time((*node, mode)) for mode in self.modes if mode[j]]
            least = max(least, min(first, default=math.inf))
        return least + self._least_fixed_cost(node, missing)

    @cached_property
    def _beyond_all_modes(self) -> str | None:
        """Why no sequence of the modes brings about the bend, if none does."""
        return unreachable_reason((*self.root(), *self.modes), self.task)

    @cached_property
    def _usable(self) -> tuple[Mode, ...]:
        """The modes that the heaters can bring about."""
        return tuple(m for m in self.modes if self.timing.refusal((m,), self.rigid) is None)

    def _must_still_soften(self, node: ModeSequence, segment: int) -> bool:
        """Whether every completion of ``node`` melts a segment that was solid all the time."""
        solid = not self.first[segment] and not any(mode[segment] for mode in node)
        return solid and self.task.must_bend(segment)

    def _network(self, sequence: ModeSequence) -> TemporalNetwork:
        settled = self.last if self.last == self.rigid else sequence[-1]
        return self.timing.network(sequence, settled, [0.0] * len(sequence))

    def _least_time(self, sequence: ModeSequence) -> float:
        """Duration of the transitions of ``sequence``, which every completion has to make too.

        And of the motion of every plan, while none of them is on its plateau, if that is known.

        Completions of a node append phases. Those before the melt of a segment that was solid so
        far delay it, and the freeze after it; the other segment has to freeze in any case.
        """
        if self.timing.refusal(sequence, self.rigid) is not None:
            return math.inf
        network = self._network(sequence)
        times = earliest_times(network)
        if times is None:
            return math.inf
        least = times[network.layout.finish]
        return max(least, self._motion_s + resting_s(network)) if self._motion_s else least

    def _least_fixed_cost(self, node: ModeSequence, missing: list[int]) -> float:
        """Cost of the melts and freezes of ``node`` and of those that must still follow."""
        cost = self._fixed_cost(self._network(node))
        for j in missing:  # no melt of it came before: what it takes is that from t = 0
            mode = tuple(int(k == j) for k in self.task.segments)
            melt = self.timing.network((mode,), mode, [0.0])
            cost += self.weights.energy_s_per_J * melt.melt_energy_J
            cost += self.weights.transition_s * (1 + (self.last[j] == 0))
        return cost

    def _fixed_cost(self, network: TemporalNetwork) -> float:
        """Cost of melts and freezes besides the time they take."""
        energy = self.weights.energy_s_per_J * network.melt_energy_J
        return energy + self.weights.transition_s * network.transitions

    def children(self, node: ModeSequence) -> list[ModeSequence]:
        """Append every other allowed mode."""
        return [(*node, mode) for mode in self.modes if not node or mode != node[-1]]

    def too_deep(self, node: ModeSequence) -> bool:
        """Whether the leaf of ``node``, or of its shortest child, exceeds ``max_phases``."""
        return len(self.leaf(node) or node) > self.max_phases

    def leaf_bound(self, node: ModeSequence) -> float:
        """Optimum of the relaxation of the complete sequence."""
        leaf = self.leaf(node)
        if leaf is None or len(leaf) > self.max_phases or leaf in self.excluded:
            return math.inf
        reason = self.in_the_way.blocks(leaf) or unreachable_reason(leaf, self.task)
        if reason is not None:
            self.unreachable[leaf] = reason
            return math.inf
        if (reason := self.timing.refusal(leaf, self.last)) is not None:
            self.unreachable[leaf] = reason
            return math.inf
        bound = self._bounds.get(leaf) or self._relaxed(leaf)
        if bound is None or bound.cost == math.inf:
            self.unreachable[leaf] = (
                f"{sequence_name(leaf)} cannot reach this shape within the shape limits"
            )
            return math.inf
        self._bounds[leaf] = bound
        if self._only_drives(leaf):
            return max(bound.cost, self.rigid_time(0.0))
        pose = self.task.pose
        if self._motion_s is None and pose is not None and pose.known_s > bound.cost:
            self._motion_s = least_motion_s(self.task, self.modes)  # driving outlasts the metal
        return max(bound.cost, self.bound(node)) if self._motion_s else bound.cost

    def _relaxed(self, leaf: ModeSequence) -> SequenceBound | None:
        durations = least_durations(leaf, self.task)
        if not all(map(math.isfinite, durations)):
            return None
        network = self.timing.network(leaf, self.last, durations)
        return sequence_bound(network, self.task, self.weights, durations)

    def _only_drives(self, leaf: ModeSequence) -> bool:
        """Whether plans of this sequence never melt anything."""
        return self.first == self.last == self.rigid and not any(map(any, leaf))

    def tighter_bound(self, node: ModeSequence, enough: float) -> float:
        """Raise the leaf bound by the time the change of pose takes, or by what blocks it."""
        leaf = self.leaf(node)
        if leaf is None:
            return -math.inf
        if (reason := self.in_the_way.blocks(leaf)) is not None:
            self.unreachable[leaf] = reason
            return math.inf
        durations, drives_s = least_durations(leaf, self.task), self.in_the_way.least_drives_s(leaf)
        longer = [max(pair) for pair in zip(durations, drives_s, strict=True)]
        network = self.timing.network(leaf, self.last, longer)
        delayed = self.timing.with_delays(network, longer)
        bound = self.bound(node) if self._motion_s else -math.inf
        if self._only_drives(leaf):
            bound = max(bound, self.rigid_time(enough))
        if bound < enough:
            bound = max(bound, self._by_parts(leaf, delayed, longer, enough))
        if bound < enough:
            bound = max(bound, pose_bound(delayed, self.task, self.weights, longer, enough))
        far = max(bound, self._bounds[leaf].cost) < (1 - _MOVING) * enough
        if self._motion_s is None and far and any(map(any, leaf)):
            self._motion_s = least_motion_s(self.task, self.modes)
            bound = max(bound, self.bound(node))
        if any(drives_s):
            relaxed = sequence_bound(network, self.task, self.weights, longer)
            bound = max(bound, math.inf if relaxed is None else relaxed.cost)
        return bound

    def _by_parts(
        self, leaf: ModeSequence, network: TemporalNetwork, known_s: Sequence[float], enough: float
    ) -> float:
        """What is proved of all parts of what a sequence may do.

        Its bound takes that over, and the bends, where its own pass a forbidden shape.
        """
        found = bound_by_parts(network, self.task, self.weights, known_s, enough)
        if found is None:
            return -math.inf
        known = self._bounds[leaf]
        bends = found.bends if passes_forbidden(leaf, self.task, known.bends) else known.bends
        self._bounds[leaf] = replace(known, cost=max(found.cost, known.cost), bends=bends)
        return found.cost

    def solve(self, node: ModeSequence) -> Iterator[tuple[float, Solution] | None]:
        """Hand the complete sequence to the fixed-sequence solver.

        Where its first attempt fails because the bound's bends pass a forbidden shape, again with
        others; after another failure, as by then another leaf may have the least bound.
        """
        leaf = self.leaf(node)
        if leaf is None:
            return
        least_s, known = [0.0] * len(leaf), self._bounds[leaf]
        network = self.timing.network(leaf, self.last, least_s)
        attempts = iter(self.solver(network, known))
        first = next(attempts, None)
        yield first
        if first is None and passes_forbidden(leaf, self.task, known.bends):
            if self._bounds[leaf] is known:
                self._by_parts(leaf, network, least_s, math.inf)
                yield None
            attempts = iter(self.solver(network, self._bounds[leaf]))
        yield from attempts
