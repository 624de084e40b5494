"""``twosra fit-paths``, ``twosra compare-models``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.output import EXIT_PLANNED, check_writable, print_table
from twosra_mpc.model_comparison import compare_models
from twosra_mpc.modes import sequence_name
from twosra_mpc.path_choice import write_fitted_robot
from twosra_mpc.path_fitting import CASES, fit_cardioids, fit_spirals
from twosra_mpc.problem import load_problem
from twosra_mpc.robot import CardioidPath, LogSpiralPath, Robot, load_robot


@click.command("fit-paths")
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
        check_writable(target)
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


@click.command("compare-models")
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
        moving = f"{made.moving_s:.2f} s"
        rows.append((name, modes, f"{made.cost.time_s:.1f} s", moving, wheel, speed))
    print_table(("model", "mode sequence", "duration", "moving", "wheels", "v_j is"), rows)
    errors: list[tuple[str, ...]] = []
    for i, maker in enumerate(result.models):
        found = result.plans[i].samples is not None
        cells = tuple(_end_error(e) if found else "no plan" for e in result.end_errors[i])
        errors.append((f"planned with {maker}", *cells))
    click.echo("End error: position [mm], heading [deg], kappa1 and kappa2 [1/m]. Executed by:")
    print_table(("", *result.models), errors)
    return EXIT_PLANNED


def _print_fits(robot: Robot) -> None:
    built_in = robot.path if isinstance(robot.path, LogSpiralPath) else None
    rows = []
    for k, fit in enumerate(fit_spirals(robot.geometry)):
        known = f"{built_in.scale[k]:.4f}, {built_in.growth[k]:.4f}" if built_in else "-"
        residual = f"{fit.rms_l:.4f}, {fit.max_l:.4f}"
        rows.append((CASES[k], f"{fit.scale:.4f}, {fit.growth:.4f}", known, residual))
    header = ("spiral", "fitted a / l, b", f"in {robot.name}", "residual / l: rms, largest")
    print_table(header, rows)
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
    print_table(header, rows)


def _end_error(error: Any) -> str:
    if math.isnan(error[0]):
        return "bends too far"
    shift, turn = 1e3 * math.hypot(error[0], error[1]), math.degrees(error[2])
    return f"{shift:.1f}, {turn:.1f}, {error[3]:.1f}, {error[4]:.1f}"
