"""``twosra plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.output import (
    EXIT_INFEASIBLE,
    EXIT_NO_PLAN,
    EXIT_PLANNED,
    check_writable,
    print_table,
)
from twosra_mpc.path_choice import with_path_model
from twosra_mpc.plan import Plan, Status
from twosra_mpc.planner import Progress, plan
from twosra_mpc.problem import Problem, load_problem
from twosra_mpc.setpoints import check_rate, save_setpoints


@click.command("plan")
@click.argument("scenario")
@click.option("--out", type=click.Path(path_type=Path), help="Write the plan as JSON.")
@click.option("--csv", type=click.Path(path_type=Path), help="Write the set-points as CSV.")
@click.option("--rate", type=float, help="Rows per second of --csv [Hz]; default: the plan's grid.")
@click.option("--plot", type=click.Path(path_type=Path), help="Draw the plan (png, pdf, svg).")
@click.option("--planner", type=click.Choice(["optimal", "greedy"]), help="Override the scenario.")
@click.option("--robot", help="Override the robot: a built-in name or a file.")
@click.option("--path-model", help="Override the robot's path model, e.g. arc.")
@click.option("--timing", help="Override the set of transition times, e.g. paper.")
@click.option("--gap", type=float, help="Relative gap to stop at, e.g. 0.01.")
@click.option("--time-limit", "time_limit_s", type=float, help="Search for at most this long [s].")
@click.option("--max-phases", type=int, help="Longest mode sequence that is searched.")
def plan_command(
    scenario: str,
    out: Path | None,
    csv: Path | None,
    rate: float | None,
    plot: Path | None,
    path_model: str | None,
    **overrides: Any,
) -> int:
    """Plan SCENARIO: a built-in name (see "twosra scenarios") or a TOML/JSON file."""
    given = {key: value for key, value in overrides.items() if value is not None}
    problem = load_problem(scenario, **given)
    if path_model is not None:
        problem = problem.with_robot(with_path_model(problem.robot, path_model))
    if rate is not None:
        check_rate(rate)
    for target in (out, csv, plot):
        check_writable(target)
    if plot is not None:
        from twosra_mpc.figure_file import check_figure_path  # matplotlib takes a second

        check_figure_path(plot)
    result = _plan_with_progress(problem)
    if out is not None:
        result.save(out)
    if csv is not None and result.samples is not None:
        save_setpoints(result, csv, rate)
    if plot is not None and result.samples is not None:
        from twosra_mpc.plotting import plot_plan

        plot_plan(result, plot)
    if result.samples is None and (csv or plot):
        unwritten = " and ".join(str(target) for target in (csv, plot) if target is not None)
        click.echo(f"twosra: there is no plan to write to {unwritten}", err=True)
    _print_summary(result)
    return _exit_code(result)


def _plan_with_progress(problem: Problem) -> Plan:
    """Plan with one line of live progress on standard error, where that is a terminal."""
    from rich.console import Console
    from rich.status import Status as Spinner

    console = Console(stderr=True)
    spinner = Spinner(f"planning ({problem.planner})", console=console)
    if not console.is_terminal:
        return plan(problem)

    def show(progress: Progress) -> None:
        best = "none yet" if progress.cost == float("inf") else f"{progress.cost:.1f} s"
        spinner.update(f"best plan {best}, no plan below {progress.lower_bound:.1f} s")

    with spinner:
        return plan(problem, on_progress=show)


def _print_summary(result: Plan) -> None:
    rows = [("status", str(result.status)), ("outcome", result.message)]
    if result.cost is not None:
        cost = result.cost
        rows.append(("duration", f"{cost.time_s:.2f} s ({result.moving_s:.2f} s of it moving)"))
        if result.gap is not None:
            bound = f"{result.lower_bound:.2f} s (gap {100 * result.gap:.3f} %)"
            rows.append(("lower bound", bound))
        rows.append(("energy", f"{cost.energy_J:.0f} J in {cost.transitions} transitions"))
    for phase in result.phases:
        span = f"{phase.start_s:8.2f} s to {phase.end_s:8.2f} s"
        rows.append((f"drive [{phase.mode[0]},{phase.mode[1]}]", span))
    for item in result.transitions:
        span = f"{item.heater_s:8.2f} s to {item.done_s:8.2f} s"
        rows.append(
            (f"segment {item.segment} {item.to}", f"{span}, holds from {item.onset_s:.2f} s")
        )
    if result.verification is not None:
        check = result.verification
        goal = max(abs(error) for error in check.goal_error)
        verdict = "passed" if check.ok else "; ".join(check.problems)
        rows.append(("verification", f"{verdict} (largest goal error {goal:.1e} m, rad or 1/m)"))
    print_table((f"{result.robot.name}", result.planner), rows)


def _exit_code(result: Plan) -> int:
    if result.status is Status.INFEASIBLE:
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if result.found and not result.stopped_early else EXIT_NO_PLAN
