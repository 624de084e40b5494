"""Robot files copied with their comments, but the identified segment."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit.items import AoT, Table

from twosra_mpc.files import write_text
from twosra_mpc.lab.identification.thermal_fit import LOGS_DIFFER, ThermalFit
from twosra_mpc.lab.identification.transition_fit import TransitionFit
from twosra_mpc.robot.description import robot_document


def write_identified_robot(
    source: str | Path, target: str | Path, fit: ThermalFit | TransitionFit, number: int = 0
) -> None:
    """Write a copy of a robot file whose ``[segment]`` has the identified values and ranges.

    Of a file that lists its segments, this is the one of a number, from 0. Everything else,
    comments included, stays as it is.

    Raises:
        InputError: If ``source`` is not TOML, or ``target`` cannot be written.
    """
    document = robot_document(source)
    segment = document["segment"]
    if isinstance(segment, AoT):
        segment = segment[number]
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
        f" {100 * LOGS_DIFFER:zg} % on either side, as fits to logs of one segment differ"
    )
    write_text(target, tomlkit.dumps(document))
