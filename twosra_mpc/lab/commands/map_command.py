"""``twosra import-map``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from twosra_mpc.cli.options import Finite, argument, command, ending, option, written
from twosra_mpc.cli.output import Output
from twosra_mpc.files import write_json

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
