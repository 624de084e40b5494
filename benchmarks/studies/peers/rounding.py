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
from scipy.optimize import Bounds, LinearConstraint, milp

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
    # By SciPy: CasADi's own HiGHS and that of highspy, in the planner, do not share a process.
    at_0 = ca.Function("rows", [opti.x], [opti.f, opti.g, opti.lbg, opti.ubg])(0)
    offset, low, high = (part.full().ravel() for part in at_0[1:])
    matrix = ca.evalf(ca.jacobian(opti.g, opti.x)).sparse()
    found = milp(
        ca.evalf(ca.gradient(opti.f, opti.x)).full().ravel(),
        integrality=np.arange(opti.nx) < on.numel(),
        bounds=Bounds(-np.inf, np.inf),
        constraints=LinearConstraint(matrix, low - offset, high - offset),
        options={"time_limit": time_limit_s},
    )
    if found.x is None:
        return Rounding(found.message, None, np.inf)
    choice = np.reshape(found.x[: on.numel()], (stages, modes), order="F").argmax(axis=1)
    return Rounding(found.message, tuple(choice.tolist()), float(found.x[on.numel()]))
