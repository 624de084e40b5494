"""Built-in missions as one plan, beside their goals planned one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, ClassVar, NamedTuple

from pydantic import TypeAdapter

from benchmarks.measurement import timed_in_turns
from benchmarks.study import Count, Names, Study
from twosra_mpc import load_problem, plan
from twosra_mpc.analysis.goal_by_goal import goal_by_goal
from twosra_mpc.validation import Positive


class Case(NamedTuple):
    """A mission."""

    scenario: str


class PickAndPlace(Study):
    """Scenarios with objects.

    Attributes:
        scenarios: Built-in scenarios.
        repeats: Timed calls after one that is not counted.
        time_limit_s: Limit of each plan, in thousands of units of work: about seconds.
    """

    record: ClassVar = TypeAdapter(dict[str, Any])
    question: ClassVar = "Fetch, carry, put down: one plan beside goal by goal from cold?"

    scenarios: Names
    repeats: Count = 3
    time_limit_s: Positive = 60.0

    def cases(self) -> Iterator[Case]:
        """Yield the scenarios."""
        yield from map(Case, self.scenarios)

    def run(self, case: Case) -> dict[str, Any]:
        """Plan as one and goal by goal, at full speed."""
        given: dict[str, Any] = {"work_limit": 1e3 * self.time_limit_s, "motion": "fastest"}
        problem = load_problem(case.scenario, **given)
        calls = {"plan": partial(plan, problem)}
        result, timing = timed_in_turns(calls, self.repeats, self.time_limit_s)["plan"]
        ways = {name: goal_by_goal(problem, name) for name in ("cold", "carried on")}
        return {
            "verified": result.found,
            "cost": result.plan and result.plan.cost.total,
            "gap": result.gap,
            "cpu_s": timing.cpu_median_s,
            "message": result.message,
            "cold": ways["cold"].cost,
            "warm": ways["carried on"].cost,
            "trouble": ways["cold"].trouble,
        }
