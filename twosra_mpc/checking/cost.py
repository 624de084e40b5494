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
from twosra_mpc.plans.trajectory import Samples, Trajectory, flown
from twosra_mpc.problem.driven import driven
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import segment_model

_CUT = 1e-2  # m: what an input moves at most from one of the quadrature's cuts to the next


def cost_of(trajectory: Trajectory) -> Cost:
    """Cost of a trajectory [s], and what it is made of."""
    problem, samples = trajectory.problem, trajectory.samples
    weights, time_s = problem.cost_weights, float(samples.t_s[-1])
    count = len(trajectory.transitions)
    energy, effort = energy_J(problem, samples), effort_s(trajectory)
    total = time_s + weights.energy_s_per_J * energy + weights.transition_s * count
    return Cost(total + weights.effort * effort, time_s, energy, count, effort)


def effort_s(trajectory: Trajectory) -> float:
    """Integral of the sum of (wheel speed / largest wheel speed)^2 over the samples [s].

    By Simpson's rule, corrected by the derivatives at the ends of intervals: exact for rigid
    motion, else to 1e-7. Intervals are cut where soft segments bend.
    """
    samples, robot, moving = trajectory.samples, trajectory.problem.robot, trajectory.driven
    t_s = samples.t_s
    fine, at = between(samples, np.where(samples.mode[:-1].any(axis=1), _CUT, np.inf), least=0)
    if len(fine) > len(samples):
        since, t_s = (fine.t_s - samples.t_s[at])[:, None], fine.t_s
        s = (samples.v[at] + samples.a[at] * since / 2) * since
        q = flown(robot, samples.q[at], s, samples.mode[at])
        moving = driven(robot, q, fine.v, fine.a, np.append(np.diff(t_s), 0.0), fine.mode)
    lasting = np.append(np.diff(t_s), 0.0)[moving.rows]
    squares = (moving.wheel_rad_s**2).sum(axis=2)
    growth = 2 * (moving.wheel_rad_s * moving.wheel_rad_s2).sum(axis=2)
    mean = (7 * squares[0] + 16 * squares[1] + 7 * squares[2]) / 30
    mean += lasting * (growth[0] - growth[2]) / 60
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
        states = np.column_stack(heated_states(samples, j, model, problem.temperatures[j]))
        turns = [0, *(np.flatnonzero(np.diff(own[:-1])) + 1).tolist(), len(t) - 1]
        for begin, end in itertools.pairwise(turns):
            if own[begin]:
                state, lasting = tuple(states[begin].tolist()), float(t[end] - t[begin])
                total += model.energy_J(state, float(own[begin]), lasting)
    return total
