"""Options that several commands share: how to talk, and files that are checked before any work."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from twosra_mpc.cli.output import Output, check_writable
from twosra_mpc.setpoints import check_rate

Function = Callable[..., Any]
Decorator = Callable[[Function], Function]


def output_options(function: Function) -> Function:
    """Add ``--json`` and ``--quiet``; the command is given what they chose as ``output``."""

    @click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
    @click.option("--quiet", "-q", is_flag=True, help="Print errors only; see the exit code.")
    @functools.wraps(function)
    def command(*args: Any, as_json: bool, quiet: bool, **given: Any) -> Any:
        return function(*args, output=Output(as_json=as_json, quiet=quiet), **given)

    return command


def file_option(name: str, words: str) -> Decorator:
    """Add an option for a file to write; one that cannot be written is refused at once."""
    return _path_option(name, words, check_writable)


def plot_option(words: str) -> Decorator:
    """Add ``--plot`` for a figure."""
    return _path_option("--plot", f"{words} (png, pdf, svg).", _check_figure)


def animate_option(words: str) -> Decorator:
    """Add ``--animate`` for a film."""
    return _path_option("--animate", f"{words} (gif; mp4 with ffmpeg).", _check_animation)


def rate_option(words: str, *, required: bool = False) -> Decorator:
    """Add ``--rate`` for rows of set-points per second [Hz]."""

    def checked(_ctx: click.Context, _param: click.Parameter, rate: float | None) -> float | None:
        if rate is not None:
            check_rate(rate)
        return rate

    asked: dict[str, Any] = {"required": required, "callback": checked, "help": words}
    return click.option("--rate", "rate_Hz", type=float, metavar="HZ", **asked)


def _path_option(name: str, words: str, check: Callable[[Path], None]) -> Decorator:
    def checked(_ctx: click.Context, _param: click.Parameter, target: Path | None) -> Path | None:
        if target is not None:
            check(target)
        return target

    return click.option(name, type=click.Path(path_type=Path), callback=checked, help=words)


def _check_figure(target: Path) -> None:
    from twosra_mpc.plotting.figure_file import check_figure_path  # matplotlib takes a second

    check_writable(target)
    check_figure_path(target)


def _check_animation(target: Path) -> None:
    from twosra_mpc.plotting.film import check_animation_path  # matplotlib takes a second

    check_writable(target)
    check_animation_path(target)
