"""``twosra compare``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.options import output_options, plot_option
from twosra_mpc.cli.output import (
    EXIT_INFEASIBLE,
    EXIT_NO_PLAN,
    EXIT_PLANNED,
    Output,
    print_table,
)
from twosra_mpc.modes import sequence_name
from twosra_mpc.plan import Plan, Status
from twosra_mpc.planner import plan
from twosra_mpc.problem import Problem, load_problem

PLANNERS = ("optimal", "greedy")
HEADER = (
    *("scenario", "planner", "mode sequence", "duration", "waiting", "moving", "transitions"),
    *("energy", "gap", "status", "cost ratio"),
)

_HELP = """Plan every SCENARIO by this planner and by the greedy rule, side by side.

Both plans have the same thermal model, speed limits and verification. The cost ratio is that of a
plan to the first of its scenario.

\b
The published experiments, as a table and as a figure:
  twosra compare paper-1 paper-2 paper-3 paper-4 paper-5 --plot comparison.png
For a program:
  twosra compare paper-1 my-scenario.toml --json
"""


@click.command("compare", help=_HELP)
@click.argument("scenarios", nargs=-1, required=True, metavar="SCENARIO...")
@click.option("--robot", help="Override the robot: a built-in name or a file.")
@click.option("--timing", help="Override the set of transition times, e.g. paper.")
@click.option("--gap", type=float, help="Relative gap to stop at, e.g. 0.01.")
@click.option("--time-limit", "time_limit_s", type=float, help="Search for at most this long [s].")
@plot_option("Draw them on one time axis")
@output_options
def compare_command(
    scenarios: tuple[str, ...], plot: Path | None, output: Output, **overrides: Any
) -> int:
    """Compare planners; see ``_HELP``."""
    given = {key: value for key, value in overrides.items() if value is not None}
    problems = {name: load_problem(name, **given) for name in scenarios}
    plans = _plans(problems, output)
    if plot is not None:
        _draw(plans, plot)
    records = [_record(name, made, each) for name, each in plans.items() for made in each]
    output.report(lambda: records, lambda: print_table(HEADER, [_cells(one) for one in records]))
    return _exit_code([each[0] for each in plans.values()])


def _plans(problems: dict[str, Problem], output: Output) -> dict[str, tuple[Plan, ...]]:
    """Plans of both planners by name of the problem."""
    plans: dict[str, tuple[Plan, ...]] = {}
    with output.progress("planning") as tell:
        for number, (name, problem) in enumerate(problems.items(), start=1):
            made = []
            for planner in PLANNERS:
                tell(f"planning {name} ({number} of {len(problems)}): {planner}")
                made.append(plan(problem.model_copy(update={"planner": planner})))
            plans[name] = tuple(made)
    return plans


def _draw(plans: dict[str, tuple[Plan, ...]], plot: Path) -> None:
    """Draw the plans that there are."""
    from twosra_mpc.plotting.comparison_figure import plot_comparison

    made = {name: [one for one in each if one.samples is not None] for name, each in plans.items()}
    shown = {name: each for name, each in made.items() if each}
    if shown:
        plot_comparison(shown, plot)
    else:
        click.echo(f"twosra: there is no plan to draw in {plot}", err=True)


def _record(name: str, made: Plan, rivals: Sequence[Plan]) -> dict[str, Any]:
    """Numbers of one plan; None where there is none."""
    cost, first = made.cost, rivals[0].cost
    return {
        "scenario": name,
        "planner": made.planner,
        "status": str(made.status),
        "message": made.message,
        "modes": [phase.mode for phase in made.phases],
        "duration_s": made.duration_s,
        "waiting_s": None if cost is None else cost.time_s - made.moving_s,
        "moving_s": None if cost is None else made.moving_s,
        "transitions": None if cost is None else cost.transitions,
        "energy_J": None if cost is None else cost.energy_J,
        "cost_s": None if cost is None else cost.total,
        "lower_bound_s": made.lower_bound,
        "gap": made.gap,
        "cost_ratio": cost.total / first.total if cost and first and first.total else None,
    }


def _cells(record: dict[str, Any]) -> tuple[str, ...]:
    """A row of the table; empty where there is no number."""
    formats = {
        "duration_s": "{:.1f} s",
        "waiting_s": "{:.1f} s",
        "moving_s": "{:.2f} s",
        "transitions": "{}",
        "energy_J": "{:.0f} J",
        "cost_ratio": "{:.3f}",
    }
    cells = {
        key: "" if record[key] is None else form.format(record[key])
        for key, form in formats.items()
    }
    modes = sequence_name(record["modes"]) if record["duration_s"] is not None else ""
    ratio, gap = cells.pop("cost_ratio"), record["gap"]
    proved = "" if gap is None else f"{100 * gap:.2g} %" if gap > 1e-5 else "< 0.001 %"
    named = (record["scenario"], record["planner"], modes)
    return (*named, *cells.values(), proved, record["status"], ratio)


def _exit_code(plans: Sequence[Plan]) -> int:
    """Judge by the optimal planner; that the greedy rule finds nothing is a result."""
    if any(made.status is Status.INFEASIBLE for made in plans):
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if all(m.found and not m.stopped_early for m in plans) else EXIT_NO_PLAN
