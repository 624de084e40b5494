"""One step of the tracker: what it costs, and what its command loses by being linearised.

Steps are timed on a model that follows a plan from a disturbed start with camera noise and then
rests at the phase's end. Commands are compared at random states (`agreement`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.studies.tracker_step.agreement import NOISE, disagreements
from benchmarks.study import RUNNING, Count, Study
from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.execution.tracking.setup import Setup, TrackerLimits, TrackerWeights
from twosra_mpc.execution.tracking.tracker import Measurement, Tracker
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.robot.modes import mode_name

PUSH = np.array([5e-3, -5e-3, 0.05, 0.0, 0.0])  # 5 mm and 3 degrees, at the start
REST_S = 0.7
HORIZON, PERIOD_S = 20, 1 / 15


class Case(NamedTuple):
    """A phase of a scenario's plan."""

    scenario: str
    phase: int


class TrackerSteps(Study):
    """A phase of each mode.

    Attributes:
        runs: Closed loops whose steps are timed.
        states: Random states at which the tracker is compared with IPOPT.
    """

    record: ClassVar = TypeAdapter(dict[str, Any])
    question: ClassVar = "What does a step of the tracker cost, and what does its command lose?"
    measures: ClassVar = RUNNING

    runs: Count = 1
    states: Count = 40

    def cases(self) -> Iterator[Case]:
        """Yield a phase of each mode."""
        yield from (Case("paper-2", 0), Case("paper-2", 1), Case("paper-4", 1), Case("paper-1", 2))

    def run(self, case: Case) -> dict[str, Any]:
        """Time steps, and compare commands; shares are of the range of each speed."""
        of = plan(load_problem(case.scenario)).require()
        taken_s = [each for seed in range(self.runs) for each in _steps_s(of, case.phase, seed)]
        apart = np.array(disagreements(of, case.phase, tracker_setup(of, case.phase), self.states))
        return {
            "mode": mode_name(of.phases[case.phase].mode),
            "taken_ms": (1e3 * np.quantile(taken_s, (0.5, 0.99))).tolist(),
            "apart_percent": (100 * np.nanquantile(apart, (0.5, 0.9, 1.0))).tolist(),
            "unsolved": int(np.isnan(apart).sum()),
        }


def tracker_setup(of: Plan, phase: int) -> Setup:
    """What a tracker with the usual settings tracks in a phase."""
    mode = of.phases[phase].mode
    return Setup(of.robot.body, mode, HORIZON, PERIOD_S, TrackerWeights(), TrackerLimits())


def _steps_s(of: Plan, phase: int, seed: int) -> Iterator[float]:
    """Drive the model in closed loop; yield the CPU time of each step [s]."""
    path, samples, rng = of.phases[phase], of.samples, np.random.default_rng(seed)
    tracker, flow = Tracker(of.robot), interval_flow(of.robot, 16)
    tracker.reset(of)
    q = samples.q[np.searchsorted(samples.t_s, path.start_s - 1e-6)] + PUSH
    for k in range(int((path.end_s - path.start_s + REST_S) / PERIOD_S)):
        measured = Measurement(path.start_s + k * PERIOD_S, phase, q + NOISE * rng.normal(size=5))
        began_s = time.process_time()
        command = tracker.step(measured)
        yield time.process_time() - began_s
        q = flow(q, command.v * PERIOD_S, path.mode).full().ravel()
