"""Plans among random obstacles, beside those of the same problems without any."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks.measurement import PlanRecord, plan_record
from benchmarks.study import Measured, OneProblem, PlanStudy
from twosra_mpc import Problem, plan
from twosra_mpc.robot.modes import ModeSequence, is_rigid
from twosra_mpc.validation import Positive

AMONG, FREE = "among obstacles", "without obstacles"


class Row(NamedTuple):
    """A scene of a set with its plan, and how its CPU time compares to that of free space."""

    problem: str
    plan: PlanRecord
    free: PlanRecord
    blocks: int
    cpu_ratio: float


class Scenes(PlanStudy):
    """Every scene with its obstacles and without, in turns.

    Attributes:
        gap: Gap asked of the search.
        exact: Whether goals are met exactly; else as nearly as the robot's accuracy asks.
    """

    record: ClassVar = TypeAdapter(dict[str, PlanRecord])
    question: ClassVar = "Plans among random obstacles: how often, how good, how fast?"

    gap: Positive = 0.005
    exact: bool = False

    def run(self, case: OneProblem) -> dict[str, PlanRecord]:
        """Plan a scene as it is, and without what is around the robot."""
        problem = self.named[case.problem].with_values(gap=self.gap)
        if self.exact:
            problem = problem.with_values(goal=problem.goal.with_values(tolerance="exact"))
        made = self.timed(
            {AMONG: partial(plan, problem), FREE: partial(plan, without_world(problem))}
        )
        return {name: plan_record(*made[name]) for name in (AMONG, FREE)}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Scenes by set."""
        rows = [_row(case.problem, made) for case, made in results]
        sets = itertools.groupby(rows, key=lambda row: row.problem.rpartition("/")[0])
        grouped = {name: list(some) for name, some in sets}
        return {"sets": grouped, "plans": {row.problem: row.plan for row in rows}}


def without_world(problem: Problem) -> Problem:
    """The problem in free space."""
    return problem.with_values(workspace=None, obstacles=())


def blocks(sequence: ModeSequence) -> int:
    """How many stretches of soft phases without a rigid one in between there are."""
    return sum(not rigid for rigid, _ in itertools.groupby(map(is_rigid, sequence)))


def _row(problem: str, made: dict[str, PlanRecord]) -> Row:
    ours, free = made[AMONG], made[FREE]
    ratio = ours.timing.cpu_median_s / free.timing.cpu_median_s
    return Row(problem, ours, free, blocks(ours.sequence), ratio)
