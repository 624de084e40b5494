"""Missions among obstacles and objects: where to reshape, grasp and put down, and the ways."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from twosra_mpc.deadline import out_of_time
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.planning.missions.bends import shapes, stage_bends
from twosra_mpc.planning.missions.itinerary import Itinerary, Legs, routes_of
from twosra_mpc.planning.missions.stages import Stage
from twosra_mpc.planning.missions.variants import Variant
from twosra_mpc.planning.nlp.fixed_sequence import INTERVALS, Candidate, timed
from twosra_mpc.planning.nlp.terminal_correction import correct_end
from twosra_mpc.planning.obstacles.placement import hidden_by_phase_s
from twosra_mpc.planning.obstacles.stations import Chain
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.mission_tree import Node
from twosra_mpc.planning.single_goal.sequence_solver import Solved, checked
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.screws import twists
from twosra_mpc.timing import TemporalNetwork

_MOST_MEMBERS = 8  # of a variant, that are tried
_STILL = 1e-9  # m, rad or change of W
_SAME_PER_M = 1e-3


class MissionPlacer:
    """Yields plans of one sequence of each stage: the first of each variant's members that has one.

    Args:
        variants: The variants of the mission.
    """

    def __init__(self, variants: Sequence[Variant]) -> None:
        self.variants = variants
        self._drives: dict[tuple[int, bytes, bytes], Drives] = {}

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound, node: Node
    ) -> Iterator[tuple[float, Solved] | None]:
        """Yield (cost, plan) of every attempt; None: it failed."""
        variant = self.variants[node.variant]
        hidden_s = hidden_by_phase_s(network)
        for stages in variant.members[:_MOST_MEMBERS]:
            for goals in _goals(stages):
                if out_of_time():
                    return
                found = self._attempt(variant, stages, goals, network, bound, node, hidden_s)
                yield found
                if found is not None:
                    break

    def _attempt(
        self,
        variant: Variant,
        stages: Sequence[Stage],
        goals: Sequence[GoalSet],
        network: TemporalNetwork,
        bound: SequenceBound,
        node: Node,
        hidden_s: Sequence[float],
    ) -> tuple[float, Solved] | None:
        problem, sequences = variant.problem, node.sequences
        bends = stage_bends(problem, goals, sequences, bound.bends)
        if not _as_asked(problem, stages, goals, sequences, bends):
            return None
        itinerary = Itinerary(problem, stages, sequences, bends, self._drives_of)
        if not itinerary.possible:
            return None
        chain = itinerary.chain(lambda phase: hidden_s[phase])
        if chain is None:
            return None
        candidate = self._candidate(variant, stages, sequences, itinerary.legs, chain, network)
        return checked(problem, candidate, network)

    def _drives_of(self, stage: Stage, shape: Array) -> Drives:
        """Drives of a stage in a shape (n,), worked out once."""
        key = id(stage.world), stage.held.tobytes(), shape.round(9).tobytes()
        if key not in self._drives:
            robot = self.variants[0].problem.robot
            self._drives[key] = Drives(
                robot,
                stage.world,
                shape,
                held=stage.held,
                may=stage.may,
                sagitta_m=stage.sagitta_m,
            )
        return self._drives[key]

    def _candidate(
        self,
        variant: Variant,
        stages: Sequence[Stage],
        sequences: Sequence[ModeSequence],
        legs: Legs,
        chain: Chain,
        network: TemporalNetwork,
    ) -> Candidate | None:
        """The motion of a chain on the clock; ends of goals are met exactly."""
        inputs = _inputs(network.sequence, legs, chain)
        robot, q = variant.problem.robot, variant.problem.start.configuration
        corrected, first = [], 0
        for stage, sequence in zip(stages, sequences, strict=True):
            part = inputs[first : first + len(sequence)]
            motion: Motion | None = roll_out(robot, q, sequence, part)
            if stage.ends is None and stage.away is None:
                motion = correct_end(motion, stage.goal) if motion is not None else None
            if motion is None:
                return None
            corrected.append(motion.inputs)
            q, first = motion.end, first + len(sequence)
        start = variant.problem.start.configuration
        whole = roll_out(robot, start, network.sequence, np.concatenate(corrected))
        ends = tuple(itertools.accumulate(map(len, sequences)))
        return timed(whole, network, variant.problem, 0, ends)


def _goals(stages: Sequence[Stage]) -> Iterator[tuple[GoalSet, ...]]:
    """Goals of the stages; those that do not say how far to bend ask for more and more."""
    yield tuple(stage.goal for stage in stages)
    openings = [len(stage.openings) for stage in stages if stage.openings]
    for k in range(max(openings, default=0)):
        yield tuple(
            stage.openings[min(k, len(stage.openings) - 1)] if stage.openings else stage.goal
            for stage in stages
        )


def _as_asked(
    problem: Problem,
    stages: Sequence[Stage],
    goals: Sequence[GoalSet],
    sequences: Sequence[ModeSequence],
    bends: Sequence[Array],
) -> bool:
    """Whether every stage ends in a shape of its goal, and bends if it must."""
    found = shapes(problem, sequences, bends)
    for stage, goal, bend, shape in zip(stages, goals, bends, found, strict=True):
        low, high = goal.box(problem.start.configuration)
        off = np.maximum(low[POSE:] - shape, shape - high[POSE:])
        rests = np.abs(bend).max(initial=0.0) < _STILL
        if off.max() > _SAME_PER_M or (stage.reshapes and rests):
            return False
    return True


def _inputs(sequence: ModeSequence, legs: Legs, chain: Chain) -> Array:
    """Input displacements of every phase, (phases, intervals, 5): a leg takes an interval."""
    routes = {}
    for phase, route in routes_of(chain, legs).items():
        by = twists(route[:-1], route[1:])
        routes[phase] = by[np.abs(by).max(axis=1) > _STILL]
    intervals = max(INTERVALS, *(len(each) for each in routes.values()), 0)
    inputs = np.zeros((len(sequence), intervals, 5))
    for phase, mode in enumerate(sequence):
        if not is_rigid(mode):
            inputs[phase, :INTERVALS] = legs.blocks[phase]
        elif phase in routes:
            inputs[phase, : len(routes[phase]), 2:] = routes[phase]
    return inputs
