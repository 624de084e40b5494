"""Rows of a table that say something new, for logs that do not repeat themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.robot.coordinates import Array


def changed(table: Array, step: ArrayLike = 0.0) -> NDArray[np.bool_]:
    """Rows that differ from the last one kept by more than ``step`` in any column; the first, too.

    Args:
        table: (rows, columns).
        step: Largest difference that is not told, of each column.
    """
    new, kept = np.zeros(len(table), dtype=bool), np.full(table.shape[1], np.inf)
    for row, values in enumerate(table):
        if row == 0 or (np.abs(values - kept) > step).any():
            new[row], kept = True, values
    return new
