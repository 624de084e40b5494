"""Plans squeezed, cut and told otherwise: whether one that is verified costs less than proved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks.attack.forgeries import accepted, forgery
from benchmarks.study import Count, Measured, Study
from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.planning.proof import Prover


class Case(NamedTuple):
    """A forgery of a plan, by its number."""

    scenario: str
    robot: str
    seed: int


@dataclass(frozen=True)
class ForgeryRecord:
    """What came of a forgery.

    Attributes:
        how: What was done.
        verified: Whether verification accepts it.
        saved_s: How much less than the plan it costs.
        below_s: How much less than what is proved; not positive where proofs hold.
    """

    how: str
    verified: bool
    saved_s: float
    below_s: float


class ForgeryStudy(Study):
    """Random forgeries of plans that cost hardly more than what is proved of all plans.

    Attributes:
        count: Forgeries of each plan.
        plans: Scenario and robot of each.
    """

    record: ClassVar = TypeAdapter(ForgeryRecord)
    question: ClassVar = "Is a plan verified that costs less than what is proved of all?"

    count: Count = 125
    plans: tuple[tuple[str, str], ...] = (
        ("paper-1", "2sra-v1"),
        ("paper-1", "2sra-v1-paper"),
        ("paper-2", "2sra-v1-paper"),
        ("paper-3", "2sra-v1-paper"),
    )

    def cases(self) -> Iterator[Case]:
        """Yield the forgeries."""
        for scenario, robot in self.plans:
            yield from (Case(scenario, robot, seed) for seed in range(self.count))

    def run(self, case: Case) -> ForgeryRecord:
        """Forge, verify and compare."""
        made, proved = _planned(case.scenario, case.robot)
        how, forged = forgery(made, case.seed)
        cost = forged.duration_s
        return ForgeryRecord(how, accepted(forged), made.cost.total - cost, proved - cost)

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Records of those that were verified."""
        return {"verified": [made for _, made in results if made.verified]}


@cache
def _planned(scenario: str, robot: str) -> tuple[Plan, float]:
    """The fastest plan, and the larger one of what planner and certificate prove [s]."""
    result = plan(load_problem(scenario, robot=robot, motion="fastest"))
    reported = result.lower_bound or 0.0
    certificate = Prover(result.problem).certificate(reported)
    return result.require(), max(reported, certificate["bound_s"])
