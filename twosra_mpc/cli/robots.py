"""``twosra scenarios``, ``twosra robots``, ``twosra check-robot``."""

from __future__ import annotations

import click

from twosra_mpc.cli.output import EXIT_PLANNED, numbers, print_table
from twosra_mpc.model.path_models import path_model
from twosra_mpc.problem import load_problem, scenario_names
from twosra_mpc.robot import load_robot, robot_names
from twosra_mpc.shape import condition_number, singular_shapes


@click.command("scenarios")
def scenarios_command() -> int:
    """List the built-in scenarios."""
    rows = []
    for name in scenario_names():
        problem = load_problem(name)
        start, goal = problem.start.configuration, problem.goal.configuration
        rows.append((name, problem.description, numbers(start), numbers(goal)))
    print_table(("scenario", "what it asks", "start", "goal [m, m, rad, 1/m, 1/m]"), rows)
    return EXIT_PLANNED


@click.command("robots")
def robots_command() -> int:
    """List the built-in robots."""
    robots = [load_robot(name) for name in robot_names()]
    rows = [(r.name, r.path.model, ", ".join(r.timing), r.description) for r in robots]
    print_table(("robot", "path model", "timings", "description"), rows)
    return EXIT_PLANNED


@click.command("check-robot")
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
    print_table((described.name, described.description), rows)
    return EXIT_PLANNED
