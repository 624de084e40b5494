"""How far runs in free space leave the paths of their plans, and what clearance that asks for.

A point of the outline is compared with the same point at the place of the path that is nearest to
the robot as a whole. The clearance a rigid drive needs is what the guard would stop at plus how far
the robot believes to be off its path: planned with that, the guard never stops it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

from benchmarks.problems import Choices, labelled
from benchmarks.study import RUNNING, Count, Measured, Study
from twosra_mpc import Plan, Problem, plan
from twosra_mpc.execution import Executor, ExecutorSettings, SimulatedRobot
from twosra_mpc.execution.guard import Guard
from twosra_mpc.execution.run import RunRecord
from twosra_mpc.execution.simulation.disturbance import disturbance_level
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.validation import plain

Array = NDArray[np.float64]
Levels = Annotated[tuple[Literal["none", "mild", "moderate", "hard"], ...], BeforeValidator(plain)]
_RATE_HZ = 15.0
_POINTS = 7  # along a segment


class Case(NamedTuple):
    """One run."""

    level: str
    problem: str
    seed: int


class Departure(Study):
    """Runs in free space at levels of disturbance.

    Attributes:
        problems: Problem sets.
        levels: Levels of disturbance.
        seeds: Robots each problem is run on.
    """

    question: ClassVar = "How far do runs leave the paths of their plans?"
    measures: ClassVar = RUNNING

    problems: Choices = ("random-100:3",)
    levels: Levels = ("mild", "moderate", "hard")
    seeds: Count = 1

    def cases(self) -> Iterator[Case]:
        """Yield the runs."""
        for level, seed in itertools.product(self.levels, range(1, self.seeds + 1)):
            yield from (Case(level, label, seed) for label in labelled(self.problems))

    def run(self, case: Case) -> dict[str, Any]:
        """Run one case; largest departures of its rigid and soft drives, and clearances needed."""
        problem = labelled(self.problems)[case.problem]
        problem = problem.with_values(goal=problem.goal.with_values(tolerance=None))
        level = disturbance_level(case.level)
        settings = ExecutorSettings(dead_zone_rad_s=level.dead_zone_rad_s)
        robot, steps = SimulatedRobot(problem, "arc", level, case.seed), list[Step]()
        guard = Guard(problem, settings.patience)

        def note(record: RunRecord) -> None:
            belief = record.controller.belief
            steps.append(Step(belief.q.copy(), robot.q.copy(), guard.stop_m(belief.deviation)))

        run = Executor(robot, settings, note).run(plan(problem).require())
        told_s = [
            event.time_s for event in run.events if event.kind in ("plan", "correct", "replan")
        ]
        found: dict[str, list[float]] = {"rigid_m": [], "soft_m": [], "needed_m": []}
        for k, item in enumerate(run.plans):
            rows = run.log.time_s[:-1] >= told_s[k]
            rows &= run.log.time_s[:-1] < [*told_s[1:], np.inf][k]
            for phase in item.phases:
                driven = np.flatnonzero(rows & (run.log.mode[:-1] == phase.mode).all(axis=1))
                if not len(driven):
                    continue
                true, needed = _departures(problem, robot.geometry, item, phase, steps, driven)
                found["soft_m" if any(phase.mode) else "rigid_m"].append(true)
                if not any(phase.mode):
                    found["needed_m"].append(needed)
        return {"ending": str(run.ending), **found}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Quantiles of departures by level."""
        rows = []
        for level in self.levels:
            of_level = [made for case, made in results if case.level == level]
            for name in ("rigid_m", "soft_m", "needed_m"):
                values = [each for made in of_level for each in made[name]]
                quantiles = np.quantile(values, (0.5, 0.9, 0.99, 1.0)) if values else [np.nan] * 4
                rows.append(
                    (level, name, len(values), [f"{1e3 * each:z.1f}" for each in quantiles])
                )
        return {"rows": rows}


class Step(NamedTuple):
    """Before a command: where the robot believes to be, where it is, what the guard stops at."""

    believed: Array
    true: Array
    stop_m: float


def _departures(
    problem: Problem, true: Geometry, item: Plan, phase: Any, steps: list[Step], driven: Array
) -> tuple[float, float]:
    """Largest departure of a drive in truth, and the clearance that it needs [m]."""
    count = max(2, int((phase.end_s - phase.start_s) * _RATE_HZ))
    at_s = np.linspace(phase.start_s, phase.end_s, count)
    geometry = problem.robot.geometry
    path = _points(geometry, item.trajectory.configuration(at_s))
    really = _points(true, np.array([steps[k].true for k in driven]))
    believed = _points(geometry, np.array([steps[k].believed for k in driven]))
    stop_m = np.array([steps[k].stop_m for k in driven])
    return float(_away(really, path).max()), float((_away(believed, path) + stop_m).max())


def _points(geometry: Geometry, q: Array) -> Array:
    """Points of the outline, (m, points, 2)."""
    shape = robot_shape(geometry, q, _POINTS)
    parts = (shape.units, shape.wheels, shape.segments)
    return np.concatenate([part.reshape(len(q), -1, 2) for part in parts], axis=1)


def _away(points: Array, path: Array) -> Array:
    """Largest distance of a point from itself at the nearest place of a path, (m,)."""
    return np.array([np.linalg.norm(path - at, axis=-1).max(axis=1).min() for at in points])
