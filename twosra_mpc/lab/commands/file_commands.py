"""Commands about files for other programs: exports, reports, maps, schemas."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import click

from twosra_mpc import Robot, json_schema, load_problem, load_robot, scenario_names
from twosra_mpc.checking.plan_file import checked_text
from twosra_mpc.cli import options
from twosra_mpc.cli.options import Finite, argument, command, ending, option, written
from twosra_mpc.cli.output import Output
from twosra_mpc.files import read_bytes, read_document, text_of, write_json, write_text
from twosra_mpc.lab import report
from twosra_mpc.lab.commands.serial_commands import drivable_plan
from twosra_mpc.lab.export.robot_chain import urdf
from twosra_mpc.lab.export.ros2_mcap import save_ros2_bag
from twosra_mpc.lab.identification.motion_log import save_authors_csv
from twosra_mpc.physics.mjcf import mjcf


def _world(source: str) -> tuple[Robot, str]:
    """MJCF of the start of a scenario or a plan, or of a robot; what comes by a pipe is a robot."""
    path = Path(source)
    if source in scenario_names() or (
        path.is_file() and {"start", "scenario"} & read_document(path, source).keys()
    ):
        problem = load_problem(source)
        return problem.robot, mjcf(problem.robot, problem=problem)
    return (robot := load_robot(source)), mjcf(robot)


def _chain(source: str) -> tuple[Robot, str]:
    """URDF of a robot."""
    return (robot := load_robot(source)), urdf(robot)


_OF_ROBOTS = {".xml": _world, ".urdf": _chain}
_OF_PLANS = {".mcap": save_ros2_bag, ".csv": save_authors_csv}


@options.command("export")
def export_command(
    source: Annotated[str, options.argument("PLAN|ROBOT|SCENARIO", **options.ROBOT)],
    accept_paper_wheels: bool,
    out: Annotated[Path, options.out_argument(options.ending(*_OF_PLANS, *_OF_ROBOTS))],
    rate_Hz: Annotated[float | None, options.RATE],
    output: Output,
) -> None:
    """Write PLAN to OUT in the format of another program: a .mcap or a .csv file.

    Or write ROBOT (a name or a file) to a .xml file: MJCF, which MuJoCo and its viewer open; or to
    a .urdf file: a chain of short links for each segment, as RViz shows it. The MJCF of SCENARIO
    has its obstacles and objects, metal as stiff as it is at the start, and the start as its key
    frame.

    MCAP is a bag for ROS 2, which Foxglove opens as well: JointState, TFMessage, Path, Temperature,
    outlines of obstacles and objects, and the robot as URDF. Its clock is the plan's, from zero. It
    needs mcap-ros2-support, and no ROS: {ros}

    CSV has the columns of the authors' own trajectories, x,y,angle,k1,k2,v1,v2,u0,v0,r0,s1,s2,time.
    Plans with the paper's wheel map are refused: without slip they bend it by 17 to 48 % of what is
    planned.

    \b
    Play a plan at thirty frames a second (in Foxglove: open the file, add a 3D panel):
      twosra plan paper-1 --out plan.json
      twosra export plan.json plan.mcap --rate 30
    The plan's own grid as the authors' scripts read it:
      twosra export plan.json plan.csv
    A robot with rolling wheels and a fibre of hinges, to play with:
      twosra export 2sra-v1 robot.xml
      python -m mujoco.viewer --mjcf=robot.xml
    The same at the start of a scenario, among its objects:
      twosra export pick-and-place world.xml

    Options:
        accept_paper_wheels: Take the paper's wheel map as well.
        rate_Hz: CSV: rows per second. MCAP: samples per second besides the plan's own.
    """
    kind = out.suffix.lower()
    if (write := _OF_ROBOTS.get(kind)) is not None:
        described, text = write(source)
        write_text(out, text)
        output.record((described.name, "exported"), {"file": str(out), "robot": described.name})
        return
    plan = drivable_plan(Path(source), accept_paper_wheels=accept_paper_wheels)
    robot, duration_s = plan.robot.name, plan.duration_s
    with output.progress(f"writing {out}"):
        _OF_PLANS.get(kind, save_ros2_bag)(plan, out, rate_Hz)  # a pipe has no ending
    document = {"file": str(out), "robot": robot, "duration_s": duration_s}
    output.record((robot, "exported"), document)


@options.command("report")
def report_command(
    plan: Annotated[Path, options.argument()],
    out: Annotated[Path, options.out_argument(options.ending(".html", ".htm"))],
    output: Output,
) -> None:
    """Write a report on PLAN, a file written by "twosra plan --out", as the HTML page OUT.

    The page needs nothing else and asks nothing of any network: send it as it is. It has the plan
    in numbers, what is proved and what was verified, an animation, figures, and the scenario and
    robot to plan it again. A plan file that holds no plan has a report with the
    reason.

    \b
    A plan and its report:
      twosra plan paper-1 --out plan.json
      twosra report plan.json report.html
    """
    content = read_bytes(plan, str(plan))
    given = checked_text(text_of(content, str(plan)), str(plan)).believed(str(plan))
    with output.progress("drawing the report"):
        report.write_report(given, out, report.Origin.of(plan.name, content))
    document = {"file": str(out), "bytes": out.stat().st_size, "status": str(given.status)}
    output.record((given.problem.robot.name, "report"), document)


_SIZE = Finite(min=0.0)


@command("import-map")
def import_map_command(
    map_file: Annotated[Path, argument("MAP")],
    out: Annotated[Path | None, written(ending(".geojson", ".json"))],
    unknown: Annotated[Literal["occupied", "free"], option(default="occupied")],
    tolerance: Annotated[float | None, option(type=_SIZE, metavar="M")],
    least_area: Annotated[float, option(type=_SIZE, default=0.0, metavar="M2")],
    output: Output,
) -> None:
    """Turn MAP, a map of ROS (map.yaml beside its image), into obstacles.

    Outlines are only ever moved outwards, so nothing that is occupied is lost.

    \b
    Obstacles for a scenario, which then says obstacles = "lab.geojson":
      twosra import-map map.yaml --out lab.geojson
    Walls at most 5 mm thicker than on the map, without specks below 1 cm2:
      twosra import-map map.yaml --tolerance 0.005 --least-area 1e-4 --out lab.geojson

    Options:
        out: Write the obstacles (GeoJSON).
        unknown: What to take cells for that are neither.
        tolerance: How far walls may grow; one cell.
        least_area: Leave out specks that are smaller.
    """
    from twosra_mpc.lab.worlds.occupancy_map import (  # shapely is slow to import
        feature_collection,
        obstacles_on,
        read_map,
    )

    with output.progress("tracing the outlines of cells"):
        cells = read_map(map_file, unknown_is_free=unknown == "free")
        found, specks = obstacles_on(cells, map_file.stem, tolerance, least_area)
    if out is not None:
        write_json(out, feature_collection(found))
    rows, columns = cells.occupied.shape
    record = {
        "cells": [columns, rows],
        "cell_m": cells.cell_m,
        "occupied_cells": int(cells.occupied.sum()),
        "unknown_cells": int(cells.unknown.sum()),
        "obstacles": len(found),
        "corners": sum(len(each.corners_m) for each in found),
        "specks_left_out": specks,
    }
    output.record((map_file.name, "what was found"), record)


@command("schema")
def schema_command(
    subject: Annotated[Literal["scenario", "robot", "plan"], argument()], output: Output
) -> None:
    """Print the JSON Schema of scenario, robot or plan files: keys, types, ranges, units.

    \b
    Completion and checking while you type, in VS Code with the extension "Even Better TOML":
      twosra schema scenario > scenario.schema.json
    and then, as the first line of your scenario:
      #:schema ./scenario.schema.json
    The same for robots:
      twosra schema robot > robot.schema.json
    For programs that read plans:
      twosra schema plan > plan.schema.json

    For scenarios and plans in JSON, VS Code takes the file in its setting "json.schemas".
    """
    schema = json_schema(subject)
    output.report(lambda: schema, lambda: click.echo(json.dumps(schema, indent=2)))
