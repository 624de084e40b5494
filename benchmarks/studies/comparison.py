"""Our planner against the greedy ones, problem by problem, in turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from benchmarks import figures
from benchmarks.measurement import PlanRecord, Timing, plan_record
from benchmarks.report import shifted_geometric_mean
from benchmarks.study import Measured, OneProblem, PlanStudy
from twosra_mpc import Problem, plan
from twosra_mpc.lab.reproduction.published_runs import (
    PublishedTrajectory,
    StopReason,
    published_trajectory,
)
from twosra_mpc.problem.limits import broken_by_shapes
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.validation import Positive

OPTIMAL, GREEDY, PUBLISHED = PLANNERS = ("optimal", "greedy", "published loop")


class Comparison(PlanStudy):
    """Every planner on every problem.

    Attributes:
        time_shift_s: Shift of the geometric mean of wall times.
    """

    record: ClassVar = TypeAdapter(dict[str, PlanRecord])
    question: ClassVar = "Our planner against greedy ones: how often right, how fast, how good?"

    time_shift_s: Positive = 0.01

    def run(self, case: OneProblem) -> dict[str, PlanRecord]:
        """Let every planner plan."""
        problem = self.named[case.problem]
        ends = (problem.start.configuration, problem.goal.configuration)
        calls: dict[str, Callable[[], Any]] = {PUBLISHED: partial(published_trajectory, *ends)}
        for name in (OPTIMAL, GREEDY):
            calls[name] = partial(plan, problem.with_values(planner=name))
        made = self.timed(calls)
        records = {name: plan_record(*made[name]) for name in (OPTIMAL, GREEDY)}
        return {**records, PUBLISHED: _published_record(problem, *made[PUBLISHED])}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Distributions of wall time and cost ratio; means and ratios."""
        planners = {name: {case.problem: one[name] for case, one in results} for name in PLANNERS}
        ours, greedy = planners[OPTIMAL], planners[GREEDY]
        ratios = {
            label: mine.cost / greedy[label].cost
            for label, mine in ours.items()
            if mine.correct and greedy[label].correct
        }
        pairs = {
            name: [*zip(planners[name].values(), ours.values(), strict=True)] for name in PLANNERS
        }
        return {
            "figures": {
                "wall-time.png": partial(figures.draw_wall_times, planners),
                "cost-ratio.png": partial(figures.draw_cost_ratios, ours, greedy, ratios),
            },
            "planners": planners,
            "means": {name: self._mean_s([*made.values()]) for name, made in planners.items()},
            "ratios": ratios,
            "costs": {
                name: [
                    x.cost / y.cost for x, y in pairs[name] if x.correct and y.correct and x.cost
                ]
                for name in PLANNERS
            },
            "cpu_times": {
                name: [x.timing.cpu_median_s / y.timing.cpu_median_s for x, y in pairs[name]]
                for name in PLANNERS
            },
            "time_ratios": {
                name: [ours[x].timing.median_s / planners[name][x].timing.median_s for x in ours]
                for name in PLANNERS[1:]
            },
            "errors": [made.goal_error for made in ours.values() if made.correct],
            "others": {f"{x}, {name}": planners[name][x] for name in PLANNERS[1:] for x in ours},
        }

    def _mean_s(self, plans: Sequence[PlanRecord]) -> float:
        """Shifted geometric mean of the wall times; a plan that is not correct took the limit."""
        times_s = [one.timing.median_s if one.correct else self.time_limit_s for one in plans]
        return shifted_geometric_mean(times_s, self.time_shift_s)


def _published_record(problem: Problem, path: PublishedTrajectory, timing: Timing) -> PlanRecord:
    """Write down a run of Algorithm 1 as published.

    It gives a path on the published model without transitions or a clock, so there is no cost, and
    less to check than of a plan: that it ends at the goal, stays in the curvature range and keeps
    the locomotion units apart.
    """
    error = float(np.abs(problem.goal.error(path.final_q.copy())).max())
    shapes_allowed = broken_by_shapes(problem.robot, path.q[:, POSE:]) is None
    return PlanRecord(
        status=path.stop.name.lower(),
        message=path.stop.value,
        success=path.stop is StopReason.REACHED,
        verified=shapes_allowed,
        stopped_early=path.stop is StopReason.ITERATION_LIMIT,
        timing=timing,
        goal_error=error if np.isfinite(error) else None,
    )
