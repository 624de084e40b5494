"""Command line: plan, list what is built in, check robots, fit and compare path models.

Results go to standard output, progress and errors to standard error. Exit codes: 0 planned, 2 bad
input, 3 proved infeasible, 4 no plan within the limits (the best so far is written, if any).
"""

from __future__ import annotations

import math
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from twosra_mpc.errors import InputError
from twosra_mpc.model.path_models import path_model
from twosra_mpc.model_comparison import compare_models
from twosra_mpc.modes import sequence_name
from twosra_mpc.path_choice import with_path_model, write_fitted_robot
from twosra_mpc.path_fitting import CASES, fit_cardioids, fit_spirals
from twosra_mpc.plan import Plan, Status
from twosra_mpc.planner import Progress, plan
from twosra_mpc.problem import Problem, load_problem, scenario_names
from twosra_mpc.robot import CardioidPath, LogSpiralPath, Robot, load_robot, robot_names
from twosra_mpc.setpoints import check_rate, save_setpoints
from twosra_mpc.shape import condition_number, singular_shapes
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
        _check_writable(target)
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


@commands.command("check-robot")
@click.argument("robot")
def check_robot_command(robot: str) -> int:
    """Check ROBOT (a name or a file) and report shapes in which its wheels lose control."""
    described = load_robot(robot)
    limit = described.limits.curvature_per_m
    rows = [
        ("path model", f"{described.path.model}; v_j: {path_model(described).speed}"),
        ("curvature limit", f"{limit:g} 1/m"),
        ("wheel condition number, straight", f"{condition_number(described, (0.0, 0.0)):.2f}"),
    ]
    for shape in singular_shapes(described):
        gap = 1e3 * shape.unit_gap_m
        state = f"units {gap:.1f} mm apart" if gap > 0 else f"units overlap by {-gap:.1f} mm"
        where = f"kappa = ({shape.kappa1_per_m:.1f}, {shape.kappa2_per_m:.1f}) 1/m; {state}"
        rows.append(("wheels singular", f"{where}; the planner does not drive near it"))
    if len(rows) == 3:
        rows.append(("wheels singular", "nowhere within the curvature limits"))
    _print_table((described.name, described.description), rows)
    return EXIT_PLANNED


@commands.command("fit-paths")
@click.argument("robot")
@click.option("--out", type=click.Path(path_type=Path), help="Write a robot file with the fit.")
@click.option(
    "--model",
    type=click.Choice(["log_spiral", "log_spiral_corrected", "cardioid"]),
    default="log_spiral_corrected",
    show_default=True,
    help="Which fit goes into --out.",
)
@click.option("--plot", type=click.Path(path_type=Path), help="Draw exact and fitted paths.")
def fit_paths_command(robot: str, out: Path | None, model: str, plot: Path | None) -> int:
    """Fit spirals and cardioids to the exact paths of ROBOT (a name or a file)."""
    described = load_robot(robot)
    for target in (out, plot):
        _check_writable(target)
    if plot is not None:
        from twosra_mpc.figure_file import check_figure_path

        check_figure_path(plot)
    if out is not None:
        write_fitted_robot(robot, out, described, model)
    if plot is not None:
        from twosra_mpc.path_figure import plot_paths  # only now: importing matplotlib is slow

        plot_paths(described, plot)
    _print_fits(described)
    return EXIT_PLANNED


@commands.command("compare-models")
@click.argument("scenario")
def compare_models_command(scenario: str) -> int:
    """Plan SCENARIO under each path model, and execute each plan under the others."""
    result = compare_models(load_problem(scenario))
    rows = []
    for name, speed, made in zip(result.models, result.speeds, result.plans, strict=True):
        if made.samples is None or made.cost is None:
            rows.append((name, str(made.status), "", "", "", speed))
            continue
        wheel = f"{abs(made.samples.wheel_rad_s).max():.1f} rad/s"
        modes = sequence_name([phase.mode for phase in made.phases])
        moving = f"{_moving_s(made):.2f} s"
        rows.append((name, modes, f"{made.cost.time_s:.1f} s", moving, wheel, speed))
    _print_table(("model", "mode sequence", "duration", "moving", "wheels", "v_j is"), rows)
    errors: list[tuple[str, ...]] = []
    for i, maker in enumerate(result.models):
        found = result.plans[i].samples is not None
        cells = tuple(_end_error(e) if found else "no plan" for e in result.end_errors[i])
        errors.append((f"planned with {maker}", *cells))
    click.echo("End error: position [mm], heading [deg], kappa1 and kappa2 [1/m]. Executed by:")
    _print_table(("", *result.models), errors)
    return EXIT_PLANNED


def _print_fits(robot: Robot) -> None:
    built_in = robot.path if isinstance(robot.path, LogSpiralPath) else None
    rows = []
    for k, fit in enumerate(fit_spirals(robot.geometry)):
        known = f"{built_in.scale[k]:.4f}, {built_in.growth[k]:.4f}" if built_in else "-"
        residual = f"{fit.rms_l:.4f}, {fit.max_l:.4f}"
        rows.append((CASES[k], f"{fit.scale:.4f}, {fit.growth:.4f}", known, residual))
    header = ("spiral", "fitted a / l, b", f"in {robot.name}", "residual / l: rms, largest")
    _print_table(header, rows)
    given = robot.path if isinstance(robot.path, CardioidPath) else None
    rows = []
    for k, cardioid in enumerate(fit_cardioids(robot.geometry)):
        known = f"{given.radius_m[k]:.4f}, {given.phi_per_alpha[k]:.4f}" if given else "-"
        fitted = f"{cardioid.radius_m:.4f}, {cardioid.phi_per_alpha:.4f}"
        residual = f"{1e3 * cardioid.rms_m:.3f}, {1e3 * cardioid.max_m:.3f}"
        rows.append((CASES[k], fitted, known, residual))
    header = (
        "cardioid",
        "fitted a [m], dphi/dalpha",
        f"in {robot.name}",
        "residual [mm]: rms, max",
    )
    _print_table(header, rows)


def _end_error(error: Any) -> str:
    if math.isnan(error[0]):
        return "bends too far"
    shift, turn = 1e3 * math.hypot(error[0], error[1]), math.degrees(error[2])
    return f"{shift:.1f}, {turn:.1f}, {error[3]:.1f}, {error[4]:.1f}"


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


def _check_writable(target: Path | None) -> None:
    """Refuse an output path before an hour of planning is lost to it."""
    if target is not None and _cannot_be_written(target):
        raise InputError("output", str(target), "a file path in a folder that can be written")


def _cannot_be_written(target: Path) -> bool:
    folder = target.parent
    return target.is_dir() or not (folder.is_dir() and os.access(folder, os.W_OK))


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
    if not console.is_terminal:
        console.width = 240  # lines in files and pipes are not broken
    console.print(table)


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
