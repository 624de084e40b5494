"""``twosra import-map``, ``twosra check-passage``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.options import (
    FILE,
    SCENARIO,
    Finite,
    Load,
    choice_option,
    command,
    ending,
    file_option,
    plot_option,
    scenario_options,
)
from twosra_mpc.cli.output import Output, numbers, print_table
from twosra_mpc.files import write_json

_LENGTH, _AREA = Finite(min=0.0), Finite(min=0.0)


@command("import-map")
@click.argument("map_file", metavar="MAP", type=FILE)
@file_option("--out", "Write the obstacles (GeoJSON).", ending(".geojson", ".json"))
@choice_option("What to take cells for that are neither.", ("occupied", "free"), "--unknown")
@click.option("--tolerance", type=_LENGTH, metavar="M", help="How far walls may grow; one cell.")
@click.option(
    "--least-area", type=_AREA, default=0.0, metavar="M2", help="Leave out specks that are smaller."
)
def import_map_command(
    map_file: Path,
    out: Path | None,
    unknown: str,
    tolerance: float | None,
    least_area: float,
    output: Output,
) -> None:
    """Turn MAP, a map of ROS (map.yaml beside its image), into obstacles.

    Outlines are only ever moved outwards, so nothing that is occupied is lost.

    \b
    Obstacles for a scenario, which then says obstacles = "lab.geojson":
      twosra import-map map.yaml --out lab.geojson
    Walls at most 5 mm thicker than on the map, without specks below 1 cm2:
      twosra import-map map.yaml --tolerance 0.005 --least-area 1e-4 --out lab.geojson
    """
    from twosra_mpc.problem.geojson import feature_collection
    from twosra_mpc.space.occupancy_map import obstacles_on, read_map  # shapely is slow to import

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


@command("check-passage")
@click.argument("scenario", **SCENARIO)
@scenario_options("robot")
@choice_option("Of b0 at start and goal.", ("free", "given"), "--headings")
@click.option("--step", default=10.0, metavar="1/M", help="Between curvatures on the grid [1/m].")
@plot_option("Draw the verdicts over both curvatures")
def check_passage_command(
    scenario: str, load: Load, headings: Any, step: float, plot: Path | None, output: Output
) -> None:
    """Say in which shapes the robot can drive from start to goal of SCENARIO (a name or a file).

    For each shape on a grid: certified (a drive exists), blocked (proved: none does) or undecided.
    The shape is kept all the way; start and goal lend their poses. Shapes between those of the grid
    are not tried.

    \b
    Which shapes pass the doorway?
      twosra check-passage doorway --plot shapes.png
    A finer grid; 5 1/m take four times as long:
      twosra check-passage doorway --step 5 --json
    """
    from twosra_mpc.analysis.passages import VERDICTS, find_passages

    problem = load(scenario)
    with output.progress("deciding") as tell:
        found = find_passages(
            problem, step, headings, lambda done, of: tell(f"deciding: shape {done} of {of}")
        )
        if plot is not None:
            from twosra_mpc.plotting.passage_figure import plot_passages  # matplotlib is slow

            plot_passages(problem, found, plot)
    total = found.verdicts.size
    rows: list[tuple[str, str]] = [(each, f"{found.count(each)} of {total}") for each in VERDICTS]
    rows.append(("shape at the start", found.start))
    rows.append(("shape at the goal", found.goal or "left open"))
    nearest = found.nearest_per_m
    words = "none on this grid" if nearest is None else f"({numbers(nearest)}) 1/m"
    rows.append(("certified, nearest to the start's", words))
    if found.count("undecided"):
        words = "too tight for its slices of headings: lower clearance_m, or ask twosra plan"
        rows.append(("undecided is what is", words))
    rows.append(("not tried", f"shapes between those of the grid ({step:zg} 1/m apart)"))
    document = {"headings": headings, **vars(found)}
    output.report(lambda: document, lambda: print_table((scenario, "shapes"), rows))
