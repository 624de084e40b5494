r"""A small convex program by a primal-dual interior point method (Nocedal and Wright, ch. 19).

.. math:: \min_t\; \sum_i e_i / (L t)_i + p^T t \quad\text{s.t.}\quad A t \ge b

With slacks s = A t - b and multipliers z, Newton's method on the optimality conditions, with s z
equal to a mean that is driven to zero.
"""

from __future__ import annotations

import numpy as np

from twosra_mpc.robot.coordinates import Array

_ITERATIONS = 60
_EXACT = 1e-9  # of the mean of s z, and a hundredth of what the gradient may miss
_LOOSE = 1e-9  # by which every row may be missed: rows may leave no room between them
_SHARE = 0.995  # of the way to where a slack or a multiplier is zero
_CENTRED = 0.03  # of the mean of s z, in a step


def minimum(e: Array, lasting: Array, price: Array, rows: Array, least: Array, t: Array) -> Array:
    """The t of least objective.

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
    z = 1e-2 / slack
    for _ in range(_ITERATIONS):
        d = lasting @ t
        each = e / d**2
        dual, primal = price - each @ lasting - z @ rows, rows @ t - slack - least
        mean = float(slack @ z) / len(z)
        if max(mean, 1e-2 * np.abs(dual).max(), np.abs(primal).max()) <= _EXACT:
            break
        ratio, aim = z / slack, _CENTRED * mean / slack - z
        hessian = (lasting.T * (2 * each / d)) @ lasting + (rows.T * ratio) @ rows
        step = np.linalg.solve(hessian, (aim - ratio * primal) @ rows - dual)
        slack_step = rows @ step + primal
        z_step = aim - ratio * slack_step
        size = _most(np.append(slack, d), np.append(slack_step, lasting @ step))
        t, slack = t + size * step, slack + size * slack_step
        z = z + _most(z, z_step) * z_step
    return t


def _most(values: Array, step: Array) -> float:
    """Largest share of a step, up to 1, that keeps values positive."""
    return min(1.0, _SHARE * float((values / np.maximum(-step, 1e-300)).min()))
