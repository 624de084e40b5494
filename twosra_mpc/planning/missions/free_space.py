"""Missions of goals alone, with nothing in the way: stage by stage as single goals are solved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.planning.missions.bends import shapes, stage_bends
from twosra_mpc.planning.missions.variants import Variant
from twosra_mpc.planning.nlp.fixed_sequence import INTERVALS, Candidate, timed
from twosra_mpc.planning.nlp.guess import guess_motion, moved_inside
from twosra_mpc.planning.nlp.terminal_correction import correct_end
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.mission_tree import Node
from twosra_mpc.planning.single_goal.sequence_solver import Solved, checked
from twosra_mpc.problem.ends import may_drive
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import ModeSequence
from twosra_mpc.timing import TemporalNetwork

_WIDE_PER_M = 1e-3  # around shapes that are chosen for the mission


class StageSolver:
    """Yields the verified plan of one sequence of each stage: every stage as it is guessed alone.

    A nonlinear program for each stage finds nothing better: what it could gain, waiting hides.
    """

    def __init__(self, variants: Sequence[Variant]) -> None:
        self.variants = variants

    def __call__(
        self, network: TemporalNetwork, bound: SequenceBound, node: Node
    ) -> Iterator[tuple[float, Solved] | None]:
        """Yield (cost, plan) of every attempt; None: it failed."""
        variant = self.variants[node.variant]
        problem, stages = variant.problem, variant.members[0]
        goals = [stage.goal for stage in stages]
        bends = stage_bends(problem, goals, node.sequences, bound.bends)
        ends = shapes(problem, node.sequences, bends)
        q, motions = problem.start.configuration, list[Motion]()
        for goal, sequence, bend, shape in zip(goals, node.sequences, bends, ends, strict=True):
            motion = _motion(problem, q, goal.shaped(shape, _WIDE_PER_M), sequence, bend)
            if motion is None:
                yield None
                return
            motions.append(motion)
            q = motion.end
        yield checked(problem, joined(problem, motions, network), network)


def _motion(
    problem: Problem, q: Array, goal: GoalSet, sequence: ModeSequence, bends: Array
) -> Motion | None:
    """A stage from a configuration to its goal; None if it does not get there."""
    x_m, y_m, phi_rad, *kappa_per_m = q.tolist()
    start = Start(x_m=x_m, y_m=y_m, phi_rad=phi_rad, kappa_per_m=tuple(kappa_per_m))
    alone = problem.with_values(start=start, goal=goal, tasks=())
    usable = may_drive(alone, sequence)
    made = guess_motion(alone.robot, q, goal, sequence, bends, INTERVALS, usable)
    return correct_end(moved_inside(made, alone), goal)


def joined(
    problem: Problem, motions: Sequence[Motion], network: TemporalNetwork
) -> Candidate | None:
    """One motion after the other on one clock."""
    most = max(motion.inputs.shape[1] for motion in motions)
    inputs = np.concatenate(
        [
            np.pad(motion.inputs, ((0, 0), (0, most - motion.inputs.shape[1]), (0, 0)))
            for motion in motions
        ]
    )
    sequence = network.sequence
    whole = roll_out(problem.robot, problem.start.configuration, sequence, inputs)
    ends = tuple(np.cumsum([len(motion.sequence) for motion in motions]).tolist())
    return timed(whole, network, problem, 0, ends)
