"""Cost of a trajectory, from its samples alone: what plans state, and what is compared with bounds.

Time is that of the last sample, energy the heat of the sampled currents in the coils, and effort
the integral of the sum of (wheel speed / largest wheel speed)^2, by the inputs at the samples.
"""

from __future__ import annotations

import itertools

import numpy as np

from twosra_mpc.checking.heat import heated_states
from twosra_mpc.checking.reintegration import between
from twosra_mpc.plans.plan import Cost
from twosra_mpc.plans.trajectory import Samples, Trajectory, flown, wheel_speeds
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import segment_model

_CUT = 5e-3  # m: what an input moves at most from one place of the quadrature's cuts to the next
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for rigid motion, else to 1e-8


def cost_of(trajectory: Trajectory) -> Cost:
    """Cost of a trajectory [s], and what it is made of."""
    problem, samples = trajectory.problem, trajectory.samples
    weights, time_s = problem.cost_weights, float(samples.t_s[-1])
    count = len(trajectory.transitions)
    energy, effort = energy_J(problem, samples), effort_s(problem, samples)
    total = time_s + weights.energy_s_per_J * energy + weights.transition_s * count
    return Cost(total + weights.effort * effort, time_s, energy, count, effort)


def effort_s(problem: Problem, samples: Samples) -> float:
    """Integral of the sum of (wheel speed / largest wheel speed)^2 over the samples [s].

    By Gauss and Legendre's rule, on intervals that are cut where soft segments bend.
    """
    robot = problem.robot
    fine, at = between(samples, np.where(samples.mode[:-1].any(axis=1), _CUT, np.inf), least=0)
    rows = np.flatnonzero(fine.moves[:-1])
    lasting, at = np.diff(fine.t_s)[rows], at[rows]
    since = fine.t_s[rows] - samples.t_s[at] + (1 + _NODES[:, None]) / 2 * lasting
    at, since = np.tile(at, len(_NODES)), since.reshape(-1, 1)
    v, a, mode = samples.v[at], samples.a[at], samples.mode[at]
    q, soft = samples.q[at], mode.any(axis=1)  # a rigid robot's wheels turn alike wherever it is
    if soft.any():
        q[soft] = flown(robot, q[soft], ((v + a * since / 2) * since)[soft], mode[soft])
    squares = (wheel_speeds(robot, q, v + a * since, mode) ** 2).sum(axis=1)
    mean = _WEIGHTS / 2 @ squares.reshape(len(_NODES), -1)
    return float(mean @ lasting) / robot.limits.wheel_speed_rad_s**2


def energy_J(problem: Problem, samples: Samples) -> float:
    """Heat that the sampled currents give off in all coils [J]."""
    t, currents = samples.t_s, samples.heater_current_A
    if not problem.transition_times.needs_segment:
        squares = np.diff(t) @ currents[:-1] ** 2
        return problem.robot.heater.resistance_ohm * float(squares.sum())
    total = 0.0
    for j, own in enumerate(currents.T):
        model = segment_model(problem.robot, problem.ambient, j)
        states = np.column_stack(heated_states(problem, samples, j, model))
        turns = [0, *(np.flatnonzero(np.diff(own[:-1])) + 1).tolist(), len(t) - 1]
        for begin, end in itertools.pairwise(turns):
            if own[begin]:
                state, lasting = tuple(states[begin].tolist()), float(t[end] - t[begin])
                total += model.energy_J(state, float(own[begin]), lasting)
    return total
