"""``twosra scenarios``, ``twosra robots``, ``twosra check-robot``, ``twosra fit-paths``."""

from __future__ import annotations

from pathlib import Path

import click

from twosra_mpc.cli.options import ROBOT, choice_option, command, file_option, plot_option
from twosra_mpc.cli.output import Output, numbers, print_table
from twosra_mpc.problem.problem import load_problem, scenario_names
from twosra_mpc.robot.description import load_robot, robot_names

_FITTED = ("log_spiral_corrected", "log_spiral", "cardioid")


@command("scenarios")
def scenarios_command(output: Output) -> None:
    """List the built-in scenarios.

    \b
    What is there to plan?
      twosra scenarios
    One of them with every default filled in, as a start for your own:
      twosra scenarios --json
    """
    problems = {name: load_problem(name) for name in scenario_names()}
    rows = []
    for name, problem in problems.items():
        anywhere, asked = problem.ends_anywhere, numbers(problem.goal.configuration)
        goal = "none: only tasks" if anywhere else asked
        rows.append((name, problem.description, numbers(problem.start.configuration), goal))
    header = ("scenario", "what it asks", "start", "goal [m, m, rad, 1/m, 1/m]")
    output.report(
        lambda: [{"name": name, **each.scenario()} for name, each in problems.items()],
        lambda: print_table(header, rows),
    )


@command("robots")
def robots_command(output: Output) -> None:
    """List the built-in robots.

    \b
    Which robots are there?
      twosra robots
    All their numbers, SI, unit in the name:
      twosra robots --json
    """
    robots = [load_robot(name) for name in robot_names()]
    rows = [(r.name, r.path.model, ", ".join(r.timing), r.description) for r in robots]
    output.report(
        lambda: [robot.model_dump(mode="json") for robot in robots],
        lambda: print_table(("robot", "path model", "timings", "description"), rows),
    )


@command("check-robot")
@click.argument("robot", **ROBOT)
def check_robot_command(robot: str, output: Output) -> None:
    """Check ROBOT (a name or a file) and report shapes in which its wheels lose control.

    \b
    A built-in robot:
      twosra check-robot 2sra-v1
    Your own, which must be a valid robot file; a mistake is named with its key:
      twosra check-robot my-robot.toml
    """
    from twosra_mpc.analysis.singular_shapes import (
        condition_number,
        singular_set_in_words,
        singular_shapes,
    )
    from twosra_mpc.model.path_models import path_model  # CasADi takes a second

    described = load_robot(robot)
    segments, speed = described.geometry.segments, path_model(described).speed
    condition = condition_number(described, (0.0,) * segments)
    with output.progress("looking for shapes in which the wheels lose control"):
        shapes = singular_shapes(described)
    limit, model = described.limits.curvature_per_m, described.path.model
    document = {
        "robot": described.name,
        "path_model": model,
        "speed": speed,
        "curvature_limit_per_m": limit,
        "condition_number_straight": condition,
        "singular_shapes": shapes,
    }
    rows = [
        ("path model", f"{model}; v_j: {speed}"),
        ("curvature limit", f"{limit:zg} 1/m"),
        ("wheel condition number, straight", f"{condition:z.2f}"),
    ]
    for shape in shapes:
        gap = 1e3 * shape.unit_gap_m
        state = f"units {gap:z.1f} mm apart" if gap > 0 else f"units overlap by {-gap:z.1f} mm"
        kappa = ", ".join(f"{each:z.1f}" for each in shape.kappa_per_m)
        where = f"kappa = ({kappa}) 1/m; {state}"
        rows.append(("wheels singular", f"{where}; the planner does not drive near it"))
    if shapes and segments > 2:
        form = f"in {singular_set_in_words(segments)}; above, those found nearest the straight one"
        rows.append((f"of {segments} segments", form))
    if not shapes:
        rows.append(("wheels singular", "nowhere within the curvature limits, by a scan"))
    title = (described.name, described.description)
    output.report(lambda: document, lambda: print_table(title, rows))


@command("fit-paths")
@click.argument("robot", **ROBOT)
@file_option("--out", "Write a robot file with the fit.")
@choice_option("Which fit goes into --out.", _FITTED, "--model")
@plot_option("Draw exact and fitted paths")
def fit_paths_command(
    robot: str, out: Path | None, model: str, plot: Path | None, output: Output
) -> None:
    """Fit spirals and cardioids to the exact paths of ROBOT (a name or a file).

    The spirals are fitted as Table I of the paper was; the table printed shows both.

    \b
    How well do spirals and cardioids follow the exact arcs?
      twosra fit-paths 2sra-v1 --plot paths.png
    A robot file for your own fibre's lengths, with its comments kept:
      twosra fit-paths my-robot.toml --model cardioid --out fitted.toml
    """
    from twosra_mpc.robot.copies import write_fitted_robot
    from twosra_mpc.robot.path_choice import parameters_in_words
    from twosra_mpc.robot.path_fitting import CASES, fit_cardioids, fit_spirals

    described = load_robot(robot)
    with output.progress("fitting"):
        if out is not None:
            write_fitted_robot(robot, out, described, model)
        if plot is not None:
            from twosra_mpc.plotting.path_figure import plot_paths  # importing matplotlib is slow

            plot_paths(described, plot)
    spirals, cardioids = fit_spirals(described.geometry), fit_cardioids(described.geometry)
    document = {
        "robot": described.name,
        "path": described.path.model_dump(mode="json"),
        "cases": CASES,
        "spirals": spirals,
        "cardioids": cardioids,
    }
    given_spirals, given_cardioids = parameters_in_words(described.path)
    spiral_rows = [
        (case, f"{fit.scale:z.4f}, {fit.growth:z.4f}", given, f"{fit.rms_l:z.4f}, {fit.max_l:z.4f}")
        for case, fit, given in zip(CASES, spirals, given_spirals, strict=True)
    ]
    cardioid_rows = []
    for case, fit, given in zip(CASES, cardioids, given_cardioids, strict=True):
        residual = f"{1e3 * fit.rms_m:z.3f}, {1e3 * fit.max_m:z.3f}"
        cardioid_rows.append(
            (case, f"{fit.radius_m:z.4f}, {fit.phi_per_alpha:z.4f}", given, residual)
        )

    def tables() -> None:
        own = f"in {described.name}"
        header = ("spiral", "fitted a / l, b", own, "residual / l: rms, largest")
        print_table(header, spiral_rows)
        header = ("cardioid", "fitted a [m], dphi/dalpha", own, "residual [mm]: rms, max")
        print_table(header, cardioid_rows)

    output.report(lambda: document, tables)
