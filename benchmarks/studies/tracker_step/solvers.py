"""The tracker and solvers of the nonlinear program, called with a recorded step and a clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from twosra_mpc import Plan
from twosra_mpc.execution.tracking import linearisation
from twosra_mpc.execution.tracking.linearisation import RATE_LIMITED_PERIODS, tracking_program
from twosra_mpc.execution.tracking.prediction import believed_start, motion, stage_model
from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.execution.tracking.solver import QuadraticProgram
from twosra_mpc.execution.tracking.tracker import CommandStatus, Measurement, Tracker
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.modes import rigid_mode

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recorded:
    """One step of a closed loop: what every solver is given.

    ``previous`` is the solution of the step before (zeros at the start of a run), ``wheels`` the
    last command, ``program`` the tracker's linearised program with its solution, where needed.
    """

    first: bool
    time_s: float
    q: Array
    reference: Array
    previous: Array
    wheels: Array
    program: QuadraticProgram | None


class Answer(NamedTuple):
    """What a solver found: first deviation e_1, residuals (NaN: not told)."""

    success: bool
    first: Array
    primal: float
    dual: float


class Clock:
    """Times what a control loop would do: on the wall, and on a core without other programs."""

    def __enter__(self) -> None:
        self._began = np.array([time.perf_counter(), time.thread_time()])

    def __exit__(self, *_: object) -> None:
        self.taken_s = np.array([time.perf_counter(), time.thread_time()]) - self._began


Solver = Callable[[Recorded, Clock], Answer]


def tracker(of: Plan, phase: int) -> Solver:
    """The tracker as a user calls it, making the measurement included; a run starts at rest."""
    tracks = Tracker(of.robot)
    tracks.reset(of)

    def solve(step: Recorded, clock: Clock) -> Answer:
        if step.first:
            tracks.step(Measurement(step.time_s, None, step.q))
        with clock:
            command = tracks.step(Measurement(step.time_s, phase, step.q))
        program = tracks.quadratic_program()
        assert program is not None
        success = command.status is CommandStatus.SOLVED and not command.message
        return qp_answer(success, program, program.x, program.y, step)

    return solve


def qp_answer(
    success: bool, program: QuadraticProgram, x: Array, y: Array, step: Recorded
) -> Answer:
    """What a solver of the linearised program found, with its residuals."""
    rows = program.constraints @ x
    primal = np.maximum(program.lower - rows, rows - program.upper).max(initial=0.0)
    dual = np.abs(program.hessian @ x + program.cost + program.constraints.T @ y).max()
    return Answer(success, np.array(x[: step.reference.shape[1]]), float(primal), float(dual))


def ipopt(setup: Setup, tolerance: float = 1e-6) -> Solver:
    """The nonlinear program in the deviations, by IPOPT from the last solution."""
    nlp, lower, upper = _deviations_program(setup)
    least = np.full(setup.variables, -np.inf)
    if setup.outputs.bending:
        least[-1] = 0.0
    options = {"ipopt": {"print_level": 0, "sb": "yes", "tol": tolerance}}
    solved = _nlp("ipopt", nlp, options, lbg=lower, ubg=upper, lbx=least)

    def solve(step: Recorded, clock: Clock) -> Answer:
        p = np.concatenate([step.q, step.reference.ravel(), step.wheels])
        answer = solved(step.previous, p, clock)
        return answer._replace(first=answer.first[: setup.outputs.count])

    return solve


def _nlp(
    solver: str, nlp: Mapping[str, ca.SX], options: dict[str, Any], **bounds: Array
) -> Callable[[Array, Array, Clock], Answer]:
    """(guess, parameters, clock) -> answer of one of CasADi's solvers, all of x in ``first``."""
    x, f, g, p = (nlp[name] for name in "xfgp")
    solve = ca.nlpsol("nlp", solver, dict(nlp), {"print_time": False, **options})
    on_g, on_x = ca.SX.sym("lg", g.numel()), ca.SX.sym("lx", x.numel())
    gradient = ca.gradient(f, x) + ca.jacobian(g, x).T @ on_g + on_x
    stationarity = ca.Function("stationarity", [x, p, on_g, on_x], [ca.norm_inf(gradient)])

    def solved(guess: Array, p: Array, clock: Clock) -> Answer:
        with clock:
            found = solve(x0=guess, p=p, **bounds)
        rows = found["g"].full().ravel()
        primal = np.maximum(bounds["lbg"] - rows, rows - bounds["ubg"]).max(initial=0.0)
        dual = float(stationarity(found["x"], p, found["lam_g"], found["lam_x"]))
        x = found["x"].full().ravel()
        return Answer(bool(solve.stats()["success"]), x, float(primal), dual)

    return solved


def _deviations_program(setup: Setup) -> tuple[dict[str, ca.SX], Array, Array]:
    """The tracker's program before linearising, and the bounds of its constraints."""
    stage, n, m = stage_model(setup), setup.horizon, setup.outputs.count
    wheel_rows = slice(-len(stage.wheels), None)
    q, wheels, x = ca.SX.sym("q", 5), ca.SX.sym("w", 4), ca.SX.sym("x", setup.variables)
    reference = ca.SX.sym("r", m, n + 1)
    start, deviation = believed_start(setup, q, reference[:, 0])
    e = [deviation, *ca.vertsplit(x[: m * n], m)]
    y = [reference[:, k] + e[k] * setup.scale for k in range(n + 1)]
    program, limits = tracking_program(setup), setup.body.limits
    hessian = program.hessian + sparse.triu(program.hessian, 1).T
    f = ca.bilin(ca.DM(hessian.toarray()), x, x) / 2 + ca.dot(ca.DM(program.cost), x)
    f -= setup.rho / (0.5 + setup.rho) * ca.dot(deviation, x[:m])
    rows = []  # what is limited, lower, upper
    before = wheels[list(stage.wheels)] / limits.wheel_speed_rad_s
    for k, period in enumerate(motion(setup, stage, start, y)):
        speeds = stage.speeds(period.half_way, period.step)[0]
        rows.append((speeds[list(stage.limits)], -1.0, 1.0))
        if k < RATE_LIMITED_PERIODS:
            change = setup.wheel_change / limits.wheel_speed_rad_s
            rows.append((speeds[wheel_rows] - before, -change, change))
            before = speeds[wheel_rows]
        if setup.outputs.bending:
            slack = x[-1] * setup.weights.curvature_per_m / linearisation.SLACK_UNIT
            rows.append((ca.fabs(period.kappa) - slack - limits.curvature_per_m, -np.inf, 0.0))
    lower, upper = (np.repeat([row[i] for row in rows], [row[0].numel() for row in rows])
                    for i in (1, 2))  # fmt: skip
    p, g = ca.vertcat(q, reference[:], wheels), ca.vertcat(*(row[0] for row in rows))
    return {"x": x, "f": f, "g": g, "p": p}, lower, upper


def _rigid_period(
    setup: Setup, k: int, y: Any, v: Any, drive: Sequence[Any], before: Sequence[Any], of: Any
) -> tuple[list[Any], list[Any], list[tuple[Any, float]]]:
    """Write down period ``k`` of a rigid motion in the algebra ``of`` CasADi or GEKKO.

    Returns the outputs after it, its wheel speeds, and what is limited, each with its limit.
    """
    h, middle = setup.period_s, y[2] + setup.period_s * v[2] / 2
    c, s = of.cos(middle), of.sin(middle)
    rate = [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]
    wheels = [sum(row[i] * v[i] for i in range(3)) for row in drive]
    limited = [(wheel, setup.body.limits.wheel_speed_rad_s) for wheel in wheels]
    if k < RATE_LIMITED_PERIODS:
        pairs = zip(wheels, before, strict=True)
        limited += [(now - last, setup.wheel_change) for now, last in pairs]
    return [y[i] + h * rate[i] for i in range(3)], wheels, limited


def _rigid_drive(setup: Setup, q: Array) -> Array:
    """Wheel speeds by [u0, v0, r0], (4, 3)."""
    rigid = rigid_mode(setup.coordinates.segments)
    return np.asarray(kinematics(setup.body).wheel_matrix(q, rigid).full()[:, 2:])


def fatrop(setup: Setup) -> Solver:
    """The rigid nonlinear program stage by stage, by fatrop; a state is y and the last speeds."""
    n, h = setup.horizon, setup.period_s
    y0, wheels, drive = ca.SX.sym("y0", 3), ca.SX.sym("w", 4), ca.SX.sym("V", 4, 3)
    reference, rows = ca.SX.sym("r", 3, n + 1), [ca.vec(row) for row in ca.vertsplit(drive)]
    s, v = (ca.horzsplit(ca.SX.sym(name, size, n + 1)) for name, size in (("s", 6), ("v", 3)))
    e = [(s[k][:3] - reference[:, k]) / setup.scale for k in range(n + 1)]
    f, g = setup.terminal / 2 * ca.sumsqr(e[n]), []
    for k in range(n):
        before = ca.vertsplit(wheels if k == 0 else drive @ s[k][3:])
        after, _, limited = _rigid_period(setup, k, s[k], v[k], rows, before, ca)
        reached = ca.vertcat(*after)
        g.append((s[k + 1] - ca.vertcat(reached, v[k]), 0.0))
        g += [(s[0] - ca.vertcat(y0, 0, 0, 0), 0.0)] if k == 0 else []
        g += limited
        change = (reached - reference[:, k + 1]) / setup.scale - e[k]
        f += setup.rho / 2 * ca.sumsqr(change) + (ca.sumsqr(e[k]) / 2 if k else 0)
    most = np.repeat([limit for _, limit in g], [row.numel() for row, _ in g])
    x = ca.vertcat(*(ca.vertcat(*pair) for pair in zip(s, v, strict=True)))[: 9 * n + 6]
    p = ca.vertcat(y0, reference[:], wheels, drive[:])
    nlp = {"x": x, "f": f / (0.5 + setup.rho), "g": ca.vertcat(*(row for row, _ in g)), "p": p}
    structure = {"structure_detection": "auto", "equality": (most == 0.0).tolist()}
    options = {"expand": True, "fatrop": {"print_level": 0, "tol": 1e-6}, **structure}
    solved = _nlp("fatrop", nlp, options, lbg=-most, ubg=most)

    def solve(step: Recorded, clock: Clock) -> Answer:
        given = (step.q[:3], step.reference, step.wheels, _rigid_drive(setup, step.q).T)
        last = step.previous.reshape(n, 3)
        y = step.reference + setup.scale * np.vstack([last[0], last])
        v = np.diff(y, axis=0) / h
        c, s = np.cos(y[:-1, 2] + v[:, 2] * h / 2), np.sin(y[:-1, 2] + v[:, 2] * h / 2)
        v[:, :2] = np.column_stack([c * v[:, 0] + s * v[:, 1], c * v[:, 1] - s * v[:, 0]])
        speeds = np.vstack([np.zeros(3), v, np.zeros(3)])
        guess = np.hstack([y, speeds[:-1], speeds[1:]]).ravel()[: 9 * n + 6]
        answer = solved(guess, np.concatenate([part.ravel() for part in given]), clock)
        return answer._replace(first=(answer.first[9:12] - step.reference[1]) / setup.scale)

    return solve


def gekko(setup: Setup) -> Solver:
    """The rigid nonlinear program in GEKKO, solved locally by its IPOPT."""
    from gekko import GEKKO

    n, m = setup.horizon, GEKKO(remote=False)
    shapes = ((3,), (n + 1, 3), (4,), (4, 3))
    parameters = [
        np.array([m.Param(0.0) for _ in range(int(np.prod(s)))]).reshape(s) for s in shapes
    ]
    start, reference, wheels, drive = parameters
    before = list(wheels)
    y = [start, *(np.array([m.Var(0.0) for _ in range(3)]) for _ in range(n))]
    e = [(y[k] - reference[k]) / setup.scale for k in range(n + 1)]
    cost = 0.0
    for k in range(n):
        v = [m.Var(0.0) for _ in range(3)]
        after, before, limited = _rigid_period(setup, k, y[k], v, list(drive), before, m)
        for value, reached in zip(y[k + 1], after, strict=True):
            m.Equation(value == reached)
        for value, most in limited:
            m.Equation(m.Var(0.0, lb=-most, ub=most) == value)
        weight = setup.terminal if k == n - 1 else 1.0
        cost += sum(weight / 2 * e[k + 1] ** 2 + setup.rho / 2 * (e[k + 1] - e[k]) ** 2)
    m.Minimize(cost / (0.5 + setup.rho))
    m.options.SOLVER = 3

    def solve(step: Recorded, clock: Clock) -> Answer:
        given = (step.q[:3], step.reference, step.wheels, _rigid_drive(setup, step.q))
        with clock:
            for array, values in zip(parameters, given, strict=True):
                for parameter, value in zip(array.flat, values.flat, strict=True):
                    parameter.value = float(value)
            try:
                m.solve(disp=False)
                success = m.options.APPSTATUS == 1
            except Exception:  # GEKKO raises a bare Exception when its solver fails
                success = False
        clock.taken_s[1] = np.nan  # another process works
        first = np.array([np.ravel(item.value)[0] for item in y[1]], dtype=float)
        return Answer(success, (first - step.reference[1]) / setup.scale, np.nan, np.nan)

    return solve
