r"""Linear programs (HiGHS): their optima, and what is proved of them.

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
from functools import lru_cache
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge
from twosra_mpc.native_output import discarded_native_output
from twosra_mpc.robot.coordinates import Array

_LEAST = 100  # rows and columns: no program costs less than one of so many
_STEPS = 10_000  # of the simplex method, which may go round in circles
_NEVER = 1e9  # a cost that no plan has
_UNIT = 2.0**-52

Bounds = Sequence[tuple[float | None, float | None]]


class Rows(NamedTuple):
    """A sparse matrix, row by row.

    Attributes:
        starts: Where the entries of each row begin, and last how many there are, (m + 1,).
        columns: Column of each entry.
        values: Value of each entry.
    """

    starts: NDArray[np.intp]
    columns: NDArray[np.intp]
    values: Array

    @classmethod
    def of(cls, matrix: Array) -> Rows:
        """The entries of a matrix that are not 0."""
        row, column = np.nonzero(matrix)
        starts = np.searchsorted(row, np.arange(len(matrix) + 1))
        return cls(starts, column, matrix[row, column])

    @classmethod
    def summed(
        cls, count: int, row: NDArray[np.intp], column: NDArray[np.intp], value: Array
    ) -> Rows:
        """So many rows, from entries in any order; those in one place are added."""
        width = int(column.max(initial=0)) + 1
        place, which = np.unique(row * width + column, return_inverse=True)
        starts = np.searchsorted(place, width * np.arange(count + 1))
        return cls(starts, place % width, np.bincount(which, value).astype(float))

    @classmethod
    def stacked(cls, parts: Sequence[Rows]) -> Rows:
        """One above the other."""
        before = np.cumsum([0, *(len(part.values) for part in parts)])
        starts = [part.starts[:-1] + first for part, first in zip(parts, before, strict=False)]
        columns, values = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
        return cls(np.concatenate([*starts, before[-1:]]), columns, values)


class Optimum(NamedTuple):
    """The least cost, where it is reached, and what each row's limit is worth (never positive)."""

    cost: float
    x: Array
    marginals: Array


@lru_cache(maxsize=1)
def _quiet_highspy() -> ModuleType:
    """The HiGHS module, after the banner that its first solver prints (version 1.16 and newer).

    No option of a solver can stop it. Many problems are planned without, so it is imported late.
    """
    import highspy

    with discarded_native_output():
        highspy.Highs()  # type: ignore[no-untyped-call]
    return highspy


def minimise(objective: Array, rows: Array | Rows, limits: Array, bounds: Bounds) -> Optimum | None:
    """Minimise ``objective . x`` subject to ``rows @ x <= limits`` and bounds on x.

    None if the constraints contradict each other; all that as the solver says.

    Raises:
        ArithmeticError: If the program is unbounded or the solver gives up.
    """
    return Program(objective, bounds).optimum(rows, limits)


class Program:
    """A linear program to which rows are added; the simplex method goes on where it was."""

    def __init__(self, objective: Array, bounds: Bounds) -> None:
        """With no rows yet; arguments as ``minimise`` has them."""
        self._highspy, self._size = _quiet_highspy(), _LEAST + len(objective)
        ends = np.array([(a, b) for a, b in bounds], dtype=float)
        program = self._highspy.HighsLp()
        program.num_col_, program.col_cost_ = len(objective), objective
        program.col_lower_, program.col_upper_ = np.where(
            np.isnan(ends), (-np.inf, np.inf), ends
        ).T.copy()
        self._solver = self._highspy.Highs()
        self._solver.setOptionValue("output_flag", False)
        self._solver.setOptionValue("threads", 1)
        self._solver.setOptionValue("simplex_iteration_limit", _STEPS)
        self._solver.passModel(program)

    def optimum(self, rows: Array | Rows, limits: Array) -> Optimum | None:
        """The least ``objective . x`` with ``rows @ x <= limits`` too, as in ``minimise``."""
        self._size += len(limits)
        charge(Cost.LINEAR_PROGRAM, self._size)
        starts, columns, values = rows if isinstance(rows, Rows) else Rows.of(rows)
        none, (first, where) = np.full(len(limits), -np.inf), map(np.int32, (starts[:-1], columns))
        self._solver.addRows(len(limits), none, limits, len(values), first, where, values)
        self._solver.run()
        status, known = self._solver.getModelStatus(), self._highspy.HighsModelStatus
        if status == known.kInfeasible:
            return None
        if status != known.kOptimal:
            words = self._solver.modelStatusToString(status)
            raise ArithmeticError(f"linear program without optimum: {words}")
        found = self._solver.getSolution()
        cost = self._solver.getInfo().objective_function_value
        return Optimum(cost, np.array(found.col_value), np.array(found.row_dual))


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
    result = minimise(objective, rows, limits, bounds) if objective.any() else None
    if result is not None:
        least, loose = _weak_duality(objective, rows, limits, bounds, per_cost, result)
        return max(0.0, least / (1 + loose)), result.x
    none = np.zeros(len(objective))
    elastic = np.column_stack([rows, -np.ones(len(rows))])
    result = minimise(np.append(none, 1.0), elastic, limits, [*bounds, (0.0, None)])
    if result is None:
        raise ArithmeticError("linear program whose bounds contradict each other")
    least, loose = _weak_duality(none, rows, limits, bounds, per_cost, result)
    proved = least > _NEVER * loose and least > 0
    return math.inf if proved else 0.0, result.x[:-1]


def _weak_duality(
    objective: Array, rows: Array, limits: Array, bounds: Bounds, per_cost: Array, result: Optimum
) -> tuple[float, float]:
    """Find v and rho as above, rounded so that the proof holds."""
    y = np.maximum(-result.marginals, 0.0)
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
