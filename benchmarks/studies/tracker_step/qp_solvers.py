"""Other solvers of the tracker's linearised program, each through its Python interface.

All have the tolerance of the tracker's own solver. Every step hands them a new cost, matrix and
bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import osqp
from scipy import sparse

from benchmarks.studies.tracker_step.solvers import Answer, Clock, Recorded, Solver, qp_answer
from twosra_mpc.execution.tracking.linearisation import tracking_program
from twosra_mpc.execution.tracking.setup import Setup, SolverSettings
from twosra_mpc.execution.tracking.solver import QuadraticProgram

TOLERANCE = SolverSettings().tolerance


def plain_osqp(setup: Setup) -> Solver:
    """OSQP through its Python class, defaults but the tolerance."""
    solver, linearised = osqp.OSQP(), _linearised(setup)
    begun: list[bool] = []

    def solve(step: Recorded, clock: Clock) -> Answer:
        with clock:
            program = linearised(step)
            matrix, bounds = program.constraints, {"l": program.lower, "u": program.upper}
            if begun:
                solver.update(q=program.cost, Ax=matrix.data, **bounds)
            else:
                hessian = sparse.csc_matrix(sparse.triu(program.hessian))
                settings = {"eps_abs": TOLERANCE, "eps_rel": 0.0, "verbose": False}
                solver.setup(hessian, program.cost, matrix, **bounds, **settings)
                begun.append(True)
            found = solver.solve(raise_error=False)
        return qp_answer(found.info.status == "solved", program, found.x, found.y, step)

    return solve


def piqp(setup: Setup) -> Solver:
    """PIQP (interior point), sparse interface."""
    import piqp

    solver, linearised = piqp.SparseSolver(), _linearised(setup)
    solver.settings.eps_abs, solver.settings.eps_rel = TOLERANCE, 0.0
    change = [solver.update, solver.setup]

    def solve(step: Recorded, clock: Clock) -> Answer:
        with clock:
            program = linearised(step)
            bounds = {"G": program.constraints, "h_l": program.lower, "h_u": program.upper}
            change[-1](P=program.hessian, c=program.cost, **bounds)
            status, found = solver.solve(), solver.result
        del change[1:]
        multipliers = found.z_u - found.z_l
        return qp_answer(status == piqp.PIQP_SOLVED, program, found.x, multipliers, step)

    return solve


def daqp(setup: Setup) -> Solver:
    """DAQP (dual active set), dense, from its last active set."""
    import daqp

    solver, linearised = daqp.Model(), _linearised(setup)
    begun: list[bool] = []

    def solve(step: Recorded, clock: Clock) -> Answer:
        with clock:
            program = linearised(step)
            rows = program.constraints.toarray(), program.upper, program.lower
            if begun:
                solver.update(None, program.cost, *rows)
            else:
                solver.setup(program.hessian.toarray(), program.cost, *rows)
                solver.settings = {"primal_tol": TOLERANCE, "dual_tol": TOLERANCE}
                begun.append(True)
            x, _, flag, info = solver.solve()
        return qp_answer(flag == 1, program, x, info["lam"], step)

    return solve


def proxqp(setup: Setup) -> Solver:
    """ProxQP (proximal augmented Lagrangian), dense, from its own guess.

    From its last solution it fails on one step in ten, and its sparse solver is less exact.
    """
    from proxsuite import proxqp

    linearised, rows = _linearised(setup), tracking_program(setup).constraints.shape[0]
    solver = proxqp.dense.QP(setup.variables, 0, rows)
    solver.settings.eps_abs, solver.settings.eps_rel = TOLERANCE, 0.0
    begun: list[bool] = []

    def solve(step: Recorded, clock: Clock) -> Answer:
        with clock:
            program = linearised(step)
            matrix = program.constraints.toarray()
            given = {"g": program.cost, "C": matrix, "l": program.lower, "u": program.upper}
            if begun:
                solver.update(**given)
            else:
                solver.init(H=program.hessian.toarray(), **given)
                begun.append(True)
            solver.solve()
        found = solver.results
        success = found.info.status == proxqp.QPSolverOutput.PROXQP_SOLVED
        return qp_answer(success, program, found.x, found.z, step)

    return solve


def _linearised(setup: Setup) -> Callable[[Recorded], QuadraticProgram]:
    """Step -> the tracker's program, linearised by an ordinary CasADi call."""
    program = tracking_program(setup)

    def linearise(step: Recorded) -> QuadraticProgram:
        assert step.program is not None
        arguments = (step.q, step.reference.T, step.previous, step.wheels)
        values, lower, upper, changing = (
            part.full().ravel() for part in program.linearise(*arguments)[:4]
        )
        cost, pattern = program.cost.copy(), program.constraints
        cost[: len(changing)] = changing
        matrix = sparse.csc_matrix((values, pattern.indices, pattern.indptr), shape=pattern.shape)
        return replace(step.program, cost=cost, constraints=matrix, lower=lower, upper=upper)

    return linearise
