"""Plans beside other plans: ``twosra compare``, ``compare-models`` and ``explain``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from twosra_mpc.analysis.critical_path import Activity, in_words
from twosra_mpc.analysis.explanation import Alternative, Explanation, explain
from twosra_mpc.analysis.mission_explanation import MissionExplanation, explain_mission
from twosra_mpc.analysis.model_comparison import ModelComparison, compare_models
from twosra_mpc.cli.options import SCENARIO, Load, command, plot_option, scenario_options
from twosra_mpc.cli.output import EXIT_INFEASIBLE, EXIT_NO_PLAN, EXIT_PLANNED, Output, print_table
from twosra_mpc.cli.planning import exit_code, plan_with_progress
from twosra_mpc.plans.headline import quality
from twosra_mpc.plans.plan import Status
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
    """What both planners come to, by name of the problem."""
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


@command("compare-models")
@click.argument("scenario", **SCENARIO)
@scenario_options("robot", "timing", "gap", "work_limit", "time_limit_s", "exact")
def compare_models_command(scenario: str, load: Load, output: Output) -> None:
    """Plan SCENARIO under each path model, and execute each plan under the others.

    \b
    How far does the robot end from the goal if it bends otherwise than planned?
      twosra compare-models paper-2
    The same with constant times of melting and freezing, for a program to read:
      twosra compare-models paper-2 --timing constant --json
    """
    problem = load(scenario)
    with output.progress("planning under each path model"):
        result = compare_models(problem)
    output.report(lambda: _comparison(result), lambda: _print_comparison(result))


def _comparison(result: ModelComparison) -> dict[str, Any]:
    """The comparison as plain data; end errors as [x m, y m, phi rad, kappa1, kappa2 1/m]."""
    columns = (result.models, result.speeds, result.results, result.end_errors)
    plans = [
        {
            "model": model,
            "speed": speed,
            "status": str(planned.status),
            "duration_s": planned.plan and planned.plan.duration_s,
            "moving_s": planned.plan.moving_s if planned.plan else 0.0,
            "gap": planned.gap,
            "modes": planned.plan.sequence if planned.plan else [],
            "end_error_under": planned.plan and dict(zip(result.models, ends, strict=True)),
        }
        for model, speed, planned, ends in zip(*columns, strict=True)
    ]
    return {"scenario": result.results[0].problem.scenario(), "plans": plans}


def _print_comparison(result: ModelComparison) -> None:
    rows = []
    for name, speed, planned in zip(result.models, result.speeds, result.results, strict=True):
        if (made := planned.plan) is None:
            rows.append((name, str(planned.status), "", "", "", speed))
            continue
        wheel = f"{abs(made.samples.wheel_rad_s).max():z.1f} rad/s"
        took, moving = f"{made.cost.time_s:z.1f} s", f"{made.moving_s:z.2f} s"
        rows.append((name, sequence_name(made.sequence), took, moving, wheel, speed))
    print_table(("model", "mode sequence", "duration", "moving", "wheels", "v_j is"), rows)
    errors = [
        (maker, runner, *(_end_error(error) if planned.plan else ("no plan",)))
        for maker, planned, ends in zip(
            result.models, result.results, result.end_errors, strict=True
        )
        for runner, error in zip(result.models, ends, strict=True)
    ]
    click.echo("Error at the end of each plan, executed by each model:")
    header = ("planned with", "executed by", "position", "heading", "kappa1", "kappa2")
    print_table(header, [(*row, *[""] * (len(header) - len(row))) for row in errors])


def _end_error(error: Any) -> tuple[str, ...]:
    if math.isnan(error[0]):
        return ("bends too far",)
    shift, turn = 1e3 * math.hypot(error[0], error[1]), math.degrees(error[2])
    bends = (f"{value:z.1f} 1/m" for value in error[3:])
    return f"{shift:z.1f} mm", f"{turn:z.1f} deg", *bends


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
    explained: Callable[..., Explanation | MissionExplanation]
    explained = explain_mission if problem.is_mission else explain
    with output.progress("planning") as tell:
        found = explained(problem, on_progress=lambda words: tell(f"planning {words}"))
    if isinstance(found, MissionExplanation):
        output.report(lambda: _mission(found), lambda: _print_mission(found))
    else:
        output.report(lambda: _explanation(found), lambda: _print_explanation(found))
    if not found.complete:
        click.echo("twosra: interrupted before all alternatives were planned", err=True)
    if found.result.status is Status.INFEASIBLE:
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if found.result.found and found.complete else EXIT_NO_PLAN


def _explanation(found: Explanation) -> dict[str, Any]:
    """The explanation as plain data."""
    return {
        "plan": found.result.to_dict(),
        "why": found.why,
        "critical_path": [_activity(item) for item in found.critical_path],
        "hidden": [
            {**_activity(one.activity), "during": [str(item) for item in one.during]}
            for one in found.hidden
        ],
        "alternatives": list(map(_alternative, found.alternatives)),
        "complete": found.complete,
        **({} if found.reshaping is None else {"reshaping": _reshaping(found.reshaping)}),
    }


def _alternative(other: Alternative) -> dict[str, Any]:
    return {
        "change": other.change,
        "difference_s": other.difference_s,
        "difference": other.difference,
        "outcome": other.outcome,
        "status": other.result and str(other.result.status),
        "duration_s": other.plan and other.plan.duration_s,
    }


def _mission(found: MissionExplanation) -> dict[str, Any]:
    """The explanation of a mission as plain data."""
    return {
        "plan": found.result.to_dict(),
        "tasks": [
            {**vars(each), "duration_s": each.duration_s, "shares": each.shares}
            for each in found.tasks
        ],
        "critical_path": [_activity(item) for item in found.critical_path],
        "compared_s": found.quick and found.quick.cost.total,
        "goal_by_goal": [
            {
                "temperatures": way.temperatures,
                "tasks": way.tasks,
                "costs_s": [each.plan and each.plan.cost.total for each in way.results],
                "cost_s": way.cost,
                "melts": way.melts,
                "outcome": found.outcome(way),
            }
            for way in found.goal_by_goal
        ],
        "orders": list(map(_alternative, found.orders)),
        "orders_left": found.orders_left,
        "complete": found.complete,
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
    made = found.result
    rows = [("status", made.status.words), ("outcome", made.message)]
    rows += _named_once("why", found.why)
    if found.reshaping is not None:
        rows += _named_once("reshaping" if made.found else "blocked", found.reshaping.why)
        rows += _named_once("where", found.reshaping.places)
    print_table((made.problem.robot.name, f"planner {made.planner}"), rows)
    _print_sum(found.critical_path)
    if found.hidden:
        rows = [(f"{one.activity.duration_s:z8.2f} s", str(one)) for one in found.hidden]
        print_table(("at no cost", "meanwhile"), rows)
    if found.alternatives:
        options = [(other.change, other.price, other.outcome) for other in found.alternatives]
        compared = "instead, at full speed" if made.problem.drives_gently else "instead"
        print_table((compared, "costs more", "outcome"), options)


def _print_mission(found: MissionExplanation) -> None:
    made = found.result
    rows = [("status", made.status.words), ("outcome", made.message)]
    print_table((made.problem.robot.name, f"planner {made.planner}"), rows)
    if found.tasks:
        tasks = [
            (each.words, f"{each.duration_s:z8.2f} s", f"{each.energy_J:z.0f} J", each.shares)
            for each in found.tasks
        ]
        print_table(("task", "takes", "heat", "melts"), tasks)
    _print_sum(found.critical_path)
    options = [(str(way), found.price(way), found.outcome(way)) for way in found.goal_by_goal]
    options += [(other.change, other.price, other.outcome) for other in found.orders]
    if found.orders_left:
        options.append(("in other orders", "", f"{found.orders_left} were not planned"))
    if options and found.quick is not None:
        compared = f"instead, at full speed ({found.quick.cost.total:z.2f} s)"
        print_table((compared, "costs more", "outcome"), options)


def _print_sum(path: Sequence[Activity]) -> None:
    if path:
        rows = [(f"{lasts:z8.2f} s", words) for lasts, words in in_words(path)]
        print_table((f"{path[-1].end_s:z8.2f} s", "is the sum of"), rows)


def _named_once(name: str, items: Sequence[object]) -> list[tuple[str, str]]:
    """Rows of a table of which only the first has a name."""
    return [("" if i else name, str(item)) for i, item in enumerate(items)]
