r"""The quadratic program of a mode, written down symbolically and compiled to one function.

With outputs y_k = r_k + S e_k (reference plus deviation in units of the weights), e_0 measured, and
the limited speeds g,

.. math::
    \min_{e, s}\; \tfrac12 \sum_{k=1}^{N} |e_k|^2
    + \tfrac{\rho}{2} \sum_{k=0}^{N-1} |e_{k+1} - e_k|^2 + \tfrac{p-1}{2} |e_N|^2 + \lambda s \\
    \text{s.t.}\quad |g_k| \le 1,\quad |\omega_k - \omega_{k-1}| \le h \dot\omega_{max},\quad
    |\kappa_k| \le \kappa_{max} + s,\quad F t_k \le \epsilon s,\quad s \ge 0,

rho = (response / h)^2. The cost is exactly quadratic: penalising the change of the deviation makes
the plan's own inputs free. With p = (1 + sqrt(1 + 4 rho)) / 2 it is the cost over an infinite
horizon, and e_{k+1} = a e_k with a = rho / (rho + p) its solution while no limit is active.

Twists t of b0 with F t <= 0 keep an object that is pushed: see `contact.grip`. So what is off is
set right by turning where a step aside would leave the object behind.

All that is nonlinear are the limits. They are linearised about the previous solution, moved on by
one period, plus a^k times what the measurement has brought that it did not predict: a motion of the
model that starts at the measured configuration, not the old one with its first node overwritten.

By the midpoint rule, the motion that takes the outputs from y_k to y_{k+1} in one period h is

.. math:: z_k = (T N(\bar q_k))^{-1} (y_{k+1} - y_k) / h,

with the configuration half way. Speeds g = (v / v_max in soft modes, omega / omega_max), each
divided by its limit, follow from it.

Wheel rates are limited over the first periods only. The first one is what the drives feel; limiting
all of them makes the program ill conditioned when rates are tight, and changes little.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.model.kinematics import driven
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.modes import is_rigid

UNLIMITED = 1e30  # what OSQP takes as no bound
RATE_LIMITED_PERIODS = 3
CURVATURE_UNIT, SLACK_UNIT = 0.3, 3.0  # found by experiment: few iterations, limit active or not
PUSH_UNIT = 0.05  # epsilon: a push aside costs so much more, or what is off would pay for it
CURVATURE_MARGIN = 1.01  # curvatures beyond the limit are taken as so many times the limit


class Stage(NamedTuple):
    """Compiled model of one period in one mode; m outputs, q half way, d = y_{k+1} - y_k.

    Attributes:
        motion: (q, d) -> (inputs v (5,) [m/s, rad/s], four wheel speeds [rad/s]).
        speeds: (q, d) -> (g, dg/dd, dg/dy, bending): speeds, and their derivatives by the step and
            by the outputs half way, (rows, m). Where something is pushed, the twist of b0 comes
            first [m/s, m/s, rad/s].
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
    if setup.facets:
        g, rows = ca.vertcat(v[2:], g), [POSE + i for i in rows]
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
    """Period of a motion.

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


@dataclass(frozen=True, eq=False)
class TrackingProgram:
    """A compiled quadratic program: variables (e_1 ... e_N, slack in soft modes).

    Attributes:
        setup: What it was made from.
        linearise: (q measured, reference (m, N+1), previous solution, last wheel command (4,),
            facets of the cone)
            -> (values of A in column order, lower, upper, first m entries of the cost vector,
            deviation measured and guess of the solution).
        command: (q measured, reference, solution, last wheel command) -> (v (5,), wheel speeds (4,)
            within all limits of the drives).
        hessian: Upper triangle of P, compressed columns.
        cost: Cost vector; its first m entries change with the measurement.
        constraints: Pattern of A, compressed columns.
        next_rows: For each row of A, the row for the same limit one period later.
    """

    setup: Setup
    linearise: ca.Function
    command: ca.Function
    hessian: sparse.csc_matrix
    cost: Array
    constraints: sparse.csc_matrix
    next_rows: NDArray[np.intp]


class _Rows(NamedTuple):
    """lower <= matrix x <= upper."""

    matrix: ca.SX
    lower: ca.SX
    upper: ca.SX


class _Affine(NamedTuple):
    """A linearised quantity, matrix x + constant."""

    matrix: ca.SX
    constant: ca.SX

    def within(self, lower: Array, upper: Array) -> _Rows:
        return _Rows(self.matrix, ca.SX(lower) - self.constant, ca.SX(upper) - self.constant)


@lru_cache(maxsize=32)
def tracking_program(setup: Setup) -> TrackingProgram:
    """Write down and compile the quadratic program of one mode."""
    stage, m, n = stage_model(setup), setup.outputs.count, setup.horizon
    q, wheels = ca.SX.sym("q", setup.coordinates.size), ca.SX.sym("wheels", WHEELS)
    reference = ca.SX.sym("reference", m, n + 1)
    previous = ca.SX.sym("previous", setup.variables)
    facets = ca.SX.sym("facets", POSE, setup.facets).T
    arguments = [q, reference, previous, wheels]

    start, deviation = believed_start(setup, q, reference[:, 0])
    expected = expected_deviations(setup, deviation, previous)
    y = [reference[:, k] + expected[k] * setup.scale for k in range(n + 1)]
    periods = motion(setup, stage, start, y)
    kinds = _constraints(setup, stage, expected, periods, wheels, facets)
    rows = list(itertools.chain(*kinds))
    matrix = ca.sparsify(ca.vertcat(*(item.matrix for item in rows)))
    numbers = [
        matrix.nz[:],
        ca.densify(ca.vertcat(*(item.lower for item in rows))),
        ca.densify(ca.vertcat(*(item.upper for item in rows))),
        -setup.rho / _norm(setup) * deviation,
        ca.vertcat(*expected, previous[m * n :]),
    ]
    first = [y[0], reference[:, 1] + previous[:m] * setup.scale]
    sent = _command(setup, stage, motion(setup, stage, start, first)[0], wheels)
    cost, pattern = np.zeros(setup.variables), matrix.sparsity()
    cost[m * n :] = setup.weights.curvature_penalty / SLACK_UNIT / _norm(setup)
    same_shape = is_rigid(setup.mode)  # all along: then whole horizons have terms in common
    values = (np.ones(matrix.nnz()), pattern.row(), pattern.colind())
    return TrackingProgram(
        setup=setup,
        linearise=ca.Function("linearise", [*arguments, facets.T], numbers, {"cse": same_shape}),
        command=ca.Function("command", arguments, sent),
        hessian=_hessian(setup),
        cost=cost,
        constraints=sparse.csc_matrix(values, shape=matrix.shape),
        next_rows=_next_rows(kinds),
    )


def _norm(setup: Setup) -> float:
    """Divisor of the cost with which its Hessian is of the order of one."""
    return 0.5 + setup.rho


def _hessian(setup: Setup) -> sparse.csc_matrix:
    n, m = setup.horizon, setup.outputs.count
    diagonal = np.full(n, 1 + 2 * setup.rho)
    diagonal[-1] = setup.terminal + setup.rho
    band = np.diag(diagonal) - np.diag(np.full(n - 1, setup.rho), 1)
    hessian = np.zeros((setup.variables, setup.variables))
    hessian[: m * n, : m * n] = np.kron(band, np.eye(m)) / _norm(setup)
    return sparse.csc_matrix(hessian)


def _constraints(
    setup: Setup,
    stage: Stage,
    expected: list[ca.SX],
    periods: list[Period],
    wheels: ca.SX,
    facets: ca.SX,
) -> list[list[_Rows]]:
    """Rows of each stage, of the wheel rates period by period, and the sign of the slack."""
    unit, limits = _row_units(setup, stage), list(stage.limits)
    largest = unit[limits]
    speeds = [_linearised_speeds(setup, unit, expected, p, k) for k, p in enumerate(periods)]
    stages = []
    for k, speed in enumerate(speeds):
        limited = _Affine(speed.matrix[limits, :], speed.constant[limits])
        rows = [limited.within(-largest, largest)]
        if setup.outputs.bending:
            rows.append(_curvature_rows(setup, k, periods[k], expected[k + 1]))
        if setup.facets:
            rows.append(_push_rows(speed, facets, unit[:POSE]))
        stages.append(_Rows(*(ca.vertcat(*parts) for parts in zip(*rows, strict=True))))
    kinds = [stages, _wheel_rates(setup, stage, unit, speeds, wheels)]
    if setup.slack:
        slack = ca.SX(1, setup.variables)
        slack[0, -1] = 1
        kinds.append([_Rows(slack, ca.SX(0), ca.SX(UNLIMITED))])
    return kinds


def _row_units(setup: Setup, stage: Stage) -> Array:
    """Factors of the speeds with which a weighted step changes each by about one.

    Keeps the program equally well conditioned for every robot and weight, (rows of g,).
    """
    straight = np.zeros(setup.coordinates.size)
    _, by_step, *_ = stage.speeds(straight, np.zeros(setup.outputs.count))
    return 1 / np.linalg.norm(by_step.full() * setup.scale, axis=1)


def _linearised_speeds(
    setup: Setup, unit: Array, expected: list[ca.SX], period: Period, k: int
) -> _Affine:
    """Speeds of period k, which depend on e_k and e_{k+1}."""
    m, scale = setup.outputs.count, ca.diag(ca.DM(setup.scale))
    g, by_step, by_middle = (ca.diag(unit) @ term for term in period.speeds)
    ahead, behind = (by_middle / 2 + by_step) @ scale, (by_middle / 2 - by_step) @ scale
    matrix = ca.SX(g.numel(), setup.variables)
    matrix[:, m * k : m * (k + 1)] = ahead
    constant = g - ahead @ expected[k + 1]
    if k > 0:  # e_0 is measured, not a variable
        matrix[:, m * (k - 1) : m * k] = behind
        constant -= behind @ expected[k]
    return _Affine(matrix, constant)


def _curvature_rows(setup: Setup, k: int, period: Period, expected: ca.SX) -> _Rows:
    """Keep each curvature within the limit it is nearer to, up to the slack."""
    m = setup.outputs.count
    limit, unit = setup.body.limits.curvature_per_m, setup.weights.curvature_per_m
    side = ca.if_else(period.kappa >= 0, CURVATURE_UNIT, -CURVATURE_UNIT)
    slope = ca.diag(side) @ period.bending @ ca.diag(ca.DM(setup.scale)) / unit
    matrix = ca.SX(side.numel(), setup.variables)
    matrix[:, m * k : m * (k + 1)] = slope
    matrix[:, -1] = -CURVATURE_UNIT / SLACK_UNIT
    constant = side * period.kappa / unit - slope @ expected
    free = ca.SX(-UNLIMITED * np.ones(side.numel()))
    return _Rows(matrix, free, CURVATURE_UNIT * limit / unit - constant)


def _push_rows(speed: _Affine, facets: ca.SX, unit: Array) -> _Rows:
    """Keep the twist of a period in the cone of what is pushed, up to the slack."""
    own = facets @ np.diag(unit[0] / unit)
    matrix, constant = own @ speed.matrix[:POSE, :], own @ speed.constant[:POSE]
    matrix[:, -1] = -PUSH_UNIT / SLACK_UNIT
    return _Rows(matrix, ca.SX(-UNLIMITED * np.ones(constant.numel())), -constant)


def _wheel_rates(
    setup: Setup, stage: Stage, unit: Array, speeds: list[_Affine], wheels: ca.SX
) -> list[_Rows]:
    """Changes of the wheel speeds, the first one from the last command."""
    turning, of_wheels = list(stage.wheels), slice(-len(stage.wheels), None)
    unit, most = unit[of_wheels], setup.body.limits.wheel_speed_rad_s
    tightness = most / (6 * setup.wheel_change)
    weight = min(max(0.5, tightness), 1.5)  # by experiment: the more, the likelier they are active
    change = weight * unit * setup.wheel_change / most
    before = _Affine(ca.SX(len(turning), setup.variables), wheels[turning] * unit / most)
    rows = []
    for speed in speeds[:RATE_LIMITED_PERIODS]:
        now = _Affine(speed.matrix[of_wheels, :], speed.constant[of_wheels])
        difference = _Affine(
            weight * (now.matrix - before.matrix), weight * (now.constant - before.constant)
        )
        rows.append(difference.within(-change, change))
        before = now
    return rows


def _next_rows(kinds: list[list[_Rows]]) -> NDArray[np.intp]:
    """Row of the same limit one period later; rows of the last period stay."""
    sizes = [[item.matrix.size1() for item in kind] for kind in kinds]
    steps = [step for kind in sizes for step in (*kind[1:], 0)]
    ahead: NDArray[np.intp] = np.repeat(steps, list(itertools.chain(*sizes)))
    return ahead + np.arange(len(ahead))


def _command(setup: Setup, stage: Stage, period: Period, last: ca.SX) -> list[ca.SX]:
    """Input of the first period, scaled into the limits, and the wheel speeds sent for it."""
    limits = setup.body.limits
    v, wheels = stage.motion(period.half_way, period.step)
    shares = [ca.fabs(wheels) / limits.wheel_speed_rad_s]
    if setup.outputs.bending:
        shares.append(ca.fabs(v[:2]) / limits.unit_speed_m_s)
    within = 1 / ca.fmax(1, ca.mmax(ca.vertcat(*shares)))
    sent = ca.fmax(wheels * within, last - setup.wheel_change)
    return [ca.densify(v) * within, ca.fmin(sent, last + setup.wheel_change)]
