"""Runs on a foreign robot with a fault: does every run end truly, and leave the robot off?

The robot shares nothing with this package but its interface: see `benchmarks.foreign`. A claim is
false if a run says that the goal is reached and the robot is in truth not within the accuracy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field

from benchmarks.foreign import FAULTS, BrokenError, ForeignRobot
from benchmarks.problems import Choices, labelled
from benchmarks.study import RUNNING, Count, Measured, Study
from twosra_mpc import Plan, plan
from twosra_mpc.execution import Executor
from twosra_mpc.validation import plain

Executors = Annotated[tuple[Literal["optimal", "greedy"], ...], BeforeValidator(plain)]
Kinds = Annotated[tuple[Literal[tuple(FAULTS)], ...], BeforeValidator(plain)]  # type: ignore[valid-type]


class Case(NamedTuple):
    """One run."""

    executor: str
    fault: str
    problem: str
    seed: int


class Faults(Study):
    """Runs with each fault.

    Attributes:
        problems: Problem sets; runs take their problems in turns.
        count: Runs of each fault by each executor.
        executors: What drives.
        faults: Which faults.
        first: Seed of the first run of each fault.
    """

    question: ClassVar = "Does every run with a fault end truly, and leave the robot off?"
    measures: ClassVar = RUNNING

    problems: Choices = ("random-100:20",)
    count: Count = 1
    executors: Executors = ("optimal", "greedy")
    faults: Kinds = tuple(FAULTS)
    first: Annotated[int, Field(ge=0)] = 0

    def cases(self) -> Iterator[Case]:
        """Yield the runs, all faults in turns."""
        problems = list(labelled(self.problems))
        seeds = range(self.first, self.first + self.count)
        for seed, drives, fault in itertools.product(seeds, self.executors, self.faults):
            if (drives, fault) != ("greedy", "planner raises"):
                yield Case(drives, fault, problems[seed % len(problems)], seed)

    def run(self, case: Case) -> dict[str, Any]:
        """Run one case; how it ended, whether that is true, and what the robot did."""
        made = _planned(self.problems, case.problem)
        rng = np.random.default_rng([case.seed, 3])
        begins = float(rng.uniform(0.0, made.duration_s))
        return attacked(made, case.executor, case.fault, case.seed, begins)

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Sum up by fault; list the runs that ended as they should not."""
        found = {
            (drives, fault): [
                made for case, made in results if (case.executor, case.fault) == (drives, fault)
            ]
            for drives in self.executors
            for fault in self.faults
        }
        return {
            "rows": {key: made for key, made in found.items() if made},
            "odd": [(case, made) for case, made in results if not _as_it_should(made)],
        }


_HOTTEST_C, _FORCED_M, _LONGEST_S = 85.0, 0.03, 60.0  # of the metal; solid; to the cause


def _as_it_should(made: dict[str, Any]) -> bool:
    """Whether a run ended truly, in time, and did no harm before."""
    harmless = made["hottest_C"] <= _HOTTEST_C and made["forced_m"] <= _FORCED_M
    if made["came_to"] == "right cause":
        return harmless and made["mattered_s"] <= _LONGEST_S
    return harmless and made["came_to"] == "reached"


@cache
def _planned(problems: tuple[str, ...], label: str) -> Plan:
    return plan(labelled(problems)[label]).require()


def attacked(made: Plan, executor: str, fault: str, seed: int, begins_s: float) -> dict[str, Any]:
    """Run a plan, or to its goal by the greedy rule, on a foreign robot with a fault."""
    robot = ForeignRobot(made.problem, seed, "" if fault == "none" else fault, begins_s)
    try:
        if executor == "greedy":
            run = Executor(robot).drive(made.problem)
        else:
            run = Executor(robot, think=robot.think).run(made)
        ending, reason = str(run.ending), run.reason
    except (BrokenError, KeyboardInterrupt) as error:
        if isinstance(error, KeyboardInterrupt) and fault != "interrupt":
            raise  # whoever runs the study wants it to end
        ending, reason = type(error).__name__, str(error)
    off = made.robot.ends_within.of(made.problem.judged_goal.error(robot.q.copy()))
    came_to = "wrong cause"
    if ending == "reached":
        came_to = "reached" if off <= 1.0 else "false claim"
    elif ending in FAULTS[fault]:
        came_to = "right cause"
    return {
        "came_to": came_to,
        "ending": ending,
        "reason": reason,
        "off_goal": off,
        "off": robot.off,
        "time_s": robot.time_s,
        "forced_m": robot.forced_m,
        "blind_m": robot.blind_m,
        "planning_m": robot.planning_m,
        "hottest_C": robot.hottest_C,
        "ailed_s": robot.time_s - begins_s,
        "mattered_s": 0.0 if math.isnan(robot.mattered_s) else robot.time_s - robot.mattered_s,
    }
