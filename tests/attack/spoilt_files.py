"""Give spoilt files to the program: whatever they hold, it says what is wrong with them."""

from __future__ import annotations

import io
import random
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import NamedTuple

from attack.mutations import MUTATIONS

import twosra_mpc
from benchmarks.__main__ import main as benchmark
from benchmarks.problems import FOLDER, read_set
from benchmarks.run_log import NAME
from twosra_mpc import InputError, load_problem, plan
from twosra_mpc.cli import main
from twosra_mpc.export.authors_csv import save_authors_csv

CODES = {0, 2, 3, 4}  # those of a program that knew what to do
LONGEST_S = 5.0  # of CPU time that a command may take
_MOST_SAID = 6000  # characters on standard error
_PACKAGE = Path(twosra_mpc.__file__).parent
_LIMIT = ("--time-limit", "0.5")


class Kind(NamedTuple):
    """A kind of file: its ending, good ones to spoil, and the command that reads it."""

    suffix: str
    good: Callable[[], tuple[bytes, ...]]
    command: Callable[[Path], tuple[str, ...]]
    program: Callable[[list[str]], object] = main


class Deviation(NamedTuple):
    """A file for which the program did not do as it should."""

    kind: str
    mutation: str
    seed: int
    what: str


def _built_in(folder: str, *names: str) -> Callable[[], tuple[bytes, ...]]:
    return lambda: tuple((_PACKAGE / folder / f"{name}.toml").read_bytes() for name in names)


@cache
def _plans() -> tuple[bytes, ...]:
    return tuple(_written(plan(load_problem(name)).save) for name in ("paper-2", "rigid-move"))


def _log() -> tuple[bytes, ...]:
    made = plan(load_problem("paper-2", robot="2sra-v1-paper")).require()
    return (_written(lambda path: save_authors_csv(made, path)),)


def _written(write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(path := Path(folder) / "file.json")
        return path.read_bytes()


def _read_set(arguments: list[str]) -> None:
    try:
        read_set(Path(arguments[0]))
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None


@cache
def _run_log() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory() as folder:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            _finish([str(Path(folder) / NAME)])
        return ((Path(folder) / NAME).read_bytes(),)


def _finish(arguments: list[str]) -> None:
    """Go on with a study from its log."""
    settings = ("count=2", "robots=2", "time_limit_s=0.1")
    with tempfile.TemporaryDirectory() as folder:
        if (log := Path(arguments[0])).exists():
            shutil.copy(log, Path(folder) / NAME)
        given = [word for each in settings for word in ("--set", each)]
        try:
            benchmark(["soak", "--out", folder, *given], standalone_mode=False)
        finally:
            shutil.copy(Path(folder) / NAME, log)


_SCENARIOS = ("paper-1", "move-and-shape", "doorway", "pick-and-place", "three-segments")
_ROBOTS = _built_in("robots", "2sra-v1", "2sr-v2", "2sra-v1-paper")
KINDS = {
    "scenario": Kind(
        ".toml", _built_in("scenarios", *_SCENARIOS), lambda path: ("plan", str(path), *_LIMIT)
    ),
    "robot": Kind(".toml", _ROBOTS, lambda path: ("check-robot", str(path))),
    "robot that plans": Kind(
        ".toml", _ROBOTS, lambda path: ("plan", "rigid-move", "--robot", str(path), *_LIMIT)
    ),
    "plan": Kind(".json", _plans, lambda path: ("verify", str(path))),
    "problem set": Kind(
        ".toml",
        lambda: tuple(path.read_bytes() for path in sorted(FOLDER.glob("[rt]*.toml"))),
        lambda path: (str(path),),
        _read_set,
    ),
    "run log": Kind(".jsonl", _run_log, lambda path: (str(path),), _finish),
    "log": Kind(".csv", _log, lambda path: ("replay", str(path), "--robot", "2sra-v1-paper")),
}


def attacked(name: str, seeds: range) -> Iterator[Deviation | None]:
    """Spoil a good file of a kind for each seed and mutation; yield what went wrong, or None."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"spoilt{kind.suffix}"
        for seed in seeds:
            for mutation, spoil in MUTATIONS.items():
                rng = random.Random(f"{name} {mutation} {seed}")
                path.write_bytes(spoil(rng, rng.choice(kind.good())))
                wrong = _wrong(kind.program, kind.command(path))
                yield None if wrong is None else Deviation(name, mutation, seed, wrong)


def _wrong(program: Callable[[list[str]], object], arguments: tuple[str, ...]) -> str | None:
    """What the program does that it should not; None if nothing."""
    out, err = io.StringIO(), io.StringIO()
    before = signal.signal(signal.SIGPROF, _hangs)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            program(list(arguments))
        code: object = 0
    except SystemExit as ended:
        code = ended.code
    except KeyboardInterrupt:  # of whoever attacks
        raise
    except BaseException:
        return traceback.format_exc(limit=-3)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    said = out.getvalue() + err.getvalue()
    if code not in CODES:
        return f"exit code {code}: {err.getvalue()[-500:]}"
    if "Warning: " in said:
        return f"a library speaks: {said[-500:]}"
    if strange := {c for c in said if not c.isprintable() and c != "\n"}:
        return f"control characters: {strange}"
    return "says too much" if len(err.getvalue()) > _MOST_SAID else None


def _hangs(*_: object) -> None:
    raise SystemExit(f"still at work after {LONGEST_S:g} s")
