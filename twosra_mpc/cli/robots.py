"""``twosra scenarios``, ``twosra robots``, ``twosra check-robot``."""

from __future__ import annotations

import click

from twosra_mpc.cli.options import ROBOT, command
from twosra_mpc.cli.output import Output, numbers, print_table
from twosra_mpc.problem.problem import load_problem, scenario_names
from twosra_mpc.robot.description import load_robot, robot_names


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
