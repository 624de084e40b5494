"""Time until a robot knows that a plan is done, by a walk through its phases."""

from __future__ import annotations

from twosra_mpc.control.heated_segment import confirming_windows
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import segment_model
from twosra_mpc.thermal.model import State

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
    """A segment (from 0): its thermal state, and since when it is soft or rigid."""

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
        """Time at which it is confirmed soft, or rigid, if the phase before ends now [s]."""
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
