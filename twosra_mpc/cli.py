"""Command line: ``twosra plan``, ``twosra scenarios``, ``twosra robots``.

Results go to standard output, progress and errors to standard error. Exit codes: 0 planned, 2 bad
input, 3 proved infeasible, 4 no plan within the limits (the best so far is written, if any).
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from twosra_mpc.errors import InputError
from twosra_mpc.plan import Plan, Status
from twosra_mpc.planner import Progress, plan
from twosra_mpc.problem import Problem, load_problem, scenario_names
from twosra_mpc.robot import load_robot, robot_names
from twosra_mpc.setpoints import check_rate, save_setpoints
from twosra_mpc.version import __version__

EXIT_PLANNED, EXIT_BAD_INPUT, EXIT_INFEASIBLE, EXIT_NO_PLAN = 0, 2, 3, 4


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="twosra")
def commands() -> None:
    """Plan motions of the self-reconfigurable soft-rigid agent (2SRA)."""


@commands.command("plan")
@click.argument("scenario")
@click.option("--out", type=click.Path(path_type=Path), help="Write the plan as JSON.")
@click.option("--csv", type=click.Path(path_type=Path), help="Write the set-points as CSV.")
@click.option("--rate", type=float, help="Rows per second of --csv [Hz]; default: the plan's grid.")
@click.option("--plot", type=click.Path(path_type=Path), help="Draw the plan (png, pdf, svg).")
@click.option("--planner", type=click.Choice(["optimal", "greedy"]), help="Override the scenario.")
@click.option("--robot", help="Override the robot: a built-in name or a file.")
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
    **overrides: Any,
) -> int:
    """Plan SCENARIO: a built-in name (see "twosra scenarios") or a TOML/JSON file."""
    given = {key: value for key, value in overrides.items() if value is not None}
    problem = load_problem(scenario, **given)
    if rate is not None:
        check_rate(rate)
    for target in (out, csv, plot):
        _check_writable(target)
    result = _plan_with_progress(problem)
    if out is not None:
        result.save(out)
    if csv is not None and result.samples is not None:
        save_setpoints(result, csv, rate)
    if plot is not None and result.samples is not None:
        from twosra_mpc.plotting import plot_plan  # only now: importing matplotlib takes a second

        plot_plan(result, plot)
    _print_summary(result)
    return _exit_code(result)


@commands.command("scenarios")
def scenarios_command() -> int:
    """List the built-in scenarios."""
    rows = []
    for name in scenario_names():
        problem = load_problem(name)
        start, goal = problem.start.configuration, problem.goal.configuration
        rows.append((name, problem.description, _numbers(start), _numbers(goal)))
    _print_table(("scenario", "what it asks", "start", "goal [m, m, rad, 1/m, 1/m]"), rows)
    return EXIT_PLANNED


@commands.command("robots")
def robots_command() -> int:
    """List the built-in robots."""
    robots = [load_robot(name) for name in robot_names()]
    rows = [(r.name, r.path.model, ", ".join(r.timing), r.description) for r in robots]
    _print_table(("robot", "path model", "timings", "description"), rows)
    return EXIT_PLANNED


def _plan_with_progress(problem: Problem) -> Plan:
    """Plan with one line of live progress on standard error, shown if it takes over a second."""
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


def _check_writable(target: Path | None) -> None:
    """Refuse an output path before an hour of planning is lost to it."""
    if target is not None and (target.is_dir() or not os.access(target.parent, os.W_OK)):
        raise InputError("output", str(target), "a file path in a folder that can be written")


def _print_summary(result: Plan) -> None:
    rows = [("status", str(result.status)), ("outcome", result.message)]
    if result.cost is not None:
        cost = result.cost
        rows.append(("duration", f"{cost.time_s:.2f} s ({_moving_s(result):.2f} s of it moving)"))
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
    _print_table((f"{result.robot.name}", result.planner), rows)


def _moving_s(result: Plan) -> float:
    return sum(phase.end_s - phase.start_s for phase in result.phases)


def _print_table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(*header, box=box.SIMPLE_HEAD, pad_edge=False, highlight=False)
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)
    console.print(table, soft_wrap=not console.is_terminal)


def _numbers(values: Any) -> str:
    return ", ".join("free" if value != value else f"{value:g}" for value in values)


def _exit_code(result: Plan) -> int:
    if result.status is Status.INFEASIBLE:
        return EXIT_INFEASIBLE
    return EXIT_PLANNED if result.found and not result.stopped_early else EXIT_NO_PLAN


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = commands.main(arguments, prog_name="twosra", standalone_mode=False)
    except InputError as error:
        click.echo(f"twosra: {error}", err=True)
        code = EXIT_BAD_INPUT
    except click.ClickException as error:
        error.show()
        code = EXIT_BAD_INPUT
    except (click.Abort, KeyboardInterrupt):
        click.echo("twosra: interrupted before there was a plan", err=True)
        code = EXIT_NO_PLAN
    sys.exit(code or 0)
