"""``twosra compare``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.options import SCENARIO, Load, output_options, plot_option, scenario_options
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.cli.planning import exit_code, plan_with_progress
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import sequence_name

PLANNERS = ("optimal", "greedy")
PLANS = ("scenario", "planner", "mode sequence", "duration", "cost ratio", "gap", "status")
EFFORT = ("scenario", "planner", "waiting", "moving", "transitions", "energy")

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
@click.argument("scenarios", nargs=-1, required=True, metavar="SCENARIO...", **SCENARIO)
@scenario_options("robot", "path_model", "timing", "gap", "time_limit_s")
@plot_option("Draw them on one time axis")
@output_options
def compare_command(
    scenarios: tuple[str, ...], load: Load, plot: Path | None, output: Output
) -> int:
    """Compare planners; see ``_HELP``."""
    plans = _plans({name: load(name) for name in scenarios}, output)
    if plot is not None:
        with output.progress("drawing"):
            _draw(plans, plot)
    records = [_record(name, made, each) for name, each in plans.items() for made in each]
    output.report(lambda: records, lambda: _print_records(records))
    return exit_code(*(each[0] for each in plans.values()))  # the greedy rule may find nothing


def _plans(problems: dict[str, Problem], output: Output) -> dict[str, tuple[Plan, ...]]:
    """Plans of both planners by name of the problem."""
    plans: dict[str, tuple[Plan, ...]] = {}
    for number, (name, problem) in enumerate(problems.items(), start=1):
        words = f"planning {name} ({number} of {len(problems)})"
        plans[name] = tuple(
            plan_with_progress(
                problem.model_copy(update={"planner": planner}), output, f"{words}, {planner}"
            )
            for planner in PLANNERS
        )
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


def _print_records(records: Sequence[dict[str, Any]]) -> None:
    """Print what each plan is, and what it takes; cells are empty where there is no number."""
    plans, effort = [], []
    for record in records:
        named = (record["scenario"], record["planner"])
        if record["duration_s"] is None:
            plans.append((*named, "", "", "", "", record["status"]))
            continue
        gap, ratio = record["gap"], record["cost_ratio"]
        proved = "" if gap is None else f"{100 * gap:.2g} %" if gap > 1e-5 else "< 0.001 %"
        compared = "" if ratio is None else f"{ratio:.3f}"
        duration, modes = f"{record['duration_s']:.1f} s", sequence_name(record["modes"])
        plans.append((*named, modes, duration, compared, proved, record["status"]))
        times = (f"{record['waiting_s']:.1f} s", f"{record['moving_s']:.2f} s")
        effort.append((*named, *times, f"{record['transitions']}", f"{record['energy_J']:.0f} J"))
    print_table(PLANS, plans)
    if effort:
        print_table(EFFORT, effort)
