"""The tree of mode sequences of missions: stage after stage, in one temporal network.

A node is a variant of the mission with the mode sequences of its first stages; its children add one
for the next stage. A stage's sequence begins with a drive where the robot is solid and may drive,
ends in the stiffness that the stage asks for, and no phase repeats the mode before it; the same
mode may follow across the end of a stage.

What a node's stages take is a longest path through the network of their sequences. Stages that are
still to come take no less than alone, whatever came before: as all segments can be as warm as they
ever get, that is the least over their sequences of the longest path from the end of the stage
before, with no heating to wait for. Both add up, as every plan passes through that end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, TypeVar

from twosra_mpc.planning.search.bends import (
    BendingTask,
    Intervals,
    least_durations,
    unreachable_reason,
)
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.mission_bound import MissionRelaxation, StageEnd, mission_bound
from twosra_mpc.planning.search.schedule import with_durations
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid, rigid_mode, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, earliest_times

Solution = TypeVar("Solution")

_LATE_S = 1e6  # later than anything that happens before a stage
_MOST_PHASES = 5  # of a stage


@dataclass(frozen=True, eq=False)
class StageTask:
    """What the search must know of a stage.

    Attributes:
        change: (low, high) of each segment: change of W since t = 0 where the stage ends.
        bend: What its modes must do where the shapes at both of its ends are known exactly.
        modes: Modes that it may use.
        last: Stiffness at its end; None: any.
        drives_first: Whether it may begin with a drive.
        drives_last: Whether it may drive after its last soft phase.
        distance_m: How far b0 must come in it, at least.
        rigid_s: Least duration where nothing bends in it.
        reshapes: Whether it is proved that it must reshape.
    """

    change: Intervals
    bend: BendingTask | None
    modes: tuple[Mode, ...]
    last: Mode | None
    drives_first: bool = True
    drives_last: bool = True
    distance_m: float = 0.0
    rigid_s: float = 0.0
    reshapes: bool = False
    _durations: dict[ModeSequence, list[float]] = field(default_factory=dict)

    def sequences(self, begins: Mode, most_phases: int) -> Iterator[ModeSequence]:
        """Yield every sequence of up to so many phases from a stiffness on."""
        rigid = rigid_mode(len(begins))
        drives = self.drives_first and rigid in self.modes
        heads: list[ModeSequence] = [()] if any(begins) or not drives else [(rigid,)]
        for length in range(most_phases + 1):
            heads = heads if not length else list(self._longer(heads, begins))
            for head in heads:
                whole = self._closed(head, rigid)
                if whole and len(whole) <= most_phases and self._fits(whole):
                    yield whole

    def _longer(self, heads: Sequence[ModeSequence], begins: Mode) -> Iterator[ModeSequence]:
        for head in heads:
            for mode in self.modes:
                stays = mode == head[-1] if head else not any(begins) and is_rigid(mode)
                if not stays:
                    yield (*head, mode)

    def _closed(self, head: ModeSequence, rigid: Mode) -> ModeSequence | None:
        """The sequence that ends as the stage asks for; None if another head stands for it."""
        if self.last is None:
            return head
        if self.last == rigid:
            if head == (rigid,):
                return head
            return None if head and head[-1] == rigid else (*head, rigid)
        return head if head and head[-1] == self.last else None

    def _fits(self, sequence: ModeSequence) -> bool:
        if self.reshapes and not any(map(any, sequence)):
            return False
        return self.bend is None or unreachable_reason(sequence, self.bend) is None

    def durations(self, sequence: ModeSequence) -> list[float]:
        """Proved least duration of each phase of a sequence; worked out once."""
        if sequence not in self._durations:
            self._durations[sequence] = self._least_durations(sequence)
        return self._durations[sequence]

    def _least_durations(self, sequence: ModeSequence) -> list[float]:
        found = [0.0] * len(sequence)
        if self.bend is not None:
            found = list(least_durations(sequence, self.bend))
        if len(sequence) == 1 and is_rigid(sequence[0]):
            found[0] = max(found[0], self.rigid_s)
        return found


class Node(NamedTuple):
    """A variant of the mission (-1: none chosen), and the sequences of its first stages.

    ``beyond`` stands for all that goes on with longer sequences than are opened.
    """

    variant: int
    sequences: tuple[ModeSequence, ...] = ()
    beyond: bool = False

    @property
    def joined(self) -> ModeSequence:
        """All phases."""
        return tuple(itertools.chain.from_iterable(self.sequences))


MissionSolver = Callable[
    [TemporalNetwork, SequenceBound, Node], Iterable[tuple[float, Solution] | None]
]


@dataclass
class MissionTree(Generic[Solution]):
    """Missions as a search tree.

    Attributes:
        variants: The stages of every variant.
        first: Stiffness at t = 0.
        timing: The transition model.
        weights: Weights of the cost.
        relaxation: Rates and room of the bending coordinates.
        solver: Yields attempts at a plan of a complete node, given its network and bound.
        unreachable: Filled by the search: why nodes were proved infeasible.
    """

    variants: Sequence[Sequence[StageTask]]
    first: Mode
    timing: TransitionModel
    weights: Weights
    relaxation: MissionRelaxation
    solver: MissionSolver[Solution]
    unreachable: dict[Node, str] = field(default_factory=dict)
    _bounds: dict[Node, SequenceBound] = field(default_factory=dict)
    _alone: dict[tuple[int, Mode], float] = field(default_factory=dict)
    _further: dict[tuple[int, Mode], float] = field(default_factory=dict)

    def root(self) -> Node:
        """No variant chosen."""
        return Node(-1)

    def bound(self, node: Node) -> float:
        """What the stages of a node take, and those to come at least."""
        if node.variant < 0:
            return 0.0
        stages, joined = self.variants[node.variant], node.joined
        done = len(node.sequences)
        cost = 0.0
        if joined:
            network = self.network(node)
            durations = self._durations(node)
            if not all(map(math.isfinite, durations)):
                self.unreachable[node] = "a stage must pass shapes that are forbidden"
                return math.inf
            if (reason := self.timing.refusal(joined, network.last)) is not None:
                self.unreachable[node] = reason
                return math.inf
            times = earliest_times(with_durations(network, durations))
            if times is None:
                return math.inf
            cost = times[network.layout.finish]
            cost += self.weights.energy_s_per_J * network.melt_energy_J
            cost += self.weights.transition_s * network.transitions
        begins = self._ends(node)
        if node.beyond:
            cost += min(self._beyond(stages[done], mode) for mode in begins)
            begins, done = self._after(stages[done]), done + 1
        for stage in stages[done:]:
            cost += min(self._least(stage, mode) for mode in begins)
            begins = self._after(stage)
        return cost

    def children(self, node: Node) -> list[Node]:
        """The variants, or the next stage with each of its sequences."""
        if node.variant < 0:
            return [Node(variant) for variant in range(len(self.variants))]
        stages = self.variants[node.variant]
        if len(node.sequences) == len(stages):
            return []
        stage, (begins,) = stages[len(node.sequences)], self._ends(node)
        found = [
            Node(node.variant, (*node.sequences, sequence))
            for sequence in stage.sequences(begins, _MOST_PHASES)
        ]
        return [*found, node._replace(beyond=True)]

    def too_deep(self, node: Node) -> bool:
        """Whether it stands for sequences longer than are opened."""
        return node.beyond

    def leaf_bound(self, node: Node) -> float:
        """Optimum of the relaxation of a complete mission."""
        if node.variant < 0 or len(node.sequences) < len(self.variants[node.variant]):
            return math.inf
        stages = self.variants[node.variant]
        ends = list(itertools.accumulate(map(len, node.sequences)))
        bound = mission_bound(
            self.network(node),
            self.relaxation,
            self.weights,
            self._durations(node),
            [
                StageEnd(end, stage.change, stage.distance_m)
                for end, stage in zip(ends, stages, strict=True)
            ],
        )
        if bound is None:
            name = sequence_name(node.joined)
            self.unreachable[node] = f"{name} cannot reach these shapes within the shape limits"
            return math.inf
        self._bounds[node] = bound
        return bound.cost

    def tighter_bound(self, node: Node, enough: float) -> float:
        """Nothing more is known."""
        del node, enough
        return -math.inf

    def solve(self, node: Node) -> Iterable[tuple[float, Solution] | None]:
        """Hand a complete mission to the solver."""
        return self.solver(self.network(node), self._bounds[node], node)

    def network(self, node: Node) -> TemporalNetwork:
        """The temporal network of all phases so far."""
        (last,) = self._ends(node)
        joined = node.joined
        return self.timing.network(joined, last, [0.0] * len(joined))

    def _durations(self, node: Node) -> list[float]:
        stages = self.variants[node.variant]
        pairs = zip(stages, node.sequences, strict=False)
        return [time for stage, sequence in pairs for time in stage.durations(sequence)]

    def _ends(self, node: Node) -> tuple[Mode, ...]:
        """Stiffness where the next stage begins."""
        return (node.joined[-1] if node.sequences else self.first,)

    def _after(self, stage: StageTask) -> tuple[Mode, ...]:
        """Stiffnesses in which a stage may end."""
        return stage.modes if stage.last is None else (stage.last,)

    def _least(self, stage: StageTask, begins: Mode) -> float:
        """What a stage adds at least, whatever came before it."""
        key = (id(stage), begins)
        if key not in self._alone:
            whole = (
                self._from_warm(begins, sequence, stage.durations(sequence))
                for sequence in stage.sequences(begins, _MOST_PHASES)
            )
            self._alone[key] = min(min(whole, default=math.inf), self._beyond(stage, begins))
        return self._alone[key]

    def _beyond(self, stage: StageTask, begins: Mode) -> float:
        """What a stage adds at least with sequences longer than are opened."""
        key = (id(stage), begins)
        if key not in self._further:
            self._further[key] = self._least_prefix(stage, begins)
        return self._further[key]

    def _least_prefix(self, stage: StageTask, begins: Mode) -> float:
        """Least time of what every longer sequence begins with, by depth first search."""
        rigid, best = rigid_mode(len(begins)), math.inf
        first: ModeSequence = (rigid,) if stage.drives_first and not any(begins) else ()
        heads = [(first, 0.0)]
        while heads:
            head, least = heads.pop()
            if least >= best:
                continue
            if len(head) == _MOST_PHASES:
                best = least
                continue
            longer = [
                (mode_head, self._from_warm(begins, mode_head, [0.0] * len(mode_head)))
                for mode_head in stage._longer([head], begins)
            ]
            heads += sorted(longer, key=lambda each: -each[1])
        return best

    def _from_warm(self, begins: Mode, sequence: ModeSequence, durations: list[float]) -> float:
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
        network = self.timing.network(whole, sequence[-1], [0.0] * len(whole))
        begin = network.layout.origin, network.layout.end(len(before) - 1)
        late = replace(network, least={**network.least, begin: _LATE_S})
        times = earliest_times(with_durations(late, lasting))
        if times is None:
            return math.inf
        return times[network.layout.finish] - _LATE_S
