"""CasADi functions at the rows of arrays: called once for all of them, and nothing converted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.cache import per_function
from twosra_mpc.model.kinematics import InPlace
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode

_BLOCK = 64  # rows at once: a function for so many rows weighs as much as their arrays


def by_rows(function: ca.Function, *rows: Array | NDArray[np.int64]) -> list[Array]:
    """Values of a function of dense vectors: an array (m, k) for each argument and each result."""
    values = [np.empty((len(rows[0]), size)) for size in _sizes(function)]
    _fill(values, function, rows)
    return values


def by_modes(function: ca.Function, *rows: Array | NDArray[np.int64]) -> list[Array]:
    """As ``by_rows``, where the last array says the mode of each row."""
    *given, modes = rows
    codes = modes @ (1 << np.arange(modes.shape[1]))
    values = [np.empty((len(modes), size)) for size in _sizes(function)]
    for code in set(codes.tolist()):
        at = (codes == code).nonzero()[0]
        _fill(values, in_mode(function, tuple(modes[at[0]].tolist())), given, at)
    return values


@per_function()
def _sizes(function: ca.Function) -> list[int]:
    return [function.numel_out(i) for i in range(function.n_out())]


def _fill(
    values: Sequence[Array],
    function: ca.Function,
    rows: Sequence[Array | NDArray[np.int64]],
    of: NDArray[np.intp] | None = None,
) -> None:
    """Fill in the values of some rows, or of all."""
    count = len(rows[0] if of is None else of)
    if not count:
        return
    block = math.ceil(count / math.ceil(count / _BLOCK))  # all alike
    idle = _idle(function, block)
    ready = idle.pop() if idle else _Ready(function, block)
    for first in range(0, count, block):
        begin = min(first, count - block)  # ends with rows
        at = slice(begin, begin + block) if of is None else of[begin : begin + block]
        for own, given in zip(ready.reads, rows, strict=True):
            own[:] = given[at]
        ready.evaluate()
        for asked, own in zip(values, ready.writes, strict=True):
            asked[at] = own
    idle.append(ready)


@per_function(16)
def in_mode(function: ca.Function, mode: Mode) -> ca.Function:
    """A function whose last argument is sigma in one mode: what that does not use falls away."""
    given = [ca.SX.sym("x", function.size1_in(i)) for i in range(function.n_in() - 1)]
    told = [ca.densify(each) for each in function.call([*given, ca.DM(mode)])]
    return ca.Function(function.name(), given, told)


class _Ready:
    """A function at so many rows, with arrays of its own that it reads from and writes to."""

    def __init__(self, function: ca.Function, count: int) -> None:
        self.reads = [np.empty((count, function.numel_in(i))) for i in range(function.n_in())]
        self.writes = [np.empty((count, size)) for size in _sizes(function)]
        self._mapped = InPlace(function.map(count), self.reads, self.writes)
        self.evaluate = self._mapped.evaluate


@per_function(32)
def _idle(function: ca.Function, count: int) -> list[_Ready]:
    """Those of ``count`` rows that nobody evaluates now: in another thread somebody may."""
    del function, count
    return []
