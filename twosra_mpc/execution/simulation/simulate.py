"""``simulate``: plan, and run the plan in closed loop on a simulated robot."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields
from typing import Any

from twosra_mpc.errors import InputError
from twosra_mpc.execution.executor import Executor, ExecutorSettings
from twosra_mpc.execution.greedy_executor import GreedyExecutor
from twosra_mpc.execution.run import Run
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.execution.simulation.metrics import Metrics, metrics
from twosra_mpc.execution.simulation.plant import SimulatedRobot, Truth
from twosra_mpc.planning.planner import plan as find_plan
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.problem import Problem

EXECUTORS = ("optimal", "greedy")


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated run.

    Attributes:
        plant: True path model of the robot.
        disturbance: Level of what else differed from the model.
        seed: Of all that was drawn.
        run: What the robot measured and did.
        truth: What really happened.
    """

    plant: str
    disturbance: str
    seed: int
    run: Run
    truth: Truth

    @property
    def metrics(self) -> Metrics:
        """Numbers, by what really happened."""
        return metrics(self.run, self.truth)

    def to_dict(self) -> dict[str, Any]:
        """The simulation as plain data."""
        return {
            **self.run.to_dict(),
            "plant": self.plant,
            "disturbance": self.disturbance,
            "seed": self.seed,
            "metrics": self.metrics._asdict(),
            "truth": {item.name: getattr(self.truth, item.name).tolist() for item in fields(Truth)},
        }


def simulate(
    problem: Problem,
    *,
    plant: str = "arc",
    disturbance: str = "moderate",
    seed: int = 0,
    executor: str = "optimal",
    plan: Plan | None = None,
    settings: ExecutorSettings | None = None,
    broken_heaters: Collection[int] = (),
) -> Simulation:
    """Plan a problem and run it; or drive to its goal by the greedy rule, which needs no plan.

    Args:
        problem: The problem.
        plant: True path model of the robot, or "as-planned".
        disturbance: A level: none, mild, moderate or hard.
        seed: Of all that is drawn at random.
        executor: "optimal", or "greedy".
        plan: A plan of the problem, if there is one already.
        settings: Of the executor; by default it knows the level's dead zone.
        broken_heaters: Segments (from 1) whose heater never warms.

    Raises:
        InputError: If there is no such plant, level or executor, or the robot has no ``[segment]``.
        NoPlanError: If the problem has no plan.
    """
    level = disturbance_level(disturbance)
    if executor not in EXECUTORS:
        raise InputError("executor", executor, f"one of {', '.join(EXECUTORS)}")
    robot = SimulatedRobot(problem, plant, level, seed, broken_heaters=broken_heaters)
    chosen = settings or ExecutorSettings(dead_zone_rad_s=level.dead_zone_rad_s)
    if executor == "greedy":
        run = GreedyExecutor(robot, chosen).run(problem)
    else:
        run = Executor(robot, chosen).run(plan or find_plan(problem).require())
    return Simulation(plant, disturbance, seed, run, robot.truth())
