"""Our planner against the greedy ones, problem by problem, in turns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from benchmarks.comparison.figures import draw_cost_ratios, draw_wall_times
from benchmarks.comparison.published import PUBLISHED, published_record
from benchmarks.comparison.tables import COST, PLANNERS, WALL_TIME, report_lines
from benchmarks.measurement import Timing, timed_in_turns
from benchmarks.plan_record import PlanRecord, plan_record
from benchmarks.suite import Choices, Record, Run, Suite, chosen
from twosra_mpc import Plan, Problem, plan
from twosra_mpc.reproduction.published import PublishedTrajectory, published_trajectory
from twosra_mpc.validation import Positive


class Comparison(Suite):
    """Every planner on every problem.

    Attributes:
        problems: The problems.
        time_limit_s: Time limit of a plan; a run that is not correct counts with it in means.
        time_shift_s: Shift of the geometric mean of wall times.
    """

    problems: Choices
    time_limit_s: Positive = 60.0
    time_shift_s: Positive = 0.01

    def runs(self) -> Iterator[Run]:
        """Yield one run per problem: all planners in turns."""
        for label, problem in chosen(self.problems):
            yield Run(label, partial(self._measure, label, problem))

    def report(self, records: Sequence[Record], folder: Path) -> list[str]:
        """Rates, times and costs of the planners; distributions of wall time and cost ratio."""
        problems = [
            {name: PlanRecord.from_record(one) for name, one in record.items()}
            for record in records
        ]
        draw_wall_times(problems, folder / WALL_TIME)
        draw_cost_ratios(problems, folder / COST)
        return report_lines(problems, self.time_limit_s, self.time_shift_s)

    def _measure(self, label: str, problem: Problem) -> Record:
        start, goal = problem.start.configuration, problem.goal.configuration
        limited = problem.model_copy(update={"time_limit_s": self.time_limit_s})
        functions: dict[str, Callable[[], Plan | PublishedTrajectory]] = {
            PUBLISHED: partial(published_trajectory, start, goal)
        }
        for planner in PLANNERS[:2]:
            functions[planner] = partial(plan, limited.model_copy(update={"planner": planner}))
        timed = timed_in_turns(functions, self.repeats, self.repeat_budget_s)
        return {name: _record(label, limited, *timed[name]).to_record() for name in PLANNERS}


def _record(
    label: str, problem: Problem, result: Plan | PublishedTrajectory, timing: Timing
) -> PlanRecord:
    if isinstance(result, Plan):
        return plan_record(label, result, timing)
    return published_record(label, problem, result, timing)
