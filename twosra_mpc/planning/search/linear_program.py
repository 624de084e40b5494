"""The one linear-program call (HiGHS through SciPy) that bounds and schedules share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from twosra_mpc.robot.coordinates import Array

_INFEASIBLE = 2  # SciPy's status code


def minimise(
    objective: Array,
    rows: Array | sparse.csr_matrix,
    limits: Array,
    bounds: Sequence[tuple[float | None, float | None]],
) -> tuple[float, Array] | None:
    """Minimise ``objective . x`` subject to ``rows @ x <= limits`` and bounds on x.

    Returns the optimum and its x, or None if the constraints contradict each other.

    Raises:
        ArithmeticError: If the program is unbounded or the solver gives up.
    """
    matrix: Any = rows  # the stubs know of no sparse ones
    result = linprog(objective, A_ub=matrix, b_ub=limits, bounds=bounds, method="highs")
    if result.status == _INFEASIBLE:
        return None
    if result.status != 0 or result.x is None or result.fun is None:
        raise ArithmeticError(f"linear program without optimum: {result.message}")
    return float(result.fun), np.asarray(result.x, dtype=float)
