"""The tracker's program before linearising, for nonlinear programming solvers."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from benchmarks.tracker_solvers import Answer, Recorded, Taken
from twosra_mpc.execution.tracking.linearisation import (
    RATE_LIMITED_PERIODS,
    SLACK_UNIT,
    tracking_program,
)
from twosra_mpc.execution.tracking.prediction import believed_start, motion
from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.execution.tracking.stage import stage_model
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.modes import RIGID

Array = NDArray[np.float64]


class Ipopt:
    """The nonlinear program in the deviations, by IPOPT from the last solution."""

    solves = "NLP"

    def __init__(self, setup: Setup, tolerance: float = 1e-6, name: str = "IPOPT") -> None:
        self.name, self._setup = name, setup
        x, f, g, p, self._lower, self._upper = deviations_program(setup)
        options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": tolerance}}
        self._solver = ca.nlpsol("nlp", "ipopt", {"x": x, "f": f, "g": g, "p": p}, options)
        self._stationarity = _stationarity(x, f, g, p)
        self._least = np.full(setup.variables, -np.inf)
        if setup.outputs.bending:
            self._least[-1] = 0.0

    def solve(self, step: Recorded) -> Answer:
        """Solve one step."""
        p = np.concatenate([step.q, step.reference.ravel(), step.wheels])
        started = Taken.now()
        found = self._solver(
            x0=step.previous, p=p, lbg=self._lower, ubg=self._upper, lbx=self._least
        )
        taken = started.until_now()
        success = bool(self._solver.stats()["success"])
        primal, dual = _kkt(found, p, self._lower, self._upper, self._stationarity)
        first = found["x"].full().ravel()[: self._setup.outputs.count]
        return Answer(success, first, primal, dual, taken)


def deviations_program(setup: Setup) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, Array, Array]:
    """(x, cost, constraints, parameters, bounds): the tracker's program before linearising."""
    stage, n, m = stage_model(setup), setup.horizon, setup.outputs.count
    q, wheels, x = ca.SX.sym("q", 5), ca.SX.sym("w", 4), ca.SX.sym("x", setup.variables)
    reference = ca.SX.sym("r", m, n + 1)
    start = believed_start(setup, q, reference[:, 0])
    e = [start.deviation, *ca.vertsplit(x[: m * n], m)]
    y = [reference[:, k] + e[k] * setup.scale for k in range(n + 1)]
    program, limits = tracking_program(setup), setup.robot.limits
    hessian = sparse.triu(program.hessian, 1)
    full = ca.DM((program.hessian + hessian.T).toarray())
    norm = 0.5 + setup.rho
    f = ca.bilin(full, x, x) / 2 + ca.dot(ca.DM(program.cost), x)
    f -= setup.rho / norm * ca.dot(start.deviation, x[:m])
    change = setup.wheel_change / limits.wheel_speed_rad_s
    g, most, before = [], [], wheels[list(stage.wheels)] / limits.wheel_speed_rad_s
    for k, period in enumerate(motion(setup, stage, start, y)):
        speeds = stage.speeds(period.half_way, period.step)[0]
        g.append(speeds[list(stage.limits)])
        most += [1.0] * len(stage.limits)
        if k < RATE_LIMITED_PERIODS:
            g.append(speeds[stage.wheel_rows] - before)
            most += [change] * len(stage.wheels)
            before = speeds[stage.wheel_rows]
        if setup.outputs.bending:
            excess = x[-1] * setup.weights.curvature_per_m / SLACK_UNIT
            g += [ca.fabs(period.kappa) - excess - limits.curvature_per_m]
            most += [0.0] * len(setup.outputs.bending)
    upper = np.array(most)
    lower = np.where(upper > 0, -upper, -np.inf)
    p = ca.vertcat(q, reference[:], wheels)
    return x, f, ca.vertcat(*g), p, lower, upper


def _stationarity(x: ca.SX, f: ca.SX, g: ca.SX, p: ca.SX) -> ca.Function:
    on_g, on_x = ca.SX.sym("lg", g.numel()), ca.SX.sym("lx", x.numel())
    gradient = ca.gradient(f, x) + ca.jacobian(g, x).T @ on_g + on_x
    return ca.Function("stationarity", [x, p, on_g, on_x], [ca.norm_inf(gradient)])


def _kkt(
    found: dict[str, ca.DM], p: Array, lower: Array, upper: Array, stationarity: ca.Function
) -> tuple[float, float]:
    g = found["g"].full().ravel()
    primal = np.maximum(lower - g, g - upper).max(initial=0.0)
    return float(primal), float(stationarity(found["x"], p, found["lam_g"], found["lam_x"]))


class Fatrop:
    """The rigid nonlinear program stage by stage, by fatrop."""

    name, solves = "fatrop", "NLP"

    def __init__(self, setup: Setup) -> None:
        self._setup, n = setup, setup.horizon
        limits, change = setup.robot.limits, setup.wheel_change
        y0, wheels, drive = ca.SX.sym("y0", 3), ca.SX.sym("w", 4), ca.SX.sym("V", 4, 3)
        reference = ca.SX.sym("r", 3, n + 1)
        s, v = [ca.SX.sym(f"s{k}", 6) for k in range(n + 1)], []
        f, x, g, equal, upper = ca.SX(0), [s[0]], [], [], []
        deviation = [(s[k][:3] - reference[:, k]) / setup.scale for k in range(n + 1)]
        for k in range(n):
            v.append(ca.SX.sym(f"v{k}", 3))
            x += [v[k], s[k + 1]]
            middle = s[k][2] + setup.period_s * v[k][2] / 2
            c, sn = ca.cos(middle), ca.sin(middle)
            rate = ca.vertcat(c * v[k][0] - sn * v[k][1], sn * v[k][0] + c * v[k][1], v[k][2])
            after = ca.vertcat(s[k][:3] + setup.period_s * rate, v[k])
            rows = [(s[k + 1] - after, 0.0)]
            if k == 0:
                rows.append((s[0] - ca.vertcat(y0, 0, 0, 0), 0.0))
            rows.append((drive @ v[k], limits.wheel_speed_rad_s))
            if k < RATE_LIMITED_PERIODS:
                before = wheels if k == 0 else drive @ s[k][3:]
                rows.append((drive @ v[k] - before, change))
            for row, most in rows:
                g.append(row)
                equal += [most == 0] * row.numel()
                upper += [most] * row.numel()
            next_deviation = (after[:3] - reference[:, k + 1]) / setup.scale
            f += setup.rho / 2 * ca.sumsqr(next_deviation - deviation[k])
            f += ca.sumsqr(deviation[k]) / 2 if k else 0
        f += setup.terminal / 2 * ca.sumsqr(deviation[n])
        f /= 0.5 + setup.rho
        self._upper = np.array(upper)
        self._lower = -self._upper
        self._x, self._g = ca.vertcat(*x), ca.vertcat(*g)
        p = ca.vertcat(y0, reference[:], wheels, drive[:])
        options = {
            "print_time": False,
            "structure_detection": "auto",
            "equality": equal,
            "expand": True,
            "fatrop": {"print_level": 0, "tol": 1e-6},
        }
        nlp = {"x": self._x, "f": f, "g": self._g, "p": p}
        self._solver = ca.nlpsol("nlp", "fatrop", nlp, options)
        self._stationarity = _stationarity(self._x, f, self._g, p)
        self._rigid = kinematics(setup.robot).wheel_matrix

    def solve(self, step: Recorded) -> Answer:
        """Solve one step."""
        setup, n = self._setup, self._setup.horizon
        drive = self._rigid(step.q, RIGID).full()[:, 2:]
        p = np.concatenate([step.q[:3], step.reference.ravel(), step.wheels, drive.T.ravel()])
        y = step.reference + setup.scale * np.vstack(
            [step.previous[:3], step.previous.reshape(n, 3)]
        )
        v = np.diff(y, axis=0) / setup.period_s
        c, sn = np.cos(y[:-1, 2] + v[:, 2] / 30), np.sin(y[:-1, 2] + v[:, 2] / 30)
        v[:, :2] = np.column_stack([c * v[:, 0] + sn * v[:, 1], c * v[:, 1] - sn * v[:, 0]])
        before = np.vstack([np.zeros(3), v])
        stages = [np.concatenate([y[k], before[k], v[k]]) for k in range(n)]
        guess = np.concatenate([*stages, y[n], before[n]])
        started = Taken.now()
        found = self._solver(x0=guess, p=p, lbg=self._lower, ubg=self._upper)
        taken = started.until_now()
        success = bool(self._solver.stats()["success"])
        primal, dual = _kkt(found, p, self._lower, self._upper, self._stationarity)
        first = (found["x"].full().ravel()[9:12] - step.reference[1]) / setup.scale
        return Answer(success, first, primal, dual, taken)


class Gekko:
    """The rigid nonlinear program in GEKKO, solved locally by its IPOPT."""

    name, solves = "GEKKO, local", "NLP"

    def __init__(self, setup: Setup) -> None:
        from gekko import GEKKO

        self._setup, n = setup, setup.horizon
        m = self._model = GEKKO(remote=False)
        self._start, self._wheels = [m.Param(0.0) for _ in range(3)], [m.Param(0.0) for _ in "1234"]
        self._drive = [[m.Param(0.0) for _ in range(3)] for _ in range(4)]
        self._reference = [[m.Param(0.0) for _ in range(3)] for _ in range(n + 1)]
        self._y = [[m.Var(0.0) for _ in range(3)] for _ in range(n)]
        v = [[m.Var(0.0) for _ in range(3)] for _ in range(n)]
        y = [self._start, *self._y]
        deviation = [
            [(y[k][i] - self._reference[k][i]) / setup.scale[i] for i in range(3)]
            for k in range(n + 1)
        ]
        most, h, cost = setup.robot.limits.wheel_speed_rad_s, setup.period_s, 0
        before = self._wheels
        for k in range(n):
            middle = y[k][2] + h * v[k][2] / 2
            c, s = m.cos(middle), m.sin(middle)
            m.Equation(y[k + 1][0] == y[k][0] + h * (c * v[k][0] - s * v[k][1]))
            m.Equation(y[k + 1][1] == y[k][1] + h * (s * v[k][0] + c * v[k][1]))
            m.Equation(y[k + 1][2] == y[k][2] + h * v[k][2])
            wheels = [m.Var(0.0, lb=-most, ub=most) for _ in range(4)]
            for j in range(4):
                m.Equation(wheels[j] == sum(self._drive[j][i] * v[k][i] for i in range(3)))
                if k < RATE_LIMITED_PERIODS:
                    m.Equation(wheels[j] - before[j] <= setup.wheel_change)
                    m.Equation(before[j] - wheels[j] <= setup.wheel_change)
            before = wheels
            weight = setup.terminal if k == n - 1 else 1.0
            for i in range(3):
                cost += weight / 2 * deviation[k + 1][i] ** 2
                cost += setup.rho / 2 * (deviation[k + 1][i] - deviation[k][i]) ** 2
        m.Minimize(cost / (0.5 + setup.rho))
        m.options.SOLVER = 3
        self._rigid = kinematics(setup.robot).wheel_matrix

    def solve(self, step: Recorded) -> Answer:
        """Solve one step."""
        started = Taken.now()
        self._fill(step)
        try:
            self._model.solve(disp=False)
            success = self._model.options.APPSTATUS == 1
        except Exception:  # GEKKO raises a bare Exception when its solver fails
            success = False
        taken = started.until_now()
        first = np.array([float(item.value[0]) for item in self._y[0]])
        return Answer(
            success, (first - step.reference[1]) / self._setup.scale, np.nan, np.nan, taken
        )

    def _fill(self, step: Recorded) -> None:
        drive = self._rigid(step.q, RIGID).full()[:, 2:]
        pairs = [(self._start, step.q), (self._wheels, step.wheels)]
        pairs += zip(self._drive, drive, strict=True)
        pairs += zip(self._reference, step.reference, strict=True)
        for parameters, values in pairs:
            for parameter, value in zip(parameters, values, strict=False):
                parameter.value = float(value)
