"""``twosra batch`` and ``twosra atlas``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import click

from twosra_mpc.cli.options import Plot, argument, command, ending, option, written
from twosra_mpc.cli.output import Exit, Output, print_table
from twosra_mpc.files import read_text, write_text
from twosra_mpc.installation import BATCH, require
from twosra_mpc.interrupts import noted_interrupts
from twosra_mpc.lab.batch import read_runs
from twosra_mpc.lab.batch.atlas import Atlas, Spread, atlas


@command("batch")
def batch_command(
    spec: Annotated[Path, argument()],
    out: Annotated[Path, option(metavar="RUNS")],
    planner: Literal["optimal", "greedy", "both"] | None,
    plans: bool | None,
    workers: Annotated[int | None, option(type=click.IntRange(min=1))],
    scheduler: Annotated[str | None, option(metavar="URL")],
    output: Output,
) -> int:
    """Plan everything that SPEC, a TOML file, asks for; results go into the folder RUNS.

    \b
    A thousand random problems on all cores:
      twosra batch random.toml --out runs
    The same problems by the greedy rule as well, with all plan files, on a cluster:
      twosra batch random.toml --out both --planner both --plans --scheduler tcp://host:8786

    Whatever ends it, the same command goes on with what is not planned yet. RUNS/runs.parquet is
    the table in the end, a row a problem; a problem without a plan has a row that says why.

    Options:
        out: Folder of the runs.
        planner: Override the spec.
        plans: Write plan files, too.
        workers: Processes here; default: one a core.
        scheduler: Plan on a Dask cluster, e.g. tcp://host:8786.
    """
    if scheduler is not None and workers is not None:
        raise click.UsageError("--workers are processes here; a --scheduler has its own")
    require("twosra batch", "batch", *BATCH)
    from twosra_mpc.lab.batch.problems import Problems
    from twosra_mpc.lab.batch.spec import spec_in

    chosen = {"planner": planner, "plans": plans}
    given = {name: value for name, value in chosen.items() if value is not None}
    text = read_text(spec, str(spec))  # once: it may be a pipe
    problems = Problems(spec_in(text, spec, **given), spec.parent)
    from twosra_mpc.lab.batch.folder import Asked, Folder  # CasADi takes a second

    folder = Folder(out, problems, text)
    done, started = folder.done(), time.perf_counter()
    ready = before = int(done.sum())
    try:
        if before < len(problems):
            from twosra_mpc.lab.batch.workers import cluster_at, local_cluster, planned

            asked = Asked(problems.spec.planner, problems.spec.plans)
            with (
                noted_interrupts() as interrupts,
                output.progress("waiting for workers") as tell,
                local_cluster(workers) if scheduler is None else cluster_at(scheduler) as client,
            ):
                if scheduler is None and find_spec("bokeh") is not None and not output.quiet:
                    click.echo(f"twosra: dashboard: {client.dashboard_link}", err=True)
                for chunk in planned(client, problems.posed(done), asked):
                    folder.add(chunk)
                    interrupts.check()  # an exception may be lost in a callback of Dask
                    ready += len(chunk.rows)
                    rate = (ready - before) / (time.perf_counter() - started)
                    left_s = (len(problems) - ready) / rate
                    words = f"planning: {ready} of {len(problems)}, {rate:z.1f}/s"
                    tell(f"{words}, {left_s:z.0f} s left")
        folder.finish()
    except KeyboardInterrupt:
        told = f"{folder.done().sum()} of {len(problems)} problems are planned"
        click.echo(f"twosra: interrupted: {told}; the same command goes on", err=True)
        return Exit.INTERRUPTED
    frame = read_runs(out)
    statuses = {str(name): int(count) for name, count in frame["status"].value_counts().items()}
    numbers = {
        "runs": str(out / "runs.parquet"),
        "problems": len(frame),
        **statuses,
        "planned now": len(problems) - before,
        "wall_s": time.perf_counter() - started,
        "cpu_s": float(frame["cpu_s"].sum()),
    }
    output.record(("batch", str(out)), numbers)
    return Exit.PLANNED


_SHOWN = 8  # rows of a table whose length nobody chose


@command("atlas")
def atlas_command(
    runs: Annotated[Path, argument()],
    x: Annotated[str | None, option("-x", metavar="KEY")],
    y: Annotated[str | None, option("-y", metavar="KEY")],
    csv: Annotated[Path | None, written(ending(".csv"))],
    plot: Plot,
    output: Output,
) -> None:
    """Say what the plans of a batch have in common: RUNS is the folder of "twosra batch".

    It need not be finished. Which sequences plans have, how long plans take, what they save against
    the greedy rule, what a second less freezing is worth, and what failed and why.

    \b
    In words, and as a picture over the first two keys that were varied:
      twosra atlas runs --plot atlas.png
    Over others:
      twosra atlas runs -x robot.heater.melt_current_A -y goal.kappa_per_m.0 --plot atlas.png

    Options:
        x: Varied key along the figure's x axes.
        y: Varied key along the y axes of its maps.
        csv: Write the whole table as CSV.
        plot: Draw sequences, durations, savings, sensitivities and gaps (png, pdf, svg).
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
