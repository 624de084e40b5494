"""Soft phases of plans driven by rigid bodies: by the plan's wheel speeds alone, and tracked.

The bodies are drawn over the whole of the ranges in the robot file. The tracker is told where the
robot is 15 times a second, with the noise of a camera; a phase ends when the bend is right.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.problems import Choices, labelled
from benchmarks.study import RUNNING, Count, Measured, Study
from twosra_mpc import Plan, plan
from twosra_mpc.execution.tracking import Measurement, Tracker
from twosra_mpc.physics.engine import Engine
from twosra_mpc.plans.trajectory import Phase
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import mode_name

Array = NDArray[np.float64]
_PERIOD_S = 1 / 15
_NOISE = np.array([5e-4, 5e-4, 5e-3, 0.5, 0.5])  # m, m, rad, 1/m, 1/m
_RIGHT_PER_M, _LONGEST_S = (
    0.35,
    10.0,
)  # of the mean bend, and how long it is tried for after the plan
_WITHIN = np.array([1e-3, math.radians(1.0), 0.7])  # what an end is counted by
_LEAST_BEND_RAD = 0.2  # of a segment: less says nothing of what is lost per bend


class Case(NamedTuple):
    """One soft phase on one robot."""

    problem: str
    phase: int
    seed: int


class SoftPhases(Study):
    """Phases with soft segments in the rigid-body engine.

    Attributes:
        problems: Problem sets.
        robots: Robots drawn for each phase.
    """

    question: ClassVar = "Where do soft phases end that rigid bodies drive?"
    measures: ClassVar = RUNNING

    problems: Choices = ("published-default",)
    robots: Count = 4

    def cases(self) -> Iterator[Case]:
        """Yield the phases."""
        for label, seed in itertools.product(labelled(self.problems), range(1, self.robots + 1)):
            for index, phase in enumerate(self._plan(label).phases):
                if any(phase.mode):
                    yield Case(label, index, seed)

    def _plan(self, label: str) -> Plan:
        return plan(labelled(self.problems)[label]).require()

    def run(self, case: Case) -> dict[str, Any]:
        """Drive the phase twice."""
        made = self._plan(case.problem)
        phase, rng = made.phases[case.phase], np.random.default_rng([case.seed, case.phase])
        physics = made.robot.true_physics.drawn(1.0, rng)

        def begun() -> Engine:
            x_m, y_m, phi_rad, *kappa_per_m = made.trajectory.configuration([phase.start_s])[0]
            at = {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": tuple(kappa_per_m)}
            problem = made.problem.with_values(start=made.problem.start.with_values(**at))
            return Engine(problem, made.robot, physics, list(map(float, phase.mode)))

        alone = _driven(made, phase, begun(), _by_plan(made, phase))
        tracked = _driven(made, phase, begun(), _by_tracker(made, case.phase, rng))
        return {"mode": mode_name(phase.mode), "alone": alone, "tracked": tracked}

    def report(self, results: Sequence[Measured]) -> dict[str, Any]:
        """Ends of tracked phases, and what is lost per bend of those that are not."""
        rows, lost = [], []
        for soft in (1, 2):
            some = [made for _, made in results if made["mode"].count("1") == soft]
            ends = np.array([made["tracked"]["end"] for made in some])
            off = np.column_stack([np.hypot(*ends[:, :2].T), np.abs(ends[:, 2:])])
            right = (off[:, :2] <= _WITHIN[:2]).all(axis=1) & (off[:, 2:] <= _WITHIN[2]).all(axis=1)
            way_m = [made["tracked"]["way_m"] for made in some]
            rows.append((soft, len(some), int(right.sum()), off[:, 0].tolist(), way_m))
            per_bend = [made["alone"]["lost"] for made in some if made["alone"]["lost"] is not None]
            lost.append((soft, len(per_bend), *zip(*per_bend, strict=True)))
        return {"rows": rows, "lost": lost}


_Wheels = Callable[[float, Array], Array]


def _driven(made: Plan, phase: Phase, engine: Engine, wheels: _Wheels) -> dict[str, Any]:
    """Drive a phase until its bend is right; where it ends, and its largest way off the plan."""
    soft = POSE + np.flatnonzero(phase.mode)
    first, last = made.trajectory.configuration([phase.start_s, phase.end_s])
    time_s, q, way_m = phase.start_s, engine.q.copy(), 0.0
    while time_s < phase.end_s or (
        abs((q - last)[soft].mean()) > _RIGHT_PER_M and time_s < phase.end_s + _LONGEST_S
    ):
        turned = _PERIOD_S * wheels(time_s, q)
        engine.roll(turned, list(map(float, phase.mode)), _PERIOD_S)
        q = engine.q
        time_s += _PERIOD_S
        planned = made.trajectory.configuration([min(time_s, phase.end_s)])[0]
        way_m = max(way_m, math.hypot(*(q - planned)[:2]))
    off, lengths = q - last, np.array(made.robot.geometry.lengths_m)[soft - POSE]
    bend_rad, across = float(lengths @ (last - first)[soft]), [-math.sin(q[2]), math.cos(q[2])]
    lost = None
    if abs(bend_rad) >= _LEAST_BEND_RAD * len(soft):
        reached = float(lengths @ (q - first)[soft]) / bend_rad
        lost = [off[2] / bend_rad, float(off[:2] @ across) / bend_rad, reached]
    return {"end": off.tolist(), "way_m": way_m, "lost": lost}


def _by_plan(made: Plan, phase: Phase) -> _Wheels:
    def wheels(time_s: float, q: Array) -> Array:
        del q
        ends_s = np.minimum([time_s, time_s + _PERIOD_S], phase.end_s)
        return np.diff(made.trajectory.wheel_travel_rad(ends_s), axis=0)[0] / _PERIOD_S

    return wheels


def _by_tracker(made: Plan, index: int, rng: np.random.Generator) -> _Wheels:
    tracker = Tracker(made.robot)
    tracker.reset(made)

    def wheels(time_s: float, q: Array) -> Array:
        seen = q + _NOISE * rng.standard_normal(len(q))
        return tracker.step(Measurement(time_s, index, seen)).wheel_rad_s

    return wheels
