"""Flow of the kinematics over one interval of constant input, by classical Runge-Kutta steps.

The kinematics is driftless, so an interval is described by its input displacement s = v h alone
([s1, s2, su, sv, sr] in m, m, m, m, rad): q+ depends on s, not on how fast it is travelled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.coordinates import INPUTS, POSE
from twosra_mpc.robot.description import Body

Array = NDArray[np.float64]


def runge_kutta(rate: Callable[[ca.SX], ca.SX], start: ca.SX) -> ca.SX:
    """State after a classical Runge-Kutta 4 step of length 1."""
    k1 = rate(start)
    k2 = rate(start + k1 / 2)
    k3 = rate(start + k2 / 2)
    k4 = rate(start + k3)
    return start + (k1 + 2 * k2 + 2 * k3 + k4) / 6


@per_body(64)
def interval_flow(body: Body, steps: int) -> ca.Function:
    """(q, s, sigma) -> q at the end of the interval, with ``steps`` Runge-Kutta 4 steps."""
    jacobian = kinematics(body).jacobian
    q, s, sigma = _arguments(ca.SX, body)

    after = runge_kutta(lambda at: jacobian(at, sigma) @ s / steps, q)
    step = ca.Function("step", [q, s, sigma], [after])
    if steps == 1:
        return step
    sym_q, sym_s, sym_sigma = _arguments(ca.MX, body)
    chain = step.fold(steps)
    end = chain(sym_q, ca.repmat(sym_s, 1, steps), ca.repmat(sym_sigma, 1, steps))
    return ca.Function("interval_flow", [sym_q, sym_s, sym_sigma], [end])


def _arguments(symbol: Any, body: Body) -> tuple[Any, Any, Any]:
    """Symbols of a kind: q (3 + n,), s (5,), sigma (n,)."""
    segments = body.geometry.segments
    return symbol.sym("q", POSE + segments), symbol.sym("s", INPUTS), symbol.sym("sigma", segments)


@per_body(64)
def interval_chain(body: Body, intervals: int, steps: int) -> ca.Function:
    """``interval_flow`` of intervals one after the other, all nodes returned."""
    return interval_flow(body, steps).mapaccum(intervals)


@per_body(64)
def bending_chain(body: Body, intervals: int, steps: int) -> ca.Function:
    """``bending_flow`` of intervals one after the other, all nodes returned."""
    return bending_flow(body, steps).mapaccum(intervals)


@per_body(64)
def bending_flow(body: Body, steps: int) -> ca.Function:
    """(q, dW, sigma) -> (q, travel) after bending W of the soft segments by dW.

    Both locomotion units travel equally far [m], the fastest way to bend; ``steps`` Runge-Kutta 4
    steps in W itself, so that no travel has to be searched for.
    """
    jacobian, path, lengths = kinematics(body).jacobian, path_model(body), body.geometry.lengths_m
    q, _, sigma = _arguments(ca.SX, body)
    bend, stiffness, size = ca.SX.sym("dW"), ca.vertsplit(sigma), q.numel()
    travelled = ca.vertcat(q, ca.SX.sym("travelled"))

    def rate(at: ca.SX) -> ca.SX:
        matrix = jacobian(at[:size], sigma)
        first, second = path.bends(at[POSE:size] * ca.DM(lengths), stiffness)
        moved = ca.vertcat(matrix[:, 0] + matrix[:, 1], 1)
        return moved / (first.pace + second.pace) * bend / steps

    step = ca.Function("step", [travelled, bend, sigma], [runge_kutta(rate, travelled)])
    sym_q, _, sym_sigma = _arguments(ca.MX, body)
    sym_bend = ca.MX.sym("dW")
    chain = step.fold(steps) if steps > 1 else step
    repeated = ca.repmat(sym_bend, 1, steps), ca.repmat(sym_sigma, 1, steps)
    end = chain(ca.vertcat(sym_q, 0), *repeated)
    return ca.Function("bending_flow", [sym_q, sym_bend, sym_sigma], [end[:size], end[size]])


def drive(q: Array, s: Array) -> Array:
    """Where rigid input displacements lead: screw motions, q (3 + n,), s (m, 3) -> (m, 3 + n)."""
    reached = np.tile(q, (len(s), 1)).astype(float)
    x, y, phi = q[:POSE].tolist()
    for i, (along, across, turn) in enumerate(s.tolist()):
        half = turn / 2
        chord = math.sin(half) / half if half else 1.0
        c, sine = chord * math.cos(phi + half), chord * math.sin(phi + half)
        x, y = x + c * along - sine * across, y + sine * along + c * across
        phi += turn
        reached[i, :POSE] = x, y, phi
    return reached
