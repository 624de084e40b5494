"""Robot files copied with their comments, but one part: name, fitted path, identified segment."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.items import Table

from twosra_mpc.errors import InputError
from twosra_mpc.files import locate, read_text, write_text
from twosra_mpc.identification.path_fitting import fitted_path_tables
from twosra_mpc.identification.thermal import LOGS_DIFFER, ThermalFit
from twosra_mpc.identification.transitions import TransitionFit
from twosra_mpc.robot.description import Robot


def write_fitted_robot(source: str | Path, target: str | Path, robot: Robot, model: str) -> None:
    """Write a copy of a robot file whose ``[path]`` table is fitted to its lengths.

    Everything else, comments included, stays as it is.

    Raises:
        InputError: If ``source`` is not TOML, or ``target`` cannot be written.
    """
    document = _robot_document(source)
    table = tomlkit.table()
    for key, value in fitted_path_tables(robot)[model].items():
        table.add(key, value)
    table.comment("fitted to the exact paths of this robot's lengths")
    table.add(tomlkit.nl())
    document["path"] = table
    write_text(target, tomlkit.dumps(document))


def write_identified_robot(
    source: str | Path, target: str | Path, fit: ThermalFit | TransitionFit
) -> None:
    """Write a copy of a robot file whose ``[segment]`` has the identified values and ranges.

    Everything else, comments included, stays as it is.

    Raises:
        InputError: If ``source`` is not TOML, or ``target`` cannot be written.
    """
    document = _robot_document(source)
    segment = document["segment"]
    assert isinstance(segment, Table)
    for name in fit.fitted:
        segment[name] = getattr(fit.segment, name)
    segment.comment(f"identified anew from {fit.summary}")
    if "ranges" not in segment:
        segment["ranges"] = tomlkit.table()
    ranges = segment["ranges"]
    assert isinstance(ranges, Table)
    for name in fit.fitted:
        ranges[name] = list(fit.segment.ranges[name])
    ranges.comment(
        "5 to 95 %: standard error, all fits that leave a part out, and at least"
        f" {100 * LOGS_DIFFER:g} % on either side, as fits to logs of one segment differ"
    )
    write_text(target, tomlkit.dumps(document))


def renamed_robot(source: str | Path, name: str) -> str:
    """Return the text of a robot file with another ``name``, comments included.

    Raises:
        InputError: If ``source`` is not TOML.
    """
    document = _robot_document(source)
    document["name"] = name
    return tomlkit.dumps(document)


def _robot_document(source: str | Path) -> TOMLDocument:
    """Read a robot file (a built-in name or a path) with its comments and layout.

    Raises:
        InputError: If there is none, it cannot be read, or is not a TOML file.
    """
    path = locate(source, "robots", "robot")
    if path.suffix == ".json":
        raise InputError("robot", str(source), "a TOML file, to be copied with its comments")
    return tomlkit.parse(read_text(path, str(source)))
