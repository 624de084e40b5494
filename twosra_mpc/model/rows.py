"""CasADi functions at the rows of arrays: called once for all of them, and nothing converted."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.kinematics import InPlace
from twosra_mpc.robot.coordinates import Array


def by_rows(function: ca.Function, *rows: Array | NDArray[np.int64]) -> list[Array]:
    """Values of a function of dense vectors: an array (m, k) for each argument and each result."""
    count = len(rows[0])
    values = [np.empty((count, function.numel_out(i))) for i in range(function.n_out())]
    if count:
        given = [np.ascontiguousarray(each, dtype=float) for each in rows]
        at_all = InPlace(_mapped(function, count), given, values)
        at_all.evaluate()
    return values


@lru_cache(1024)
def _mapped(function: ca.Function, count: int) -> ca.Function:
    return function.map(count)
