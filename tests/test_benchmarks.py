"""The benchmark runs on its tiny set and reports correctness beside time."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from benchmarks.problem_set import load_set, set_names

ROOT = Path(__file__).parent.parent


def test_sets_are_reproducible_and_valid() -> None:
    assert set(set_names()) >= {"published", "random-100", "tiny"}
    first, second = load_set("random-100"), load_set("random-100")
    assert first == second
    assert len(first.problems) == 100
    assert first.redrawn > 0
    assert max(abs(k) for _, p in first.problems for k in p.start.kappa_per_m) <= 60


def test_the_tiny_set_runs_and_nothing_is_worse_than_greedy(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "tiny", "--out", str(tmp_path / "report.md")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (tmp_path / "report.md").read_text() == done.stdout
    assert "| optimal | 5 of 5 | 5 |" in done.stdout
    largest = re.search(r"largest ([0-9.]+)\.\n", done.stdout)
    assert largest is not None
    assert float(largest.group(1)) <= 1.0
