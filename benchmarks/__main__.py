"""``python -m benchmarks NAME``: run a study and write its report."""

from __future__ import annotations

import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from benchmarks.report import write_report
from benchmarks.run import open_log, run_study
from benchmarks.studies import STUDIES
from twosra_mpc import InputError

_BAD_INPUT, _INTERRUPTED = 2, 130


def _settings(
    _ctx: click.Context, _param: click.Parameter, given: tuple[str, ...]
) -> dict[str, Any]:
    try:
        return tomllib.loads("\n".join(given))
    except tomllib.TOMLDecodeError as error:
        raise click.BadParameter(f"not TOML, such as repeats=3 ({error})") from None


@click.command(
    help="Run a study and write its report.\n\n\b\n"
    + "\n".join(f"{name:17} {study.question}" for name, study in STUDIES.items())
)
@click.argument("name", metavar="NAME", type=click.Choice(list(STUDIES)))
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of report, figures and finished cases; a run that was interrupted goes on there. "
    "Default: twosra-benchmarks/NAME in the folder for temporary files.",
)
@click.option(
    "--set",
    "settings",
    metavar="KEY=VALUE",
    multiple=True,
    callback=_settings,
    help="""A setting other than the study's own, in TOML: repeats=3, 'problems=["tiny:1"]'.""",
)
def main(name: str, out: Path | None, settings: dict[str, Any]) -> None:
    """Measure what is not finished yet, then write the report and print it."""
    console = Console(stderr=True)
    folder = out or Path(tempfile.gettempdir()) / "twosra-benchmarks" / name
    try:
        usual = STUDIES[name]
        study = type(usual).parse({**usual.model_dump(), **settings}, name)
        log = open_log(name, study, folder)
        if not run_study(study, log, console):
            console.print(f"interrupted; run again to go on from {log.path}", highlight=False)
            sys.exit(_INTERRUPTED)
        sys.stdout.write(write_report(study, log, folder))
    except InputError as error:
        console.print(f"benchmarks: {error}", highlight=False, markup=False)
        sys.exit(_BAD_INPUT)


if __name__ == "__main__":
    main()
