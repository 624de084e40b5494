r"""Gentle motion: of all schedules of a plan's mode sequence that cost no more, the least effort.

A phase that is travelled in T instead of its least time T_min takes the effort E T_min / T, where E
is the integral of the sum of (wheel speed / largest wheel speed)^2 of its quickest profile. So

.. math::
    \min_{t}\; \sum_i E_i T_{min,i} / (t_{end,i} - t_{start,i}) \quad\text{s.t.}\quad
    t_v - t_u \ge w_{uv}, \quad T_{min,i} \le t_{end,i} - t_{start,i} \le T_{max,i}, \quad
    c^T t \le C

is a small convex program over the event times of the temporal network: waiting time is used to
drive slowly, and what the plan may cost more is spent where it helps most. Of waiting time a phase
uses only a part: a drive that lasts right up to a melt holds the heater up as soon as it takes
longer than planned. What happens before a transition decides how long it takes, so the schedule of
the durations found is made anew.

Where the cost itself weighs effort by w > 0, nothing may cost more: the objective is then
:math:`c^T t + w \sum_i E_i T_{min,i} / (t_{end,i} - t_{start,i})`, without the last constraint.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.bounds.schedule import cost_coefficients, feasible_schedule
from twosra_mpc.planning.solver.fixed_sequence import Candidate
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import ROUNDING
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.timing import TemporalNetwork

_ITERATIONS = 60
_EXACT = 1e-9  # of the mean of s z; the gradient may miss a hundred times that, or rounding
_LOOSE = 1e-9  # by which every row may be missed: rows may leave no room between them
_SHARE = 0.995  # of the way to where a slack or a multiplier is zero
_CENTRED = 0.03  # of the mean of s z, in a step
_LEAST = 1e-10  # mean that a step aims at: what is much smaller leaves the gradient to rounding
_CONTRADICTED = 1e12  # mean of s z beyond which rows contradict each other: z only grows
_REGULAR = 1e-15  # added to a diagonal of ones: some units of rounding


def minimum(e: Array, lasting: Array, price: Array, rows: Array, least: Array, t: Array) -> Array:
    r"""Minimum of a small convex program by a primal-dual interior point method.

    .. math:: \min_t\; \sum_i e_i / (L t)_i + p^T t \quad\text{s.t.}\quad A t \ge b

    With slacks s = A t - b and multipliers z, Newton's method on the optimality conditions, with
    s z equal to a mean that is driven to zero (Nocedal and Wright, ch. 19). The system's matrix may
    be singular: rows may repeat or contradict each other, numerators may be zero, and directions
    free. So it is scaled to a diagonal of ones and regularised. Where Newton's method ends early,
    the last t that it came to is returned.

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
    z, off = 1e-2 / slack, np.inf
    for _ in range(_ITERATIONS):
        charge(Cost.NEWTON_STEP, len(t) + len(least))
        d = lasting @ t
        each = e / d**2
        dual, primal = price - each @ lasting - z @ rows, rows @ t - slack - least
        mean = float(slack @ z) / len(z)
        off, before = float(np.abs(dual).max()), off
        exact = max(mean, np.abs(primal).max()) <= _EXACT
        if exact and (off <= 100 * _EXACT or (mean <= 2 * _LEAST and off >= before)):
            break
        if mean > _CONTRADICTED:
            break
        ratio, aim = z / slack, max(_CENTRED * mean, _LEAST) / slack - z
        hessian = (lasting.T * (2 * each / d)) @ lasting + (rows.T * ratio) @ rows
        step = _newton(hessian, (aim - ratio * primal) @ rows - dual)
        if not np.isfinite(step).all():
            break
        slack_step = rows @ step + primal
        z_step = aim - ratio * slack_step
        size = _most(np.append(slack, d), np.append(slack_step, lasting @ step))
        t, slack = t + size * step, slack + size * slack_step
        z = z + _most(z, z_step) * z_step
    return t


def _newton(hessian: Array, right: Array) -> Array:
    """Solve a symmetric system of no negative eigenvalue, regularised; NaN if nothing helps."""
    diagonal = hessian.diagonal()
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    try:
        scaled = scale[:, None] * hessian * scale + _REGULAR * np.eye(len(hessian))
        return scale * np.linalg.solve(scaled, scale * right)
    except np.linalg.LinAlgError:
        return np.full(len(right), np.nan)


def _most(values: Array, step: Array) -> float:
    """Largest share of a step, up to 1, that keeps values positive."""
    return min(1.0, _SHARE * float((values / np.maximum(-step, 1e-200)).min()))


Schedule = tuple[Array, TemporalNetwork]  # event times, and the network they fulfil

_SHARES = (1.0, 0.9, 0.7, 0.4, 0.1)  # of the way to what is wanted, until it fits
_SPARED = 0.4  # part of its time to spare that a phase uses
_STEP_S = 1e-3  # of durations, and more than the solver leaves of its constraints
_SLOWEST = 100.0  # times slower than the limits allow is slow enough


def cheapest(problem: Problem, candidate: Candidate, network: TemporalNetwork) -> Candidate:
    """Return the candidate at the durations of least cost, where the cost weighs effort.

    Args:
        problem: The problem.
        candidate: A feasible plan at the highest speed.
        network: The temporal network of its sequence.
    """
    weight, best = problem.cost_weights.effort, candidate
    quickest, slowest, efforts = _durations_and_efforts(problem, candidate)
    made = (candidate.times, candidate.settled) if weight and quickest.any() else None
    least = math.inf if made is None else _cost(made, problem) + weight * candidate.effort_s
    for _ in _SHARES:
        if made is None:
            break
        durations = _least_effort(problem, made, efforts, quickest, slowest, math.inf)
        made = feasible_schedule(network, durations, problem)
        slower = _lasting(candidate, durations, made) if made else best
        cost = _cost(made, problem) + weight * slower.effort_s if made else math.inf
        if cost >= (1 - ROUNDING) * least:
            break
        best, least = slower, cost
    return best


def gentle(
    problem: Problem, candidate: Candidate, network: TemporalNetwork, most: float
) -> Candidate | None:
    """Return the candidate at the least effort within a cost; None if nothing can be gained.

    Args:
        problem: The problem.
        candidate: A feasible plan at the highest speed.
        network: The temporal network of its sequence.
        most: What it may cost [s].
    """
    quickest, slowest, efforts = _durations_and_efforts(problem, candidate)
    if (slowest <= quickest).all():
        return None
    made = candidate.times, candidate.settled
    for share in _SHARES:
        wanted = _least_effort(problem, made, efforts, quickest, slowest, most)
        durations = quickest + np.floor(share * (wanted - quickest) / _STEP_S) * _STEP_S
        found = feasible_schedule(network, durations, problem)
        if found is not None and _cost(found, problem) <= (1 + ROUNDING) * most:
            return _lasting(candidate, durations, found)
        if found is not None:  # what these durations need of the metal is known now
            made = (made[0], found[1])
    return None


def _durations_and_efforts(problem: Problem, candidate: Candidate) -> tuple[Array, Array, Array]:
    """Least and largest durations of the phases [s], and E T_min [s2], each (phases,)."""
    profiles, slower = candidate.profiles, np.full(len(candidate.profiles), _SLOWEST)
    quickest = np.array([profile.duration_s for profile in profiles])
    if least := problem.robot.limits.wheel_speed_min_rad_s:  # wheels must leave the dead zone
        peaks = np.array([profile.peak_rad_s for profile in profiles])
        slower = np.clip(peaks / least, 1.0, _SLOWEST)
    efforts = np.array([profile.effort_s for profile in profiles]) * quickest
    return quickest, quickest * slower, efforts


def _lasting(candidate: Candidate, durations: Array, found: Schedule) -> Candidate:
    """The candidate with phases of these durations."""
    slower = zip(candidate.profiles, durations.tolist(), strict=True)
    stretched = tuple(profile.lasting(duration) for profile, duration in slower)
    return replace(candidate, profiles=stretched, times=found[0], settled=found[1])


def _cost(found: Schedule, problem: Problem) -> float:
    times, network = found
    coefficients, constant = cost_coefficients(network, problem.cost_weights)
    return float(coefficients @ times) + constant


def _least_effort(
    problem: Problem, made: Schedule, efforts: Array, quickest: Array, slowest: Array, most: float
) -> Array:
    """Durations of the convex program, (phases,) [s]; ``most`` is inf where effort has a weight."""
    times, network = made
    layout, moving = network.layout, np.flatnonzero(quickest > _STEP_S)
    cost, constant = cost_coefficients(network, problem.cost_weights)
    starts, ends = (np.array([at(i) for i in moving.tolist()]) for at in (layout.start, layout.end))
    kept = np.array(sorted({*np.flatnonzero(cost), *starts, *ends, layout.origin}))
    longest, of = _longest_paths(network), np.eye(len(kept))
    of[:, kept == layout.origin] = 0.0  # where time is 0
    apart = longest[np.ix_(kept, kept)]
    more = (most - float(cost @ times) - constant) / max(float(cost[layout.finish]), _STEP_S)
    spare = times[layout.finish] - longest[layout.origin, starts] - longest[ends, layout.finish]
    extra = np.maximum(_SPARED * (spare - quickest[moving]), max(more, 0.0))
    slowest = np.minimum(slowest[moving], quickest[moving] + extra)
    since, until = np.nonzero(np.isfinite(apart))
    lasting = of[np.searchsorted(kept, ends)] - of[np.searchsorted(kept, starts)]
    scale, unit = float(quickest.sum()), float((efforts[moving] / quickest[moving]).sum())
    price, weight = np.zeros(len(kept)), problem.cost_weights.effort
    if weight:
        unit += scale / weight
        price = cost[kept] * scale / (weight * unit)
    rows = [of[until] - of[since], lasting, -lasting, of]
    least = [apart[since, until], quickest[moving], -slowest, np.zeros(len(kept))]
    if not weight:
        rows.append(-cost[None, kept])
        least.append(np.array([min(_STEP_S + constant - most, -float(cost @ times))]))
    free = kept != layout.origin
    optimum = minimum(
        efforts[moving] / (unit * scale),
        lasting[:, free],
        price[free],
        np.concatenate(rows)[:, free],
        np.concatenate(least) / scale,
        times[kept][free] / scale,
    )
    durations = quickest.copy()
    durations[moving] = np.clip(lasting[:, free] @ optimum * scale, quickest[moving], slowest)
    return durations


def _longest_paths(network: TemporalNetwork) -> Array:
    """Longest paths: how far apart every two events are kept, (events, events) [s]; -inf: free."""
    apart = np.full((network.layout.count, network.layout.count), -np.inf)
    for (u, v), least in network.least.items():
        apart[u, v] = least
    for between in range(len(apart)):
        apart = np.maximum(apart, apart[:, between, None] + apart[between])
    np.fill_diagonal(apart, -np.inf)
    return apart
