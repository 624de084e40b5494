"""Bounds against the best of many local solutions, and the search against brute force.

For every problem, transition time and mode sequence, the proved bound is compared with the best
plan over several starts of the fixed-sequence program, and the search with the best over all
sequences.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.measurement import PlanRecord
from benchmarks.study import Count, Numbers, PlanStudy
from benchmarks.thermal_scale import thermally_faster
from twosra_mpc import Problem
from twosra_mpc.planning.bounds.sequence_bound import SequenceBound
from twosra_mpc.planning.relaxation import stage_tree
from twosra_mpc.planning.search.nodes import Whole
from twosra_mpc.planning.solver.sequence_solver import GoalSolver
from twosra_mpc.planning.stages.variants import ways_of
from twosra_mpc.robot.modes import is_rigid
from twosra_mpc.timing import TemporalNetwork
from twosra_mpc.validation import Positive

TOLERANCE_S = 1e-6
_NOISE = 0.01  # on the bends of every start but the first, in bending coordinates


class Case(NamedTuple):
    """A problem on a robot that melts and freezes ``times_faster``."""

    problem: str
    times_faster: float


@dataclass(frozen=True)
class CertificateRecord:
    """What brute force and search found.

    Attributes:
        sequences: Mode sequences that can bring the shape about.
        solved: Of these, sequences with a verified plan.
        violated: Sequences with a verified plan below their bound: must be zero.
        tightest: Smallest (best - bound) / best over the solved sequences; None without any.
        brute_s: Best verified cost over all sequences; None without any.
        search: What the search found.
    """

    sequences: int
    solved: int
    violated: int
    tightest: float | None
    brute_s: float | None
    search: PlanRecord

    @property
    def excess(self) -> float | None:
        """Cost of the search's plan over that of brute force, less 1; infinite without a plan."""
        return (self.search.cost or math.inf) / self.brute_s - 1 if self.brute_s else None


class Certificate(PlanStudy):
    """Brute force over short mode sequences.

    Attributes:
        times_faster: How much faster than the robot file's the segments melt and freeze.
        starts: Starts of each sequence's program.
        phases: Longest sequence.
        gap: Gap asked of the search.
    """

    record: ClassVar = TypeAdapter(CertificateRecord)
    question: ClassVar = "Do bounds and search stand up to brute force?"

    times_faster: Numbers = (1.0,)
    starts: Count = 3
    phases: Count = 4
    gap: Positive = 1e-3

    def cases(self) -> Iterator[Case]:
        """Yield every problem at each transition time."""
        for factor in self.times_faster:
            yield from (Case(label, factor) for label in self.named)

    def run(self, case: Case) -> CertificateRecord:
        """Compare bounds and search with brute force on one problem."""
        problem = self.named[case.problem]
        problem = problem.with_values(robot=thermally_faster(problem.robot, case.times_faster))
        problem = problem.with_values(max_phases=self.phases, gap=self.gap)
        bound, best = np.reshape(list(_brute_force(problem, self.starts)), (-1, 2)).T
        solved = np.isfinite(best)
        return CertificateRecord(
            sequences=len(bound),
            solved=int(solved.sum()),
            violated=int((best < bound - TOLERANCE_S).sum()),
            tightest=float((1 - bound / best)[solved].min()) if solved.any() else None,
            brute_s=float(best.min()) if solved.any() else None,
            search=self.planned(problem),
        )


def _brute_force(problem: Problem, starts: int) -> Iterator[tuple[float, float]]:
    """Yield (proved bound, best verified cost or inf) of every mode sequence [s]."""
    solve, rng = GoalSolver(ways_of(problem).variants[0]), np.random.default_rng(0)

    def attempts(network: TemporalNetwork, bound: SequenceBound, _: Whole) -> Iterator[Any]:
        """Plans from the relaxation's own bends, and from disturbed ones."""
        soft = [not is_rigid(mode) for mode in network.sequence]
        for start in range(starts):
            noise = rng.normal(0.0, _NOISE, len(bound.bends)) if start else 0.0
            yield from solve(network, replace(bound, bends=np.where(soft, bound.bends + noise, 0)))

    tree = stage_tree(problem, ways_of(problem).variants, attempts)
    nodes = [tree.root()]
    while nodes:
        node = nodes.pop()
        if len(node.head) < problem.max_phases:
            nodes += tree.children(node)
        bound = tree.leaf_bound(node)
        if math.isfinite(bound):
            if not all(map(is_rigid, node.head)):
                bound = max(bound, tree.tighter_bound(node, math.inf))
            found = [made[0] for made in tree.solve(node) if made is not None]
            yield bound, min(found, default=math.inf)
