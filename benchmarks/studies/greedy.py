"""The greedy rule beside this planner, as a user gets both: what plans take, and what is proved."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

from benchmarks.problems import Choices, labelled
from benchmarks.study import OneProblem, Study
from twosra_mpc import plan
from twosra_mpc.robot.modes import mode_name

WAYS: dict[str, dict[str, Any]] = {
    "greedy": {"planner": "greedy"},
    "fastest": {"motion": "fastest"},
    "gentle": {},
}


class Greedy(Study):
    """Three plans of each problem.

    Attributes:
        problems: Problem sets.
        exact: Whether goals are met exactly; else as nearly as the robot's accuracy asks.
    """

    question: ClassVar = "What does the greedy rule take, and what does this planner, proved?"

    problems: Choices = ("published-default",)
    exact: bool = False

    def cases(self) -> Iterator[OneProblem]:
        """Yield the problems."""
        yield from map(OneProblem, labelled(self.problems))

    def run(self, case: OneProblem) -> dict[str, Any]:
        """Plan in three ways; modes, duration [s] and proved gap of each plan.

        Raises:
            NoPlanError: If there is none.
        """
        problem, made = labelled(self.problems)[case.problem], {}
        if self.exact:
            problem = problem.with_values(goal=problem.goal.with_values(tolerance="exact"))
        for name, given in WAYS.items():
            found = plan(problem.with_values(**given)).require()
            modes = [mode_name(phase.mode) for phase in found.phases]
            made[name] = {"modes": modes, "duration_s": found.duration_s, "gap": found.gap}
        return made
