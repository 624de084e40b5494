r"""Motion seen from the outputs, symbolically: one sampling period, and the whole horizon.

By the midpoint rule, the motion that takes the outputs from y_k to y_{k+1} in one period h is

.. math:: z_k = (T N(\bar q_k))^{-1} (y_{k+1} - y_k) / h,

with the configuration half way. Speeds g = (v / v_max in soft modes, omega / omega_max), each
divided by its limit, follow from it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.model.kinematics import driven
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array

CURVATURE_MARGIN = 1.01  # curvatures beyond the limit are taken as so many times the limit


class Stage(NamedTuple):
    """Compiled model of one period in one mode; m outputs, q half way, d = y_{k+1} - y_k.

    Attributes:
        motion: (q, d) -> (inputs v (5,) [m/s, rad/s], four wheel speeds [rad/s]).
        speeds: (q, d) -> (g, dg/dd, dg/dy, bending): speeds, and their derivatives by the step and
            by the outputs half way, (rows, m).
        bending: q -> derivative of the moving curvatures by the outputs, (bending, m).
        limits: Rows of g to keep within one; those left out are then within one by themselves.
        wheels: Wheels that turn in this mode; they are the last rows of g.
    """

    motion: ca.Function
    speeds: ca.Function
    bending: ca.Function
    limits: tuple[int, ...]
    wheels: tuple[int, ...]


def stage_model(setup: Setup) -> Stage:
    """Write down the model of one period."""
    outputs, limits = setup.outputs, setup.body.limits
    q, d = ca.SX.sym("q", setup.coordinates.size), ca.SX.sym("d", outputs.count)
    motions, drive, inputs = driven(setup.body, setup.mode)(q)
    inverse = ca.inv_minor(ca.sparsify(ca.DM(outputs.selection)) @ motions)
    z, along = inverse @ d / setup.period_s, motions @ inverse
    v = inputs @ z
    wheels = tuple(i for i in range(WHEELS) if not drive[i, :].is_zero())

    by_wheel = drive[list(wheels), :] / limits.wheel_speed_rad_s
    g, rows = by_wheel @ z, list(range(len(wheels)))
    if outputs.bending:
        most = limits.unit_speed_m_s
        g = ca.vertcat(v[:2] / most, g)
        rows = [0, 1, *(2 + i for i in rows if not _within_one(by_wheel[i, :], most))]
    bends = along[list(outputs.bending), :]
    speeds = [g, ca.jacobian(g, d), ca.jacobian(g, q) @ along, bends]
    # Common terms are sought here, in what a horizon repeats: in all of it that takes seconds.
    return Stage(
        motion=ca.Function("motion", [q, d], [v, drive @ z], {"cse": True}),
        speeds=ca.Function("speeds", [q, d], speeds, {"cse": True}),
        bending=ca.Function("bending", [q], [bends], {"cse": True}),
        limits=tuple(rows),
        wheels=wheels,
    )


def _within_one(row: ca.SX, most: float) -> bool:
    """True if inputs of at most ``most`` keep a constant combination of them within one."""
    return row.is_constant() and float(ca.norm_1(ca.DM(row).T)) * most <= 1.0


class Period(NamedTuple):
    """One period of a motion.

    Attributes:
        half_way: Configuration in its middle, (3 + n,).
        step: Change of the outputs, (m,).
        kappa: Moving curvatures at its end [1/m].
        bending: Their derivative by the outputs.
        speeds: (g, dg/dd, dg/dy) of `Stage`.
    """

    half_way: ca.SX
    step: ca.SX
    kappa: ca.SX
    bending: ca.SX
    speeds: list[ca.SX]


def believed_start(setup: Setup, q: ca.SX, planned: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Bring any measurement to where the model holds; headings count modulo 2 pi.

    Returns:
        Configuration, (3 + n,), and e_0, deviation of its outputs from the plan in units of the
        weights, (m,).
    """
    outputs = setup.outputs
    kappa = _bounded(q[POSE:], CURVATURE_MARGIN * setup.body.limits.curvature_per_m)
    q = ca.vertcat(q[:POSE], kappa)
    deviation = ca.sparsify(ca.DM(outputs.selection)) @ q - planned
    turn = deviation[outputs.heading]
    deviation[outputs.heading] = turn - 2 * math.pi * ca.floor(turn / (2 * math.pi) + 0.5)
    deviation = _bounded(deviation, setup.largest_deviation)
    return q, deviation / setup.scale


def expected_deviations(setup: Setup, deviation: ca.SX, previous: ca.SX) -> list[ca.SX]:
    """e_0 ... e_N: the previous solution one period on, plus the response to what is new."""
    m, n, decay = setup.outputs.count, setup.horizon, setup.decay
    planned = [previous[k * m : (k + 1) * m] for k in range(n)]
    planned.append(decay * planned[-1])
    surprise = deviation - planned[0]
    return [planned[k] + decay**k * surprise for k in range(n + 1)]


def motion(setup: Setup, stage: Stage, start: ca.SX, outputs: Sequence[ca.SX]) -> list[Period]:
    """The motion from ``start`` along outputs y_0, y_1, ...

    Outputs may follow any path; the curvatures that go with it are rolled out.
    """
    pose, moving = list(setup.outputs.pose), list(setup.outputs.bending)
    bound = CURVATURE_MARGIN * setup.body.limits.curvature_per_m
    kappa, bending = start[moving], stage.bending(start)
    periods = []
    for y, y_next in itertools.pairwise(outputs):
        step = y_next - y
        half_way = ca.SX(start)
        half_way[pose] = (y + step / 2)[: len(pose)]
        half_way[moving] = _bounded(kappa + bending @ step / 2, bound)
        *speeds, bending = stage.speeds(half_way, step)
        kappa = kappa + bending @ step
        periods.append(Period(half_way, step, kappa, bending, speeds))
    return periods


def _bounded(value: ca.SX, bound: float | Array) -> ca.SX:
    return ca.fmin(ca.fmax(value, -bound), bound)
