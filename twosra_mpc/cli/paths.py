"""``twosra fit-paths``, ``twosra compare-models``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from twosra_mpc.analysis.model_comparison import ModelComparison, compare_models
from twosra_mpc.cli.options import (
    ROBOT,
    SCENARIO,
    Load,
    file_option,
    output_options,
    plot_option,
    scenario_options,
)
from twosra_mpc.cli.output import EXIT_PLANNED, Output, print_table
from twosra_mpc.identification.path_choice import parameters_in_words
from twosra_mpc.identification.path_fitting import CASES, fit_cardioids, fit_spirals
from twosra_mpc.robot.description import Robot, load_robot
from twosra_mpc.robot.modes import sequence_name

_FIT_HELP = """Fit spirals and cardioids to the exact paths of ROBOT (a name or a file).

The spirals are fitted as Table I of the paper was; the table printed shows both.

\b
How well do spirals and cardioids follow the exact arcs?
  twosra fit-paths 2sra-v1 --plot paths.png
A robot file for your own fibre's lengths, with its comments kept:
  twosra fit-paths my-robot.toml --model cardioid --out fitted.toml
"""


@click.command("fit-paths", help=_FIT_HELP)
@click.argument("robot", **ROBOT)
@file_option("--out", "Write a robot file with the fit.")
@click.option(
    "--model",
    type=click.Choice(["log_spiral", "log_spiral_corrected", "cardioid"]),
    default="log_spiral_corrected",
    show_default=True,
    help="Which fit goes into --out.",
)
@plot_option("Draw exact and fitted paths")
@output_options
def fit_paths_command(
    robot: str, out: Path | None, model: str, plot: Path | None, output: Output
) -> int:
    """Fit paths; see ``_FIT_HELP``."""
    described = load_robot(robot)
    with output.progress("fitting"):
        if out is not None:
            from twosra_mpc.identification.robot_files import write_fitted_robot  # takes 0.5 s

            write_fitted_robot(robot, out, described, model)
        if plot is not None:
            from twosra_mpc.plotting.path_figure import plot_paths  # importing matplotlib is slow

            plot_paths(described, plot)
    output.report(lambda: _fits(described), lambda: _print_fits(described))
    return EXIT_PLANNED


_COMPARE_HELP = """Plan SCENARIO under each path model, and execute each plan under the others.

\b
How far does the robot end from the goal if it bends otherwise than planned?
  twosra compare-models paper-2
The same with constant times of melting and freezing, for a program to read:
  twosra compare-models paper-2 --timing constant --json
"""


@click.command("compare-models", help=_COMPARE_HELP)
@click.argument("scenario", **SCENARIO)
@scenario_options("robot", "timing", "gap", "time_limit_s")
@output_options
def compare_models_command(scenario: str, load: Load, output: Output) -> int:
    """Compare path models; see ``_COMPARE_HELP``."""
    problem = load(scenario)
    with output.progress("planning under each path model"):
        result = compare_models(problem)
    output.report(lambda: _comparison(result), lambda: _print_comparison(result))
    return EXIT_PLANNED


def _comparison(result: ModelComparison) -> dict[str, Any]:
    """The comparison as plain data; end errors as [x m, y m, phi rad, kappa1, kappa2 1/m]."""
    plans = []
    for i, planned in enumerate(result.results):
        ends, made = dict(zip(result.models, result.end_errors[i], strict=True)), planned.plan
        plans.append(
            {
                "model": result.models[i],
                "speed": result.speeds[i],
                "status": str(planned.status),
                "duration_s": made and made.duration_s,
                "moving_s": made.moving_s if made else 0.0,
                "gap": planned.gap,
                "modes": made.sequence if made else [],
                "end_error_under": ends if made else None,
            }
        )
    return {"scenario": result.results[0].problem.scenario(), "plans": plans}


def _print_comparison(result: ModelComparison) -> None:
    rows = []
    for name, speed, planned in zip(result.models, result.speeds, result.results, strict=True):
        if (made := planned.plan) is None:
            rows.append((name, str(planned.status), "", "", "", speed))
            continue
        wheel = f"{abs(made.samples.wheel_rad_s).max():.1f} rad/s"
        modes = sequence_name(made.sequence)
        moving = f"{made.moving_s:.2f} s"
        rows.append((name, modes, f"{made.cost.time_s:.1f} s", moving, wheel, speed))
    print_table(("model", "mode sequence", "duration", "moving", "wheels", "v_j is"), rows)
    errors: list[tuple[str, ...]] = []
    for i, maker in enumerate(result.models):
        found = result.results[i].plan is not None
        cells = tuple(_end_error(e) if found else "no plan" for e in result.end_errors[i])
        errors.append((f"planned with {maker}", *cells))
    click.echo("End error: position [mm], heading [deg], kappa1 and kappa2 [1/m]. Executed by:")
    print_table(("", *result.models), errors)


def _fits(robot: Robot) -> dict[str, Any]:
    """The fits as plain data; what stands in the robot file is in ``path``."""
    return {
        "robot": robot.name,
        "path": robot.path.model_dump(mode="json"),
        "cases": CASES,
        "spirals": fit_spirals(robot.geometry),
        "cardioids": fit_cardioids(robot.geometry),
    }


def _print_fits(robot: Robot) -> None:
    given_spirals, given_cardioids = parameters_in_words(robot.path)
    rows = []
    for k, fit in enumerate(fit_spirals(robot.geometry)):
        residual = f"{fit.rms_l:.4f}, {fit.max_l:.4f}"
        rows.append((CASES[k], f"{fit.scale:.4f}, {fit.growth:.4f}", given_spirals[k], residual))
    header = ("spiral", "fitted a / l, b", f"in {robot.name}", "residual / l: rms, largest")
    print_table(header, rows)
    rows = []
    for k, cardioid in enumerate(fit_cardioids(robot.geometry)):
        fitted = f"{cardioid.radius_m:.4f}, {cardioid.phi_per_alpha:.4f}"
        residual = f"{1e3 * cardioid.rms_m:.3f}, {1e3 * cardioid.max_m:.3f}"
        rows.append((CASES[k], fitted, given_cardioids[k], residual))
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
