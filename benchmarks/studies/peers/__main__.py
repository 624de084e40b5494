"""``python -m benchmarks.peers [SET]``: run the peer planners and write the comparison."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.peers.answer import Peer
from benchmarks.peers.comparison import Row, compare, settings_of
from benchmarks.peers.enumeration import Enumeration
from benchmarks.peers.integral_approximation import IntegralApproximation
from benchmarks.peers.minlp import TimeGridMinlp
from benchmarks.peers.report import report
from benchmarks.problem_set import load_set, set_names
from benchmarks.report_file import out_option, publish
from benchmarks.run_log import RunLog
from twosra_mpc import InputError, Problem

PEERS: tuple[Peer, ...] = (TimeGridMinlp(), IntegralApproximation(), Enumeration())
MOST = 10  # problems of a set; more would take hours
_BAD_INPUT = 2


@click.command()
@click.argument("name", metavar="[SET]", type=click.Choice(set_names()), required=False)
@out_option(
    "Write the report to this file too. Finished rows are kept in a folder beside it, else in "
    "the folder for temporary files; a run that was interrupted goes on there."
)
def main(name: str | None, out: Path | None) -> None:
    """Compare peer planners with ours on the first ten problems of a SET.

    Without SET: the five published problems and the first ten of random-100.
    """
    names = [name] if name else ["published", "random-100"]
    problems = [pair for each in names for pair in load_set(each).problems[:MOST]]
    temporary = Path(tempfile.gettempdir()) / "twosra-benchmarks" / f"peers-{'-'.join(names)}"
    console = Console(stderr=True)
    try:
        log = RunLog(out.with_name(f"{out.stem}-rows") if out else temporary, settings_of(PEERS))
    except InputError as error:
        console.print(f"benchmarks: {error}", highlight=False, markup=False)
        sys.exit(_BAD_INPUT)
    publish(report(_with_progress(problems, log, console), PEERS), out)


def _with_progress(problems: list[tuple[str, Problem]], log: RunLog, console: Console) -> list[Row]:
    rows: list[Row] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:
        task = progress.add_task(str(log.path), total=len(problems) * len(PEERS))
        for row in compare(
            problems, PEERS, log, lambda what: progress.update(task, description=what)
        ):
            rows.append(row)
            progress.advance(task)
            done = f"{row.problem}: {row.peer}: {row.status}, {row.wall_s:.1f} s"
            progress.console.print(done, highlight=False, markup=False)
    return rows


if __name__ == "__main__":
    main()
