"""The tracker's program before linearising, solved to the end by IPOPT."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from twosra_mpc.execution.tracking import linearisation
from twosra_mpc.execution.tracking.linearisation import (
    RATE_LIMITED_PERIODS,
    believed_start,
    motion,
    stage_model,
    tracking_program,
)
from twosra_mpc.execution.tracking.setup import Setup

Array = NDArray[np.float64]
_TOLERANCE = 1e-10


class Asked(NamedTuple):
    """What a step is given: where the robot is, what to follow, the last wheel speeds."""

    q: Array
    reference: Array
    wheels: Array


def converged(setup: Setup) -> Callable[[Asked], Array | None]:
    """What finds the first deviation e_1 of the nonlinear program, None where IPOPT fails."""
    nlp, lower, upper = _deviations_program(setup)
    least = np.full(setup.variables, -np.inf)
    if setup.outputs.bending:
        least[-1] = 0.0
    ipopt = {"print_level": 0, "sb": "yes", "tol": _TOLERANCE}
    solve = ca.nlpsol("nlp", "ipopt", nlp, {"print_time": False, "ipopt": ipopt})

    def first(asked: Asked) -> Array | None:
        p = np.concatenate([asked.q, asked.reference.ravel(), asked.wheels])
        found = solve(x0=0.0, p=p, lbg=lower, ubg=upper, lbx=least)
        x: Array = found["x"].full().ravel()
        return x[: setup.outputs.count] if solve.stats()["success"] else None

    return first


def _deviations_program(setup: Setup) -> tuple[dict[str, ca.SX], Array, Array]:
    """The program in the deviations, and the bounds of its constraints."""
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
