"""``twosra explain`` and ``twosra compare``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import click

from twosra_mpc import PlanInterrupted, Problem, Result, Status
from twosra_mpc.cli import options
from twosra_mpc.cli.options import SCENARIO, Load, Plot, argument, command, overrides
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.cli.planning import exit_code, plan_with_progress
from twosra_mpc.files import attributes
from twosra_mpc.lab.analysis import explanation
from twosra_mpc.lab.analysis.critical_path import Activity
from twosra_mpc.plans.plan import quality
from twosra_mpc.robot.modes import sequence_name


@options.command("explain")
def explain_command(
    scenario: options.Scenario,
    load: Annotated[options.Load, options.overrides("planner", "max_phases")],
    output: Output,
) -> int:
    """Explain the plan of SCENARIO: what its duration is made of, what other plans would cost.

    Every other plan is found by planning again: the next best mode sequence, each mode forbidden,
    one heater. Among obstacles: the next best mode sequence, 5 mm more clearance; and what is
    proved of its reshaping. Of a mission: what tasks share, what each costs, what they would cost
    in other orders. --time-limit is for each of the plans. Ctrl-C
    prints what is known so far.

    \b
    Why these modes, in this order?
      twosra explain paper-4
    With another model of how the fibre bends, at most five seconds for each plan, as JSON:
      twosra explain paper-4 --path-model arc --time-limit 5 --json
    What do the tasks of a mission share?
      twosra explain three-shapes
    What would wider tolerances or a measured robot save, where joint bends are uncertain?
      twosra explain paper-5 --risk mean
    """
    problem = load(scenario)
    with output.progress("planning") as tell:
        try:
            found = explanation.explain(
                problem, on_progress=lambda words: tell(f"planning {words}")
            )
        except PlanInterrupted as interrupted:
            found = interrupted.result
    output.report(lambda: _explanation(found), lambda: _print_explanation(found))
    if not found.complete:
        click.echo(f"twosra: interrupted: {found.message}", err=True)
    if found.result.status is Status.INFEASIBLE:
        return Exit.INFEASIBLE
    return Exit.PLANNED if found.result.found and found.complete else Exit.NO_PLAN


def _explanation(found: explanation.Explanation) -> dict[str, Any]:
    """The explanation as plain data."""
    others = found.alternatives
    return {
        "plan": found.result.to_dict(),
        "why": found.why,
        "critical_path": [_activity(item) for item in found.critical_path],
        "hidden": [
            {**_activity(one.activity), "during": [str(item) for item in one.during]}
            for one in found.hidden
        ],
        "tasks": [
            {**vars(each), **attributes(each, "duration_s", "shares")} for each in found.tasks
        ],
        "compared_s": others[0].compared_s if others else None,
        "alternatives": [
            {
                "change": other.change,
                **attributes(other, "cost_s", "difference_s", "difference", "outcome"),
                "status": other.result and str(other.result.status),
                "duration_s": other.plan and other.plan.duration_s,
            }
            for other in others
        ],
        "orders_left": found.orders_left,
        "complete": found.complete,
    }


def _activity(item: Activity) -> dict[str, Any]:
    known = attributes(item, "kind", "segments", "start_s", "end_s", "duration_s")
    return {**known, "words": str(item)}


def _print_explanation(found: explanation.Explanation) -> None:
    made = found.result
    rows = [("status", made.status.words), ("outcome", made.message)]
    rows += [("" if i else "why", reason) for i, reason in enumerate(found.why)]
    print_table((made.problem.robot.name, f"planner {made.planner}"), rows)
    for table in found.tables:
        print_table(*table)


PLANNERS = ("optimal", "greedy")
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
    from twosra_mpc.lab.figures.atlas_figure import plot_comparison

    made = {name: [one.plan for one in each if one.plan] for name, each in results.items()}
    shown = {name: each for name, each in made.items() if each}
    if shown:
        plot_comparison(shown, plot)
    else:
        click.echo(f"twosra: there is no plan to draw in {plot}", err=True)


def _record(name: str, result: Result, rivals: Sequence[Result]) -> dict[str, Any]:
    """Numbers of one plan; None where there is none."""
    made, first = result.plan, rivals[0].plan
    cost, best = made and made.cost, first and first.cost.total
    return {
        "scenario": name,
        "planner": result.planner,
        "status": str(result.status),
        "message": result.message,
        "modes": made.sequence if made else [],
        "duration_s": made and made.duration_s,
        "waiting_s": made and made.duration_s - made.moving_s,
        "moving_s": made and made.moving_s,
        "transitions": cost and cost.transitions,
        "energy_J": cost and cost.energy_J,
        "cost_s": cost and cost.total,
        "lower_bound_s": result.lower_bound,
        "gap": result.gap,
        "fastest_cost_s": made and made.fastest_cost,
        "search_gap": made and made.search_gap,
        "cost_ratio": cost.total / best if cost and best else None,
        "proved": quality(made) if made and made.lower_bound is not None else "",
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
