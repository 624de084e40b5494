"""Robot files that carry an identified segment."""

from __future__ import annotations

from pathlib import Path

import tomlkit
from tomlkit.items import Table

from twosra_mpc.files import write_text
from twosra_mpc.identification.thermal import SEGMENT_FIELDS, ThermalFit
from twosra_mpc.robot.document import robot_document


def write_identified_robot(source: str | Path, target: str | Path, fit: ThermalFit) -> None:
    """Write a copy of a robot file whose ``[segment]`` has the identified values and ranges.

    Everything else, comments included, stays as it is.

    Raises:
        InputError: If ``source`` is not TOML, or ``target`` cannot be written.
    """
    document = robot_document(source)
    segment = document["segment"]
    assert isinstance(segment, Table)
    for name in SEGMENT_FIELDS:
        segment[name] = getattr(fit.segment, name)
    log, rms = Path(fit.source).name, fit.residuals.rms_C
    segment.comment(f"identified anew from {log}: residual {rms:.2g} C (RMS) at the sensor")
    if "ranges" not in segment:
        segment["ranges"] = tomlkit.table()
    ranges = segment["ranges"]
    assert isinstance(ranges, Table)
    for name in SEGMENT_FIELDS:
        ranges[name] = list(fit.segment.ranges[name])
    ranges.comment("5 % to 95 % by the fit's standard error, and all fits without a cycle")
    write_text(target, tomlkit.dumps(document))
