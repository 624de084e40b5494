r"""Combinatorial integral approximation: a mixed-integer linear program that rounds mode shares.

Given the relaxed shares w_{km} of the modes m in stages k, find binaries b_{km}, one a stage, with

.. math::
    \min\; \eta + \epsilon S \quad\text{s.t.}\quad
    \Big|\sum_{i \le k} (w_{im} - b_{im})\Big| \le \eta \;\;\forall k, m, \quad
    S = \sum_{k > 0, m} s_{km} \le S_{max}, \quad s_{km} \ge b_{km} - b_{k-1,m},

where a mode that is on stays on for a dwell time, and of given groups of modes (those in which a
segment is soft that must bend) one at least is used. This is what sum-up rounding
approximates (Sager, Jung, Kirches 2011), with the number of switches and dwell times respected.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

Array = NDArray[np.float64]

_PER_SWITCH = 0.05  # stages of approximation error that one switch fewer is worth
_DECIMALS = 4  # of the shares; what is left of vanished shares upsets HiGHS
_Row = tuple[dict[int, float], float, float]


@dataclass(frozen=True)
class Rounding:
    """Outcome of the rounding.

    Attributes:
        status: HiGHS' words.
        choice: Index of the mode of each stage; None if none was found.
        error: The approximation error eta [stages]; inf if none was found.
    """

    status: str
    choice: tuple[int, ...] | None
    error: float


def rounded(
    shares: Array,
    needed: Sequence[Sequence[int]],
    *,
    max_switches: int,
    dwell_stages: int,
    time_limit_s: float,
) -> Rounding:
    """Round shares (stages, modes) to one mode a stage.

    Args:
        shares: Relaxed shares of the modes, each row sums to 1.
        needed: Groups of modes; of each group one is used.
        max_switches: Most changes of mode.
        dwell_stages: Least stages a mode stays on.
        time_limit_s: Wall time HiGHS may take.
    """
    stages, modes = int(shares.shape[0]), int(shares.shape[1])
    used, switches = stages * modes, (stages - 1) * modes
    width = used + switches + 1
    rows = list(_rows(shares.round(_DECIMALS), max_switches, dwell_stages))
    for group in needed:
        columns = [k * modes + m for k in range(stages) for m in group]
        rows.append((dict.fromkeys(columns, 1.0), 1.0, np.inf))
    cells = [(i, column, value) for i, row in enumerate(rows) for column, value in row[0].items()]
    at, places, values = zip(*cells, strict=True)
    matrix = csr_array((values, (at, places)), shape=(len(rows), width))
    objective = np.concatenate([np.zeros(used), np.full(switches, _PER_SWITCH), [1.0]])
    result = milp(
        objective,
        constraints=LinearConstraint(matrix, [row[1] for row in rows], [row[2] for row in rows]),
        integrality=np.repeat([1, 0], [used, switches + 1]),
        bounds=Bounds(0.0, np.append(np.ones(width - 1), np.inf)),
        options={"time_limit": time_limit_s},
    )
    if result.x is None:
        return Rounding(str(result.message), None, np.inf)
    choice = result.x[:used].reshape(stages, modes).argmax(axis=1)
    return Rounding(str(result.message), tuple(choice.tolist()), float(result.x[-1]))


def _rows(shares: Array, max_switches: int, dwell_stages: int) -> Iterator[_Row]:
    """Yield the constraints as ({column: coefficient}, lower, upper)."""
    stages, modes = int(shares.shape[0]), int(shares.shape[1])
    error = stages * modes + (stages - 1) * modes

    def on(k: int, m: int) -> int:
        return k * modes + m

    def switched(k: int, m: int) -> int:
        return (stages + k - 1) * modes + m

    for k in range(stages):
        yield {on(k, m): 1.0 for m in range(modes)}, 1.0, 1.0
    for m in range(modes):
        for k, sum_of_shares in enumerate(np.cumsum(shares[:, m]).tolist()):
            sum_of_choices = {on(i, m): -1.0 for i in range(k + 1)}
            yield {**sum_of_choices, error: 1.0}, -sum_of_shares, np.inf
            yield {**sum_of_choices, error: -1.0}, -np.inf, -sum_of_shares
        for i in range(1, min(stages, dwell_stages)):
            yield {on(i, m): 1.0, on(0, m): -1.0}, 0.0, np.inf
        for k in range(1, stages):
            yield {switched(k, m): 1.0, on(k, m): -1.0, on(k - 1, m): 1.0}, 0.0, np.inf
            for i in range(k, min(stages, k + dwell_stages)):
                yield {on(i, m): 1.0, switched(k, m): -1.0}, 0.0, np.inf
    every = {switched(k, m): 1.0 for k in range(1, stages) for m in range(modes)}
    yield every, 0.0, float(max_switches)
