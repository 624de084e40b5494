"""The tracker and other quadratic programming solvers, each behind the same method."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from twosra_mpc import Plan
from twosra_mpc.execution.tracking.linearisation import TrackingProgram, tracking_program
from twosra_mpc.execution.tracking.settings import SolverSettings
from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.execution.tracking.solver import QuadraticProgram
from twosra_mpc.execution.tracking.tracker import CommandStatus, Measurement, Tracker

Array = NDArray[np.float64]

TOLERANCE = SolverSettings().tolerance


@dataclass(frozen=True, eq=False)
class Recorded:
    """One step of a closed loop: what every solver is given.

    ``previous`` is the solution of the step before (zeros at the start of a run), ``wheels`` the
    last command, ``program`` the tracker's linearised program with its solution.
    """

    first: bool
    time_s: float
    q: Array
    reference: Array
    previous: Array
    wheels: Array
    program: QuadraticProgram


class Taken(NamedTuple):
    """Time on the wall, and of this thread on a core: without what other programs take."""

    wall_s: float
    core_s: float

    @staticmethod
    def now() -> Taken:
        """The clocks themselves."""
        return Taken(time.perf_counter(), time.thread_time())

    def until_now(self) -> Taken:
        """Time since."""
        core_s = time.thread_time() - self.core_s
        return Taken(time.perf_counter() - self.wall_s, core_s)


@dataclass(frozen=True, eq=False)
class Answer:
    """What a solver found: first deviation e_1, residuals (NaN: not told), time taken [s]."""

    success: bool
    first: Array
    primal: float
    dual: float
    taken: Taken


class Solver(Protocol):
    """Solves recorded steps in order."""

    name: str
    solves: str

    def solve(self, step: Recorded) -> Answer:
        """Solve one step; the time is that of everything a control loop would do."""


class TrackerStep:
    """The tracker as a user calls it, making the measurement included."""

    name, solves = "**tracker**, whole step", "QP"

    def __init__(self, of: Plan, phase: int) -> None:
        self._tracker, self._phase = Tracker(of.robot), phase
        self._tracker.reset(of)

    def solve(self, step: Recorded) -> Answer:
        """Solve one step; a new run starts from rest."""
        tracker = self._tracker
        if step.first:
            tracker.step(Measurement(step.time_s, None, step.q))
        started = Taken.now()
        command = tracker.step(Measurement(step.time_s, self._phase, step.q))
        taken = started.until_now()
        program = tracker.quadratic_program()
        assert program is not None
        success = command.status is CommandStatus.SOLVED and not command.message
        return _answer(success, program, program.x, program.y, step, taken)


class PlainOsqp:
    """OSQP through its Python class and CasADi through its call, defaults but the tolerance."""

    name, solves = "OSQP, plain loop", "QP"

    def __init__(self, setup: Setup) -> None:
        self._program = tracking_program(setup)
        self._solver: Any = None

    def solve(self, step: Recorded) -> Answer:
        """Solve one step."""
        started = Taken.now()
        program = _linearised(self._program, step)
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(
                sparse.csc_matrix(sparse.triu(program.hessian)),
                program.cost,
                program.constraints,
                program.lower,
                program.upper,
                eps_abs=TOLERANCE,
                eps_rel=0.0,
                verbose=False,
            )
        else:
            matrix = program.constraints.data
            self._solver.update(q=program.cost, l=program.lower, u=program.upper, Ax=matrix)
        found = self._solver.solve(raise_error=False)
        taken = started.until_now()
        return _answer(found.info.status == "solved", program, found.x, found.y, step, taken)


class Piqp:
    """PIQP (interior point), sparse interface."""

    name, solves = "PIQP", "QP"

    def __init__(self, setup: Setup) -> None:
        import piqp

        self._program, self._solver = tracking_program(setup), piqp.SparseSolver()
        self._solver.settings.eps_abs, self._solver.settings.eps_rel = TOLERANCE, 0.0
        self._solved = piqp.PIQP_SOLVED
        self._set_up = False

    def solve(self, step: Recorded) -> Answer:
        """Solve one step."""
        started = Taken.now()
        program = _linearised(self._program, step)
        change = self._solver.update if self._set_up else self._solver.setup
        bounds = {"G": program.constraints, "h_l": program.lower, "h_u": program.upper}
        change(P=program.hessian, c=program.cost, **bounds)
        self._set_up = True
        status, found = self._solver.solve(), self._solver.result
        taken = started.until_now()
        multipliers = found.z_u - found.z_l
        return _answer(status == self._solved, program, found.x, multipliers, step, taken)


def _linearised(program: TrackingProgram, step: Recorded) -> QuadraticProgram:
    """The tracker's program of a step, by an ordinary CasADi call."""
    arguments = (step.q, step.reference.T, step.previous, step.wheels)
    values, lower, upper, changing, _ = program.linearise(*arguments)
    cost, pattern = program.cost.copy(), program.constraints
    cost[: changing.numel()] = changing.full().ravel()
    parts = (values.full().ravel(), pattern.indices, pattern.indptr)
    return QuadraticProgram(
        hessian=step.program.hessian,
        cost=cost,
        constraints=sparse.csc_matrix(parts, shape=pattern.shape),
        lower=lower.full().ravel(),
        upper=upper.full().ravel(),
        x=step.program.x,
        y=step.program.y,
        iterations=0,
    )


def _answer(
    success: bool, program: QuadraticProgram, x: Array, y: Array, step: Recorded, taken: Taken
) -> Answer:
    rows = program.constraints @ x
    primal = np.maximum(program.lower - rows, rows - program.upper).max(initial=0.0)
    dual = np.abs(program.hessian @ x + program.cost + program.constraints.T @ y).max()
    outputs = step.reference.shape[1]
    return Answer(success, np.array(x[:outputs]), float(primal), float(dual), taken)
