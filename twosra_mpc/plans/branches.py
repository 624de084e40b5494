"""Policies: a plan with recourse where a joint bend ends elsewhere, and its expected cost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from twosra_mpc.problem.problem import Risk
from twosra_mpc.robot.modes import ModeSequence, named, soft_segments


def priced(costs: Iterable[tuple[float, float]], risk: Risk) -> float:
    """Mean, or a quantile, of costs that each have their probability before them."""
    if isinstance(risk, str):
        return sum(share * cost for share, cost in costs if share > 0)
    left, ordered = risk, sorted(costs, key=lambda each: each[1])
    for share, cost in ordered:
        if (left := left - share) <= _ROUNDING:
            return cost
    return ordered[-1][1]


_ROUNDING = 1e-9  # of probabilities


class Branch(NamedTuple):
    """Branch of a policy: its course after a joint bend that misses, or is right by chance.

    Attributes:
        probability: Of the branch.
        phase: Number of the bend's phase, from 1.
        when: Outcome of the bend, e.g. "splits by more than 5 %".
        off_per_m: How far off the goal a curvature is then, at least.
        sequence: Modes in which the rest is done.
        cost_s: Expected cost of all, from the start.
    """

    probability: float
    phase: int
    when: str
    off_per_m: float
    sequence: ModeSequence
    cost_s: float

    @property
    def condition(self) -> str:
        """Condition of the branch in words, with its probability."""
        bend = f"if the joint bend of phase {self.phase} {self.when}"
        return f"{bend} (probability {self.probability:z.2g})"

    @property
    def action(self) -> str:
        """Recourse in words, e.g. "segment 2 freezes and segment 1 is corrected"."""
        soft = [mode for mode in self.sequence if any(mode)]
        if not soft:
            return "all segments freeze as they are"
        count, last = len(soft[-1]), soft_segments(soft[-1])
        frozen = named("segment", [j + 1 for j in range(count) if j not in last], count)
        corrected = named("segment", [j + 1 for j in last], count)
        return f"{frozen} freezes and {corrected} is corrected"


class Policy(NamedTuple):
    """Plan with recourse: the robot is measured after a joint bend, and the rest planned again.

    Costs are of runs: until melts and freezes are known to be over.

    Attributes:
        risk: Risk measure of the cost: "mean", or a quantile.
        cost_s: That mean or quantile.
        planned_s: Cost where everything goes as planned.
        branches: Branches, one for each other outcome.
        lower_bound: Proved lower bound on the cost of every policy [s].
        known_bound: Lower bound for a planner that knows all outcomes in advance [s].
    """

    risk: Risk
    cost_s: float
    planned_s: float
    branches: tuple[Branch, ...] = ()
    lower_bound: float = 0.0
    known_bound: float = 0.0

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
    def gap(self) -> float:
        """Proved relative gap to the best policy."""
        return 1 - self.lower_bound / self.cost_s

    @property
    def what(self) -> str:
        """Risk measure in words."""
        return "expected" if isinstance(self.risk, str) else f"{self.risk:zg} quantile"

    @property
    def words(self) -> str:
        """Cost by the risk measure, its proved gap, and the value of perfect information."""
        proved = f"proved: no policy below {self.lower_bound:z.1f} s ({100 * self.gap:z.1f} % less)"
        unknown = f"not knowing costs {self.cost_s - self.known_bound:z.0f} s at most"
        return f"{self.what} {self.cost_s:z.1f} s as confirmed; {proved}; {unknown}"

    @property
    def outcomes(self) -> Iterator[tuple[str, str, float]]:
        """Outcomes in words, with the recourse and the expected cost of the whole [s]."""
        yield f"as planned (probability {self.going_as_planned:z.2g})", "", self.planned_s
        for each in self.branches:
            yield each.condition, each.action, each.cost_s

    @property
    def sentences(self) -> Iterator[str]:
        """Outcomes as sentences, with the time that each adds."""
        for when, done, cost_s in self.outcomes:
            takes = f"{cost_s - self.planned_s:+z.0f} s" if done else f"{cost_s:z.0f} s"
            yield f"{', '.join(filter(None, (when, done)))}: {takes}"

    def to_dict(self) -> dict[str, Any]:
        """The policy as plain data."""
        return {**self._asdict(), "branches": [each._asdict() for each in self.branches]}
