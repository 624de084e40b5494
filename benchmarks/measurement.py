"""What is measured: times of calls that take turns, and what a planner said of a problem.

This is the only place that takes results of ``twosra_mpc.plan`` apart.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from twosra_mpc import Plan, Result
from twosra_mpc.robot.modes import ModeSequence, sequence_name

Returned = TypeVar("Returned")
GOAL_TOLERANCE = 1e-6  # m, rad, 1/m


@dataclass(frozen=True)
class Timing:
    """Times of repeated calls of one function.

    Attributes:
        first_s: Wall time of the first call, which may build functions.
        wall_s: Wall times of the calls after it; of the first, where it was too long for others.
        cpu_s: CPU times of the same calls.
    """

    first_s: float
    wall_s: tuple[float, ...]
    cpu_s: tuple[float, ...]

    @property
    def median_s(self) -> float:
        """Median wall time of a warm call."""
        return statistics.median(self.wall_s)

    @property
    def cpu_median_s(self) -> float:
        """Median CPU time of a warm call: its wall time, had the CPU been free."""
        return statistics.median(self.cpu_s)


def timed_in_turns(
    functions: Mapping[str, Callable[[], Returned]], repeats: int, budget_s: float
) -> dict[str, tuple[Returned, Timing]]:
    """Call each function once, then all of them in turns ``repeats`` times.

    A function whose repeats took ``budget_s`` together is not called again; where the first call
    took as long, that one counts. The result is that of the last call.
    """
    results: dict[str, Returned] = {}
    made: dict[str, list[tuple[float, float]]] = {name: [] for name in functions}
    for _ in range(1 + repeats):
        for name, function in functions.items():
            first, *warm = [wall for wall, _ in made[name]] or [0.0]
            if max(first, sum(warm)) >= budget_s:
                continue
            wall, cpu = time.perf_counter(), time.process_time()
            results[name] = function()
            made[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    timings = {}
    for name, calls in made.items():
        walls, cpus = zip(*(calls[1:] or calls), strict=True)  # a single call counts as a warm one
        timings[name] = (results[name], Timing(calls[0][0], walls, cpus))
    return timings


@dataclass(frozen=True)
class PlanRecord:
    """A plan, or the lack of one, as numbers.

    Attributes:
        status: What the planner said.
        message: The planner's own words.
        success: Whether the planner says that it has a plan.
        stopped_early: Whether a limit ended the search.
        timing: Times of the calls.
        verified: Whether what it returned holds when it is checked by other code.
        cost: Cost of the plan [s]; None without one, or where the planner has no clock.
        lower_bound: Proved lower bound on any plan's cost [s]; None without one.
        sequence: Mode of each phase.
        goal_error: Largest error at the goal after re-integration [m, rad, 1/m].
        solved: Mode sequences handed to the nonlinear program.
    """

    status: str
    message: str
    success: bool
    stopped_early: bool
    timing: Timing
    verified: bool = False
    cost: float | None = None
    lower_bound: float | None = None
    sequence: ModeSequence = ()
    goal_error: float | None = None
    solved: int = 0

    @property
    def correct(self) -> bool:
        """Whether the planner has a plan, and it is one."""
        reached = self.goal_error is not None and self.goal_error <= GOAL_TOLERANCE
        return self.success and self.verified and reached

    @property
    def gap(self) -> float | None:
        """Proved relative gap (cost - lower bound) / cost; None where either is missing."""
        if not self.correct or not self.cost or self.lower_bound is None:
            return None
        return max(0.0, (self.cost - self.lower_bound) / self.cost)

    @property
    def sequence_name(self) -> str:
        """The mode sequence in one word, e.g. ``[0,0] > [1,0]``."""
        return sequence_name(self.sequence)


def plan_record(result: Result, timing: Timing) -> PlanRecord:
    """Write down what ``twosra_mpc.plan`` returned."""
    return PlanRecord(
        status=str(result.status),
        message=result.message,
        success=result.found,
        stopped_early=result.stopped_early,
        timing=timing,
        lower_bound=result.lower_bound,
        solved=result.stats.sequences_solved,
        **(facts(result.plan) if result.plan else {}),
    )


def facts(plan: Plan) -> dict[str, Any]:
    """What a record says of a plan itself."""
    error = max(map(abs, plan.verification.goal_error))
    return {
        "verified": plan.verification.ok,
        "cost": plan.cost.total,
        "sequence": plan.sequence,
        "goal_error": error if math.isfinite(error) else None,
    }
