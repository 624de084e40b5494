"""``python -m benchmarks NAME``: run a study, make a record of it, write the tables of records."""

from __future__ import annotations

import json
import shlex
import subprocess
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
from benchmarks.run import open_log, run_study, versions
from benchmarks.run_log import NAME
from benchmarks.studies import FULL, STUDIES
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
    """Run a study, or all; write reports, records of studies, and tables of records."""


def _settings(
    _ctx: click.Context, _param: click.Parameter, given: tuple[str, ...]
) -> dict[str, Any]:
    try:
        return tomllib.loads("\n".join(given))
    except tomllib.TOMLDecodeError as error:
        raise click.BadParameter(f"not TOML, such as repeats=3 ({error})") from None


def _out(words: str) -> click.Option:
    return click.Option(
        ["--out"],
        type=click.Path(path_type=Path, file_okay=False),
        help=f"Folder of report, figures and finished cases{words}; a run that was interrupted "
        "goes on there. Default: a folder of its own for the source files as they are, in the "
        "folder for temporary files.",
    )


_OPTIONS: list[click.Parameter] = [
    _out(""),
    click.Option(
        ["--size"],
        type=click.Choice(["standing", "full"]),
        default="standing",
        help="The small set that tables are made of, or all that the study has, for hours.",
    ),
    click.Option(
        ["--set", "settings"],
        metavar="KEY=VALUE",
        multiple=True,
        callback=_settings,
        help="""A setting other than the study's own, in TOML: repeats=3, 'problems=["tiny:1"]'.""",
    ),
]


def _measure(name: str, out: Path | None, size: str, settings: dict[str, Any]) -> None:
    """Measure what is not finished yet, then write the report and print it."""
    console = Console(stderr=True)
    folder = out or _folder(None) / (name if size == "standing" else f"{name}-{size}")
    with _told(console):
        study = _study(name, _sized(name, size) | settings)
        log = open_log(name, study, folder)
        if not run_study(study, log, console):
            console.print(f"interrupted; run again to go on from {log.path}", highlight=False)
            sys.exit(_INTERRUPTED)
        console.print(f"{name}: {sum(log.cpu_s.values()):z.0f} s of CPU", highlight=False)
        sys.stdout.write(write_report(study, log, folder))


for _name, _usual in STUDIES.items():
    main.add_command(
        click.Command(
            _name, callback=partial(_measure, _name), params=_OPTIONS, help=_usual.question
        )
    )


@main.command("all", params=[_out(" of each study")])
def all_command(out: Path | None) -> None:
    """Run every study on its standing set, make its records anew, and write all tables."""
    console, folder = Console(stderr=True), _folder(out)
    with _told(console):
        for number, name in enumerate(STUDIES, start=1):
            console.print(f"{number} of {len(STUDIES)}: {name}", highlight=False)
            if code := _in_a_process(name, folder / name):
                sys.exit(code)
            record(folder / name)
        write_tables(records.ROOT)
    spent_s = {each.command: each.cpu_s for each in records.load_records(records.FOLDER).values()}
    console.print(f"{sum(spent_s.values()):z.0f} s of CPU in all", highlight=False)


def _in_a_process(name: str, folder: Path) -> int:
    """Run a study where nothing is known of other ones; its exit code."""
    command = [sys.executable, "-m", "benchmarks", name, "--out", str(folder)]
    try:
        return subprocess.run(command, stdout=subprocess.DEVNULL).returncode
    except KeyboardInterrupt:
        return _INTERRUPTED


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
    made = {
        "command": _command(name, about["settings"]),
        "date": max(log.dates, default=""),
        "commit": commit_of(study.measures, records.ROOT),
        "cases": len(log.cpu_s),
        "cpu_s": round(sum(log.cpu_s.values()), 1),
        **{key: about[key] for key in ("settings", "machine", "versions")},
        "measures": {path: source_digest(records.ROOT / path) for path in study.measures},
    }
    paths = []
    for suffix, (columns, *rows) in published_tables(study, log, folder).items():
        paths.append(records.FOLDER / f"{name}{suffix.replace('_', '-')}.json")
        Record(**made, columns=columns, rows=tuple(rows)).save(paths[-1])
    return paths


def _command(name: str, settings: dict[str, Any]) -> str:
    """The shortest command that runs a study with some settings."""
    commands = []
    for size in ("standing", "full"):
        usual = _study(name, _sized(name, size)).model_dump(mode="json")
        words = [f"{key}={json.dumps(now)}" for key, now in settings.items() if now != usual[key]]
        options = [f"--size {size}"] * (size == "full")
        options += [f"--set {shlex.quote(word)}" for word in words]
        commands.append(" ".join(["python -m benchmarks", name, *options]))
    return min(commands, key=len)


def _sized(name: str, size: str) -> dict[str, Any]:
    return FULL.get(name, {}) if size == "full" else {}


def _folder(out: Path | None) -> Path:
    """Where studies are; what other source files made stands elsewhere."""
    temporary = Path(tempfile.gettempdir()) / "twosra-benchmarks"
    return out or temporary / versions()["source"]


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
