"""Quadratic program of a mode in OSQP: set up once, then only numbers change."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import osqp  # type: ignore[import-untyped]  # it has no stubs
from scipy import sparse

from twosra_mpc.execution.tracking.linearisation import TrackingProgram, tracking_program
from twosra_mpc.execution.tracking.setup import Setup, SolverSettings
from twosra_mpc.model.kinematics import InPlace
from twosra_mpc.robot.coordinates import INPUTS, POSE, WHEELS, Array

USABLE = 0.03  # residuals up to which a point that did not converge is still worth sending
STEP_SIZE = 2.0  # rho of ADMM; rows and cost are scaled so that one suits every robot and weight
SOLVED = "solved"  # OSQP's word for it
CHECK_EVERY = 5  # iterations between tests for convergence
NEAR = 0.02  # units of the weights; limits linearised this near err by a few 1e-5 at most
MOST_PROGRAMS = 3  # of one step: from the largest deviations, the third is linearised near enough


class Quality(enum.Enum):
    """Quality of a solution of a program."""

    CONVERGED = enum.auto()
    ROUGH = enum.auto()  # iterations ran out with residuals small enough to use the point
    UNUSABLE = enum.auto()


class Residuals(NamedTuple):
    """Residuals of a point in a quadratic program, in its scaled units; infinity norms.

    Attributes:
        primal: Largest violation of a bound.
        dual: Largest entry of P x + q + A' y.
    """

    primal: float
    dual: float


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """min x'Px/2 + q'x, lower <= Ax <= upper, with the point OSQP found.

    Attributes:
        hessian: P, symmetric, (n, n).
        cost: q, (n,).
        constraints: A, (rows, n).
        lower: Lower bounds, (rows,).
        upper: Upper bounds, (rows,).
        x: Primal solution, (n,).
        y: Multipliers, positive at upper bounds, (rows,).
        iterations: ADMM iterations of the whole step, of programs linearised elsewhere, too.
    """

    hessian: sparse.csc_matrix
    cost: Array
    constraints: sparse.csc_matrix
    lower: Array
    upper: Array
    x: Array
    y: Array
    iterations: int

    def residuals(self) -> Residuals:
        """Primal and dual residual of (x, y), computed from the program itself."""
        rows = self.constraints @ self.x
        primal = np.maximum(self.lower - rows, rows - self.upper).max(initial=0.0)
        dual = np.abs(self.hessian @ self.x + self.cost + self.constraints.T @ self.y).max()
        return Residuals(float(primal), float(dual))


class ProgramInPlace:
    """A tracking program for a loop: fill what it reads, ``solve()``.

    CasADi writes the numbers of the program where OSQP reads them. A solution stays as the next
    one's linearisation point and start, until ``forget()``.

    Attributes:
        measured: Measured configuration, (3 + n,).
        reference: Outputs of the plan now and at the following samples, (N + 1, m).
        wheels: Last wheel command, (4,) [rad/s].
        facets: Of the cone that keeps what is pushed, (f, 3): see `contact.grip`.
        v: Input found, [v1, v2, u0, v0, r0], (5,).
        command: Wheel speeds found, (4,) [rad/s].
        iterations: ADMM iterations of the last step; 0 before the first.
    """

    def __init__(self, program: TrackingProgram, settings: SolverSettings) -> None:
        setup = program.setup
        self.program, self._settings = program, settings
        self.measured = np.zeros(setup.coordinates.size)
        self.reference = np.zeros((setup.horizon + 1, setup.outputs.count))
        self.facets = np.zeros((setup.facets, POSE))
        self.v, self.wheels, self.command = np.zeros(INPUTS), np.zeros(WHEELS), np.zeros(WHEELS)
        self._cost = program.cost.copy()
        self._x = np.zeros(len(self._cost))
        self._expected = np.zeros(setup.outputs.count + len(self._cost))
        self._guess = self._expected[setup.outputs.count :]
        self._y = np.zeros(program.constraints.shape[0])
        self._values = np.zeros(program.constraints.nnz)
        self._lower, self._upper = np.zeros_like(self._y), np.zeros_like(self._y)
        self.iterations = 0
        arguments = [self.measured, self.reference, self._x, self.wheels]
        changing = self._cost[: setup.outputs.count]
        numbers = [self._values, self._lower, self._upper, changing, self._expected]
        self._linearise = InPlace(program.linearise, [*arguments, self.facets], numbers)
        self._first_command = InPlace(program.command, arguments, [self.v, self.command])
        self.forget()
        self._linearise.evaluate()
        self._solver = self._set_up(settings)

    def _set_up(self, settings: SolverSettings) -> Any:
        """OSQP's compiled solver; the Python class around it would take 20 us more per step."""
        workspace = osqp.OSQP()
        workspace.setup(
            self.program.hessian,
            self._cost,
            self._constraints(),
            self._lower,
            self._upper,
            eps_abs=settings.tolerance,
            eps_rel=0.0,
            eps_prim_inf=1e-12,  # the program always has a solution
            eps_dual_inf=1e-12,
            max_iter=settings.max_iterations,
            check_termination=CHECK_EVERY,
            check_dualgap=False,
            rho=STEP_SIZE,
            adaptive_rho=0,
            scaling=0,
            polishing=False,
            verbose=False,
        )
        return workspace._solver

    def forget(self) -> None:
        """Start afresh: the next linearisation is about the response without limits."""
        self._x[:] = 0.0
        self._y[:] = 0.0
        if self.program.setup.outputs.bending:
            self._y[-1] = -self._cost[-1]  # the multiplier of a slack that is zero

    def __reduce__(self) -> tuple[object, ...]:
        """State without what is compiled: its setup, and the solution to go on from."""
        return ProgramInPlace._resumed, (self.program.setup, self._settings, self._x, self._y)

    @classmethod
    def _resumed(cls, setup: Setup, settings: SolverSettings, x: Array, y: Array) -> ProgramInPlace:
        made = cls(tracking_program(setup), settings)
        made._x[:], made._y[:] = x, y
        return made

    def solve(self) -> Quality:
        """Linearise, solve, and find ``v`` and ``command``; these mean nothing if unusable.

        A solution far from where its limits were linearised, as after a push, is the next point.
        """
        self.iterations = 0
        quality = self._solve_linearised()
        outputs = slice(self.program.setup.outputs.count * self.program.setup.horizon)
        for _ in range(MOST_PROGRAMS - 1):
            departure = np.abs(self._x[outputs] - self._guess[outputs]).max()
            if quality is not Quality.CONVERGED or departure <= NEAR:
                break
            self._stay()
            quality = self._solve_linearised()
        if not math.isfinite(sum(self.v.tolist())):
            self.forget()
            return Quality.UNUSABLE
        if quality is Quality.UNUSABLE:
            self._stay()
        else:
            self._solver.solution.y.take(self.program.next_rows, out=self._y)
        return quality

    def _solve_linearised(self) -> Quality:
        solver = self._solver
        self._linearise.evaluate()
        solver.update_data_vec(q=self._cost, l=self._lower, u=self._upper)
        solver.update_data_mat(P_x=None, P_i=None, A_x=self._values, A_i=None)
        solver.warm_start(self._guess, self._y)
        solver.solve()
        info = solver.info
        self.iterations += int(info.iter)
        self._x[:] = solver.solution.x
        self._first_command.evaluate()
        if info.status == SOLVED:
            return Quality.CONVERGED
        usable = max(info.prim_res, info.dual_res) <= USABLE
        return Quality.ROUGH if usable else Quality.UNUSABLE

    def _stay(self) -> None:
        """Let the next program iterate on from here: the robot will not have moved."""
        setup, found = self.program.setup, self._solver.solution
        m, last = setup.outputs.count, setup.outputs.count * setup.horizon
        self._x[:m] = self._expected[:m]
        self._x[m:last] = found.x[: last - m]
        self._y[:] = found.y

    def describe(self) -> str:
        """Words of OSQP about the last solve."""
        info = self._solver.info
        return (
            f"{info.status} after {info.iter} iterations, "
            f"residuals {info.prim_res:z.2g} and {info.dual_res:z.2g}"
        )

    def quadratic_program(self) -> QuadraticProgram:
        """The program of the last step and OSQP's point, as a value of its own."""
        upper = sparse.triu(self.program.hessian, 1)
        return QuadraticProgram(
            hessian=sparse.csc_matrix(self.program.hessian + upper.T),
            cost=self._cost.copy(),
            constraints=self._constraints(),
            lower=self._lower.copy(),
            upper=self._upper.copy(),
            x=np.array(self._solver.solution.x),
            y=np.array(self._solver.solution.y),
            iterations=self.iterations,
        )

    def _constraints(self) -> sparse.csc_matrix:
        pattern = self.program.constraints
        values = (self._values.copy(), pattern.indices, pattern.indptr)
        return sparse.csc_matrix(values, shape=pattern.shape)
