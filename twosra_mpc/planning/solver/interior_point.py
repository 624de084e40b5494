r"""A small convex program by a primal-dual interior point method (Nocedal and Wright, ch. 19).

.. math:: \min_t\; \sum_i e_i / (L t)_i + p^T t \quad\text{s.t.}\quad A t \ge b

With slacks s = A t - b and multipliers z, Newton's method on the optimality conditions, with s z
equal to a mean that is driven to zero. The system's matrix may be singular: rows may repeat or
contradict each other, numerators may be zero, and directions free. So it is scaled to a diagonal of
ones and regularised.
"""

from __future__ import annotations

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.robot.coordinates import Array

_ITERATIONS = 60
_EXACT = 1e-9  # of the mean of s z; the gradient may miss a hundred times that, or rounding
_LOOSE = 1e-9  # by which every row may be missed: rows may leave no room between them
_SHARE = 0.995  # of the way to where a slack or a multiplier is zero
_CENTRED = 0.03  # of the mean of s z, in a step
_LEAST = 1e-10  # mean that a step aims at: what is much smaller leaves the gradient to rounding
_CONTRADICTED = 1e12  # mean of s z beyond which rows contradict each other: z only grows
_REGULAR = 1e-15  # added to a diagonal of ones: some units of rounding


def minimum(e: Array, lasting: Array, price: Array, rows: Array, least: Array, t: Array) -> Array:
    """The t of least objective; where Newton's method ends early, the last one that it came to.

    Args:
        e: Numerators, (m,), not negative.
        lasting: L, (m, n).
        price: p, (n,).
        rows: A, (k, n).
        least: b, (k,).
        t: Where to begin, (n,); all of L t must be positive there.
    """
    least = least - _LOOSE
    slack = np.maximum(rows @ t - least, 1e-2)
    z, off = 1e-2 / slack, np.inf
    for _ in range(_ITERATIONS):
        charge(Cost.NEWTON_STEP, len(t) + len(least))
        d = lasting @ t
        each = e / d**2
        dual, primal = price - each @ lasting - z @ rows, rows @ t - slack - least
        mean = float(slack @ z) / len(z)
        off, before = float(np.abs(dual).max()), off
        exact = max(mean, np.abs(primal).max()) <= _EXACT
        if exact and (off <= 100 * _EXACT or (mean <= 2 * _LEAST and off >= before)):
            break
        if mean > _CONTRADICTED:
            break
        ratio, aim = z / slack, max(_CENTRED * mean, _LEAST) / slack - z
        hessian = (lasting.T * (2 * each / d)) @ lasting + (rows.T * ratio) @ rows
        step = _newton(hessian, (aim - ratio * primal) @ rows - dual)
        if not np.isfinite(step).all():
            break
        slack_step = rows @ step + primal
        z_step = aim - ratio * slack_step
        size = _most(np.append(slack, d), np.append(slack_step, lasting @ step))
        t, slack = t + size * step, slack + size * slack_step
        z = z + _most(z, z_step) * z_step
    return t


def _newton(hessian: Array, right: Array) -> Array:
    """Solve a symmetric system of no negative eigenvalue, regularised; NaN if nothing helps."""
    diagonal = hessian.diagonal()
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    try:
        scaled = scale[:, None] * hessian * scale + _REGULAR * np.eye(len(hessian))
        return scale * np.linalg.solve(scaled, scale * right)
    except np.linalg.LinAlgError:
        return np.full(len(right), np.nan)


def _most(values: Array, step: Array) -> float:
    """Largest share of a step, up to 1, that keeps values positive."""
    return min(1.0, _SHARE * float((values / np.maximum(-step, 1e-200)).min()))
