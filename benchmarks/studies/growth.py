"""How the wall time grows: with the number of phases, and with the grid of the program."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, TypeAdapter

from benchmarks import figures
from benchmarks.measurement import PlanRecord, Timing
from benchmarks.report import power_law
from benchmarks.study import Count, Counts, Measured, Numbers, PlanStudy
from benchmarks.thermal_scale import thermally_faster
from twosra_mpc import Problem
from twosra_mpc.model.flow import roll_out
from twosra_mpc.planning.solver.fixed_sequence import Candidate, solve
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, ModeSequence
from twosra_mpc.timing import transition_model
from twosra_mpc.validation import NonNegative, plain


class Program(NamedTuple):
    """A single nonlinear program."""

    problem: str
    phases: int
    intervals: int


class Search(NamedTuple):
    """A whole search."""

    problem: str
    times_faster: float
    gap: float
    max_phases: int


@dataclass(frozen=True)
class ProgramRecord:
    """A solved program.

    Attributes:
        iterations: Iterations of the solver; None if it found nothing.
        timing: Times of the calls: solver, fine roll-out, terminal correction and schedule.
    """

    iterations: int | None
    timing: Timing

    @property
    def cpu_s(self) -> float:
        """CPU time [s]."""
        return self.timing.cpu_median_s

    @property
    def iteration_s(self) -> float:
        """CPU time per iteration of the solver, everything included [s]."""
        return self.cpu_s / (self.iterations or np.nan)


Sized = dict[int, list[ProgramRecord]]  # by size


class Growth(PlanStudy):
    """Whole searches over ``max_phases``; single nonlinear programs over phases and grid.

    Attributes:
        max_phases: Longest mode sequences that a search may use.
        gaps: Gaps asked of a search.
        times_faster: How much faster than the robot as it is the searched robots melt and freeze.
        phases: Numbers of phases of a single program.
        intervals: Shooting intervals per phase of these programs.
        grid: Shooting intervals per phase to try.
        grid_phases: Number of phases of those programs.
    """

    record: ClassVar = TypeAdapter(PlanRecord | ProgramRecord)
    question: ClassVar = "How does wall time grow with the number of phases, and with the grid?"

    max_phases: Counts
    gaps: Annotated[tuple[NonNegative, ...], Field(min_length=1), BeforeValidator(plain)]
    times_faster: Numbers = (1.0,)
    phases: Counts
    intervals: Count = 10
    grid: Counts
    grid_phases: Count = 3

    def cases(self) -> Iterator[Program | Search]:
        """Yield the single programs first, then the searches."""
        sizes = [(phases, self.intervals) for phases in self.phases]
        sizes += [(self.grid_phases, intervals) for intervals in self.grid]
        for size in dict.fromkeys(sizes):
            yield from (Program(label, *size) for label in self.named)
        for setting in itertools.product(self.times_faster, self.gaps, self.max_phases):
            yield from (Search(label, *setting) for label in self.named)

    def run(self, case: Program | Search) -> ProgramRecord | PlanRecord:
        """Solve a single program, or plan."""
        problem = self.named[case.problem]
        if isinstance(case, Program):
            solve = _solve_at_rest(problem, case.phases, case.intervals)
            candidate, timing = self.timed({"solve": solve})["solve"]
            return ProgramRecord(candidate.iterations if candidate else None, timing)
        if case.times_faster != 1.0:
            problem = problem.with_values(robot=thermally_faster(problem.robot, case.times_faster))
        limits = {"gap": case.gap, "max_phases": case.max_phases}
        return self.planned(problem.with_values(**limits))

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Wall times over phases and over the grid, with slopes."""
        searches: dict[tuple[float, float], dict[int, list[PlanRecord]]] = {}
        by_phases: Sized = {n: [] for n in sorted(self.phases)}
        by_grid: Sized = {n: [] for n in sorted(self.grid)}
        for case, made in results:
            if isinstance(case, Search):
                same = searches.setdefault((case.times_faster, case.gap), {})
                same.setdefault(case.max_phases, []).append(made)
                continue
            if case.intervals == self.intervals and case.phases in by_phases:
                by_phases[case.phases].append(made)
            if case.phases == self.grid_phases and case.intervals in by_grid:
                by_grid[case.intervals].append(made)
        laws = {
            "phases": _solved(by_phases, "cpu_s"),
            "intervals per phase": _solved(by_grid, "cpu_s"),
            "intervals per phase, each iteration": _solved(by_grid, "iteration_s"),
        }
        slopes = {
            name: power_law([*values], [np.median(several) for several in values.values()])[1]
            for name, values in laws.items()
            if len(values) > 1
        }
        figures.draw_growth(searches, self.time_limit_s, laws, folder / "growth.png")
        groups = {"searches": searches, "by_phases": by_phases, "by_grid": by_grid}
        return {**groups, "slopes": slopes}


def _solved(programs: Sized, name: str) -> dict[int, list[float]]:
    """A value of the solved programs, by their size."""
    known = {n: [getattr(one, name) for one in group if one.iterations]
             for n, group in programs.items()}  # fmt: skip
    return {n: several for n, several in known.items() if several}


def cyclic_sequence(phases: int) -> ModeSequence:
    """Rigid, segment 1 soft, segment 2 soft, and so on: reaches any goal from three phases on."""
    return tuple(itertools.islice(itertools.cycle((RIGID, SOFT_1, SOFT_2)), phases))


def _solve_at_rest(problem: Problem, phases: int, intervals: int) -> Callable[[], Candidate | None]:
    """Return what solves the program of ``cyclic_sequence`` from a guess that does not move.

    With such a guess the work does not depend on how good the planner's own guesses are.
    """
    sequence = cyclic_sequence(phases)
    network = transition_model(problem).network(sequence, problem.goal.mode, [0.0] * phases)
    rest = np.zeros((phases, intervals, 5))
    guess = roll_out(problem.robot, problem.start.configuration, sequence, rest)
    return partial(solve, guess, network, problem)
