"""How the wall time grows: with the number of phases, and with the grid of the program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, Field

from benchmarks.growth.figures import draw_grid, draw_phases
from benchmarks.growth.fixed_sequence import SequenceSolve, solve_record
from benchmarks.growth.tables import GRID, PHASES, SearchRun, report_lines
from benchmarks.measurement import timed_in_turns
from benchmarks.plan_record import PlanRecord, plan_record
from benchmarks.suite import Choices, Count, Counts, Numbers, Record, Run, Suite, chosen
from benchmarks.transition_sweep.thermal_scale import thermally_faster
from twosra_mpc import Problem, plan
from twosra_mpc.validation import NonNegative, Positive, plain


class Growth(Suite):
    """Whole searches over ``max_phases``; single nonlinear programs over phases and grid.

    Attributes:
        problems: The problems.
        max_phases: Longest mode sequences that a search may use.
        gaps: Gaps asked of a search.
        times_faster: How much faster than the robot as it is the searched robots melt and freeze.
        time_limit_s: Time limit of a search.
        phases: Numbers of phases of a single program.
        intervals: Shooting intervals per phase of these programs.
        grid: Shooting intervals per phase to try.
        grid_phases: Number of phases of those programs.
    """

    problems: Choices
    max_phases: Counts
    gaps: Annotated[tuple[NonNegative, ...], Field(min_length=1), BeforeValidator(plain)]
    times_faster: Numbers = (1.0,)
    time_limit_s: Positive = 20.0
    phases: Counts
    intervals: Count = 10
    grid: Counts
    grid_phases: Count = 3

    def runs(self) -> Iterator[Run]:
        """Yield the single programs first, then the searches."""
        problems = chosen(self.problems)
        sizes = [(phases, self.intervals) for phases in self.phases]
        sizes += [(self.grid_phases, intervals) for intervals in self.grid]
        for phases, intervals in dict.fromkeys(sizes):
            for label, problem in problems:
                key = f"{label}: program of {phases} phases, {intervals} intervals"
                yield Run(key, partial(self._solve, label, problem, phases, intervals))
        for factor in self.times_faster:
            for gap in self.gaps:
                for most in self.max_phases:
                    for label, problem in problems:
                        key = f"{label}: search, {factor:g} x, gap {gap:g}, {most} phases"
                        yield Run(key, partial(self._search, label, problem, factor, gap, most))

    def report(self, records: Sequence[Record], folder: Path) -> list[str]:
        """Wall times over phases and over the grid, with slopes."""
        solves = [SequenceSolve.from_record(r["solve"]) for r in records if "solve" in r]
        searches = [_search_run(record) for record in records if "plan" in record]
        by_phases = [solve for solve in solves if solve.intervals == self.intervals]
        by_phases = [solve for solve in by_phases if solve.phases in self.phases]
        by_grid = [solve for solve in solves if solve.phases == self.grid_phases]
        by_grid = [solve for solve in by_grid if solve.intervals in self.grid]
        draw_phases(searches, by_phases, self.time_limit_s, folder / PHASES)
        draw_grid(by_grid, folder / GRID)
        return report_lines(searches, by_phases, by_grid, self.time_limit_s)

    def _solve(self, label: str, problem: Problem, phases: int, intervals: int) -> Record:
        record = solve_record(label, problem, phases, intervals, self.repeats, self.repeat_budget_s)
        return {"solve": record.to_record()}

    def _search(self, label: str, problem: Problem, factor: float, gap: float, most: int) -> Record:
        robot = problem.robot if factor == 1.0 else thermally_faster(problem.robot, factor)
        limits = {"gap": gap, "max_phases": most, "time_limit_s": self.time_limit_s}
        asked = problem.with_robot(robot).model_copy(update=limits)
        made = timed_in_turns({"plan": partial(plan, asked)}, self.repeats, self.repeat_budget_s)
        record = plan_record(label, *made["plan"]).to_record()
        return {"times_faster": factor, "gap": gap, "max_phases": most, "plan": record}


def _search_run(record: Record) -> SearchRun:
    plan_made = PlanRecord.from_record(record["plan"])
    return SearchRun(record["times_faster"], record["gap"], record["max_phases"], plan_made)
