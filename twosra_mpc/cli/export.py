"""``twosra export``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.options import ending, out_argument, output_options, rate_option
from twosra_mpc.cli.output import EXIT_PLANNED, Output
from twosra_mpc.export.authors_csv import save_authors_csv
from twosra_mpc.export.plan_mcap import TOPICS, save_mcap
from twosra_mpc.installation import install_command
from twosra_mpc.plans.document import load_plan

_HELP = f"""Write PLAN to OUT in the format of another program: a .mcap or a .csv file.

MCAP opens in Foxglove without ROS: the robot to scale (topic /robot, frames on /tf),
configuration, mode, wheels, heaters and temperatures. Its clock is the plan's, from zero. CSV has
the columns of the authors' own trajectories, x,y,angle,k1,k2,v1,v2,u0,v0,r0,s1,s2,time. At a
--rate, a phase that is shorter than a period can fall between two of its rows.

MCAP needs the package foxglove-sdk: {install_command("mcap")}

\b
Play a plan at thirty frames a second (in Foxglove: open the file, add a 3D panel):
  twosra plan paper-1 --out plan.json
  twosra export plan.json plan.mcap --rate 30
The plan's own grid as the authors' scripts read it:
  twosra export plan.json plan.csv
"""


@click.command("export", help=_HELP)
@click.argument("plan", type=click.Path(path_type=Path))
@out_argument(ending(".mcap", ".csv"))
@rate_option("CSV: rows per second. MCAP: samples per second besides the plan's own.")
@output_options
def export_command(plan: Path, out: Path, rate_Hz: float | None, output: Output) -> int:
    """Export a plan; see ``_HELP``."""
    given = load_plan(plan).require()
    with output.progress(f"writing {out}"):
        if out.suffix == ".csv":
            save_authors_csv(given, out, rate_Hz)
        else:
            save_mcap(given, out, rate_Hz)
    robot, duration_s = given.robot.name, given.duration_s
    document: dict[str, Any] = {"file": str(out), "robot": robot, "duration_s": duration_s}
    if out.suffix == ".mcap":
        document["topics"] = list(TOPICS)
    output.record((robot, "exported"), document)
    return EXIT_PLANNED
