"""Cost of a trajectory, from its samples alone: what plans state, and what is compared with bounds.

Time is that of the last sample, energy the heat of the sampled currents in the coils, and effort
the integral of the sum of (wheel speed / largest wheel speed)^2, by the inputs at the samples.
"""

from __future__ import annotations

import itertools

import numpy as np

from twosra_mpc.checking.reintegration import between
from twosra_mpc.control.heated_segment import confirming_windows
from twosra_mpc.plans.plan import Cost, Plan
from twosra_mpc.plans.trajectory import Trajectory, flown
from twosra_mpc.problem.driven import driven
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import segment_model
from twosra_mpc.thermal.model import State

_CUT = 1e-2  # m: what an input moves at most from one of the quadrature's cuts to the next


def cost_of(trajectory: Trajectory) -> Cost:
    """Cost of a trajectory [s], and what it is made of."""
    problem, samples = trajectory.problem, trajectory.samples
    weights, time_s = problem.cost_weights, float(samples.t_s[-1])
    count = len(trajectory.transitions)
    energy, effort = energy_J(trajectory), effort_s(trajectory)
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


def energy_J(trajectory: Trajectory) -> float:
    """Heat that the sampled currents give off in all coils [J]."""
    problem, t = trajectory.problem, trajectory.samples.t_s
    currents = trajectory.samples.heater_current_A
    if not problem.transition_times.needs_segment:
        squares = np.diff(t) @ currents[:-1] ** 2
        return problem.robot.heater.resistance_ohm * float(squares.sum())
    total = 0.0
    for model, states, own in zip(
        problem.segment_models, trajectory.metal, currents.T, strict=True
    ):
        turns = [0, *(np.flatnonzero(np.diff(own[:-1])) + 1).tolist(), len(t) - 1]
        for begin, end in itertools.pairwise(turns):
            if own[begin]:
                state = tuple(float(values[begin]) for values in states)
                lasting = float(t[end] - t[begin])
                total += model.energy_J(state, float(own[begin]), lasting)
    return total


_ROUNDS = 20  # to find when to switch on a segment that cools or warms meanwhile


def walked_s(plan: Plan) -> float:
    """Time in which the phases and the changes of metal between them are confirmed [s].

    Raises:
        InputError: If the robot does not describe its segments.
    """
    problem, now_s, phases = plan.problem, 0.0, plan.phases
    segments = [_Segment(problem, j) for j in range(problem.robot.coordinates.segments)]
    modes, lasting = [phase.mode for phase in phases], [one.end_s - one.start_s for one in phases]
    for mode, for_s in zip([*modes, plan.last_mode], [*lasting, 0.0], strict=True):
        known = [one.known_s(soft == 1, now_s) for one, soft in zip(segments, mode, strict=True)]
        now_s = max(now_s, *known) + for_s
    return now_s


class _Segment:
    """A segment (from 0) on its way: its state at a time, from which on it is soft or not."""

    def __init__(self, problem: Problem, j: int) -> None:
        robot, bodies = problem.robot, problem.start.body_temperature_C
        self._model = model = segment_model(robot, problem.ambient, j)
        here_C, share = problem.temperatures[j], problem.melt_fractions[j]
        self._state: State = model.initial(here_C, share, None if bodies is None else bodies[j])
        self._windows = confirming_windows(robot, problem.ambient, j)
        self._heater, self._since_s = robot.heater, 0.0
        first = problem.start_stiffness[j]
        self._soft = None if first is None else first == 1

    def known_s(self, soft: bool, now_s: float) -> float:
        """When it is known to be soft, or rigid, if what came before is done now."""
        if soft == self._soft:
            return 0.0
        changed = self._melted_s if soft else self._frozen_s
        self._soft, self._since_s = soft, changed(now_s)
        return self._since_s

    def _melted_s(self, now_s: float) -> float:
        model, full_A, on_s = self._model, self._heater.melt_current_A, self._since_s
        for _ in range(_ROUNDS):
            state = model.propagate(self._state, 0.0, on_s - self._since_s)
            solid = model.level(state) < model.solid_level
            lead_s = model.time_until(state, full_A, model.solid_level) if solid else 0.0
            on_s = max(self._since_s, now_s - self._windows.melt_early * lead_s)
        for_s = self._windows.melt_late * model.time_until(state, full_A, model.liquid_level)
        self._state = self._heated(state, for_s)
        return on_s + for_s

    def _frozen_s(self, now_s: float) -> float:
        model, state = self._model, self._state
        if self._soft:
            state = self._heated(state, now_s - self._since_s)
        for_s = self._windows.freeze_late * model.time_until(state, 0.0, model.solid_level)
        self._state = model.propagate(state, 0.0, for_s)
        return now_s + for_s

    def _heated(self, state: State, for_s: float) -> State:
        """Brought to the soft set-point and held there."""
        model, level = self._model, self._model.level_at(self._heater.soft_setpoint_C)
        current_A = 0.0 if model.level(state) > level else self._heater.melt_current_A
        there_s = min(for_s, model.time_until(state, current_A, level))
        return model.hold(model.propagate(state, current_A, there_s), for_s - there_s)
