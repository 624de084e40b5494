"""Missions in closed loop: is the object where it should be, or has the robot stopped safely?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

from benchmarks.study import RUNNING, Count, Measured, Study
from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.problem.world import ACCURACY


class Case(NamedTuple):
    """A run."""

    seed: int


class ClosedLoopMissions(Study):
    """Runs of one mission, each on another robot.

    Attributes:
        scenario: A built-in mission with an object that is carried.
        level: Level of disturbance.
        seeds: Robots.
    """

    question: ClassVar = "Do missions end with the object at its goal, or stopped with a reason?"
    measures: ClassVar = RUNNING

    scenario: str = "pick-and-place"
    level: str = "moderate"
    seeds: Count = 2

    def cases(self) -> Iterator[Case]:
        """Yield the runs."""
        yield from map(Case, range(1, self.seeds + 1))

    def run(self, case: Case) -> dict[str, Any]:
        """Run the same plan on the robot of this seed; its ``Metrics``."""
        made = _planned(self.scenario)
        done = simulate(made.problem, plan=made, disturbance=self.level, seed=case.seed).metrics
        return {**done._asdict(), "planned_s": made.duration_s, "came_to": came_to(done._asdict())}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Runs by what they came to."""
        return {
            "runs": {
                name: [each for each in results if each.record["came_to"] == name]
                for name in (PLACED, STOPPED, WRONG)
            }
        }


PLACED, STOPPED, WRONG = "object at its goal", "stopped with a reason", "neither"


def came_to(made: dict[str, Any]) -> str:
    """What a run came to, in truth: objects within 5 mm and 3 degrees, nothing touched."""
    harmed = bool(made["touched"] or made["squeezed"])
    far, turned = (made["object_m"] or 0.0), (made["object_rad"] or 0.0)
    if made["ending"] == "reached":
        put = far <= ACCURACY[0] and turned <= ACCURACY[2]
        return PLACED if put and not harmed else WRONG
    return STOPPED if made["reason"] and not harmed else WRONG


@lru_cache
def _planned(scenario: str) -> Plan:
    return plan(load_problem(scenario)).require()
