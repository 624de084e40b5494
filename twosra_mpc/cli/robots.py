"""``twosra scenarios``, ``twosra robots``, ``twosra check-robot``."""

from __future__ import annotations

import click

from twosra_mpc.cli.options import ROBOT, command
from twosra_mpc.cli.output import Output, numbers, print_table
from twosra_mpc.problem.problem import load_problem, scenario_names
from twosra_mpc.robot.description import load_robot, robot_names

_SCENARIOS_HELP = """List the built-in scenarios.

\b
What is there to plan?
  twosra scenarios
One of them with every default filled in, as a start for your own:
  twosra scenarios --json
"""


@command("scenarios", _SCENARIOS_HELP)
def scenarios_command(output: Output) -> None:
    """List the built-in scenarios; see ``_SCENARIOS_HELP``."""
    problems = {name: load_problem(name) for name in scenario_names()}
    rows = []
    for name, problem in problems.items():
        start, goal = problem.start.configuration, problem.goal.configuration
        rows.append((name, problem.description, numbers(start), numbers(goal)))
    header = ("scenario", "what it asks", "start", "goal [m, m, rad, 1/m, 1/m]")
    output.report(
        lambda: [{"name": name, **each.scenario()} for name, each in problems.items()],
        lambda: print_table(header, rows),
    )


_ROBOTS_HELP = """List the built-in robots.

\b
Which robots are there?
  twosra robots
All their numbers, SI, unit in the name:
  twosra robots --json
"""


@command("robots", _ROBOTS_HELP)
def robots_command(output: Output) -> None:
    """List the built-in robots; see ``_ROBOTS_HELP``."""
    robots = [load_robot(name) for name in robot_names()]
    rows = [(r.name, r.path.model, ", ".join(r.timing), r.description) for r in robots]
    output.report(
        lambda: [robot.model_dump(mode="json") for robot in robots],
        lambda: print_table(("robot", "path model", "timings", "description"), rows),
    )


_CHECK_HELP = """Check ROBOT (a name or a file) and report shapes in which its wheels lose control.

\b
A built-in robot:
  twosra check-robot 2sra-v1
Your own, which must be a valid robot file; a mistake is named with its key:
  twosra check-robot my-robot.toml
"""


@command("check-robot", _CHECK_HELP)
@click.argument("robot", **ROBOT)
def check_robot_command(robot: str, output: Output) -> None:
    """Check a robot; see ``_CHECK_HELP``."""
    from twosra_mpc.analysis.singular_shapes import condition_number, singular_shapes
    from twosra_mpc.model.path_models import path_model  # CasADi takes a second

    described = load_robot(robot)
    condition, speed = condition_number(described, (0.0, 0.0)), path_model(described).speed
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
        ("curvature limit", f"{limit:g} 1/m"),
        ("wheel condition number, straight", f"{condition:.2f}"),
    ]
    for shape in shapes:
        gap = 1e3 * shape.unit_gap_m
        state = f"units {gap:.1f} mm apart" if gap > 0 else f"units overlap by {-gap:.1f} mm"
        where = f"kappa = ({shape.kappa1_per_m:.1f}, {shape.kappa2_per_m:.1f}) 1/m; {state}"
        rows.append(("wheels singular", f"{where}; the planner does not drive near it"))
    if not shapes:
        rows.append(("wheels singular", "nowhere within the curvature limits"))
    title = (described.name, described.description)
    output.report(lambda: document, lambda: print_table(title, rows))
