"""``twosra animate``."""

from __future__ import annotations

from pathlib import Path

import click

from twosra_mpc.cli.options import output_options
from twosra_mpc.cli.output import EXIT_NO_PLAN, EXIT_PLANNED, Output, check_writable
from twosra_mpc.plan import load_plan

_HELP = """Animate PLAN, a plan file, into OUT (gif; mp4 with ffmpeg).

Waits are compressed, motion is slowed down, and a clock shows the time.

\b
  twosra plan paper-1 --out plan.json
  twosra animate plan.json plan.gif
"""


@click.command("animate", help=_HELP)
@click.argument("plan_file", metavar="PLAN")
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--seconds",
    type=click.FloatRange(min=1.0, max=120.0),
    default=12.0,
    show_default=True,
    help="Length of the animation [s].",
)
@output_options
def animate_command(plan_file: str, out: Path, seconds: float, output: Output) -> int:
    """Animate a plan file; see ``_HELP``."""
    check_writable(out)
    from twosra_mpc.plotting.film import check_animation_path  # matplotlib takes a second

    check_animation_path(out)
    made = load_plan(plan_file)
    if made.samples is None:
        click.echo(f"twosra: there is nothing to animate: {made.message}", err=True)
        return EXIT_NO_PLAN
    from twosra_mpc.plotting.animation import animate_plan

    with output.progress("animating") as tell:
        animate_plan(
            made,
            out,
            duration_s=seconds,
            on_progress=lambda done, total: tell(f"animating: frame {done} of {total}"),
        )
    size = out.stat().st_size
    output.report(
        lambda: {"file": str(out), "bytes": size},
        lambda: click.echo(f"{out}: {size / 1e6:.1f} MB"),
    )
    return EXIT_PLANNED
