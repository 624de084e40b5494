"""``twosra resample``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from twosra_mpc.checking.resampling import refined
from twosra_mpc.cli.options import ending, out_argument, output_options, rate_option
from twosra_mpc.cli.output import EXIT_PLANNED, Output
from twosra_mpc.plans.document import load_plan
from twosra_mpc.plans.setpoints import save_setpoints

_HELP = """Write the set-points of PLAN at a regular rate to OUT, a .csv or a .json file.

CSV has one row a tick: what is in force at that time, for a controller that sends it and waits for
the next tick. JSON stays a plan, whose inputs hold from a sample to the next: samples are added at
the ticks, and those of the plan stay, because its inputs change between ticks too. "twosra verify"
accepts the outcome.

\b
Set-points for a controller that runs at 20 Hz:
  twosra resample plan.json setpoints.csv --rate 20
The same plan, dense enough to look at:
  twosra resample plan.json dense.json --rate 5
"""


@click.command("resample", help=_HELP)
@click.argument("plan", type=click.Path(path_type=Path))
@out_argument(ending(".csv", ".json"))
@rate_option("Ticks per second.", required=True)
@output_options
def resample_command(plan: Path, out: Path, rate_Hz: float, output: Output) -> int:
    """Resample a plan; see ``_HELP``."""
    loaded = load_plan(plan)
    given = loaded.require()
    with output.progress(f"resampling at {rate_Hz:g} Hz"):
        if out.suffix == ".csv":
            save_setpoints(given, out, rate_Hz)
        else:
            replace(loaded, plan=refined(given, rate_Hz)).save(out)
    document = {"file": str(out), "rate_Hz": rate_Hz, "duration_s": given.duration_s}
    output.record((given.robot.name, "resampled"), document)
    return EXIT_PLANNED
