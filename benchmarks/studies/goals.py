"""Random goals all over the shapes: planned, refused, or given up, beside a grid of their boxes.

A goal is rightly refused where no shape of a grid of its box is allowed, and wrongly given up where
there is none either; one that has a shape in the grid should be planned.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.study import Count, Measured, Numbers, Study
from twosra_mpc import InputError, Problem, load_problem, plan
from twosra_mpc.problem.limits import broken_by_shapes
from twosra_mpc.validation import Positive

_POINTS = 15  # of the grid, along each curvature


class Goal(NamedTuple):
    """A goal, by its number."""

    number: int


class Goals(Study):
    """Goals of random shapes, from where a built-in scenario starts.

    Attributes:
        scenario: It also says the goal's pose.
        count: Goals.
        curvature_per_m: Largest curvature of the middle of a goal.
        half_widths_per_m: Of the boxes of curvature, one of them for each segment at random.
        seed: Of all that is random.
        time_limit_s: Of each plan.
    """

    record: ClassVar = TypeAdapter(dict[str, Any])
    question: ClassVar = "Is every goal planned or refused, and none given up that has no shape?"

    scenario: str = "paper-1"
    count: Count = 100
    curvature_per_m: Positive = 70.0
    half_widths_per_m: Numbers = (1e-6, 0.7, 5.0)
    seed: Count = 2026
    time_limit_s: Positive = 60.0

    def cases(self) -> Iterator[Goal]:
        """Yield the goals."""
        yield from map(Goal, range(self.count))

    def run(self, case: Goal) -> dict[str, Any]:
        """Verdict, whether a grid has a shape that is allowed, and the proved gap of the plan."""
        problem, free = self.problem(case)
        try:
            found = plan(problem)
        except InputError as error:
            return {"verdict": "refused", "free": free, "message": str(error), "gap": None}
        verdict, message = found.status.value, found.message
        return {"verdict": verdict, "free": free, "message": message, "gap": found.gap}

    def problem(self, case: Goal) -> tuple[Problem, bool]:
        """The problem of a goal, and whether a shape in a grid of its box is allowed."""
        rng = np.random.default_rng([self.seed, case.number])
        asked = load_problem(self.scenario, time_limit_s=self.time_limit_s)
        most, n = asked.robot.limits.curvature_per_m, asked.robot.coordinates.segments
        middle = rng.uniform(-self.curvature_per_m, self.curvature_per_m, n)
        half = rng.choice(self.half_widths_per_m, n)
        sides = (np.linspace(m - h, m + h, _POINTS) for m, h in zip(middle, half, strict=True))
        grid = np.clip([*itertools.product(*sides)], -most, most)
        free = any(broken_by_shapes(asked.robot, shape) is None for shape in grid)
        tolerance = asked.goal.tolerance.with_values(kappa_per_m=tuple(half.tolist()))
        goal = asked.goal.with_values(kappa_per_m=tuple(middle.tolist()), tolerance=tolerance)
        return asked.with_values(goal=goal), free

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Goals by verdict, and those that are wrong."""
        del folder
        records = [each.record for each in results]
        verdicts = sorted({record["verdict"] for record in records})
        wrong = [
            each
            for each in results
            if (each.record["verdict"] == "refused") == each.record["free"]
            or each.record["verdict"] == "failed"
        ]
        return {
            "verdicts": {
                verdict: [record for record in records if record["verdict"] == verdict]
                for verdict in verdicts
            },
            "wrong": wrong,
        }
