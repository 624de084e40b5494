"""Run both planners on a problem set and write down what came out, correctness beside time."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from benchmarks.problem_set import ProblemSet
from twosra_mpc import Plan, plan

PLANNERS = ("optimal", "greedy")


@dataclass(frozen=True)
class Run:
    """One problem, both planners."""

    label: str
    plans: dict[str, Plan]
    wall_s: dict[str, float]


def run_set(problems: ProblemSet, on_done: Callable[[str], None]) -> list[Run]:
    """Plan every problem with both planners, the compiled model warm."""
    _, first = problems.problems[0]
    for planner in PLANNERS:
        plan(first.model_copy(update={"planner": planner}))
    runs = []
    for label, problem in problems.problems:
        plans, wall = {}, {}
        for planner in PLANNERS:
            started = time.perf_counter()
            plans[planner] = plan(problem.model_copy(update={"planner": planner}))
            wall[planner] = time.perf_counter() - started
        runs.append(Run(label, plans, wall))
        on_done(label)
    return runs


def report(problems: ProblemSet, runs: Sequence[Run]) -> str:
    """Write the Markdown report."""
    lines = [
        f"# {problems.name}: {len(runs)} problems",
        "",
        f"Python {platform.python_version()}, casadi {version('casadi')}, "
        f"scipy {version('scipy')}, numpy {version('numpy')}, {platform.machine()}, "
        "compiled model warm, one thread.",
        "",
        "| planner | found and verified | optimal | duration [s] median / p90 / max "
        "| largest proved gap | wall time [ms] median / p90 / p99 |",
        "|---|---|---|---|---|---|",
        *(_planner_row(planner, runs) for planner in PLANNERS),
        "",
        *_comparison(runs),
    ]
    if problems.redrawn:
        lines.append(f"- {problems.redrawn} random problems were drawn again: units would overlap.")
    lines += [
        "- Limitation: the greedy planner here pays for exact flow and verification like any plan;",
        "  its bare loop, as published, is faster. Machines differ: compare within one run only.",
        "",
    ]
    return "\n".join(lines)


def _planner_row(planner: str, runs: Sequence[Run]) -> str:
    plans = [run.plans[planner] for run in runs]
    found = [made for made in plans if made.found]
    durations = [made.duration_s for made in found if made.duration_s is not None]
    gaps = [made.gap for made in found if made.gap is not None]
    wall = 1e3 * np.array([run.wall_s[planner] for run in runs])
    optimal = sum(made.status == "optimal" for made in plans)
    spread = " / ".join(f"{np.quantile(durations, q):.1f}" for q in (0.5, 0.9, 1.0))
    times = " / ".join(f"{np.quantile(wall, q):.0f}" for q in (0.5, 0.9, 0.99))
    gap = f"{100 * max(gaps):.2g} %" if gaps else "no bound"
    return f"| {planner} | {len(found)} of {len(plans)} | {optimal} | {spread} | {gap} | {times} |"


def _comparison(runs: Sequence[Run]) -> list[str]:
    both = [run for run in runs if all(run.plans[planner].found for planner in PLANNERS)]
    ratios = np.array(
        [
            (run.plans["optimal"].duration_s or 0.0) / (run.plans["greedy"].duration_s or 1.0)
            for run in both
        ]
    )
    wall = np.array([run.wall_s["optimal"] / run.wall_s["greedy"] for run in runs])
    errors = [
        max(abs(error) for error in run.plans["optimal"].verification.goal_error)
        for run in runs
        if run.plans["optimal"].verification is not None
    ]
    return [
        f"- Duration against greedy, where both plan ({len(both)}): "
        f"median {np.median(ratios):.3f}, largest {ratios.max():.3f}.",
        f"- Wall time against the greedy planner: median {np.median(wall):.2f}.",
        f"- Largest goal error of the optimal planner after re-integration: {max(errors):.1e} "
        "(m, rad, 1/m).",
    ]
