"""What a comparison says in Markdown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.comparison.published import PUBLISHED
from benchmarks.markdown import figure, milliseconds, percent, share, table
from benchmarks.plan_record import PlanRecord
from benchmarks.summary import quantiles, shifted_geometric_mean

PLANNERS = ("optimal", "greedy", PUBLISHED)
WALL_TIME, COST = "wall-time.png", "cost-ratio.png"
_SPREAD = (0.5, 0.9, 0.99)
_WORST = 5

OneProblem = dict[str, PlanRecord]


def report_lines(problems: Sequence[OneProblem], limit_s: float, shift_s: float) -> list[str]:
    """Everything the report says of a comparison."""
    return [
        *_rates(problems),
        *_times(problems, limit_s, shift_s),
        *figure(
            WALL_TIME,
            "Share of the problems solved correctly within a time, warm, one thread: wall time, "
            "and thin the CPU time, which is the wall time of a machine that does nothing else.",
        ),
        *_costs(problems),
        *figure(
            COST,
            "Cost of the plans relative to the greedy planner's plan for the same problem, by the "
            "greedy planner's mode sequence; short bars mark the proved lower bound.",
        ),
        *_worst(problems),
        *_every_problem(problems),
        *_limitations(),
    ]


def cost_ratios(problems: Sequence[OneProblem]) -> dict[str, float]:
    """Label -> cost of the optimal planner over cost of the greedy one, where both are correct."""
    ratios = {}
    for one in problems:
        ours, greedy = one["optimal"], one["greedy"]
        if ours.correct and greedy.correct and ours.cost is not None and greedy.cost:
            ratios[ours.problem] = ours.cost / greedy.cost
    return ratios


def time_ratios(problems: Sequence[OneProblem], other: str) -> list[float]:
    """Wall time of the optimal planner over that of another, problem by problem."""
    return [one["optimal"].timing.median_s / one[other].timing.median_s for one in problems]


def _rates(problems: Sequence[OneProblem]) -> list[str]:
    rows = []
    for name in PLANNERS:
        records = [one[name] for one in problems]
        count = len(records)
        rows.append(
            (
                name,
                share(sum(record.success for record in records), count),
                share(sum(record.correct for record in records), count),
                str(sum(record.status == "optimal" for record in records)),
                str(sum(record.stopped_early for record in records)),
            )
        )
    header = ("planner", "success rate", "correct rate", "proved optimal", "stopped by a limit")
    return [
        "## Success and correctness",
        "",
        "Success: the planner says that it has a plan. Correct: code that shares nothing with the "
        "planner re-integrates the plan and finds every limit, transition and the goal met "
        "(1e-6 m, rad, 1/m). The published loop gives a path without a clock; of it only the "
        "goal, the curvature range and that the units stay apart are checked.",
        "",
        *table(header, rows),
    ]


def _times(problems: Sequence[OneProblem], limit_s: float, shift_s: float) -> list[str]:
    rows = []
    for name in PLANNERS:
        records = [one[name] for one in problems]
        wall = [1e3 * record.timing.median_s for record in records]
        cpu = [1e3 * record.timing.cpu_median_s for record in records]
        scored = [r.timing.median_s if r.correct else limit_s for r in records]
        rows.append(
            (
                name,
                quantiles(wall, _SPREAD, ".1f"),
                quantiles(cpu, _SPREAD, ".1f"),
                milliseconds(shifted_geometric_mean(scored, shift_s)),
                milliseconds(max(record.timing.first_s for record in records)),
            )
        )
    against = [
        f"- Wall time of the optimal planner over that of the {name}, problem by problem: "
        f"median {np.median(time_ratios(problems, name)):.3g}, "
        f"smallest {min(time_ratios(problems, name)):.3g}, "
        f"largest {max(time_ratios(problems, name)):.3g}."
        for name in PLANNERS[1:]
    ]
    header = (
        "planner",
        "wall time [ms] median / p90 / p99",
        "CPU time [ms] median / p90 / p99",
        "shifted geometric mean [ms]",
        "longest first call [ms]",
    )
    return [
        "## Time",
        "",
        "Warm calls; a problem's time is the median of its repeats. Quantiles are over all "
        f"problems; the geometric mean is shifted by {milliseconds(shift_s)} ms and counts a run "
        f"that is not correct with the time limit of {limit_s:g} s. The longest first call built "
        "the compiled functions.",
        "",
        *table(header, rows),
        *against,
        "",
    ]


def _costs(problems: Sequence[OneProblem]) -> list[str]:
    ratios = list(cost_ratios(problems).values())
    gaps = [one["optimal"].gap for one in problems]
    proved = [100 * gap for gap in gaps if gap is not None]
    lines = ["## Cost and proof", ""]
    if ratios:
        lines.append(
            f"- Cost over the greedy planner's, where both are correct ({len(ratios)} of "
            f"{len(problems)}): median {np.median(ratios):.3f}, smallest {min(ratios):.3f}, "
            f"largest {max(ratios):.3f}."
        )
    if proved:
        lines.append(
            f"- Proved gap of the optimal planner: median {np.median(proved):.2g} %, "
            f"p90 {np.quantile(proved, 0.9):.2g} %, largest {max(proved):.2g} %."
        )
    reached = [one["optimal"].goal_error for one in problems if one["optimal"].correct]
    if reached:
        largest = max(error for error in reached if error is not None)
        lines.append(
            f"- Largest goal error of the optimal planner after re-integration: {largest:.1e} "
            "(m, rad, 1/m)."
        )
    return [*lines, ""]


def _worst(problems: Sequence[OneProblem]) -> list[str]:
    ours = [one["optimal"] for one in problems]
    slow = sorted(ours, key=lambda record: -record.timing.median_s)[:_WORST]
    loose = sorted(ours, key=lambda record: -(record.gap or 0.0))[:_WORST]
    wrong = [record for one in problems for record in one.values() if not record.correct]
    slowest = ", ".join(f"{r.problem} ({milliseconds(r.timing.median_s)} ms)" for r in slow)
    loosest = ", ".join(f"{r.problem} ({percent(r.gap)})" for r in loose)
    return [
        "## What looks bad",
        "",
        f"- Slowest for the optimal planner: {slowest}.",
        f"- Largest proved gaps: {loosest}.",
        *(
            f"- Not correct: {r.problem}, {r.planner} ({r.status}): "
            f"{r.message if not r.success else 'says it has a plan, which does not verify'}"
            for r in wrong
        ),
        "",
    ]


def _every_problem(problems: Sequence[OneProblem]) -> list[str]:
    ratios = cost_ratios(problems)
    rows = []
    for one in problems:
        ours, greedy, loop = (one[name] for name in PLANNERS)
        ratio = ratios.get(ours.problem)
        rows.append(
            (
                ours.problem,
                f"`{ours.sequence_name}`",
                _seconds(ours),
                f"`{greedy.sequence_name}`",
                _seconds(greedy),
                "-" if ratio is None else f"{ratio:.3f}",
                percent(ours.gap),
                *(milliseconds(record.timing.median_s) for record in (ours, greedy, loop)),
            )
        )
    header = (
        *("problem", "optimal", "cost [s]", "greedy", "cost [s]", "ratio", "proved gap"),
        *("optimal [ms]", "greedy [ms]", "published loop [ms]"),
    )
    return ["## Every problem", "", *table(header, rows)]


def _seconds(record: PlanRecord) -> str:
    if record.cost is None:
        return record.status
    return f"{record.cost:.1f}" if record.correct else f"{record.cost:.1f} (not correct)"


def _limitations() -> list[str]:
    return [
        "## Limitations",
        "",
        "- The greedy planner pays for exact flow, schedule and verification like any plan; the "
        "published loop pays for none of these and knows no transition time.",
        "- Random problems are uniform in pose and curvature; real tasks are not.",
        "- A gap is against the planner's own model of robot and transitions, not the hardware.",
        "- The machine may be shared: where CPU time is well below wall time, others were at work. "
        "Compare within one run only.",
        "",
    ]
