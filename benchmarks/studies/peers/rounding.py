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

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

_PER_SWITCH = 0.05  # stages of approximation error that one switch fewer is worth
_DECIMALS = 4  # of the shares; what is left of vanished shares upsets HiGHS


class Rounding(NamedTuple):
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
    shares: NDArray[np.float64],
    needed: Sequence[Sequence[int]],
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
    opti, (stages, modes) = ca.Opti("conic"), shares.shape
    on, error = opti.variable(stages, modes), opti.variable()
    switched = ca.vertcat(on[0, :], opti.variable(stages - 1, modes))  # the first: on from there
    sums = ca.DM(np.tri(stages)) @ (shares.round(_DECIMALS) - on)
    changes = ca.sum1(ca.sum2(switched)) - 1
    opti.set_domain(on, "integer")
    opti.subject_to(opti.bounded(0, ca.vec(on), 1))
    opti.subject_to(ca.vec(switched) >= 0)
    opti.subject_to(ca.sum2(on) == 1)
    opti.subject_to(ca.vec(sums) <= error)
    opti.subject_to(ca.vec(sums) >= -error)
    opti.subject_to(ca.vec(switched[1:, :] - on[1:, :] + on[:-1, :]) >= 0)
    for later in range(1, min(stages, dwell_stages)):
        opti.subject_to(ca.vec(on[later:, :] - switched[: stages - later, :]) >= 0)
    for group in needed:
        opti.subject_to(sum(ca.sum1(on[:, m]) for m in group) >= 1)
    opti.subject_to(changes <= max_switches)
    opti.minimize(error + _PER_SWITCH * changes)
    settings = {"output_flag": False, "time_limit": time_limit_s}
    opti.solver("highs", {"print_time": False, "error_on_fail": False, "highs": settings})
    try:
        choice = np.reshape(opti.solve().value(on), (stages, modes)).argmax(axis=1)
    except RuntimeError:
        return Rounding(opti.stats()["return_status"], None, np.inf)
    return Rounding(opti.stats()["return_status"], tuple(choice.tolist()), float(opti.value(error)))
