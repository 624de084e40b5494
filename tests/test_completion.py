"""Completion in the shell: commands, options, and the names of built-in scenarios and robots."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from click.shell_completion import ShellComplete

from twosra_mpc.cli import commands
from twosra_mpc.files import built_in_names


def completions(*words: str) -> tuple[list[str], bool]:
    """What can stand for the last word, and whether a file can."""
    shell = ShellComplete(commands, {}, "twosra", "_TWOSRA_COMPLETE")
    items = shell.get_completions(list(words[:-1]), words[-1])
    return [i.value for i in items if i.type == "plain"], any(i.type == "file" for i in items)


def test_commands_are_completed() -> None:
    assert completions("sim") == (["simulate"], False)
    context = commands.make_context("twosra", ["robots"])
    assert completions("") == (commands.list_commands(context), False)


@pytest.mark.parametrize("command", ["plan", "explain", "compare", "simulate"])
def test_scenarios_are_completed_beside_files(command: str) -> None:
    assert completions(command, "") == (built_in_names("scenarios"), True)
    assert completions(command, "paper-") == ([f"paper-{n}" for n in range(1, 6)], True)


def test_every_scenario_of_several_is_completed() -> None:
    assert completions("compare", "paper-1", "paper-2", "rig") == (["rigid-move"], True)


@pytest.mark.parametrize(
    "words",
    [
        ("check-robot",),
        ("fit-paths",),
        ("plan", "paper-1", "--robot"),
        ("fit-thermal", "--robot"),
    ],
    ids=" ".join,
)
def test_robots_are_completed_beside_files(words: tuple[str, ...]) -> None:
    assert completions(*words, "2sra") == (
        [name for name in built_in_names("robots") if name.startswith("2sra")],
        True,
    )


def test_options_are_completed() -> None:
    assert completions("plan", "paper-1", "--pl") == (["--plot", "--planner"], False)
    assert completions("--ver") == (["--version"], False)


@pytest.mark.parametrize("shell", ["bash", "fish"])
def test_the_shell_is_told(shell: str) -> None:
    asked = {"COMP_WORDS": "twosra plan shape", "COMP_CWORD": "2" if shell != "fish" else "shape"}
    environment = {**os.environ, **asked, "_TWOSRA_COMPLETE": f"{shell}_complete"}
    done = subprocess.run(
        [sys.executable, "-m", "twosra_mpc"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "shape-change" in done.stdout
    assert not done.stderr
