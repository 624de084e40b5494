"""Robots that differ only in what no compiled function depends on, planned for in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import TypeAdapter

from benchmarks.measurement import Timing
from benchmarks.study import Measured, OneProblem, PlanStudy
from benchmarks.thermal_scale import thermally_faster
from twosra_mpc import Robot, plan

SAME = "nothing"
CHANGES: dict[str, Callable[[Robot, int], Robot]] = {
    SAME: lambda robot, _: robot,
    "name": lambda robot, n: _with(robot, name=f"{robot.name}, number {n}"),
    "description": lambda robot, n: _with(robot, description=f"Number {n}."),
    "heat": lambda robot, n: thermally_faster(robot, 1 + 1e-6 * n),
}


class Cache(PlanStudy):
    """Every plan but that of the same robot is for a robot that no plan was made for before."""

    record: ClassVar = TypeAdapter(dict[str, Timing])
    question: ClassVar = "What does a plan cost for a robot of another name, description or heat?"

    def run(self, case: OneProblem) -> dict[str, Timing]:
        """Plan for the robot as it is and for changed ones."""
        problem, numbers = self.named[case.problem], range(1, self.repeats + 2)
        asked = {
            what: iter([problem.with_values(robot=change(problem.robot, n)) for n in numbers])
            for what, change in CHANGES.items()
        }
        made = self.timed({what: lambda of=of: plan(next(of)) for what, of in asked.items()})
        return {what: timing for what, (_, timing) in made.items()}

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Times over those for the same robot."""
        del folder
        wall, cpu = (
            {
                what: [getattr(m[what], clock) / getattr(m[SAME], clock) for _, m in results]
                for what in CHANGES
            }
            for clock in ("median_s", "cpu_median_s")
        )
        return {"wall_ratios": wall, "cpu_ratios": cpu}


def _with(robot: Robot, **changes: str) -> Robot:
    return Robot.parse({**robot.model_dump(mode="json"), **changes}, robot.name)
