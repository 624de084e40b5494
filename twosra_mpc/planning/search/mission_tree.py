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
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, TypeVar

from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.mission_bound import (
    MissionRelaxation,
    StageEnd,
    mission_bound,
    reachable,
)
from twosra_mpc.planning.search.schedule import with_durations
from twosra_mpc.planning.search.stage_task import StageTask, Way
from twosra_mpc.problem.problem import Weights
from twosra_mpc.robot.modes import Mode, ModeSequence, rigid_mode, sequence_name
from twosra_mpc.timing import TemporalNetwork, TransitionModel, earliest_times

Solution = TypeVar("Solution")

_LATE_S = 1e6  # later than anything that happens before a stage


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
    _alone: dict[tuple[Hashable, Mode, ModeSequence], float] = field(default_factory=dict)
    _rest: dict[tuple[int, int, Mode, Way], float] = field(default_factory=dict)
    _known: dict[tuple[Hashable, ModeSequence], list[float]] = field(default_factory=dict)
    _bending: dict[tuple[int, tuple[ModeSequence, ...]], bool] = field(default_factory=dict)
    _further: dict[tuple[Hashable, Mode], float] = field(default_factory=dict)

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
        if not self._bends(node):
            self.unreachable[node] = f"{sequence_name(joined)} cannot bend as the tasks ask"
            return math.inf
        if self._stranded(node):
            self.unreachable[node] = "without a drive it does not come so far"
            return math.inf
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
        (begins,) = self._ends(node)
        if node.beyond:
            return cost + self._beyond_and_on(node.variant, done, begins)
        here = stages[done].since if done < len(stages) else 1
        so_far = Way().then(node.sequences[done - here + 1 :], stages[done - here + 1 :])
        return cost + self._to_go(node.variant, done, begins, so_far)

    def _to_go(self, variant: int, done: int, begins: Mode, way: Way) -> float:
        """What the stages from a number on add at least, whatever came before.

        ``way`` is what has moved since the last end of a stage whose place is known.
        """
        stages = self.variants[variant]
        if done == len(stages):
            return 0.0
        key = (variant, done, begins, way)
        if key not in self._rest:
            stage, best = stages[done], self._beyond_and_on(variant, done, begins)
            known = done + 1 == len(stages) or stages[done + 1].since == 1
            for sequence in stage.sequences(begins):
                least = self._alone_s(stage, begins, sequence)
                after = way.then([sequence], [stage])
                if least < best and not self._too_far(stage, after):
                    after = Way() if known else after
                    best = min(best, least + self._to_go(variant, done + 1, sequence[-1], after))
            self._rest[key] = best
        return self._rest[key]

    def _beyond_and_on(self, variant: int, done: int, begins: Mode) -> float:
        """The same where the first of these stages has a sequence longer than are opened."""
        stage, way = self.variants[variant][done], Way(drives=True)
        on = (self._to_go(variant, done + 1, mode, way) for mode in self._after(stage))
        return self._beyond(stage, begins) + min(on)

    def _too_far(self, stage: StageTask, way: Way) -> bool:
        """Whether blocks alone do not come as far as a stage must, and there is no drive."""
        by_blocks = way.blocks * self.relaxation.soft_travel_m if way.blocks else 0.0
        return not way.drives and stage.distance_m > by_blocks

    def _bends(self, node: Node) -> bool:
        """Whether the modes of a node can bring about the shapes of its stages."""
        modes = tuple(tuple(sorted(set(filter(any, each)))) for each in node.sequences)
        key = node.variant, modes
        if key not in self._bending:
            stages = self.variants[node.variant][: len(modes)]
            self._bending[key] = reachable([stage.change for stage in stages], modes)
        return self._bending[key]

    def _stranded(self, node: Node) -> bool:
        """Whether the last stage is too far away for blocks alone, and there is no drive."""
        done = len(node.sequences)
        if not done:
            return False
        stages = self.variants[node.variant]
        since = slice(done - stages[done - 1].since, done)
        return self._too_far(stages[done - 1], Way().then(node.sequences[since], stages[since]))

    def _moving(self, node: Node) -> list[bool]:
        """In which phases of a node something may move."""
        pairs = zip(self.variants[node.variant], node.sequences, strict=False)
        return [moves for stage, sequence in pairs for moves in stage.moving(sequence)]

    def children(self, node: Node) -> list[Node]:
        """The variants, or the next stage with each of its sequences."""
        if node.variant < 0:
            return [Node(variant) for variant in range(len(self.variants))]
        stages = self.variants[node.variant]
        if len(node.sequences) == len(stages):
            return []
        stage, (begins,) = stages[len(node.sequences)], self._ends(node)
        found = [
            Node(node.variant, (*node.sequences, sequence)) for sequence in stage.sequences(begins)
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
        ends = [0, *itertools.accumulate(map(len, node.sequences))]
        bound = mission_bound(
            self.network(node),
            self.relaxation,
            self.weights,
            self._durations(node),
            [
                StageEnd(ends[k], stage.change, ends[k - stage.since], stage.distance_m)
                for k, stage in enumerate(stages, start=1)
            ],
            [i for i, moves in enumerate(self._moving(node)) if not moves],
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
        return [time for stage, sequence in pairs for time in self._lasting(stage, sequence)]

    def _lasting(self, stage: StageTask, sequence: ModeSequence) -> list[float]:
        """Least durations of a stage's phases, worked out once."""
        key = (stage.alike, sequence)
        if key not in self._known:
            self._known[key] = stage.durations(sequence)
        return self._known[key]

    def _ends(self, node: Node) -> tuple[Mode, ...]:
        """Stiffness where the next stage begins."""
        return (node.joined[-1] if node.sequences else self.first,)

    def _after(self, stage: StageTask) -> tuple[Mode, ...]:
        """Stiffnesses in which a stage may end."""
        return stage.modes if stage.last is None else (stage.last,)

    def _alone_s(self, stage: StageTask, begins: Mode, sequence: ModeSequence) -> float:
        """What a stage adds at least with a sequence, whatever came before it."""
        key = (stage.alike, begins, sequence)
        if key not in self._alone:
            durations = self._lasting(stage, sequence)
            self._alone[key] = self._from_warm(begins, sequence, durations)
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
        first: ModeSequence = (rigid,) if stage.drives_first and not any(begins) else ()
        heads = [(first, 0.0)]
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
        durations: list[float],
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
