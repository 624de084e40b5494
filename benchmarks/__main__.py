"""``python -m benchmarks NAME``: run a suite and write its report."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from pathlib import Path

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from benchmarks.report import settings_of, write_report
from benchmarks.run_log import RunLog
from benchmarks.suite import Suite
from benchmarks.suite_file import load_suite, suite_names
from twosra_mpc import InputError

_BAD_INPUT, _INTERRUPTED = 2, 130


@click.command(help=f"Run a suite: {', '.join(suite_names())}, or a suite's TOML file.")
@click.argument("name")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of report, figures and finished runs; a run that was interrupted goes on there. "
    "Default: twosra-benchmarks/NAME in the folder for temporary files.",
)
def main(name: str, out: Path | None) -> None:
    """Run what is not finished yet, then write the report and print it."""
    console = Console(stderr=True)
    try:
        label, suite = load_suite(name)
        folder = out or Path(tempfile.gettempdir()) / "twosra-benchmarks" / label
        log = RunLog(folder, settings_of(suite))
    except InputError as error:
        console.print(f"benchmarks: {error}", highlight=False, markup=False)
        sys.exit(_BAD_INPUT)
    load_before = os.getloadavg()[0]
    if not run_suite(suite, log, console):
        console.print(f"interrupted; run again to go on from {log.path}", highlight=False)
        sys.exit(_INTERRUPTED)
    text = write_report(label, suite, log, folder, load_before)
    sys.stdout.write(text)


def run_suite(suite: Suite, log: RunLog, console: Console) -> bool:
    """Make every run that ``log`` does not hold yet; False if interrupted before the end."""
    interrupt = _Interrupt()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    runs = list(suite.runs())
    with Progress(*columns, console=console) as progress, interrupt:
        task = progress.add_task("", total=len(runs))
        try:
            for run in runs:
                progress.update(task, description=run.key)
                if run.key not in log.records:
                    record = run.measure()
                    if interrupt.asked:  # the planner returns what it has: not a finished run
                        return False
                    log.append(run.key, record)
                progress.advance(task)
        except KeyboardInterrupt:
            return False
    return True


class _Interrupt:
    """Notes Ctrl-C besides raising it: the planner answers it with the best plan so far."""

    def __init__(self) -> None:
        self.asked = False

    def __enter__(self) -> None:
        self._before = signal.signal(signal.SIGINT, self._note)

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _note(self, *_: object) -> None:
        self.asked = True
        raise KeyboardInterrupt


if __name__ == "__main__":
    main()
