"""Missions of random goals: one plan of all of them beside plans of one after the other.

With goals that say a whole shape, plans can share little but warmth. With goals that are boxes of
curvature, one shape may serve several: joint plans are counted against going to the nearest point
of each box, which reshapes only where the shape at hand is not in the next box.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmarks.goal_by_goal import goal_by_goal
from benchmarks.measurement import Timing, timed_in_turns
from benchmarks.studies.scenes import blocks
from benchmarks.study import Count, Counts, Measured, Numbers, Study
from twosra_mpc import InputError, Problem, load_problem, plan
from twosra_mpc.plans.result import Result
from twosra_mpc.problem.ends import check_shapes
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.validation import NonNegative, Positive

_SAME_PER_M = 1e-6


class Case(NamedTuple):
    """How many goals, half-width of their boxes of curvature (0: whole shapes), and number."""

    goals: int
    box_per_m: float
    number: int


class Missions(Study):
    """Missions of random goals in free space.

    Attributes:
        count: Missions of each kind.
        goals: How many goals missions have that say whole shapes.
        boxes_per_m: Half-widths of the boxes of curvature of the others.
        box_goals: How many goals these have.
        position_m: Largest coordinate of goals; headings are of any direction.
        curvature_per_m: Largest curvature of the middle of goals.
        seed: Of all that is random.
        time_limit_s: Limit of each plan, in thousands of units of work: about seconds.
        gap: Asked of each plan.
    """

    question: ClassVar = "Several goals as one plan: how much is saved, how good, how fast?"

    count: Count = 2
    goals: Counts = (2, 3)
    boxes_per_m: Numbers = (5.0, 20.0)
    box_goals: Count = 4
    position_m: Positive = 0.25
    curvature_per_m: Positive = 30.0
    seed: Count = 2026
    time_limit_s: Positive = 60.0
    gap: NonNegative = 0.005

    def cases(self) -> Iterator[Case]:
        """Yield whole shapes first."""
        for goals in self.goals:
            yield from (Case(goals, 0.0, number) for number in range(self.count))
        for box in self.boxes_per_m:
            yield from (Case(self.box_goals, box, number) for number in range(self.count))

    def run(self, case: Case) -> dict[str, Any]:
        """Plan a mission as one, and goal by goal or with shapes taken at their nearest."""
        problem = self.mission(case)
        result, timing = timed_in_turns({"plan": partial(plan, problem)}, 1, 1e-9)["plan"]
        found = as_one(result, timing)
        found["reshapings"] = blocks(result.plan.sequence) if result.plan else None
        if case.box_per_m:
            return {**found, "nearest": reshapings_at_the_nearest(problem)}
        return {**found, **in_turns(problem)}

    def mission(self, case: Case) -> Problem:
        """The mission of a case; those of boxes that differ in width alone have the same goals."""
        rng = np.random.default_rng([self.seed, case.goals, case.number])
        start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
        goals = [self._goal(rng, case.box_per_m) for _ in range(case.goals)]
        tasks = [{"do": "reach", **goal} for goal in goals]
        given = {"work_limit": 1e3 * self.time_limit_s, "gap": self.gap, "motion": "fastest"}
        base = load_problem("rigid-move", start=start)
        return base.with_values(tasks=tasks[:-1], goal=goals[-1], **given)

    def _goal(self, rng: np.random.Generator, box_per_m: float) -> dict[str, Any]:
        """A goal in which the units do not meet."""
        while True:
            x_m, y_m = rng.uniform(-self.position_m, self.position_m, 2).tolist()
            phi_rad = float(rng.uniform(-math.pi, math.pi))
            kappa = rng.uniform(-self.curvature_per_m, self.curvature_per_m, 2).tolist()
            goal = {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": tuple(kappa)}
            if box_per_m:
                goal["tolerance"] = {"kappa_per_m": (box_per_m, box_per_m)}
            try:
                check_shapes(load_problem("rigid-move", goal=goal))
            except InputError:
                continue
            return goal

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Missions by kind."""
        whole = [(case, made) for case, made in results if not case.box_per_m]
        boxes = [(case, made) for case, made in results if case.box_per_m]
        return {
            "whole": {n: [m for c, m in whole if c.goals == n] for n in self.goals},
            "boxes": {b: [m for c, m in boxes if c.box_per_m == b] for b in self.boxes_per_m},
            "unverified": [(case, made) for case, made in results if not made["verified"]],
            "longer": [case for case, made in whole if longer(made, self.gap)],
        }


def as_one(result: Result, timing: Timing) -> dict[str, Any]:
    """What one plan of all goals came to."""
    return {
        "verified": result.found and result.require().verification.ok,
        "cost": result.plan and result.plan.cost.total,
        "gap": result.gap,
        "cpu_s": timing.cpu_median_s,
        "message": result.message,
    }


def in_turns(problem: Problem) -> dict[str, Any]:
    """Costs goal by goal, from cold and from as warm as the one before ended; trouble, if any."""
    cold, warm = (goal_by_goal(problem, name) for name in ("cold", "carried on"))
    return {"cold": cold.cost, "warm": warm.cost, "trouble": cold.trouble}


def longer(made: dict[str, Any], gap: float) -> bool:
    """Whether one plan is longer than goal by goal, by more than the asked gap allows."""
    known = made["cost"] is not None and made["warm"] is not None
    return bool(known and made["cost"] > made["warm"] * (1 + gap) + _SAME_PER_M)


def reshapings_at_the_nearest(problem: Problem) -> int:
    """How often a robot reshapes that goes to the nearest point of each goal's box in turn."""
    goals = [*(task.goal for task in problem.tasks), problem.goal]  # type: ignore[attr-defined]
    now: Array = problem.start.configuration
    count = 0
    for goal in goals:
        low, high = goal.box(now)
        nearest = np.clip(now, low, high)
        count += bool(np.abs(nearest - now)[POSE:].max() > _SAME_PER_M)
        now = nearest
    return count
