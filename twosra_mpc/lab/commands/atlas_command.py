"""``twosra atlas``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from twosra_mpc.cli.options import FILE, command, ending, file_option, plot_option
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.files import write_text
from twosra_mpc.lab.batch import read_runs
from twosra_mpc.lab.batch.atlas import Atlas, Spread, atlas

_SHOWN = 8  # rows of a table whose length nobody chose


@command("atlas")
@click.argument("runs", metavar="RUNS", type=FILE)
@click.option("-x", "x", metavar="KEY", help="Varied key along the figure's x axes.")
@click.option("-y", "y", metavar="KEY", help="Varied key along the y axes of its maps.")
@file_option("--csv", "Write the whole table as CSV.", ending(".csv"))
@plot_option("Draw sequences, durations, savings, sensitivities and gaps")
def atlas_command(
    runs: Path, x: str | None, y: str | None, csv: Path | None, plot: Path | None, output: Output
) -> None:
    """Say what the plans of a batch have in common: RUNS is the folder of "twosra batch".

    It need not be finished. Which sequences plans have, how long plans take, what they save against
    the greedy rule, what a second less freezing is worth, and what failed and why.

    \b
    In words, and as a picture over the first two keys that were varied:
      twosra atlas runs --plot atlas.png
    Over others:
      twosra atlas runs -x robot.heater.melt_current_A -y goal.kappa_per_m.0 --plot atlas.png
    """
    with output.progress("reading the table") as tell:
        frame = read_runs(runs)
        found = atlas(frame)
        if csv is not None:
            write_text(csv, frame.to_csv(index=False))
        if plot is not None:
            tell("drawing")
            from twosra_mpc.lab.figures.atlas_figure import plot_atlas  # matplotlib takes a second

            plot_atlas(frame, x, y, plot)
    output.report(lambda: found, lambda: _print(found))


def _print(found: Atlas) -> None:
    count = {name: f"{number} of {found.problems}" for name, number in found.statuses.items()}
    print_table(("problems that are", "how many"), list(count.items()))
    plans = sum(found.sequences.values())
    shares = [(name, f"{number} of {plans}") for name, number in found.sequences.items()]
    print_table(("mode sequence", "plans"), _first(shares))
    quantities = {
        "duration [s]": _cells(found.duration_s),
        "proved gap at full speed [%]": _cells(found.gap, 100.0),
        "saved against the greedy rule [s]": _cells(found.saved_s),
        **{f"saved by {each.change} [s]": _cells(each.saved_s) for each in found.worth},
    }
    header = ("of the plans", "number", "least", "10 %", "median", "90 %", "most")
    print_table(header, [(name, *cells) for name, cells in quantities.items() if cells])
    if found.failures:
        rows = [(f.status, str(f.problems), str(f.first), f.message) for f in found.failures]
        print_table(("without a plan", "problems", "first", "what was said of it"), _first(rows))


def _cells(spread: Spread | None, scale: float = 1.0) -> tuple[str, ...]:
    if spread is None:
        return ()
    plans, *quantiles = spread
    return (str(plans), *(f"{scale * value:z.4g}" for value in quantiles))


def _first(rows: Sequence[tuple[str, ...]]) -> Sequence[tuple[str, ...]]:
    """The first rows, and a last one that says how many others there are."""
    if len(rows) <= _SHOWN:
        return rows
    return [*rows[:_SHOWN], (f"{len(rows) - _SHOWN} others", *("" for _ in rows[0][1:]))]
