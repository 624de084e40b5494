"""Flow of the kinematics over one interval of constant input, by classical Runge-Kutta steps.

The kinematics is driftless, so an interval is described by its input displacement s = v h alone
([s1, s2, su, sv, sr] in m, m, m, m, rad): q+ depends on s, not on how fast it is travelled.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot import Robot


@lru_cache(maxsize=64)
def interval_flow(robot: Robot, steps: int) -> ca.Function:
    """(q, s, sigma) -> q at the end of the interval, with ``steps`` Runge-Kutta 4 steps."""
    jacobian = kinematics(robot).jacobian
    q, s, sigma = ca.SX.sym("q", 5), ca.SX.sym("s", 5), ca.SX.sym("sigma", 2)

    def rate(at: ca.SX) -> ca.SX:
        return jacobian(at, sigma) @ s / steps

    k1 = rate(q)
    k2 = rate(q + k1 / 2)
    k3 = rate(q + k2 / 2)
    k4 = rate(q + k3)
    step = ca.Function("step", [q, s, sigma], [q + (k1 + 2 * k2 + 2 * k3 + k4) / 6])
    if steps == 1:
        return step
    sym_q, sym_s, sym_sigma = ca.MX.sym("q", 5), ca.MX.sym("s", 5), ca.MX.sym("sigma", 2)
    chain = step.fold(steps)
    end = chain(sym_q, ca.repmat(sym_s, 1, steps), ca.repmat(sym_sigma, 1, steps))
    return ca.Function("interval_flow", [sym_q, sym_s, sym_sigma], [end])
