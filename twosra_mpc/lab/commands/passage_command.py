"""``twosra check-passage``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.options import (
    SCENARIO,
    Load,
    choice_option,
    command,
    plot_option,
    scenario_options,
)
from twosra_mpc.cli.output import Output, numbers, print_table


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
    from twosra_mpc.lab.worlds.passages import VERDICTS, find_passages

    problem = load(scenario)
    with output.progress("deciding") as tell:
        found = find_passages(
            problem, step, headings, lambda done, of: tell(f"deciding: shape {done} of {of}")
        )
        if plot is not None:
            from twosra_mpc.lab.figures.passage_figure import plot_passages  # matplotlib is slow

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
