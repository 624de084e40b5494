"""Plans beside other plans: ``twosra compare`` and ``explain``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from twosra_mpc.analysis.alternatives import Alternative
from twosra_mpc.analysis.critical_path import Activity, in_words
from twosra_mpc.analysis.explanation import Explanation, explain
from twosra_mpc.cli.options import SCENARIO, Load, command, plot_option, scenario_options
from twosra_mpc.cli.output import EXIT_INFEASIBLE, EXIT_NO_PLAN, EXIT_PLANNED, Output, print_table
from twosra_mpc.cli.planning import exit_code, plan_with_progress
from twosra_mpc.plans.plan import Status, quality
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.modes import sequence_name

if TYPE_CHECKING:
    from twosra_mpc.analysis.reshaping import Reshaping

PLANNERS = ("optimal", "greedy")
_MEASURES = ("duration_s", "waiting_s", "moving_s", "transitions", "energy_J", "cost_s")
PLANS = ("scenario", "planner", "mode sequence", "duration", "cost ratio", "status", "proved")
EFFORT = ("scenario", "planner", "waiting", "moving", "transitions", "energy")


@command("compare")
@click.argument("scenarios", nargs=-1, required=True, metavar="SCENARIO...", **SCENARIO)
@scenario_options("robot", "path_model", "timing", "gap", "work_limit", "time_limit_s", "exact")
@plot_option("Draw them on one time axis")
def compare_command(
    scenarios: tuple[str, ...], load: Load, plot: Path | None, output: Output
) -> int:
    """Plan every SCENARIO by this planner and by the greedy rule, side by side.

    Both plans have the same thermal model, speed limits and verification. The cost ratio is that of
    a plan to the first of its scenario.

    \b
    The published experiments, as a table and as a figure:
      twosra compare paper-1 paper-2 paper-3 paper-4 paper-5 --plot comparison.png
    For a program:
      twosra compare paper-1 my-scenario.toml --json
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
    from twosra_mpc.plotting.plan_figures import plot_comparison

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
        "duration_s": made.duration_s,
        "waiting_s": made.duration_s - made.moving_s,
        "moving_s": made.moving_s,
        "transitions": cost.transitions,
        "energy_J": cost.energy_J,
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


@command("explain")
@click.argument("scenario", **SCENARIO)
@scenario_options("robot", "path_model", "timing", "gap", "work_limit", "time_limit_s", "exact")
def explain_command(scenario: str, load: Load, output: Output) -> int:
    """Explain the plan of SCENARIO: what its duration is made of, what other plans would cost.

    Every other plan is found by planning again: the next best mode sequence, each mode forbidden,
    one heater, slower metal. Among obstacles: the next best mode sequence, the next best way round,
    5 mm more clearance; and why it reshapes, and where. Of a mission: what tasks share, what each
    costs, what they would cost goal by goal and in other orders. --time-limit is for each of the
    plans. Ctrl-C prints what is known so far.

    \b
    Why these modes, in this order?
      twosra explain paper-4
    With another model of how the fibre bends, at most five seconds for each plan, as JSON:
      twosra explain paper-4 --path-model arc --time-limit 5 --json
    What do the tasks of a mission share?
      twosra explain three-shapes
    """
    problem = load(scenario)
    with output.progress("planning") as tell:
        found = explain(problem, on_progress=lambda words: tell(f"planning {words}"))
    output.report(lambda: _explanation(found), lambda: _print_explanation(found))
    if not found.complete:
        click.echo("twosra: interrupted before all alternatives were planned", err=True)
    if found.result.status is Status.INFEASIBLE:
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if found.result.found and found.complete else EXIT_NO_PLAN


def _explanation(found: Explanation) -> dict[str, Any]:
    """The explanation as plain data."""
    others, reshaping = found.alternatives, found.reshaping
    return {
        "plan": found.result.to_dict(),
        "why": found.why,
        "critical_path": [_activity(item) for item in found.critical_path],
        "hidden": [
            {**_activity(one.activity), "during": [str(item) for item in one.during]}
            for one in found.hidden
        ],
        "tasks": [
            {**vars(each), "duration_s": each.duration_s, "shares": each.shares}
            for each in found.tasks
        ],
        "compared_s": others[0].original.cost.total if others else None,
        "alternatives": list(map(_alternative, others)),
        "orders_left": found.orders_left,
        "reshaping": None if reshaping is None else _reshaping(reshaping),
        "complete": found.complete,
    }


def _alternative(other: Alternative) -> dict[str, Any]:
    return {
        "change": other.change,
        "cost_s": other.cost,
        "difference_s": other.difference_s,
        "difference": other.difference,
        "outcome": other.outcome,
        "status": other.result and str(other.result.status),
        "duration_s": other.plan and other.plan.duration_s,
    }


def _reshaping(found: Reshaping) -> dict[str, Any]:
    return {
        "why": found.why,
        "blocked": [{"words": each.words, "obstacles": each.obstacles} for each in found.blocked],
        "places": [place._asdict() | {"words": str(place)} for place in found.places],
    }


def _activity(item: Activity) -> dict[str, Any]:
    keys = ("kind", "segments", "start_s", "end_s", "duration_s")
    return {key: getattr(item, key) for key in keys} | {"words": str(item)}


def _print_explanation(found: Explanation) -> None:
    made, path = found.result, found.critical_path
    rows = [("status", made.status.words), ("outcome", made.message)]
    rows += _named_once("why", found.why)
    if found.reshaping is not None:
        rows += _named_once("reshaping" if made.found else "blocked", found.reshaping.why)
        rows += _named_once("where", found.reshaping.places)
    print_table((made.problem.robot.name, f"planner {made.planner}"), rows)
    if found.tasks:
        tasks = [
            (each.words, f"{each.duration_s:z8.2f} s", f"{each.energy_J:z.0f} J", each.shares)
            for each in found.tasks
        ]
        print_table(("task", "takes", "heat", "melts"), tasks)
    if path:
        rows = [(f"{lasts:z8.2f} s", words) for lasts, words in in_words(path)]
        print_table((f"{path[-1].end_s:z8.2f} s", "is the sum of"), rows)
    if found.hidden:
        rows = [(f"{one.activity.duration_s:z8.2f} s", str(one)) for one in found.hidden]
        print_table(("at no cost", "meanwhile"), rows)
    options = [(other.change, other.price, other.outcome) for other in found.alternatives]
    if found.orders_left:
        options.append(("in other orders", "", f"{found.orders_left} were not planned"))
    if options:
        compared = "instead, at full speed" if made.problem.drives_gently else "instead"
        print_table((compared, "costs more", "outcome"), options)


def _named_once(name: str, items: Sequence[object]) -> list[tuple[str, str]]:
    """Rows of a table of which only the first has a name."""
    return [("" if i else name, str(item)) for i, item in enumerate(items)]
