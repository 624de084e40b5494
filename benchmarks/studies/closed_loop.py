"""Runs in closed loop on simulated robots, driven by this package's executor and the greedy rule.

Does a plan reach its goal on a robot that slips, drifts, and melts earlier or later than its model,
and what does that cost? Problems are planned with exact arcs and with the paper's spirals; each is
run on robots of exact arcs, or of rigid bodies, drawn from the ranges of a disturbance level.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import BeforeValidator

from benchmarks.problems import Choices, labelled
from benchmarks.study import RUNNING, Count, Measured, Study
from twosra_mpc import InputError, NoPlanError, with_path_model
from twosra_mpc.execution.run import Ending
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.validation import plain

UNPLANNED, REACHED = "not planned", str(Ending.REACHED)

Executors = Annotated[tuple[Literal["optimal", "greedy"], ...], BeforeValidator(plain)]
PathModels = Annotated[tuple[Literal["arc", "log_spiral"], ...], BeforeValidator(plain)]


class Case(NamedTuple):
    """One run."""

    executor: str
    path_model: str
    problem: str
    seed: int


class ClosedLoop(Study):
    """Runs at one level of disturbance.

    Attributes:
        problems: Problem sets.
        level: Level of disturbance.
        seeds: Robots each problem is run on.
        executors: What drives.
        path_models: What plans assume.
        plant: What robots are simulated by: exact arcs, or a rigid-body engine.
        risk: What plans count with of joint bends that end elsewhere.
    """

    question: ClassVar = "Do plans reach their goals on robots that are not as described?"
    measures: ClassVar = RUNNING

    problems: Choices = ("published-default", "random-100:7")
    level: Literal["none", "mild", "moderate", "hard"] = "moderate"
    seeds: Count = 1
    executors: Executors = ("optimal", "greedy")
    path_models: PathModels = ("arc",)
    plant: Literal["arc", "as-planned", "mujoco"] = "arc"
    risk: Literal["nominal", "mean"] = "mean"

    def cases(self) -> Iterator[Case]:
        """Yield the runs; every problem has robots of its own, whatever drives them."""
        labels = list(labelled(self.problems))
        for drives, model, k in itertools.product(
            self.executors, self.path_models, range(self.seeds)
        ):
            first = 1 + k * len(labels)
            yield from (Case(drives, model, *each) for each in zip(labels, itertools.count(first)))

    def run(self, case: Case) -> dict[str, Any]:
        """Run one case; its ``Metrics``, plan, and last command."""
        problem = labelled(self.problems)[case.problem]
        problem = problem.with_values(robot=with_path_model(problem.robot, case.path_model))
        if problem.only_time:
            problem = problem.with_values(risk=self.risk)
        drawn: dict[str, Any] = {"plant": self.plant, "disturbance": self.level, "seed": case.seed}
        try:
            done = simulate(problem, executor=case.executor, **drawn)
        except (InputError, NoPlanError) as error:
            return {"ending": UNPLANNED, "reason": str(error)}
        planned_s = confirmed_s = over = None
        if done.run.plans:
            first = done.run.plans[0]
            planned_s, confirmed_s = first.duration_s, first.confirmed_s
            over = done.run.duration_s / planned_s
        log, rigid_C = done.run.log, problem.robot.heater.rigid_setpoint_C
        off = not log.wheel_rad_s[-1].any() and bool((log.setpoint_C[-1] <= rigid_C).all())
        kept = done.run.duration_s / confirmed_s if confirmed_s else None
        own = {"planned_s": planned_s, "over_planned": over, "over_confirmed": kept, "off": off}
        return {**done.metrics._asdict(), **own}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Runs that melted or froze more than their plans asked for."""
        ran = [found for found in results if found.record["ending"] != UNPLANNED]
        ours = [made for case, made in ran if case.executor == "optimal"]
        around = [made for _, made in ran if made.get("least_clearance_m") is not None]
        return {
            "ran": ran,
            "unplanned": [found for found in results if found not in ran],
            "around": around,
            "untrue": [
                made for _, made in ran if made["ending"] == REACHED and not made["reached"]
            ],
            "extra": sum(made["transitions"] > made["allowed"] for made in ours),
        }
