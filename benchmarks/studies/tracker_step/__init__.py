"""One step of the tracker against other ways to compute it.

What does a step cost, how well is it solved, and what does its command lose against the converged
nonlinear program? All solve the same recorded steps, of a robot that follows a plan from a
disturbed start with camera noise and then rests at the phase's end. QP means the tracker's
linearised program, NLP the same cost with the limits as they are. Then the tracker alone against
IPOPT, at random states (`agreement`).
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from benchmarks.studies.tracker_step import qp_solvers, solvers
from benchmarks.studies.tracker_step.agreement import NOISE, disagreements, first_speeds
from benchmarks.studies.tracker_step.solvers import Answer, Array, Clock, Recorded, Solver
from benchmarks.study import Count, Measured, Study
from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.execution.tracking.linearisation import tracking_program
from twosra_mpc.execution.tracking.setup import Setup, SolverSettings, TrackerLimits, TrackerWeights
from twosra_mpc.execution.tracking.solver import ProgramInPlace
from twosra_mpc.execution.tracking.tracker import PhaseReference
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.robot.modes import is_rigid, mode_name

PUSH = np.array([5e-3, -5e-3, 0.05, 0.0, 0.0])  # 5 mm and 3 degrees, at the start
REST_S = 0.7
HORIZON, PERIOD_S = 20, 1 / 15
TRACKER = "**tracker**, whole step"
RIVALS = {  # name: what it solves, the package it needs, what makes it, whether in rigid mode only
    "OSQP, plain loop": ("QP", "osqp", qp_solvers.plain_osqp, False),
    "DAQP": ("QP", "daqp", qp_solvers.daqp, False),
    "ProxQP": ("QP", "proxsuite", qp_solvers.proxqp, False),
    "PIQP": ("QP", "piqp", qp_solvers.piqp, False),
    "IPOPT": ("NLP", "casadi", solvers.ipopt, False),
    "fatrop": ("NLP", "casadi", solvers.fatrop, True),
    "GEKKO, local": ("NLP", "gekko", solvers.gekko, True),
}
SLOW_STEPS = 12  # for solvers that take milliseconds or more


class Case(NamedTuple):
    """A phase of a scenario's plan."""

    scenario: str
    phase: int


@dataclass(frozen=True)
class SolverRecord:
    """What a solver did with the recorded steps.

    Attributes:
        solves: QP or NLP.
        steps: Steps it was given.
        success: Steps it says it solved.
        wall_us: Least, median and 99 % quantile of the wall time of a step.
        core_us: The same on a core; None where another process works.
        ratio: Median of a step's wall time over the tracker's.
        residuals: Largest of the constraints and of the stationarity; None: not told.
        errors: Median and largest error of the first speeds, in shares of their ranges, each from
            minus to plus its limit.
    """

    solves: str
    steps: int
    success: int
    wall_us: list[float]
    core_us: list[float] | None
    ratio: float
    residuals: list[float] | None
    errors: list[float]


@dataclass(frozen=True)
class StepsRecord:
    """All solvers on the steps of one phase.

    Attributes:
        mode: Mode of the phase, by name.
        solvers: Solver -> what it did, the tracker first.
        missing: Solver -> package that is not installed.
        least_us: Each step's least time of all rounds: median, p90, p99 and largest over the steps.
        iterations: ADMM iterations of the tracker: median, p90 and largest.
        apart: At random states, how far the tracker's first speeds are from IPOPT's: median, p90
            and largest, in shares of their ranges.
        unsolved: Random states at which either has no solution.
    """

    mode: str
    solvers: dict[str, SolverRecord]
    missing: dict[str, str]
    least_us: list[float]
    iterations: list[float]
    apart: list[float]
    unsolved: int


class TrackerSteps(Study):
    """The tracker and other solvers on recorded steps.

    Attributes:
        runs: Closed loops that are recorded for each phase.
        rounds: Rounds of the tracker, whose steps are too short to time once.
        states: Random states at which the tracker is compared with IPOPT.
    """

    record: ClassVar = TypeAdapter(StepsRecord)
    question: ClassVar = "What does a step of the tracker cost, and what does its command lose?"

    runs: Count = 6
    rounds: Count = 21
    states: Count = 100

    def cases(self) -> Iterator[Case]:
        """Yield a phase of each mode."""
        yield from (Case("paper-2", 0), Case("paper-2", 1), Case("paper-4", 1), Case("paper-1", 2))

    def run(self, case: Case) -> StepsRecord:
        """Let every solver that is installed solve the same steps."""
        of = plan(load_problem(case.scenario)).require()
        mode, setup = of.phases[case.phase].mode, tracker_setup(of, case.phase)
        steps = _record_steps(of, case.phase, setup, self.runs)
        converged = solvers.ipopt(setup, tolerance=1e-10)
        best = [first_speeds(setup, step, converged(step, Clock()).first) for step in steps]
        own, taken_s = _measured(solvers.tracker(of, case.phase), steps, self.rounds)
        base = np.median(taken_s[:, :, 0], axis=0)
        records = {TRACKER: _record("QP", own, taken_s, _errors(setup, steps, own, best), base)}
        missing = {}
        for name, (solves, package, make, rigid_only) in RIVALS.items():
            if rigid_only and not is_rigid(mode):
                continue
            if importlib.util.find_spec(package) is None:
                missing[name] = package
                continue
            some = slice(None, None, 1 if solves == "QP" else max(1, len(steps) // SLOW_STEPS))
            answers, taken = _measured(make(setup), steps[some], rounds=1)
            errors = _errors(setup, steps[some], answers, best[some])
            records[name] = _record(solves, answers, taken, errors, base[some])
        iterations = [step.program.iterations for step in steps if step.program]
        apart = np.array(disagreements(of, case.phase, setup, self.states))
        return StepsRecord(
            mode=mode_name(mode),
            solvers=records,
            missing=missing,
            least_us=np.quantile(1e6 * taken_s[:, :, 0].min(axis=0), (0.5, 0.9, 0.99, 1)).tolist(),
            iterations=np.quantile(iterations, (0.5, 0.9, 1.0)).tolist(),
            apart=np.nanquantile(apart, (0.5, 0.9, 1.0)).tolist(),
            unsolved=int(np.isnan(apart).sum()),
        )

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """The horizon."""
        del results, folder
        return {"horizon": HORIZON}


def tracker_setup(of: Plan, phase: int) -> Setup:
    """What a tracker with the usual settings tracks in a phase."""
    mode = of.phases[phase].mode
    return Setup(of.robot.body, mode, HORIZON, PERIOD_S, TrackerWeights(), TrackerLimits())


def _record_steps(of: Plan, phase: int, setup: Setup, runs: int) -> list[Recorded]:
    """Drive the model in closed loop and keep what every step was given."""
    path, samples, h = of.phases[phase], of.samples, setup.period_s
    program = ProgramInPlace(tracking_program(setup), SolverSettings())
    selection = setup.outputs.selection
    reference = PhaseReference(of.trajectory, path, selection, setup.horizon, h)
    flow = interval_flow(of.robot, 16)
    start = samples.q[np.searchsorted(samples.t_s, path.start_s - 1e-6)]
    steps = []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        q, previous, wheels = start + PUSH, np.zeros(setup.variables), np.zeros(4)
        program.forget()
        for k in range(int((path.end_s - path.start_s + REST_S) / h)):
            time_s = path.start_s + k * h
            program.measured[:] = measured = q + NOISE * rng.normal(size=5)
            program.wheels[:] = wheels
            reference.write(time_s, program.reference)
            at = program.reference.copy()
            program.solve()
            solved = program.quadratic_program()
            steps.append(Recorded(k == 0, time_s, measured, at, previous, wheels, solved))
            previous, wheels = solved.x, program.command.copy()
            q = flow(q, program.v * h, setup.mode).full().ravel()
    return steps


def _measured(
    solver: Solver, steps: Sequence[Recorded], rounds: int
) -> tuple[list[Answer], np.ndarray]:
    """Answers, and times (rounds, steps, [wall, core]) [s]."""
    clock, answers, taken_s = Clock(), [], []
    for _ in range(rounds):
        for step in steps:
            answers.append(solver(step, clock))
            taken_s.append(clock.taken_s)
    return answers[: len(steps)], np.reshape(taken_s, (rounds, len(steps), 2))


def _errors(
    setup: Setup, steps: Sequence[Recorded], answers: Sequence[Answer], best: Sequence[Array]
) -> list[float]:
    return [
        float(np.abs(first_speeds(setup, step, answer.first) - at).max()) / 2
        for step, answer, at in zip(steps, answers, best, strict=True)
    ]


def _record(
    solves: str, answers: Sequence[Answer], taken_s: Array, errors: Sequence[float], base_s: Array
) -> SolverRecord:
    wall_us, core_us = np.quantile(1e6 * taken_s, (0.0, 0.5, 0.99), axis=(0, 1)).T.tolist()
    residuals = np.max([(one.primal, one.dual) for one in answers], axis=0)
    return SolverRecord(
        solves=solves,
        steps=len(answers),
        success=sum(answer.success for answer in answers),
        wall_us=wall_us,
        core_us=None if np.isnan(core_us).any() else core_us,
        ratio=float(np.median(np.median(taken_s[:, :, 0], axis=0) / base_s)),
        residuals=None if np.isnan(residuals).any() else residuals.tolist(),
        errors=np.quantile(errors, (0.5, 1.0)).tolist(),
    )
