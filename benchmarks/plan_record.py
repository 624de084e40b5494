"""One planner on one problem: what it said, what is true of it, and how long it took."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.measurement import Timing
from twosra_mpc import Result
from twosra_mpc.robot.modes import ModeSequence, sequence_name

GOAL_TOLERANCE = 1e-6  # m, rad, 1/m


@dataclass(frozen=True)
class PlanRecord:
    """A plan, or the lack of one, as numbers.

    Attributes:
        problem: Label of the problem.
        planner: Name of the planner.
        status: What the planner said.
        message: The planner's own words.
        success: Whether the planner says that it has a plan.
        verified: Whether what it returned holds when it is checked by other code.
        stopped_early: Whether a limit ended the search.
        cost: Cost of the plan [s]; None without one, or where the planner has no clock.
        lower_bound: Proved lower bound on any plan's cost [s]; None without one.
        sequence: Mode of each phase.
        goal_error: Largest error at the goal after re-integration [m, rad, 1/m].
        sequences_solved: Mode sequences handed to the nonlinear program.
        timing: Times of the calls.
    """

    problem: str
    planner: str
    status: str
    message: str
    success: bool
    verified: bool
    stopped_early: bool
    cost: float | None
    lower_bound: float | None
    sequence: ModeSequence
    goal_error: float | None
    sequences_solved: int
    timing: Timing

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

    def to_record(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> PlanRecord:
        """Read plain data back."""
        timing = record["timing"]
        times = Timing(timing["first_s"], tuple(timing["wall_s"]), tuple(timing["cpu_s"]))
        sequence = tuple((int(s1), int(s2)) for s1, s2 in record["sequence"])
        return cls(**{**record, "timing": times, "sequence": sequence})


def plan_record(label: str, result: Result, timing: Timing) -> PlanRecord:
    """Write down what planning came to."""
    plan = result.plan
    errors = [abs(error) for error in plan.verification.goal_error] if plan else [math.inf]
    return PlanRecord(
        problem=label,
        planner=result.planner,
        status=str(result.status),
        message=result.message,
        success=result.found,
        verified=plan is not None and plan.verification.ok,
        stopped_early=result.stopped_early,
        cost=plan.cost.total if plan else None,
        lower_bound=result.lower_bound,
        sequence=plan.sequence if plan else (),
        goal_error=max(errors) if math.isfinite(max(errors)) else None,
        sequences_solved=result.stats.sequences_solved,
        timing=timing,
    )
