"""Plan files squeezed, cut and told otherwise: whether one is verified below what is proved."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks.attack.forgeries import cost_if_accepted, forged_file
from benchmarks.study import Count, Measured, Names, Study
from twosra_mpc import InputError, Problem, Result, load_problem, plan
from twosra_mpc.checking.certificate import check
from twosra_mpc.planning.proof import Prover

# Problems whose plans cost hardly more than what is proved of all: what is saved shows.
_DEAR: dict[str, Any] = {
    "start": {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)},
    "goal": {"kappa_per_m": (30.0, 0.0)},
    "weights": {"energy_s_per_J": 9.9},
    "gap": 1e-5,
}
PROBLEMS: dict[str, tuple[str, dict[str, Any]]] = {
    "paper-1": ("paper-1", {"robot": "2sra-v1"}),
    "paper-1, paper's robot": ("paper-1", {"robot": "2sra-v1-paper"}),
    "paper-3, paper's robot": ("paper-3", {"robot": "2sra-v1-paper"}),
    "dear energy": ("shape-change", {"robot": "2sra-v1", **_DEAR}),
    "dear effort": (
        "shape-change",
        {"robot": "2sra-v1", **_DEAR, "weights": {"effort": 50.0}, "gap": 0.01},
    ),
}


class Case(NamedTuple):
    """A forgery of a plan, by its number."""

    problem: str
    seed: int


@dataclass(frozen=True)
class ForgeryRecord:
    """What came of a forgery.

    Attributes:
        how: What was done.
        verified: Whether verification accepts it.
        saved_s: How much less than the plan it says it costs; 0 where it is not verified.
        below_s: How much less than what is proved, or how much more than the plan costs a forged
            certificate proves; not positive where proofs hold.
    """

    how: str
    verified: bool
    saved_s: float
    below_s: float


class ForgeryStudy(Study):
    """Random forgeries of plans that cost hardly more than what is proved of all plans.

    Attributes:
        count: Forgeries of each plan.
        problems: Names of the problems.
    """

    record: ClassVar = TypeAdapter(ForgeryRecord)
    question: ClassVar = "Is a plan verified that costs less than what is proved of all?"

    count: Count = 10
    problems: Names = tuple(PROBLEMS)

    def cases(self) -> Iterator[Case]:
        """Yield the forgeries."""
        for problem in self.problems:
            yield from (Case(problem, seed) for seed in range(self.count))

    def run(self, case: Case) -> ForgeryRecord:
        """Forge, verify and compare."""
        with tempfile.TemporaryDirectory() as folder:
            return tried(planned(case.problem), case.seed, Path(folder))

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Records of those that were verified."""
        return {"verified": [made for _, made in results if made.verified]}


def tried(result: Result, seed: int, folder: Path) -> ForgeryRecord:
    """Forge a plan that has a certificate, and see whether that is found."""
    how, document = forged_file(result, seed)
    assert result.certificate is not None
    proved = max(result.lower_bound or 0.0, result.certificate["bound_s"])
    made, cost = result.require(), cost_if_accepted(document, folder / "plan.json")
    more = _proved(result.problem, document["certificate"]) - made.cost.total
    if cost is None:
        return ForgeryRecord(how, verified=False, saved_s=0.0, below_s=more)
    return ForgeryRecord(how, True, made.cost.total - cost, max(proved - cost, more))


@cache
def planned(name: str) -> Result:
    """The fastest plan of a problem, with its certificate."""
    scenario, given = PROBLEMS[name]
    result = plan(load_problem(scenario, motion="fastest", **given))
    return replace(result, certificate=Prover(result.problem).certificate(result.lower_bound or 0))


@cache
def _checked(problem: Problem, certificate: str) -> float:
    try:
        return check(problem, json.loads(certificate)).bound
    except InputError:
        return 0.0


def _proved(problem: Problem, certificate: dict[str, Any]) -> float:
    """What a certificate proves, whatever it claims; nothing if it is none [s]."""
    return _checked(problem, json.dumps(certificate))
