"""Output of the commands: exit codes, tables or JSON, progress, and the check of output paths."""

from __future__ import annotations

import enum
import json
import math
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import click

from twosra_mpc.files import plain_data

_WIDTH, _LEAST_WIDTH = 100, 40  # characters: of tables in files and pipes, and anywhere
Tell = Callable[[str], None]


class Exit(enum.IntEnum):
    """Exit codes of the commands."""

    PLANNED = 0
    BROKEN_PIPE = 1  # whoever read the output has gone; click's code for it
    BAD_INPUT = 2  # click's own
    INFEASIBLE, NO_PLAN = 3, 4
    UNSEEN = 5  # at the goal by dead reckoning: nobody has seen it
    BUG, INTERRUPTED = 70, 130  # as sysexits.h and shells have them


@dataclass(frozen=True)
class Output:
    """Output of a command, as chosen by ``--json`` and ``--quiet``.

    Attributes:
        as_json: One JSON document on standard output, and nothing else there.
        quiet: Neither tables nor progress.
    """

    as_json: bool
    quiet: bool

    def report(self, document: Callable[[], Any], tables: Callable[[], None]) -> None:
        """Print a result: as plain data with ``--json``, else as tables unless ``--quiet``.

        The document has what was doubted in the input as ``warnings``, if anything was.
        """
        if self.as_json:
            shown = plain_data(document())
            told = click.get_current_context().find_object(list)
            if told and isinstance(shown, dict):
                shown["warnings"] = [*shown.get("warnings", ()), *told]
            click.echo(json.dumps(shown, allow_nan=False))
        elif not self.quiet:
            tables()

    def record(self, title: tuple[str, str], record: Mapping[str, Any]) -> None:
        """Print a result that is a few names with their values."""
        rows = [(name, _cell(value)) for name, value in record.items()]
        self.report(lambda: record, lambda: print_table(title, rows))

    @contextmanager
    def progress(self, words: str) -> Iterator[Tell]:
        """Show a line of progress on standard error where that is a terminal; yields its update."""
        seen = sys.stderr.isatty() or os.environ.get("FORCE_COLOR")  # as rich decides
        if self.quiet or not seen:
            yield lambda _: None
            return
        from rich.console import Console
        from rich.status import Status as Spinner

        with Spinner(words, console=Console(stderr=True)) as spinner:
            yield lambda text: spinner.update(text)


def counting(tell: Tell, words: str) -> Callable[[int, int], None]:
    """Callback that shows how many of how many are done, after these words."""
    return lambda done, of: tell(f"{words} {done} of {of}")


def digits(value: float | None, places: int) -> str:
    """A number in a table; a dash where it is not known."""
    return "-" if value is None or math.isnan(value) else f"{value:z.{places}f}"


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return str(round(value, 6) + 0.0)  # no minus zero
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def print_table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """Print a table; in files and pipes it is as wide as its cells, but at most 100 or COLUMNS."""
    from rich import box  # what prints no table need not load it
    from rich.console import Console
    from rich.table import Column, Table

    columns = (Column(title, overflow="fold") for title in header)  # narrow, no sign is lost
    table = Table(*columns, box=box.SIMPLE_HEAD, pad_edge=False, highlight=False)
    for row in rows:
        table.add_row(*row)
    width = max(shutil.get_terminal_size((_WIDTH, 0)).columns, _LEAST_WIDTH)
    console = Console(width=width, highlight=False, markup=False, emoji=False)
    with console.capture() as captured:
        console.print(table)
    click.echo(captured.get(), nl=False)


def numbers(values: Any) -> str:
    """Join numbers by commas; one that is not a number is free."""
    return ", ".join("free" if value != value else f"{value:zg}" for value in values)
