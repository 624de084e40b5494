"""Flow of the kinematics over one interval of constant input, by classical Runge-Kutta steps.

The kinematics is driftless, so an interval is described by its input displacement s = v h alone
([s1, s2, su, sv, sr] in m, m, m, m, rad): q+ depends on s, not on how fast it is travelled.
"""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.description import Robot

Array = NDArray[np.float64]


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


@lru_cache(maxsize=64)
def bending_flow(robot: Robot, steps: int) -> ca.Function:
    """(q, dW, sigma) -> (q, travel) after bending W of the first soft segment by dW.

    Both locomotion units travel equally far [m], the fastest way to bend; ``steps`` Runge-Kutta 4
    steps in W itself, so that no travel has to be searched for.
    """
    jacobian, path = kinematics(robot).jacobian, path_model(robot)
    q, bend, sigma = ca.SX.sym("q", 5), ca.SX.sym("dW"), ca.SX.sym("sigma", 2)
    length = robot.geometry.lengths_m[0]

    def rate(at: ca.SX) -> ca.SX:
        moved = jacobian(at, sigma)[:, 0] + jacobian(at, sigma)[:, 1]
        first = length / path.share(at[3] * length) * moved[3]
        second = length / path.share(at[4] * length) * moved[4]
        per_travel = ca.if_else(sigma[0], first, second)
        return ca.vertcat(moved, 1) / per_travel * bend / steps

    k1 = rate(q)
    k2 = rate(q + k1[:5] / 2)
    k3 = rate(q + k2[:5] / 2)
    k4 = rate(q + k3[:5])
    change = (k1 + 2 * k2 + 2 * k3 + k4) / 6
    travelled = ca.SX.sym("travelled")
    after = ca.vertcat(q, travelled) + change
    step = ca.Function("step", [ca.vertcat(q, travelled), bend, sigma], [after])
    sym_q, sym_bend, sym_sigma = ca.MX.sym("q", 5), ca.MX.sym("dW"), ca.MX.sym("sigma", 2)
    chain = step.fold(steps) if steps > 1 else step
    repeated = ca.repmat(sym_bend, 1, steps), ca.repmat(sym_sigma, 1, steps)
    end = chain(ca.vertcat(sym_q, 0), *repeated)
    return ca.Function("bending_flow", [sym_q, sym_bend, sym_sigma], [end[:5], end[5]])


def drive(q: Array, s: Array) -> Array:
    """Where rigid input displacements lead: exact screw motions, q (5,) and s (n, 3) -> (n, 5)."""
    reached = np.empty((len(s), 5))
    x, y, phi, kappa_1, kappa_2 = q.tolist()
    for i, (along, across, turn) in enumerate(s.tolist()):
        half = turn / 2
        chord = math.sin(half) / half if half else 1.0
        c, sine = chord * math.cos(phi + half), chord * math.sin(phi + half)
        x, y = x + c * along - sine * across, y + sine * along + c * across
        phi += turn
        reached[i] = x, y, phi, kappa_1, kappa_2
    return reached
