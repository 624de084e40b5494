"""What the growth of wall time looks like in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.growth.fixed_sequence import SequenceSolve
from benchmarks.markdown import figure, milliseconds, share, table
from benchmarks.plan_record import PlanRecord
from benchmarks.summary import power_law, quantiles

PHASES, GRID = "phases.png", "grid.png"


class SearchRun(NamedTuple):
    """One search with its settings."""

    times_faster: float
    gap: float
    max_phases: int
    plan: PlanRecord

    @property
    def setting(self) -> str:
        """Robot and asked gap in words."""
        robot = "robot as it is" if self.times_faster == 1 else f"{self.times_faster:g} x faster"
        return f"{robot}, gap {100 * self.gap:g} %"


Value = Callable[[SequenceSolve], float]


def cpu_s(solve: SequenceSolve) -> float:
    """CPU time of a program [s]."""
    return solve.timing.cpu_median_s


def medians(
    solves: Sequence[SequenceSolve], size: Callable[[SequenceSolve], int], value: Value
) -> tuple[list[int], list[float]]:
    """Median over the problems of a value of the solved programs, by their size."""
    solved = [solve for solve in solves if solve.iterations]
    sizes = sorted({size(solve) for solve in solved})
    return sizes, [float(np.median([value(s) for s in solved if size(s) == n])) for n in sizes]


def report_lines(
    searches: Sequence[SearchRun],
    by_phases: Sequence[SequenceSolve],
    by_grid: Sequence[SequenceSolve],
    limit_s: float,
) -> list[str]:
    """Everything the report says of growth."""
    return [
        "## Number of phases",
        "",
        *figure(
            PHASES,
            "Warm calls. Left: wall time of a whole search against the longest mode sequence it "
            "may use, median (line) and largest (thin) over the problems. Right: CPU time of one "
            "nonlinear program against its number of phases, every problem and a power law "
            "through the medians.",
        ),
        *_searches(searches, limit_s),
        *_solves("phases", by_phases, lambda solve: solve.phases),
        "## Grid",
        "",
        *figure(
            GRID,
            "CPU time of one nonlinear program, warm, against its shooting intervals per phase: "
            "every problem, and a "
            "power law through the medians. Left: until solved; right: per iteration.",
        ),
        *_solves("intervals per phase", by_grid, lambda solve: solve.intervals),
        *_limitations(),
    ]


def _searches(searches: Sequence[SearchRun], limit_s: float) -> list[str]:
    rows = []
    for setting in dict.fromkeys(run.setting for run in searches):
        same = [run for run in searches if run.setting == setting]
        for most in sorted({run.max_phases for run in same}):
            plans = [run.plan for run in same if run.max_phases == most]
            gaps = [100 * plan.gap for plan in plans if plan.gap is not None]
            rows.append(
                (
                    setting,
                    str(most),
                    share(sum(plan.success for plan in plans), len(plans)),
                    share(sum(plan.correct for plan in plans), len(plans)),
                    str(sum(plan.status == "infeasible" for plan in plans)),
                    str(sum(plan.stopped_early for plan in plans)),
                    quantiles([plan.sequences_solved for plan in plans], (0.5, 1.0), ".0f"),
                    quantiles(gaps, (0.5, 1.0), ".2g"),
                    quantiles([1e3 * plan.timing.median_s for plan in plans], (0.5, 1.0), ".0f"),
                )
            )
    header = (
        *("search", "max_phases", "success rate", "correct rate", "proved infeasible"),
        *(f"stopped at {limit_s:g} s", "sequences solved median / max"),
        *("proved gap [%] median / max", "wall time [ms] median / max"),
    )
    return table(header, rows)


def _solves(
    name: str, solves: Sequence[SequenceSolve], size: Callable[[SequenceSolve], int]
) -> list[str]:
    rows = []
    for n in sorted({size(solve) for solve in solves}):
        group = [solve for solve in solves if size(solve) == n]
        solved = [solve for solve in group if solve.iterations]
        rows.append(
            (
                str(n),
                share(len(solved), len(group)),
                quantiles([solve.iterations or 0 for solve in solved], (0.5, 1.0), ".0f"),
                quantiles([1e3 * s.timing.median_s for s in solved], (0.5, 0.9, 1.0), ".0f"),
                quantiles([1e3 * cpu_s(solve) for solve in solved], (0.5, 0.9, 1.0), ".0f"),
                quantiles([1e3 * solve.iteration_s for solve in solved], (0.5, 1.0), ".1f"),
                milliseconds(max(solve.timing.first_s for solve in group)),
            )
        )
    header = (
        *(name, "solved", "iterations median / max", "wall time [ms] median / p90 / max"),
        *("CPU time [ms] median / p90 / max", "CPU time per iteration [ms] median / max"),
        "longest first call [ms]",
    )
    slopes = [
        f"{what} grows as {name}^{power_law(*medians(solves, size, value))[1]:.2f}"
        for what, value in (
            ("CPU time", cpu_s),
            ("CPU time per iteration", lambda solve: solve.iteration_s),
        )
        if len(medians(solves, size, value)[0]) > 1
    ]
    fitted = [f"Fitted to the medians: {'; '.join(slopes)}.", ""] if slopes else []
    return [*table(header, rows), *fitted]


def _limitations() -> list[str]:
    return [
        "## Limitations",
        "",
        "- Single programs start from a robot that does not move, on sequences that cycle through "
        "rigid, segment 1 soft, segment 2 soft; the planner's own guesses are better, and often "
        "need no program at all. Their time includes the fine roll-out, landing and schedule.",
        "- A search with gap 0 can never be closed by a local solution and solves every sequence "
        "whose bound is below the best plan: it shows the whole tree, not everyday use.",
        "- Growth of single programs is fitted to CPU time, which is the wall time of a machine "
        "that does nothing else; searches have a limit on wall time and are shown by it.",
        "- The longest first call contains building and differentiating the program.",
        "",
    ]
