"""``twosra check-robot``."""

from __future__ import annotations

from typing import Any

import click

from twosra_mpc.analysis.singular_shapes import SingularShape, condition_number, singular_shapes
from twosra_mpc.cli.options import ROBOT, output_options
from twosra_mpc.cli.output import EXIT_PLANNED, Output, print_table
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.description import Robot, load_robot

_HELP = """Check ROBOT (a name or a file) and report shapes in which its wheels lose control.

\b
A built-in robot:
  twosra check-robot 2sra-v1
Your own, which must be a valid robot file; a mistake is named with its key:
  twosra check-robot my-robot.toml
"""


@click.command("check-robot", help=_HELP)
@click.argument("robot", **ROBOT)
@output_options
def check_robot_command(robot: str, output: Output) -> int:
    """Check a robot; see ``_HELP``."""
    described = load_robot(robot)
    condition = condition_number(described, (0.0, 0.0))
    with output.progress("looking for shapes in which the wheels lose control"):
        shapes = singular_shapes(described)
    output.report(
        lambda: _check_document(described, condition, shapes),
        lambda: _print_check(described, condition, shapes),
    )
    return EXIT_PLANNED


def _check_document(robot: Robot, condition: float, shapes: list[SingularShape]) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "path_model": robot.path.model,
        "speed": path_model(robot).speed,
        "curvature_limit_per_m": robot.limits.curvature_per_m,
        "condition_number_straight": condition,
        "singular_shapes": shapes,
    }


def _print_check(robot: Robot, condition: float, shapes: list[SingularShape]) -> None:
    rows = [
        ("path model", f"{robot.path.model}; v_j: {path_model(robot).speed}"),
        ("curvature limit", f"{robot.limits.curvature_per_m:g} 1/m"),
        ("wheel condition number, straight", f"{condition:.2f}"),
    ]
    for shape in shapes:
        gap = 1e3 * shape.unit_gap_m
        state = f"units {gap:.1f} mm apart" if gap > 0 else f"units overlap by {-gap:.1f} mm"
        where = f"kappa = ({shape.kappa1_per_m:.1f}, {shape.kappa2_per_m:.1f}) 1/m; {state}"
        rows.append(("wheels singular", f"{where}; the planner does not drive near it"))
    if not shapes:
        rows.append(("wheels singular", "nowhere within the curvature limits"))
    print_table((robot.name, robot.description), rows)
