"""``twosra check-robot``."""

from __future__ import annotations

import click

from twosra_mpc.cli.options import ROBOT, command
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.lab.bench.singular_shapes import (
    condition_number,
    singular_set_in_words,
    singular_shapes,
)
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.description import load_robot


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
