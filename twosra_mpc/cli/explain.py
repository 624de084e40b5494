"""``twosra explain``."""

from __future__ import annotations

from typing import Any

import click

from twosra_mpc.analysis.critical_path import Activity, in_words
from twosra_mpc.analysis.explanation import Explanation, explain
from twosra_mpc.cli.options import SCENARIO, Load, output_options, scenario_options
from twosra_mpc.cli.output import EXIT_INFEASIBLE, EXIT_NO_PLAN, EXIT_PLANNED, Output, print_table
from twosra_mpc.plans.plan import Status

_HELP = """Explain the plan of SCENARIO: what its duration is made of, what other plans would cost.

Every other plan is found by planning again: the next best mode sequence, each mode forbidden, one
heater, slower metal. --time-limit is for each of the plans. Ctrl-C prints what is known so far.

\b
Why these modes, in this order?
  twosra explain paper-4
With another model of how the fibre bends, and at most five seconds for each of the plans, as JSON:
  twosra explain paper-4 --path-model arc --time-limit 5 --json
"""


@click.command("explain", help=_HELP)
@click.argument("scenario", **SCENARIO)
@scenario_options("robot", "path_model", "timing", "gap", "time_limit_s")
@output_options
def explain_command(scenario: str, load: Load, output: Output) -> int:
    """Explain a plan; see ``_HELP``."""
    problem = load(scenario)
    with output.progress("planning") as tell:
        found = explain(problem, on_progress=lambda words: tell(f"planning {words}"))
    output.report(lambda: _document(found), lambda: _print(found))
    if not found.complete:
        click.echo("twosra: interrupted before all alternatives were planned", err=True)
    return _exit_code(found)


def _document(found: Explanation) -> dict[str, Any]:
    """The explanation as plain data."""
    return {
        "plan": found.result.to_dict(),
        "why": found.why,
        "critical_path": [_activity(item) for item in found.critical_path],
        "hidden": [
            {**_activity(one.activity), "during": [str(item) for item in one.during]}
            for one in found.hidden
        ],
        "alternatives": [
            {
                "change": other.change,
                "difference_s": other.difference_s,
                "difference": other.difference,
                "outcome": other.outcome,
                "status": other.result and str(other.result.status),
                "duration_s": other.plan and other.plan.duration_s,
            }
            for other in found.alternatives
        ],
        "complete": found.complete,
    }


def _activity(item: Activity) -> dict[str, Any]:
    keys = ("kind", "segments", "start_s", "end_s", "duration_s")
    return {key: getattr(item, key) for key in keys} | {"words": str(item)}


def _print(found: Explanation) -> None:
    _print_reasons(found)
    _print_duration(found)
    if found.alternatives:
        rows = [(other.change, other.price, other.outcome) for other in found.alternatives]
        print_table(("instead", "costs more", "outcome"), rows)


def _print_reasons(found: Explanation) -> None:
    made = found.result
    rows = [("status", str(made.status)), ("outcome", made.message)]
    rows += [("why" if i == 0 else "", reason) for i, reason in enumerate(found.why)]
    print_table((made.problem.robot.name, made.planner), rows)


def _print_duration(found: Explanation) -> None:
    if not found.critical_path:
        return
    told = in_words(found.critical_path)
    rows = [(f"{duration:8.2f} s", words) for duration, words in told]
    print_table((f"{found.critical_path[-1].end_s:8.2f} s", "is the sum of"), rows)
    if found.hidden:
        rows = [(f"{one.activity.duration_s:8.2f} s", str(one)) for one in found.hidden]
        print_table(("at no cost", "meanwhile"), rows)


def _exit_code(found: Explanation) -> int:
    if found.result.status is Status.INFEASIBLE:
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if found.result.found and found.complete else EXIT_NO_PLAN
