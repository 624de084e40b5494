"""``twosra batch``."""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from twosra_mpc.cli.options import FILE, command
from twosra_mpc.cli.output import Exit, Output
from twosra_mpc.files import read_text
from twosra_mpc.installation import BATCH, require
from twosra_mpc.interrupts import noted_interrupts

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from twosra_mpc.lab.batch.chunk import Chunk
    from twosra_mpc.lab.batch.problems import Problems

_PLANNERS = click.Choice(["optimal", "greedy", "both"])


@command("batch")
@click.argument("spec", type=FILE)
@click.option("--out", "-o", type=FILE, metavar="RUNS", required=True, help="Folder of the runs.")
@click.option("--planner", type=_PLANNERS, help="Override the spec.")
@click.option("--plans", is_flag=True, default=None, help="Write plan files, too.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes here; default: one a core.")
@click.option("--scheduler", metavar="URL", help="Plan on a Dask cluster, e.g. tcp://host:8786.")
def batch_command(
    spec: Path,
    out: Path,
    workers: int | None,
    scheduler: str | None,
    output: Output,
    **overrides: Any,
) -> int:
    """Plan everything that SPEC, a TOML file, asks for; results go into the folder RUNS.

    \b
    A thousand random problems on all cores:
      twosra batch random.toml --out runs
    The same problems by the greedy rule as well, with all plan files, on a cluster:
      twosra batch random.toml --out both --planner both --plans --scheduler tcp://host:8786

    Whatever ends it, the same command goes on with what is not planned yet. RUNS/runs.parquet is
    the table in the end, a row a problem; a problem without a plan has a row that says why.
    """
    if scheduler is not None and workers is not None:
        raise click.UsageError("--workers are processes here; a --scheduler has its own")
    require("twosra batch", "batch", *BATCH)
    from twosra_mpc.lab.batch.problems import Problems
    from twosra_mpc.lab.batch.spec import spec_in

    given = {name: value for name, value in overrides.items() if value is not None}
    text = read_text(spec, str(spec))  # once: it may be a pipe
    problems = Problems(spec_in(text, spec, **given), spec.parent)
    from twosra_mpc.lab.batch.folder import Folder  # CasADi takes a second

    folder = Folder(out, problems, text)
    done, started = folder.done(), time.perf_counter()
    try:
        with noted_interrupts() as interrupts:
            for chunk in _planned(problems, done, workers, scheduler, output):
                folder.add(chunk)
                interrupts.check()  # an exception may be lost in a callback of Dask
        folder.finish()
    except KeyboardInterrupt:
        told = f"{folder.done().sum()} of {len(problems)} problems are planned"
        click.echo(f"twosra: interrupted: {told}; the same command goes on", err=True)
        return Exit.INTERRUPTED
    _report(out, len(problems) - int(done.sum()), time.perf_counter() - started, output)
    return Exit.PLANNED


def _planned(
    problems: Problems,
    done: NDArray[np.bool_],
    workers: int | None,
    scheduler: str | None,
    output: Output,
) -> Iterator[Chunk]:
    """Yield what problems that are not done come to; show how far it is."""
    if done.all():
        return
    from twosra_mpc.lab.batch.chunk import Asked
    from twosra_mpc.lab.batch.workers import cluster_at, local_cluster, planned

    asked = Asked(problems.spec.planner, problems.spec.plans)
    ready, started = int(done.sum()), time.perf_counter()
    with (
        output.progress("waiting for workers") as tell,
        local_cluster(workers) if scheduler is None else cluster_at(scheduler) as client,
    ):
        if scheduler is None and find_spec("bokeh") is not None and not output.quiet:
            click.echo(f"twosra: dashboard: {client.dashboard_link}", err=True)
        for chunk in planned(client, problems.posed(done), asked):
            yield chunk
            ready += len(chunk.rows)
            rate = (ready - int(done.sum())) / (time.perf_counter() - started)
            left_s = (len(problems) - ready) / rate
            tell(f"planning: {ready} of {len(problems)}, {rate:z.1f}/s, {left_s:z.0f} s left")


def _report(out: Path, planned: int, wall_s: float, output: Output) -> None:
    """Say how many problems came to what."""
    from twosra_mpc.lab.batch import read_runs

    frame = read_runs(out)
    statuses = {str(name): int(count) for name, count in frame["status"].value_counts().items()}
    told = {
        "runs": str(out / "runs.parquet"),
        "problems": len(frame),
        **statuses,
        "planned now": planned,
        "wall_s": wall_s,
        "cpu_s": float(frame["cpu_s"].sum()),
    }
    output.record(("batch", str(out)), told)
