"""``twosra explain``."""

from __future__ import annotations

from typing import Annotated, Any

import click

from twosra_mpc.cli import options
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.errors import PlanInterrupted
from twosra_mpc.files import attributes
from twosra_mpc.lab.analysis import explanation
from twosra_mpc.lab.analysis.critical_path import Activity
from twosra_mpc.plans.plan import Status


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
