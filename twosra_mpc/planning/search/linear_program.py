r"""Linear programs (HiGHS through SciPy): their optima, and what is proved of them.

A solver's optimum is right to within its tolerances, and its word that there is none is no proof.
``proved_minimum`` believes only the multipliers, whatever they are: for y >= 0 and every feasible x

.. math:: c \cdot x \ge c \cdot x + y \cdot (A x - b) = r \cdot x - y \cdot b,
    \quad r = c + A^T y,

and the right-hand side is least at bounds of x. A variable without one is at most f_j times the
cost z: so z >= v - rho z, with v from the others and rho the sum of abs(r_j) f_j, which is rounding
alone. Without c it is a proof by Farkas that z >= v / rho: no plan, or none in this age.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from twosra_mpc.deadline import check_time
from twosra_mpc.robot.coordinates import Array

_INFEASIBLE = 2  # SciPy's status code
_NEVER = 1e9  # a cost that no plan has
_UNIT = 2.0**-52

Bounds = Sequence[tuple[float | None, float | None]]


def minimise(
    objective: Array, rows: Array | sparse.csr_matrix, limits: Array, bounds: Bounds
) -> tuple[float, Array] | None:
    """Minimise ``objective . x`` subject to ``rows @ x <= limits`` and bounds on x.

    Returns the optimum and its x, or None if the constraints contradict each other, both as the
    solver says.

    Raises:
        ArithmeticError: If the program is unbounded or the solver gives up.
    """
    result = _solved(objective, rows, limits, bounds)
    return None if result is None else (float(result.fun), np.asarray(result.x, dtype=float))


def proved_minimum(
    objective: Array, rows: Array, limits: Array, bounds: Bounds, per_cost: Array
) -> tuple[float, Array]:
    """Proved lower bound of ``objective . x`` (never negative) as in ``minimise``, and an x.

    inf where it is proved that there is no x; the x found is then the one that violates least, and
    otherwise the solver's optimum.

    Args:
        objective: Not negative for any feasible x, (n,).
        rows: (m, n).
        limits: (m,).
        bounds: Of x; the end of a variable that has only one is 0.
        per_cost: Each variable is at most so many times ``objective . x``; inf if that is not known
            or if both ends are given, (n,).

    Raises:
        ArithmeticError: If the program is unbounded or the solver gives up.
    """
    result = _solved(objective, rows, limits, bounds)
    if result is not None:
        least, loose = _weak_duality(objective, rows, limits, bounds, per_cost, result)
        return max(0.0, least / (1 + loose)), result.x
    none = np.zeros(len(objective))
    elastic = np.column_stack([rows, -np.ones(len(rows))])
    result = _solved(np.append(none, 1.0), elastic, limits, [*bounds, (0.0, None)])
    if result is None:
        raise ArithmeticError("linear program whose bounds contradict each other")
    least, loose = _weak_duality(none, rows, limits, bounds, per_cost, result)
    proved = least > _NEVER * loose and least > 0
    return math.inf if proved else 0.0, result.x[:-1]


def _solved(
    objective: Array, rows: Array | sparse.csr_matrix, limits: Array, bounds: Bounds
) -> Any | None:
    """SciPy's result; None if it calls the program infeasible."""
    check_time()
    matrix: Any = rows  # the stubs know of no sparse ones
    result = linprog(objective, A_ub=matrix, b_ub=limits, bounds=bounds, method="highs")
    if result.status == _INFEASIBLE:
        return None
    if result.status != 0 or result.x is None or result.fun is None:
        raise ArithmeticError(f"linear program without optimum: {result.message}")
    return result


def _weak_duality(
    objective: Array, rows: Array, limits: Array, bounds: Bounds, per_cost: Array, result: Any
) -> tuple[float, float]:
    """Find v and rho as above, rounded so that the proof holds."""
    y = np.maximum(-result.ineqlin.marginals, 0.0)
    ends = np.array([(a, b) for a, b in bounds], dtype=float)
    unit = _UNIT * (len(y) + len(objective) + 4)
    off = unit * (np.abs(objective) + y @ np.abs(rows))
    reduced = objective + y @ rows
    slopes = np.array([reduced - off, reduced + off])
    given = np.isfinite(ends)
    least = (slopes[:, :, None] * np.where(given, ends, 0.0)).min(axis=(0, 2))
    open_ended = np.array([np.maximum(slopes[1], 0.0), np.maximum(-slopes[0], 0.0)]).T
    loose = np.where(~given & (open_ended > 0), open_ended, 0.0).max(axis=1)
    rho = float((loose[loose > 0] * per_cost[loose > 0]).sum()) * (1 + unit)
    size = float(np.abs(least).sum() + y @ np.abs(limits))
    return float(least.sum() - y @ limits) - unit * size, rho
