"""``twosra compare``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import click

from twosra_mpc.cli.options import SCENARIO, Load, Plot, argument, command, overrides
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.cli.planning import exit_code, plan_with_progress
from twosra_mpc.files import attributes
from twosra_mpc.plans.plan import quality
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import sequence_name

PLANNERS = ("optimal", "greedy")
_MEASURES = ("duration_s", "waiting_s", "moving_s", "transitions", "energy_J", "cost_s")
PLANS = ("scenario", "planner", "mode sequence", "duration", "cost ratio", "status", "proved")
EFFORT = ("scenario", "planner", "waiting", "moving", "transitions", "energy")


@command("compare")
def compare_command(
    scenarios: Annotated[tuple[str, ...], argument("SCENARIO...", **SCENARIO)],
    load: Annotated[Load, overrides("planner", "max_phases", "risk")],
    plot: Plot,
    output: Output,
) -> int:
    """Plan every SCENARIO by this planner and by the greedy rule, side by side.

    Both plans have the same thermal model, speed limits and verification. The cost ratio is that of
    a plan to the first of its scenario.

    \b
    The published experiments, as a table and as a figure:
      twosra compare paper-1 paper-2 paper-3 paper-4 paper-5 --plot comparison.png
    For a program:
      twosra compare paper-1 my-scenario.toml --json

    Options:
        plot: Draw them on one time axis (png, pdf, svg).
    """
    results = _results({name: load(name) for name in scenarios}, output)
    if plot is not None:
        with output.progress("drawing"):
            _draw(results, plot)
    records = [_record(name, one, each) for name, each in results.items() for one in each]
    output.report(lambda: records, lambda: _print_records(records))
    return exit_code(*(each[0] for each in results.values()))  # the greedy rule may find nothing


def _results(problems: dict[str, Problem], output: Output) -> dict[str, tuple[Result, ...]]:
    """Results of both planners, by name of the problem."""
    results: dict[str, tuple[Result, ...]] = {}
    for number, (name, problem) in enumerate(problems.items(), start=1):
        words = f"planning {name} ({number} of {len(problems)})"
        results[name] = tuple(
            plan_with_progress(problem.with_values(planner=planner), output, f"{words}, {planner}")
            for planner in PLANNERS
        )
    return results


def _draw(results: dict[str, tuple[Result, ...]], plot: Path) -> None:
    """Draw the plans that there are."""
    from twosra_mpc.lab.figures.comparison_figure import plot_comparison

    made = {name: [one.plan for one in each if one.plan] for name, each in results.items()}
    shown = {name: each for name, each in made.items() if each}
    if shown:
        plot_comparison(shown, plot)
    else:
        click.echo(f"twosra: there is no plan to draw in {plot}", err=True)


def _record(name: str, result: Result, rivals: Sequence[Result]) -> dict[str, Any]:
    """Numbers of one plan; None where there is none."""
    record: dict[str, Any] = {
        "scenario": name,
        "planner": result.planner,
        "status": str(result.status),
        "message": result.message,
        "modes": [],
        **dict.fromkeys(_MEASURES),
        "lower_bound_s": result.lower_bound,
        "gap": result.gap,
        **dict.fromkeys(("fastest_cost_s", "search_gap", "cost_ratio")),
        "proved": "",
    }
    if (made := result.plan) is None:
        return record
    cost, first = made.cost, rivals[0].plan
    return record | {
        "modes": made.sequence,
        **attributes(made, "duration_s", "moving_s"),
        **attributes(cost, "transitions", "energy_J"),
        "waiting_s": made.duration_s - made.moving_s,
        "cost_s": cost.total,
        "fastest_cost_s": made.fastest_cost,
        "search_gap": made.search_gap,
        "proved": "" if made.lower_bound is None else quality(made),
        "cost_ratio": cost.total / first.cost.total if first and first.cost.total else None,
    }


def _print_records(records: Sequence[dict[str, Any]]) -> None:
    """Print what each plan is, and what it takes; cells are empty where there is no number."""
    plans, effort = [], []
    for record in records:
        named = (record["scenario"], record["planner"])
        if record["duration_s"] is None:
            plans.append((*named, "", "", "", record["status"], ""))
            continue
        compared = "" if record["cost_ratio"] is None else f"{record['cost_ratio']:z.3f}"
        duration, modes = f"{record['duration_s']:z.1f} s", sequence_name(record["modes"])
        plans.append((*named, modes, duration, compared, record["status"], record["proved"]))
        times = (f"{record['waiting_s']:z.1f} s", f"{record['moving_s']:z.2f} s")
        effort.append((*named, *times, f"{record['transitions']}", f"{record['energy_J']:z.0f} J"))
    print_table(PLANS, plans)
    if effort:
        print_table(EFFORT, effort)
