r"""The quadratic program of a mode, written down symbolically and compiled to one function.

With outputs y_k = r_k + S e_k (reference plus deviation in units of the weights), e_0 measured, and
the limited quantities g of ``stage``,

.. math::
    \min_{e, s}\; \tfrac12 \sum_{k=1}^{N} |e_k|^2 + \tfrac{\rho}{2} \sum_{k=0}^{N-1} |e_{k+1} - e_k|^2
    + \tfrac{p - 1}{2} |e_N|^2 + \lambda s \quad\text{s.t.}\quad
    |g_k| \le 1,\quad |\omega_k - \omega_{k-1}| \le h \dot\omega_{max},\quad
    |\kappa_k| \le \kappa_{max} + s,\quad s \ge 0,

rho = (response / h)^2. The cost is exactly quadratic: penalising the change of the deviation makes
the plan's own inputs free. With p = (1 + sqrt(1 + 4 rho)) / 2 it is the cost over an infinite
horizon, of which e_{k+1} = a e_k, a = rho / (rho + p), is the solution while no limit is active.

All that is nonlinear are the limits. They are linearised about the previous solution, moved on by
one period, plus a^k times what the measurement has brought that it did not predict: a motion of the
model that starts at the measured configuration, not the old one with its first node overwritten.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from twosra_mpc.tracking.stage import CURVATURE_MARGIN, Setup, Stage, stage_model

Array = NDArray[np.float64]

UNLIMITED = 1e30  # what OSQP takes as no bound
RATE_UNIT = 1.0
CURV_UNIT = 1.0
SLACK_UNIT = 10.0  # the slack is counted in tenths of the curvature weight: better conditioned


@dataclass(frozen=True, eq=False)
class TrackingProgram:
    """A compiled quadratic program: variables (e_1 ... e_N, slack in soft modes).

    Attributes:
        setup: What it was made from.
        linearise: (q measured (5,), reference (m, N+1), previous solution, last wheel command (4,))
            -> (values of A in column order, lower, upper, first m entries of the cost vector,
            guess of the solution).
        command: (q measured, reference, solution, last wheel command) -> (v (5,), wheel speeds (4,)
            within all limits of the drives).
        hessian: Upper triangle of P, compressed columns.
        cost: Cost vector; its first m entries change with the measurement.
        constraints: A, compressed columns, with values of the straight robot at rest.
        stage_rows: Rows of A that belong to one stage; stages follow one another.
    """

    setup: Setup
    linearise: ca.Function
    command: ca.Function
    hessian: sparse.csc_matrix
    cost: Array
    constraints: sparse.csc_matrix
    stage_rows: int


@dataclass(frozen=True)
class _Start:
    """Measured configuration within what the model describes, and its deviation e_0."""

    q: ca.SX
    deviation: ca.SX


@lru_cache(maxsize=32)
def tracking_program(setup: Setup) -> TrackingProgram:
    """Write down and compile the quadratic program of one mode."""
    stage = stage_model(setup)
    m, n = setup.outputs.count, setup.horizon
    slack = 1 if setup.outputs.bending else 0
    q, wheels = ca.SX.sym("q", 5), ca.SX.sym("wheels", 4)
    reference = ca.SX.sym("reference", m, n + 1)
    previous = ca.SX.sym("previous", m * n + slack)
    start = _start(setup, q, reference)
    guess = _guess(setup, start, previous)
    blocks = _limits(setup, stage, start, reference, guess, wheels)
    matrix = ca.sparsify(ca.vertcat(*(block for block, _, _ in blocks)))
    stage_rows = matrix.size1() // n
    rho, _, norm = _response(setup)
    arguments = [q, reference, previous, wheels]
    linearise = ca.Function(
        "linearise",
        arguments,
        [
            ca.vertcat(*matrix.nonzeros()),
            ca.densify(ca.vertcat(*(lower for _, lower, _ in blocks))),
            ca.densify(ca.vertcat(*(upper for _, _, upper in blocks))),
            -rho / norm * start.deviation,
            ca.vertcat(*guess[1:], previous[m * n :]),
        ],
        {"cse": True},
    )
    cost = np.zeros(m * n + slack)
    cost[m * n :] = setup.weights.curvature_penalty / SLACK_UNIT / norm
    rows, column_starts = matrix.sparsity().row(), matrix.sparsity().colind()
    values = np.ones(matrix.nnz())
    return TrackingProgram(
        setup=setup,
        linearise=linearise,
        command=ca.Function(
            "command",
            arguments,
            _first_command(setup, stage, start, reference, previous, wheels),
            {"cse": True},
        ),
        hessian=_hessian(setup, slack),
        cost=cost,
        constraints=sparse.csc_matrix((values, rows, column_starts), shape=matrix.shape),
        stage_rows=stage_rows,
    )


def _response(setup: Setup) -> tuple[float, float, float]:
    """(rho, decay a per period of a deviation, what the cost is divided by)."""
    rho = (setup.weights.response_s / setup.period_s) ** 2
    p = (1 + math.sqrt(1 + 4 * rho)) / 2
    return rho, rho / (rho + p), 0.5 + rho


def _hessian(setup: Setup, slack: int) -> sparse.csc_matrix:
    rho, decay, norm = _response(setup)
    n, m = setup.horizon, setup.outputs.count
    along = np.full(n, 1 + 2 * rho)
    along[-1] = rho / decay  # p + rho
    band = sparse.diags([along, np.full(n - 1, -rho)], [0, 1]) / norm
    hessian = sparse.csc_matrix(sparse.kron(band, sparse.eye(m)))
    hessian.resize(m * n + slack, m * n + slack)
    return hessian


def _bounded(value: ca.SX, bound: float) -> ca.SX:
    return ca.fmin(ca.fmax(value, -bound), bound)


def _start(setup: Setup, q: ca.SX, reference: ca.SX) -> _Start:
    """Bring a measurement, however absurd, to where the model holds; headings modulo 2 pi."""
    outputs, limits = setup.outputs, setup.robot.limits
    kappa = _bounded(q[3:], CURVATURE_MARGIN * limits.curvature_per_m)
    believed = ca.vertcat(q[:3], kappa)
    deviation = ca.mtimes(ca.sparsify(ca.DM(outputs.selection)), believed) - reference[:, 0]
    turn = deviation[outputs.heading]
    turn -= 2 * math.pi * ca.floor(turn / (2 * math.pi) + 0.5)
    deviation[outputs.heading] = _bounded(turn, math.pi)
    for output in range(outputs.heading):
        deviation[output] = _bounded(deviation[output], setup.limits.deviation_m)
    if not outputs.bending:
        believed[:3] = reference[:, 0] + deviation
    return _Start(believed, deviation / setup.scale)


def _guess(setup: Setup, start: _Start, previous: ca.SX) -> list[ca.SX]:
    """Deviations e_0 ... e_N about which the limits are linearised."""
    m, n = setup.outputs.count, setup.horizon
    _, decay, _ = _response(setup)
    planned = [previous[k * m : (k + 1) * m] for k in range(n)]
    planned.append(decay * planned[-1])
    surprise = start.deviation - planned[0]
    return [planned[k] + decay**k * surprise for k in range(n + 1)]


def _limits(
    setup: Setup,
    stage: Stage,
    start: _Start,
    reference: ca.SX,
    guess: list[ca.SX],
    wheels: ca.SX,
) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
    """Blocks of rows (A, lower, upper), stage by stage."""
    outputs, scale = setup.outputs, ca.DM(setup.scale)
    m, n, turning = outputs.count, setup.horizon, list(stage.wheels)
    variables = m * n + (1 if outputs.bending else 0)
    half = 0.5 * ca.DM.eye(m)[-1, :]
    y = [reference[:, k] + scale * guess[k] for k in range(n + 1)]
    unit = _row_units(setup, stage)
    w_max = setup.robot.limits.wheel_speed_rad_s
    change = setup.limits.wheel_rate_rad_s2 * setup.period_s / w_max * unit[-len(turning) :]*RATE_UNIT
    kappa = start.q[list(outputs.bending)]
    rate = stage.bending(start.q)
    blocks = []
    before: tuple[ca.SX, ca.SX] | None = None
    for k in range(n):
        step = y[k + 1] - y[k]
        q = _half_way(setup, start, y[k] + step / 2, kappa + rate @ step / 2)
        g, by_step, by_middle = (ca.diag(unit) @ term for term in stage.limited(q, step))
        ahead = (by_middle @ half + by_step) @ ca.diag(scale)
        behind = (by_middle @ half - by_step) @ ca.diag(scale)
        block = ca.SX(g.numel(), variables)
        block[:, m * k : m * (k + 1)] = ahead
        offset = ahead @ guess[k + 1] - g
        if k > 0:
            block[:, m * (k - 1) : m * k] = behind
            offset += behind @ guess[k]
        blocks.append((block, offset - unit, offset + unit))

        rows, by = block[-len(turning) :, :]*RATE_UNIT, offset[-len(turning) :]*RATE_UNIT
        if before is None:
            last = wheels[turning] / w_max * unit[-len(turning) :]*RATE_UNIT
            blocks.append((rows, by + last - change, by + last + change))
        else:
            blocks.append((rows - before[0], by - before[1] - change, by - before[1] + change))
        before = (rows, by)
        if outputs.bending:
            rate = stage.bending(q)
            kappa += rate @ step
            blocks.append(_curvature_rows(setup, k, kappa, rate @ ca.diag(scale), guess[k + 1]))
    if outputs.bending:
        block = ca.SX(1, variables)
        block[0, -1] = 1
        blocks.append((block, ca.SX(0), ca.SX(UNLIMITED)))
    return blocks


def _row_units(setup: Setup, stage: Stage) -> Array:
    """What limited quantities are multiplied by, so that a weighted step moves each by about one.

    Keeps the program equally well conditioned for every robot and weight, (rows,).
    """
    _, by_step, _ = stage.limited(np.zeros(5), np.zeros(setup.outputs.count))
    units: Array = 1 / np.linalg.norm(by_step.full() * setup.scale, axis=1)
    return units


def _half_way(setup: Setup, start: _Start, y: ca.SX, kappa: ca.SX) -> ca.SX:
    """Configuration in the middle of a period, from its outputs and the moving curvatures."""
    q = ca.SX(start.q)
    if not setup.outputs.bending:
        q[:3] = y
    else:
        bound = CURVATURE_MARGIN * setup.robot.limits.curvature_per_m
        for row, coordinate in enumerate(setup.outputs.bending):
            q[coordinate] = _bounded(kappa[row], bound)
    return q


def _curvature_rows(
    setup: Setup, k: int, kappa: ca.SX, by_deviation: ca.SX, guess: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Side of the limit each curvature is nearer to: side * kappa <= limit + slack."""
    m, n = setup.outputs.count, setup.horizon
    limit, unit = setup.robot.limits.curvature_per_m, setup.weights.curvature_per_m
    side = ca.if_else(kappa >= 0, 1.0, -1.0)
    block = ca.SX(kappa.numel(), m * n + 1)
    towards = ca.diag(side) @ by_deviation / unit
    block[:, m * k : m * (k + 1)] = towards
    block[:, -1] = -1 / SLACK_UNIT
    upper = (limit - side * kappa) / unit + towards @ guess
    return block*CURV_UNIT, ca.SX(-UNLIMITED * np.ones(kappa.numel())), upper*CURV_UNIT


def _first_command(
    setup: Setup,
    stage: Stage,
    start: _Start,
    reference: ca.SX,
    solution: ca.SX,
    last: ca.SX,
) -> list[ca.SX]:
    """Input of the first period, scaled into the limits, and the wheel speeds sent for it."""
    outputs, limits = setup.outputs, setup.robot.limits
    scale, m = ca.DM(setup.scale), setup.outputs.count
    y = reference[:, 0] + scale * start.deviation
    step = reference[:, 1] + scale * solution[:m] - y
    kappa = start.q[list(outputs.bending)] + stage.bending(start.q) @ step / 2
    u, wheels = stage.speeds(_half_way(setup, start, y + step / 2, kappa), step)
    share = [ca.fabs(wheels) / limits.wheel_speed_rad_s]
    if outputs.bending:
        share.append(ca.fabs(u) / limits.unit_speed_m_s)
    within = 1 / ca.fmax(1, ca.mmax(ca.vertcat(*share)))
    v = ca.SX.zeros(5)
    v[list(outputs.inputs)] = u * within
    zone = setup.limits.dead_zone_rad_s
    wanted = wheels * within
    turned = ca.if_else(ca.fabs(wanted) < zone / 2, 0, ca.sign(wanted) * zone)
    sent = ca.if_else(ca.fabs(wanted) < zone, turned, wanted)
    change = setup.limits.wheel_rate_rad_s2 * setup.period_s
    return [v, ca.fmin(ca.fmax(sent, last - change), last + change)]
