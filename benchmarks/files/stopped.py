"""Kill or interrupt the program at random moments: no output is ever broken, and nothing is left.

Kills hit a fork of this process, which has imported everything, so that most of them hit the work
and the writing; interrupts hit a program that begins with its first import.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from twosra_mpc import load_problem, plan
from twosra_mpc.cli import main

_BEFORE = b"what was there before"
_LONGEST_S = 60.0  # of a command that nobody stops
QUIET_S = 5.0  # from an interrupt to the end of the program
INTERRUPTED = {130, -signal.SIGINT}  # as a shell sees it, the same
_PYTHON = {1, -signal.SIGINT}  # what it ends with when interrupted while it starts
_BEST_SO_FAR = {0, 4}


class Command(NamedTuple):
    """A command that writes a file, and whether its bytes are a whole one."""

    arguments: Callable[[str, str], tuple[str, ...]]  # of a plan file and the output
    suffix: str
    whole: Callable[[bytes], bool]


def _is_json(data: bytes) -> bool:
    try:
        return isinstance(json.loads(data), dict)
    except ValueError:
        return False


COMMANDS = {
    "plan": Command(lambda _, out: ("plan", "paper-2", "--out", out, "--quiet"), ".json", _is_json),
    "report": Command(
        lambda made, out: ("report", made, out), ".html", lambda data: b"</html>" in data[-20:]
    ),
    "animate": Command(
        lambda made, out: ("animate", made, out, "--seconds", "1"),
        ".gif",
        lambda data: data[-1:] == b";",
    ),
    "simulate": Command(
        lambda _, out: ("simulate", "rigid-move", "--out", out, "--quiet"), ".json", _is_json
    ),
}


class Deviation(NamedTuple):
    """A command that was stopped and did not do as it should."""

    command: str
    seed: int
    what: str


def killed(name: str, seeds: range) -> Iterator[Deviation | None]:
    """Kill a command once for each seed, every third time as soon as a file appears.

    What replaces a file has another name for a moment, and keeps it, until the next write, if the
    program is killed just then: kills that wait for a file to appear are of new files.
    """
    _forked(name, 0, _LONGEST_S)  # what it imports and compiles is there from now on
    began = time.perf_counter()
    _forked(name, 0, _LONGEST_S)
    lasts_s = time.perf_counter() - began
    for seed in seeds:
        rng = random.Random(f"kill {name} {seed}")
        after_s = _LONGEST_S if seed % 3 == 0 else rng.uniform(0.0, 1.1 * lasts_s)
        wrong = _forked(name, int(seed % 3 == 1), after_s)
        yield None if wrong is None else Deviation(name, seed, wrong)


def interrupted(name: str, seeds: range) -> Iterator[Deviation | None]:
    """Interrupt a program once for each seed."""
    began = time.perf_counter()
    _program(name, 0, _LONGEST_S)
    lasts_s = time.perf_counter() - began
    quiet_s = max(QUIET_S, lasts_s)  # on a machine that has other things to do
    for seed in seeds:
        rng = random.Random(f"interrupt {name} {seed}")
        wrong = _program(name, seed % 2, rng.uniform(0.0, lasts_s), quiet_s)
        yield None if wrong is None else Deviation(name, seed, wrong)


@cache
def _made() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        plan(load_problem("rigid-move")).save(path := Path(folder) / "plan.json")
        return path.read_bytes()


def _forked(name: str, there: int, after_s: float) -> str | None:
    """Kill a fork after so long, or when a file appears; what is wrong with what is left."""
    with tempfile.TemporaryDirectory() as folder:
        arguments, out = _begin(name, there, Path(folder))
        if (child := os.fork()) == 0:
            _run_and_leave(arguments)
        began, reads = time.perf_counter(), after_s == _LONGEST_S
        while os.waitpid(child, os.WNOHANG) == (0, 0):
            time.sleep(1e-4)
            written = reads and len(os.listdir(out.parent)) > there
            if written or time.perf_counter() > began + after_s:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                break
        return _left(name, there, out)


def _run_and_leave(arguments: list[str]) -> None:
    """Run the program in a fork, which is left without anything of this process."""
    code = 1
    try:
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
        main(arguments)
    except SystemExit as ended:
        code = int(ended.code or 0)
    finally:
        os._exit(code)


def _program(name: str, there: int, after_s: float, quiet_s: float = QUIET_S) -> str | None:
    """Interrupt a program after so long; what is wrong with its end, or with what is left."""
    with tempfile.TemporaryDirectory() as folder:
        arguments, out = _begin(name, there, Path(folder))
        program = subprocess.Popen(
            [sys.executable, "-m", "twosra_mpc", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        try:
            _, said = program.communicate(timeout=after_s)
        except subprocess.TimeoutExpired:
            program.send_signal(signal.SIGINT)
            try:
                _, said = program.communicate(timeout=quiet_s)
            except subprocess.TimeoutExpired:
                program.kill()
                program.communicate()
                return f"still at work {quiet_s:zg} s after the interrupt at {after_s:z.3f} s"
        code = program.returncode
        if code in _PYTHON and b"Traceback" in said and b"__main__.py" not in said:
            return None  # Python had not come to the program's first line
        if code not in INTERRUPTED | _BEST_SO_FAR or b"Traceback" in said:
            return f"exit code {code}, interrupted at {after_s:z.3f} s: {said.decode()[-500:]}"
        return _left(name, there, out)


def _begin(name: str, there: int, folder: Path) -> tuple[list[str], Path]:
    """A folder with a plan beside it, and with the output already there, if it is to be."""
    (made := folder / "made.json").write_bytes(_made())
    (folder / "out").mkdir()
    out = folder / "out" / f"file{COMMANDS[name].suffix}"
    if there:
        out.write_bytes(_BEFORE)
    return list(COMMANDS[name].arguments(str(made), str(out))), out


def _left(name: str, there: int, out: Path) -> str | None:
    """What is wrong with what a command left: half a file, no file any more, or others."""
    names = set(os.listdir(out.parent))
    if others := names - {out.name}:
        return f"left {', '.join(sorted(others))}"
    if not names:
        return "the file that was there is gone" if there else None
    data = out.read_bytes()
    whole = COMMANDS[name].whole(data) or (there and data == _BEFORE)
    return None if whole else f"{len(data)} bytes that are not a whole file"
