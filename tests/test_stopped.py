"""Kills and interrupts, a few of each; ``python -m benchmarks files`` does more."""

from __future__ import annotations

import os

import pytest

from benchmarks.files.stopped import interrupted, killed

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks are killed")


@pytest.mark.parametrize(("name", "count"), [("plan", 6)])
def test_a_killed_program_leaves_a_whole_file_or_none(name: str, count: int) -> None:
    found = list(killed(name, range(count)))
    assert len(found) == count
    assert [each for each in found if each is not None] == []


def test_an_interrupted_program_ends_quietly_or_with_the_best_so_far() -> None:
    found = list(interrupted("plan", range(3)))
    assert len(found) == 3
    assert [each for each in found if each is not None] == []
