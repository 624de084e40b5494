"""This planner against an older revision of itself, plan by plan, in turns."""

from __future__ import annotations

import io
import json
import os
import statistics
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from pydantic import TypeAdapter

from benchmarks.study import Measured, OneProblem, PlanStudy

ROOT = Path(__file__).parents[2]
NOW, THEN = "now", "then"
_WORKER = """
import gc, json, sys, time
gc.set_threshold(200_000, 20, 20)  # as the program does
from benchmarks.problems import labelled
from twosra_mpc import plan
choices, label, settings = json.loads(sys.argv[1])
problem = labelled(tuple(choices))[label].with_values(**settings)
for _ in sys.stdin:
    started = time.process_time()
    made = plan(problem)
    spent_s = time.process_time() - started
    print(json.dumps([spent_s, made.plan and made.plan.cost.total, made.lower_bound]), flush=True)
"""


@dataclass(frozen=True)
class RevisionRecord:
    """A problem planned by both.

    Attributes:
        cpu_s: Median CPU time of a warm plan of each.
        cost: Cost of the plan of each [s]; None without one.
        lower_bound: Proved lower bound of each [s].
    """

    cpu_s: dict[str, float]
    cost: dict[str, float | None]
    lower_bound: dict[str, float | None]

    @property
    def ratio(self) -> float:
        """CPU time over that of the older one."""
        return self.cpu_s[NOW] / self.cpu_s[THEN]


class Revision(PlanStudy):
    """Two processes take turns: the planner as it is here, and as it was at a revision.

    Attributes:
        revision: Of git; problems are those of its own problem sets.
    """

    record: ClassVar = TypeAdapter(RevisionRecord)
    question: ClassVar = "How much CPU does a warm plan take, over that of an older revision?"

    revision: str = "2db6b48"

    def run(self, case: OneProblem) -> RevisionRecord:
        """Let both plan in turns, each in a process that has planned the problem before."""
        asked = self.problems, case.problem, {"time_limit_s": self.time_limit_s}
        made: dict[str, list[Any]] = {NOW: [], THEN: []}
        with _checkout(self.revision) as then:
            trees = {NOW: ROOT, THEN: then}
            workers = {name: _worker(tree, json.dumps(asked)) for name, tree in trees.items()}
            for turn in range(1 + self.repeats):
                for name in sorted(workers, reverse=bool(turn % 2)):
                    made[name].append(_next_plan(workers[name]))
            for worker in workers.values():
                worker.communicate()
        return RevisionRecord(
            {n: statistics.median(each[0] for each in all_[1:]) for n, all_ in made.items()},
            {name: all_[-1][1] for name, all_ in made.items()},
            {name: all_[-1][2] for name, all_ in made.items()},
        )

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Ratios, and where plans differ."""
        differ = [
            case.problem
            for case, one in results
            if any(_differ(*each.values()) for each in (one.cost, one.lower_bound))
        ]
        ratios = [one.ratio for _, one in results]
        mean = statistics.geometric_mean(ratios)
        return {"ratios": ratios, "geometric": mean, "differ": differ}


def _differ(now: float | None, then: float | None) -> bool:
    if now is None or then is None:
        return now is not then
    return abs(now - then) > 1e-9 * abs(then)


@contextmanager
def _checkout(revision: str) -> Iterator[Path]:
    """The files of a revision in a folder of their own."""
    packed = subprocess.run(
        ["git", "archive", revision, "twosra_mpc", "benchmarks"],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    with TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as files:
            files.extractall(folder, filter="data")
        yield Path(folder)


def _worker(tree: Path, asked: str) -> subprocess.Popen[str]:
    """A process that plans once for every line it is sent, with the planner of a folder."""
    return subprocess.Popen(
        [sys.executable, "-c", _WORKER, asked],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def _next_plan(worker: subprocess.Popen[str]) -> Any:
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write("\n")
    worker.stdin.flush()
    while not (line := worker.stdout.readline()).startswith("["):  # a solver says its name first
        assert line, "the process has ended"
    return json.loads(line)
