"""Give spoilt files to the program: whatever they hold, it says what is wrong with them."""

from __future__ import annotations

import io
import random
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

from benchmarks.files.kinds import KINDS
from benchmarks.files.mutations import MUTATIONS

CODES = {0, 2, 3, 4}  # those of a program that knew what to do
LONGEST_S = 5.0  # of CPU time that a command may take
_MOST_SAID = 6000  # characters on standard error


class Deviation(NamedTuple):
    """A file for which the program did not do as it should."""

    kind: str
    mutation: str
    seed: int
    what: str


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
    raise SystemExit(f"still at work after {LONGEST_S:zg} s")
