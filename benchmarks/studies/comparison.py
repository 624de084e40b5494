"""Our planner against the greedy ones, problem by problem, in turns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks import figures
from benchmarks.measurement import PlanRecord, Timing, plan_record
from benchmarks.report import Row, milliseconds, percent, shifted_geometric_mean, summary, worst
from benchmarks.study import PlanStudy
from twosra_mpc import Problem, plan
from twosra_mpc.problem.shape import shape_margins
from twosra_mpc.reproduction.published import (
    PublishedTrajectory,
    StopReason,
    published_trajectory,
)
from twosra_mpc.validation import Positive

OPTIMAL, GREEDY, PUBLISHED = PLANNERS = ("optimal", "greedy", "published loop")

Records = Mapping[str, PlanRecord]  # planner -> what it did


class Case(NamedTuple):
    """One problem: all planners in turns."""

    problem: str


class Comparison(PlanStudy):
    """Every planner on every problem.

    Attributes:
        time_shift_s: Shift of the geometric mean of wall times.
    """

    record: ClassVar = TypeAdapter(dict[str, PlanRecord])
    question: ClassVar = "Our planner against greedy ones: how often right, how fast, how good?"

    time_shift_s: Positive = 0.01

    def cases(self) -> Iterator[Case]:
        """Yield the problems."""
        yield from map(Case, self.named)

    def run(self, case: Case) -> Records:
        """Let every planner plan."""
        problem = self.named[case.problem]
        ends = (problem.start.configuration, problem.goal.configuration)
        calls: dict[str, Callable[[], Any]] = {PUBLISHED: partial(published_trajectory, *ends)}
        for name in (OPTIMAL, GREEDY):
            calls[name] = partial(plan, problem.model_copy(update={"planner": name}))
        made = self.timed(calls)
        records = {name: plan_record(*made[name]) for name in (OPTIMAL, GREEDY)}
        return {**records, PUBLISHED: _published_record(problem, *made[PUBLISHED])}

    def report(self, results: Sequence[tuple[Case, Records]], folder: Path) -> dict[str, Any]:
        """Rates, times and costs of the planners; distributions of wall time and cost ratio."""
        plans = {name: {case.problem: one[name] for case, one in results} for name in PLANNERS}
        ours, greedy = plans[OPTIMAL], plans[GREEDY]
        ratios = {
            label: mine.cost / theirs.cost
            for (label, mine), theirs in zip(ours.items(), greedy.values(), strict=True)
            if mine.correct and theirs.correct and mine.cost and theirs.cost
        }
        figures.draw_wall_times(
            {name: [*made.values()] for name, made in plans.items()}, folder / "wall-time.png"
        )
        figures.draw_cost_ratios(ours, greedy, ratios, folder / "cost-ratio.png")
        others = {f"{x}, {name}": plans[name][x] for name in PLANNERS[1:] for x in ours}
        return {
            "planners": [self._planner(name, [*made.values()]) for name, made in plans.items()],
            "time_ratios": {name: _time_ratios(ours, plans[name]) for name in PLANNERS[1:]},
            "cost_ratios": [*ratios.values()],
            "errors": [made.goal_error for made in ours.values() if made.correct],
            "worst": worst(ours, others),
            "problems": [_problem(x, one, ratios.get(x)) for (x,), one in results],
            "limit_s": self.time_limit_s,
            "shift_s": self.time_shift_s,
        }

    def _planner(self, name: str, plans: Sequence[PlanRecord]) -> Row:
        scored = [one.timing.median_s if one.correct else self.time_limit_s for one in plans]
        mean = milliseconds(shifted_geometric_mean(scored, self.time_shift_s))
        return {"planner": name, **summary(plans), "shifted geometric mean [ms]": mean}


def _time_ratios(ours: Records, others: Records) -> list[float]:
    """Wall time of the optimal planner over that of another, problem by problem."""
    return [ours[x].timing.median_s / others[x].timing.median_s for x in ours]


def _problem(label: str, one: Records, ratio: float | None) -> Row:
    plans = {name: one[name] for name in (OPTIMAL, GREEDY)}
    return {
        "problem": label,
        **{name: f"`{made.sequence_name}`" for name, made in plans.items()},
        **{f"{name} cost [s]": _seconds(made) for name, made in plans.items()},
        "ratio": "-" if ratio is None else f"{ratio:.3f}",
        "proved gap": percent(one[OPTIMAL].gap),
        **{f"{name} [ms]": milliseconds(one[name].timing.median_s) for name in PLANNERS},
    }


def _seconds(made: PlanRecord) -> str:
    if made.cost is None:
        return made.status
    return f"{made.cost:.1f}" if made.correct else f"{made.cost:.1f} (not correct)"


def _published_record(problem: Problem, path: PublishedTrajectory, timing: Timing) -> PlanRecord:
    """Write down a run of Algorithm 1 as published.

    It gives a path on the published model without transitions or a clock, so there is no cost, and
    less to check than of a plan: that it ends at the goal, stays in the curvature range and keeps
    the locomotion units apart.
    """
    error = float(np.abs(problem.goal.error(path.final_q.copy())).max())
    kappa = path.q[:, 3:]
    in_range = np.abs(kappa).max() <= problem.robot.limits.curvature_per_m
    apart = (shape_margins(problem.robot, kappa).unit_gap_m >= 0).all()
    return PlanRecord(
        status=path.stop.name.lower(),
        message=path.stop.value,
        success=path.stop is StopReason.REACHED,
        verified=bool(in_range and apart),
        stopped_early=path.stop is StopReason.ITERATION_LIMIT,
        timing=timing,
        goal_error=error if np.isfinite(error) else None,
    )
