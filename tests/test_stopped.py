"""Kills and interrupts, a few of each; ``python -m benchmarks files`` does more."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from benchmarks.files.stopped import interrupted, killed

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks are killed")


@pytest.mark.parametrize(("name", "count"), [("plan", 4)])
def test_a_killed_program_leaves_a_whole_file_or_none(name: str, count: int) -> None:
    found = list(killed(name, range(count)))
    assert len(found) == count
    assert [each for each in found if each is not None] == []


def test_an_interrupted_program_ends_quietly_or_with_the_best_so_far() -> None:
    found = list(interrupted("plan", range(2)))
    assert len(found) == 2
    assert [each for each in found if each is not None] == []


SWALLOWED = """
import os, signal, weakref
from twosra_mpc import cli
from twosra_mpc.cli import planning

class Thing: pass

def struck(_: object) -> None:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass

def late(*_: object, **__: object) -> None:
    thing = Thing()
    kept = weakref.ref(thing, struck)
    del thing
    while True:
        pass

planning.plan_with_progress = late
cli.main(["plan", "rigid-move"])
"""


def test_an_interrupt_that_falls_into_a_callback_is_asked_for_again() -> None:
    """Python itself has such callbacks, of the modules that it loads."""
    command = [sys.executable, "-c", SWALLOWED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=50, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.strip() == "twosra: interrupted before there was a result"
