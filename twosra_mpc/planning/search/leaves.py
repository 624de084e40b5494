"""Bounds of sequences of all stages: their relaxation, and what the pose of the first one adds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twosra_mpc.planning.bounds.bends import passes_forbidden
from twosra_mpc.planning.bounds.motion_bound import least_motion_s
from twosra_mpc.planning.bounds.parts import bound_by_parts
from twosra_mpc.planning.bounds.sequence_bound import SequenceBound, pose_bound
from twosra_mpc.planning.bounds.stages_bound import StageRelaxation, stages_bound
from twosra_mpc.planning.search.nodes import Nodes, Stages, Whole
from twosra_mpc.planning.search.so_far import SoFar
from twosra_mpc.robot.modes import ModeSequence


@dataclass
class Leaves:
    """Bounds of sequences of all stages, and what was learnt of them.

    Attributes:
        nodes: The stages of every variant.
        so_far: Bounds of what comes first.
        relaxation: Rates and room of the bending coordinates.
        bounds: Of sequences of all stages, as far as they were asked for.
        motion_s: Least time in which every plan moves [s], once it is asked for.
    """

    nodes: Nodes
    so_far: SoFar
    relaxation: StageRelaxation
    bounds: dict[Whole, SequenceBound] = field(default_factory=dict)
    motion_s: float | None = None
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

    def _lasting(self, whole: Whole, durations: Sequence[float]) -> SequenceBound | None:
        """The same with these least durations of the phases [s]."""
        if not all(map(math.isfinite, durations)):
            return None
        network = self.so_far.network(whole, self.nodes.last(whole), durations)
        return stages_bound(
            network,
            self._stages(whole),
            whole.sequences,
            self.relaxation,
            self.so_far.weights,
            durations,
        )

    def _stages(self, whole: Whole) -> Stages:
        return self.nodes.variants[whole.variant]

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
        stages, sequences, alone = self._stages(whole), whole.sequences, self.so_far.to_go.alone
        later = sum(
            alone.cost(stage, before[-1], sequence)
            for stage, before, sequence in zip(stages[1:], sequences, sequences[1:], strict=False)
        )
        if bound >= enough:
            return bound
        return max(bound, self._by_motion(whole, drives_s[0], enough - later) + later)

    def _drives(
        self, whole: Whole, drives_s: Sequence[Sequence[float]], enough: float
    ) -> list[float]:
        """Least durations of drives, those of stages that are nothing else with more effort [s]."""
        found = list[float]()
        triples = zip(self._stages(whole), whole.sequences, drives_s, strict=True)
        for stage, sequence, own_s in triples:
            alone = sequence == (stage.rigid,)
            found += [max(*own_s, stage.drive.at_least(enough))] if alone else own_s
        return found

    def _by_motion(self, whole: Whole, drives_s: Sequence[float], enough: float) -> float:
        """Bound of the first stage by parts of what it may do, and by its pose."""
        stage, sequence = self._stages(whole)[0], whole.sequences[0]
        if (task := stage.bend) is None:
            return -math.inf
        first, timing, weights = whole.sequences[:1], self.so_far.timing, self.so_far.weights
        if (whole.variant, first) not in self._first:
            least_s = self.so_far.to_go.alone.durations(stage, sequence)
            longer = list(map(max, least_s, drives_s))
            network = timing.network(sequence, stage.settled(sequence), longer)
            delayed = timing.with_delays(network, longer)
            parts = bound_by_parts(delayed, task, weights, longer, enough)
            cost = -math.inf if parts is None else parts.cost
            if cost < enough:
                cost = max(cost, pose_bound(delayed, task, weights, longer, enough))
            self._first[whole.variant, first] = cost, parts
        cost, parts = self._first[whole.variant, first]
        self._take_over(whole, parts)
        return cost

    def first_is_forbidden(self, whole: Whole) -> bool:
        """Whether the bends of the first stage's bound pass a forbidden shape."""
        task, first = self._stages(whole)[0].bend, whole.sequences[0]
        return task is not None and passes_forbidden(
            first, task, self.bounds[whole].bends[: len(first)]
        )

    def bend_otherwise(self, whole: Whole) -> None:
        """Look for other bends of the first stage."""
        stage, sequence = self._stages(whole)[0], whole.sequences[0]
        assert stage.bend is not None, "only then it is known what they pass"
        least_s = [0.0] * len(sequence)
        network = self.so_far.timing.network(sequence, stage.settled(sequence), least_s)
        parts = bound_by_parts(network, stage.bend, self.so_far.weights, least_s, math.inf)
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
        """Work out how long every plan moves where driving outlasts the metal."""
        task = self._stages(whole)[0].bend
        if task is None or task.pose is None or not any(map(any, whole.joined)):
            return
        if task.pose.known_s > self.bounds[whole].cost:
            self.ask_motion(whole)

    def ask_motion(self, whole: Whole) -> bool:
        """Work out how long every plan moves, where there is but one variant; whether it is news.

        That of the first stage, whose start is known.
        """
        stage = self._stages(whole)[0]
        if self.motion_s is not None or stage.bend is None or len(self.nodes.variants) > 1:
            return False
        self.motion_s = least_motion_s(stage.bend, stage.modes)
        return True
