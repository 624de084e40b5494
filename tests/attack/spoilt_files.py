"""Give spoilt files to the program: whatever they hold, it says what is wrong with them."""

from __future__ import annotations

import io
import random
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import NamedTuple

from attack.mutations import MUTATIONS

import twosra_mpc
from twosra_mpc import load_problem, plan
from twosra_mpc.cli import main
from twosra_mpc.export.authors_csv import save_authors_csv

CODES = {0, 2, 3, 4}  # those of a program that knew what to do
LONGEST_S = 20.0  # that a command may take
_MOST_SAID = 6000  # characters on standard error
_PACKAGE = Path(twosra_mpc.__file__).parent
_LIMIT = ("--time-limit", "2")


class Kind(NamedTuple):
    """A kind of file: its ending, good ones to spoil, and the command that reads it."""

    suffix: str
    good: Callable[[], tuple[bytes, ...]]
    command: Callable[[Path], tuple[str, ...]]


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
                wrong = _wrong(kind.command(path))
                yield None if wrong is None else Deviation(name, mutation, seed, wrong)


def _wrong(arguments: tuple[str, ...]) -> str | None:
    """What the program does that it should not; None if nothing."""
    out, err = io.StringIO(), io.StringIO()
    before = signal.signal(signal.SIGALRM, _hangs)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main(list(arguments))
    except SystemExit as ended:
        code = ended.code
    except BaseException:
        return traceback.format_exc(limit=-3)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    said = out.getvalue() + err.getvalue()
    if code not in CODES:
        return f"exit code {code}: {err.getvalue()[-500:]}"
    if strange := {c for c in said if not c.isprintable() and c != "\n"}:
        return f"control characters: {strange}"
    return "says too much" if len(err.getvalue()) > _MOST_SAID else None


def _hangs(*_: object) -> None:
    raise SystemExit(f"still at work after {LONGEST_S:g} s")
