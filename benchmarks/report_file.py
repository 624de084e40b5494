"""Reports are printed, and written to a file where one is asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from twosra_mpc import InputError
from twosra_mpc.cli.output import check_writable
from twosra_mpc.files import write_text


def out_option(words: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add ``--out`` for a report; a file that cannot be written is refused before any run."""
    return click.option("--out", type=click.Path(path_type=Path), callback=_checked, help=words)


def _checked(_ctx: click.Context, _param: click.Parameter, out: Path | None) -> Path | None:
    if out is not None:
        try:
            check_writable(out)
        except InputError as error:
            raise click.BadParameter(str(error)) from error
    return out


def publish(text: str, out: Path | None) -> None:
    """Print a report, and write it to ``out`` if that is given."""
    if out is not None:
        write_text(out, text)
    sys.stdout.write(text)
