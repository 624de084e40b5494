"""Commands that describe robots and problems: their lists, and new files."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from twosra_mpc import InputError, files, load_problem, load_robot, robot_names, scenario_names
from twosra_mpc.cli.options import NewFile, argument, command, completed, option
from twosra_mpc.cli.output import Output, numbers, print_table
from twosra_mpc.robot.description import robot_document


@command("scenarios")
def scenarios_command(output: Output) -> None:
    """List the built-in scenarios.

    \b
    What is there to plan?
      twosra scenarios
    One of them with every default filled in, as a start for your own:
      twosra scenarios --json
    """
    problems = {name: load_problem(name) for name in scenario_names()}
    rows = []
    for name, problem in problems.items():
        anywhere, asked = problem.ends_anywhere, numbers(problem.goal.configuration)
        goal = "none: only tasks" if anywhere else asked
        rows.append((name, problem.description, numbers(problem.start.configuration), goal))
    header = ("scenario", "what it asks", "start", "goal [m, m, rad, 1/m, 1/m]")
    output.report(
        lambda: [{"name": name, **each.scenario()} for name, each in problems.items()],
        lambda: print_table(header, rows),
    )


@command("robots")
def robots_command(output: Output) -> None:
    """List the built-in robots.

    \b
    Which robots are there?
      twosra robots
    All their numbers, SI, unit in the name:
      twosra robots --json
    """
    robots = [load_robot(name) for name in robot_names()]
    rows = [(r.name, r.path.model, ", ".join(r.timing), r.description) for r in robots]
    output.report(
        lambda: [robot.model_dump(mode="json") for robot in robots],
        lambda: print_table(("robot", "path model", "timings", "description"), rows),
    )


Kind = Literal["scenario", "robot", "batch"]

_FOLDERS: dict[str, str] = {"scenario": "scenarios", "robot": "robots"}
_FIRST_ROBOT = "2sra-v1"


def _built_in() -> list[str]:
    """Built-in names; of which kind is not known before the option has its value."""
    return [name for folder in _FOLDERS.values() for name in files.built_in_names(folder)]


class _New(NewFile):
    """A TOML file to write, named with or without its ending."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Turn a name into a path; "-" is standard output."""
        path = Path(value)
        if value == "-" or files.is_device(path) or path.suffix == ".toml":
            return super().convert(value, param, ctx)
        if not path.name.strip(".") or path.suffix in (".json", ".yaml", ".yml", ".txt"):
            raise InputError("NAME", value, "a name with or without .toml")
        return super().convert(f"{value}.toml", param, ctx)


@command("new")
def new_command(
    kind: Annotated[Kind, argument()],
    path: Annotated[Path, argument("NAME", type=_New())],
    source: Annotated[
        str | None, option("--from", metavar="BUILT_IN", shell_complete=completed(_built_in))
    ],
    force: bool,
    output: Output,
) -> None:
    """Write a scenario, a robot or a batch to start from: NAME, with or without .toml.

    A new scenario shows every key, the optional ones as comments; with --from it is a copy of a
    built-in one. A new robot is a copy of 2sra-v1 or of another built-in robot, and is called NAME.
    A new batch shows all it can plan.

    \b
    A scenario to start from, and its plan:
      twosra new scenario mine
      twosra plan mine.toml
    A copy of a built-in one:
      twosra new scenario my-doorway --from doorway
    A robot of your own:
      twosra new robot my-2sr --from 2sr-v2
    Many problems at once:
      twosra new batch many

    Options:
        source: Copy it.
        force: Replace a file that is there.
    """
    text = _text(kind, source, path.stem)
    if os.path.isfile(path) and not force:
        raise InputError("NAME", str(path), "the name of a new file, or --force to replace this")
    files.write_text(path, text)
    following = _following(kind, path, source)
    shown = "\n".join([f"{path} is written. Edit it, then:", *(f"  {line}" for line in following)])
    document = {"file": str(path), "kind": kind, "from": source, "next": following}
    output.report(lambda: document, lambda: click.echo(shown))


def _text(kind: Kind, source: str | None, name: str) -> str:
    """Text of the new file; a robot that differs from a built-in one needs a name of its own."""
    folder = _FOLDERS.get(kind)
    names = files.built_in_names(folder) if folder else []
    if source is not None and source not in names:
        raise InputError("--from", source, f"one of {', '.join(names)}")
    if kind == "robot":
        if name in names:
            raise InputError("NAME", name, "a name that no built-in robot has")
        document = robot_document(source or _FIRST_ROBOT)
        document["name"] = name
        return document.as_string()
    if source is None:
        return files.data_file(f"cli/new_{kind}.toml")
    return files.read_text(files.locate(source, _FOLDERS["scenario"], "--from"), source)


def _following(kind: Kind, path: Path, source: str | None) -> list[str]:
    """Commands to go on with."""
    file, plan = shlex.quote(str(path)), shlex.quote(f"{path.stem}.json")
    if kind == "batch":
        return [f"twosra batch {file} --out {shlex.quote(f'{path.stem}-runs')}"]
    if kind == "scenario":
        return [f"twosra plan {file} --out {plan}", f"twosra verify {plan}"]
    scenario = "three-segments" if source == "3sra" else "rigid-move"
    return [f"twosra check-robot {file}", f"twosra plan {scenario} --robot {file}"]
