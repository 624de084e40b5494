"""Plans of many robots in one process: do memory and open files stay what they are?

What is compiled for a robot is kept for the next plan, of so many robots at most: memory grows
until that many are known, and from then on no more. Garbage is collected before it is looked at.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmarks.study import Count, Measured, Study
from twosra_mpc import Goal, Problem, Robot, Start, load_robot, plan
from twosra_mpc.lab.batch.spec import RandomSet
from twosra_mpc.validation import Positive

_BUILT_IN = ("2sra-v1", "2sra-v1-paper")
_RANGES: dict[str, Any] = {"position_m": 0.15, "heading_rad": 1.0, "curvature_per_m": 30.0}
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


class Case(NamedTuple):
    """One robot, planned for several times."""

    robot: int


class Soak(Study):
    """Robots that differ in their lengths and limits, each with problems of its own.

    Attributes:
        count: Plans in all.
        robots: Robots that they are of.
        time_limit_s: Limit of a plan, in thousands of units of work: about seconds.
    """

    question: ClassVar = "Do memory and open files stay flat over many plans of many robots?"

    count: Count = 160
    robots: Count = 40
    time_limit_s: Positive = 2.0

    def cases(self) -> Iterator[Case]:
        """Yield the robots."""
        yield from map(Case, range(self.robots))

    def run(self, case: Case) -> dict[str, Any]:
        """Plan for one robot; what the process holds then."""
        rng = np.random.default_rng([case.robot, 5])
        name, statuses = _BUILT_IN[case.robot % 2], list[str]()
        ranges = _RANGES | {"count": self.count // self.robots}
        robot, ranges = (
            another(rng, load_robot(name)),
            dict(_RANGES, count=self.count // self.robots),
        )
        for start, goal in RandomSet(robot=name, seed=case.robot, **ranges).ends(robot):
            ends = {"start": Start(**start), "goal": Goal(**goal, tolerance="exact")}
            problem = Problem(robot=robot, **ends, work_limit=1e3 * self.time_limit_s)
            statuses.append(plan(problem).status)
        gc.collect()
        return {"plans": len(statuses), "found": sum(s in _FOUND for s in statuses), **held()}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Ten moments of the run, and how many MB a robot cost in its last half."""
        made = [record for _, record in results]
        half = len(made) // 2
        slope = (made[-1]["MB"] - made[half]["MB"]) / max(1, len(made) - 1 - half)
        rows = [
            (k + 1, sum(one["plans"] for one in made[: k + 1]), made[k])
            for k in np.unique(np.linspace(0, len(made) - 1, 10).astype(int)).tolist()
        ]
        return {"rows": rows, "slope": slope}


_FOUND = ("optimal", "feasible")


def another(rng: np.random.Generator, robot: Robot) -> Robot:
    """A robot whose lengths and limits differ from those of a robot by up to a tenth."""
    geometry, limits, shares = robot.geometry, robot.limits, rng.uniform(0.9, 1.1, 2).tolist()
    lengths_m = tuple(shares[0] * each for each in geometry.lengths_m)
    most, speed_m_s = limits.curvature_per_m / 1.1, shares[1] * limits.unit_speed_m_s
    return robot.with_values(
        geometry=geometry.with_values(segment_length_m=lengths_m),
        limits=limits.with_values(curvature_per_m=most, unit_speed_m_s=speed_m_s),
    )


def held() -> dict[str, float]:
    """Memory [MB] and open files of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return {"MB": pages * _PAGE_BYTES / 1e6, "files": len(os.listdir("/proc/self/fd"))}
