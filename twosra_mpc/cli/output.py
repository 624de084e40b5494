"""What the commands share: exit codes, tables, and the check of output paths."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twosra_mpc.errors import InputError

EXIT_PLANNED, EXIT_BAD_INPUT, EXIT_INFEASIBLE, EXIT_NO_PLAN = 0, 2, 3, 4


def check_writable(target: Path | None) -> None:
    """Refuse an output path before an hour of planning is lost to it."""
    if target is not None and _cannot_be_written(target):
        raise InputError("output", str(target), "a file path in a folder that can be written")


def _cannot_be_written(target: Path) -> bool:
    folder = target.parent
    return target.is_dir() or not (folder.is_dir() and os.access(folder, os.W_OK))


def print_table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """Print a table; in files and pipes its lines are not broken."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(*header, box=box.SIMPLE_HEAD, pad_edge=False, highlight=False)
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = 240
    console.print(table)


def numbers(values: Any) -> str:
    """Join numbers by commas; one that is not a number is free."""
    return ", ".join("free" if value != value else f"{value:g}" for value in values)
