"""``python -m benchmarks NAME``: run a study, make a record of it, write the tables of records."""

from __future__ import annotations

import json
import shlex
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from benchmarks import records
from benchmarks.records import Record, commit_of, source_digest
from benchmarks.report import published_tables, write_report
from benchmarks.run import open_log, run_study
from benchmarks.run_log import NAME
from benchmarks.studies import STUDIES
from benchmarks.study import Study
from benchmarks.tables import write_tables
from twosra_mpc import InputError
from twosra_mpc.files import reading

_CHANGED, _BAD_INPUT, _INTERRUPTED = 1, 2, 130


class _Commands(click.Group):
    """Commands that are all told where one is not known."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in self.commands:
            ctx.fail(f"{args[0]!r} is none of {', '.join(self.commands)}.")
        return super().resolve_command(ctx, args)


@click.group(cls=_Commands)
def main() -> None:
    """Run a study and write its report; make records of studies, and tables of records."""


def _settings(
    _ctx: click.Context, _param: click.Parameter, given: tuple[str, ...]
) -> dict[str, Any]:
    try:
        return tomllib.loads("\n".join(given))
    except tomllib.TOMLDecodeError as error:
        raise click.BadParameter(f"not TOML, such as repeats=3 ({error})") from None


_OPTIONS: list[click.Parameter] = [
    click.Option(
        ["--out"],
        type=click.Path(path_type=Path, file_okay=False),
        help="Folder of report, figures and finished cases; a run that was interrupted goes on "
        "there. Default: twosra-benchmarks/NAME in the folder for temporary files.",
    ),
    click.Option(
        ["--set", "settings"],
        metavar="KEY=VALUE",
        multiple=True,
        callback=_settings,
        help="""A setting other than the study's own, in TOML: repeats=3, 'problems=["tiny:1"]'.""",
    ),
]


def _measure(name: str, out: Path | None, settings: dict[str, Any]) -> None:
    """Measure what is not finished yet, then write the report and print it."""
    console = Console(stderr=True)
    folder = out or Path(tempfile.gettempdir()) / "twosra-benchmarks" / name
    with _told(console):
        study = _study(name, settings)
        log = open_log(name, study, folder)
        if not run_study(study, log, console):
            console.print(f"interrupted; run again to go on from {log.path}", highlight=False)
            sys.exit(_INTERRUPTED)
        sys.stdout.write(write_report(study, log, folder))


for _name, _usual in STUDIES.items():
    main.add_command(
        click.Command(
            _name, callback=partial(_measure, _name), params=_OPTIONS, help=_usual.question
        )
    )


@main.command("record")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
def record_command(folders: tuple[Path, ...]) -> None:
    """Make records of finished studies in FOLDERS, and write all tables."""
    with _told(Console(stderr=True)):
        for folder in folders:
            for path in record(folder):
                click.echo(path)
        write_tables(records.ROOT)


@main.command("tables")
@click.option(
    "--check-release", is_flag=True, help="Exit code 1 if anything measured has changed since."
)
def tables_command(check_release: bool) -> None:
    """Write the tables of README and docs from their records."""
    with _told(Console(stderr=True)):
        changed = write_tables(records.ROOT)
    for name in changed:
        click.echo(f"{name}: what it measures has changed since")
    sys.exit(_CHANGED if check_release and changed else 0)


def record(folder: Path) -> list[Path]:
    """Write the records of the finished study in a folder; their files.

    Raises:
        InputError: If it is not finished or was made by other source files, versions or another
            machine; if what it measures is not committed; or if it publishes no table.
    """
    with reading(str(folder / NAME), "study", "the log of a study"):
        about = json.loads((folder / NAME).read_text(encoding="utf-8").partition("\n")[0])
        name, study = about["study"], _study(about["study"], about["settings"])
    log = open_log(name, study, folder)
    usual, given = STUDIES[name].model_dump(mode="json"), about["settings"]
    words = [f"{key}={json.dumps(given[key])}" for key in given if given[key] != usual[key]]
    options = "".join(f" --set {shlex.quote(word)}" for word in words)
    made = {
        "command": f"python -m benchmarks {name}{options}",
        "date": max(log.dates, default=""),
        "commit": commit_of(study.measures, records.ROOT),
        "cases": f"{len(log.loads)} case{'s' * (len(log.loads) != 1)}",
        **{key: about[key] for key in ("settings", "machine", "versions")},
        "measures": {path: source_digest(records.ROOT / path) for path in study.measures},
    }
    paths = []
    for suffix, (columns, *rows) in published_tables(study, log, folder).items():
        paths.append(records.FOLDER / f"{name}{suffix.replace('_', '-')}.json")
        Record(**made, columns=columns, rows=tuple(rows)).save(paths[-1])
    return paths


def _study(name: str, settings: dict[str, Any]) -> Study:
    usual = STUDIES[name]
    return type(usual).parse({**usual.model_dump(), **settings}, name)


@contextmanager
def _told(console: Console) -> Iterator[None]:
    """End with what was wrong with an input."""
    try:
        yield
    except InputError as error:
        console.print(f"benchmarks: {error}", highlight=False, markup=False)
        sys.exit(_BAD_INPUT)


if __name__ == "__main__":
    main()
