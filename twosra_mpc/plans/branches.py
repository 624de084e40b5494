"""A policy: a plan, and what is done instead where a joint bend ends elsewhere; with its price."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from twosra_mpc.problem.problem import Risk
from twosra_mpc.robot.modes import ModeSequence, named, soft_segments


def priced(costs: Iterable[tuple[float, float]], risk: Risk) -> float:
    """Mean of costs, each with its probability before it, or their quantile."""
    if isinstance(risk, str):
        return sum(share * cost for share, cost in costs if share > 0)
    left, ordered = risk, sorted(costs, key=lambda each: each[1])
    for share, cost in ordered:
        if (left := left - share) <= _ROUNDING:
            return cost
    return ordered[-1][1]


_ROUNDING = 1e-9  # of probabilities


class Branch(NamedTuple):
    """What follows where a joint bend misses.

    Attributes:
        probability: Of it.
        phase: The bend, counted from 1.
        off_per_m: How far off the goal a curvature is then, at least.
        sequence: Modes in which the rest is done.
        cost_s: Expected cost of all, from the start.
    """

    probability: float
    phase: int
    off_per_m: float
    sequence: ModeSequence
    cost_s: float

    @property
    def words(self) -> str:
        """E.g. "phase 3 ends 1.9 1/m off or more: freeze segment 2, then correct segment 1"."""
        missed = f"phase {self.phase} ends {self.off_per_m:z.1f} 1/m off or more"
        soft = [mode for mode in self.sequence if any(mode)]
        if not soft:
            return f"{missed}: bend no more"
        count, last = len(soft[-1]), soft_segments(soft[-1])
        frozen = [j + 1 for j in range(count) if j not in last]
        corrected = named("segment", [j + 1 for j in last], count)
        return f"{missed}: freeze {named('segment', frozen, count)}, then correct {corrected}"


class Policy(NamedTuple):
    """A plan with recourse: it is looked at after a joint bend, and what is left planned again.

    Costs are of runs: until melts and freezes are known to be over.

    Attributes:
        risk: What of the cost counts: "mean", or a quantile.
        cost_s: That mean or quantile.
        least_s: Estimate of the least that any policy has; not proved, see ``planning.policy``.
        planned_s: Cost where everything goes as planned.
        branches: What may follow instead.
    """

    risk: Risk
    cost_s: float
    least_s: float
    planned_s: float
    branches: tuple[Branch, ...] = ()

    @property
    def going_as_planned(self) -> float:
        """Probability of no branch."""
        return max(0.0, 1.0 - sum(each.probability for each in self.branches))

    @property
    def mean_s(self) -> float:
        """Expected cost."""
        own = self.going_as_planned * self.planned_s
        return own + sum(each.probability * each.cost_s for each in self.branches)

    @property
    def words(self) -> tuple[str, ...]:
        """What is expected, and what follows in each branch, in words."""
        what = "expected" if self.risk == "mean" else f"{self.risk:zg} quantile"
        least = f"the least of any policy estimated at {self.least_s:z.1f} s"
        first = f"{what} {self.cost_s:z.1f} s as confirmed, {least}"
        return first, *(self._words(each) for each in self.branches)

    def _words(self, branch: Branch) -> str:
        more_s = branch.cost_s - self.planned_s
        return f"if {branch.words}; {more_s:+z.0f} s, probability {branch.probability:z.2g}"

    def to_dict(self) -> dict[str, Any]:
        """The policy as plain data."""
        return {**self._asdict(), "branches": [each._asdict() for each in self.branches]}
