"""``twosra animate``."""

from __future__ import annotations

from pathlib import Path

import click

from twosra_mpc.cli.options import animation, out_argument, output_options
from twosra_mpc.cli.output import EXIT_NO_PLAN, EXIT_PLANNED, Output
from twosra_mpc.plans.document import load_plan

_HELP = """Animate PLAN, a plan file, into OUT (gif; mp4 with ffmpeg).

Waits are compressed, motion is slowed down, and a clock shows the time.

\b
A plan and its film:
  twosra plan paper-1 --out plan.json
  twosra animate plan.json plan.gif
The same in a hurry:
  twosra animate plan.json short.gif --seconds 4
"""


@click.command("animate", help=_HELP)
@click.argument("plan", type=click.Path(path_type=Path))
@out_argument(animation)
@click.option(
    "--seconds",
    type=click.FloatRange(min=1.0, max=120.0),
    default=12.0,
    show_default=True,
    help="Length of the animation [s].",
)
@output_options
def animate_command(plan: Path, out: Path, seconds: float, output: Output) -> int:
    """Animate a plan file; see ``_HELP``."""
    loaded = load_plan(plan)
    if (made := loaded.plan) is None:
        click.echo(f"twosra: there is nothing to animate: {loaded.message}", err=True)
        return EXIT_NO_PLAN
    from twosra_mpc.plotting.animation import animate_plan  # matplotlib takes a second

    with output.progress("animating") as tell:
        animate_plan(
            made,
            out,
            duration_s=seconds,
            on_progress=lambda done, total: tell(f"animating: frame {done} of {total}"),
        )
    document = {"file": str(out), "bytes": out.stat().st_size}
    output.record((made.robot.name, "animation"), document)
    return EXIT_PLANNED
