"""Runs in closed loop on simulated robots, driven by this package's executor and the greedy rule.

Does a plan reach its goal on a robot that slips, drifts, and melts earlier or later than its model,
and what does that cost? Problems are planned with exact arcs and with the paper's spirals; each is
run on robots of exact arcs drawn from the ranges of a disturbance level.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, TypeAdapter

from benchmarks.problems import Choices, labelled
from benchmarks.report import Row, quantiles
from benchmarks.study import Count, Study
from twosra_mpc import with_path_model
from twosra_mpc.execution.simulation.metrics import Metrics
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.validation import plain

PATH_MODELS = {"arc": "exact arcs", "log_spiral": "the paper's spirals"}
EXECUTORS = {"optimal": "this package", "greedy": "greedy rule"}

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
    """

    record: ClassVar = TypeAdapter(dict[str, Any])
    question: ClassVar = "Do plans reach their goals on robots that are not as described?"

    problems: Choices = ("published", "random-100:20")
    level: Literal["none", "mild", "moderate", "hard"] = "moderate"
    seeds: Count = 8
    executors: Executors = ("optimal", "greedy")
    path_models: PathModels = ("arc", "log_spiral")

    def cases(self) -> Iterator[Case]:
        """Yield the runs; those that share a robot are neighbours."""
        seeds = range(1, self.seeds + 1)
        for drives, model, seed in itertools.product(self.executors, self.path_models, seeds):
            yield from (Case(drives, model, label, seed) for label in labelled(self.problems))

    def run(self, case: Case) -> dict[str, Any]:
        """Run one case on a robot of exact arcs; the record is that of its ``Metrics``."""
        problem = labelled(self.problems)[case.problem]
        problem = problem.with_robot(with_path_model(problem.robot, case.path_model))
        done = simulate(problem, disturbance=self.level, seed=case.seed, executor=case.executor)
        return done.metrics._asdict()

    def report(
        self, results: Sequence[tuple[Case, dict[str, Any]]], folder: Path
    ) -> dict[str, Any]:
        """One row for each executor and path model, and every run that did not reach its goal."""
        del folder
        runs = [(case, Metrics(**record)) for case, record in results]
        rows = [
            self._row(*group, [found for _, found in members])
            for group, members in itertools.groupby(runs, key=lambda run: run[0][:2])
        ]
        ours = [found for case, found in runs if case.executor == "optimal"]
        return {
            "rows": rows,
            "lost": [(case, found) for case, found in runs if not found.reached],
            "extra": sum(found.transitions > found.allowed for found in ours),
            "forced_s": max(found.forced_s for _, found in runs),
        }

    def _row(self, executor: str, path_model: str, runs: Sequence[Metrics]) -> Row:
        again = f"{sum(found.replans > 0 for found in runs)} of {len(runs)}"
        errors = np.array([(f.position_m, f.heading_rad, f.curvature_per_m) for f in runs])
        errors *= (1e3, np.degrees(1.0), 1.0)
        median, largest = (
            "{:.1f}, {:.2f}, {:.2f}".format(*of(errors, axis=0)) for of in (np.median, np.max)
        )
        return {
            "driven by": EXECUTORS[executor],
            "planned with": PATH_MODELS[path_model],
            "level": self.level,
            "reached": f"{sum(found.reached for found in runs)} of {len(runs)}",
            "time [s] median / p90 / max": quantiles(
                [found.time_s for found in runs], (0.5, 0.9, 1.0), ".0f"
            ),
            "transitions mean": f"{np.mean([found.transitions for found in runs]):.2f}",
            "planned again": again if executor == "optimal" else "",
            "energy [J] median": quantiles([found.energy_J for found in runs], (0.5,), ".0f"),
            "error median / max [mm, degrees, 1/m]": f"{median} / {largest}",
        }
