"""Course of a plan that is carried out: its clock, its heaters by events, what it waits for.

The plan's clock stands at a phase's start until the phase can begin, and jumps there if that is
early. Heaters follow the events. A melt is not let begin before every phase in which the segment
must be solid is done, however long that takes; until then the segment is only kept warm. A heater
goes off when the last phase in which the segment must be soft is done, not at a time.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from twosra_mpc.control.stiffness import warm_setpoint_C
from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import Activity, Next, Policy, rest
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase
from twosra_mpc.robot.coordinates import Array, wrapped
from twosra_mpc.robot.modes import Mode, mode_name
from twosra_mpc.timing import Transition
from twosra_mpc.timing.transitions import own_transitions

_LONGER_S = 4.0  # than planned a segment may have to stay soft before that is known


class Course:
    """A plan on its way.

    Attributes:
        belief: What is known of the robot.
        plan: The plan.
        clock_s: Time of the plan; it stands at a phase's start until the phase can begin.
        done: How many phases have ended.
    """

    def __init__(self, belief: Belief, plan: Plan) -> None:
        """The robot is where the plan starts."""
        self.belief, self.plan = belief, plan
        self.clock_s, self.done = 0.0, 0
        self._planned = -1.0, np.empty(0)

    @cached_property
    def warm_C(self) -> float:
        """Set-point at which a segment is kept warm, surely solid."""
        return warm_setpoint_C(self.plan.robot, self.plan.problem.ambient)

    @property
    def setpoint_C(self) -> Array:
        """Set-points of the segments now, by events, (n,)."""
        planned = self.plan.trajectory.heater_setpoint_C([self.clock_s])[0].tolist()
        values = np.array([self._setpoint_C(j, each_C) for j, each_C in enumerate(planned)])
        heater, warm = self.plan.robot.heater, values == self.warm_C
        heated = np.count_nonzero(values == heater.soft_setpoint_C) + np.cumsum(warm)
        # As many are kept warm as may be heated besides those that melt.
        values[warm & (heated > self.plan.problem.heaters_at_once)] = heater.rigid_setpoint_C
        return values

    def _setpoint_C(self, segment: int, planned_C: float) -> float:
        heater = self.plan.robot.heater
        soft, rigid = heater.soft_setpoint_C, heater.rigid_setpoint_C
        value = soft if self.plan.problem.start_mode[segment] else rigid
        for item in own_transitions(self.plan.transitions, segment):
            if self._commanded(item):
                value = soft if item.to == "soft" else rigid
            elif item.to == "soft" and self.clock_s >= item.heater_s - SAME_TIME_S:
                value = self.warm_C
        kept_warm = rigid < planned_C < soft  # by the plan itself
        return self.warm_C if value == rigid and kept_warm else value

    def _commanded(self, item: Transition) -> bool:
        before = sum(phase.end_s <= item.onset_s + SAME_TIME_S for phase in self.plan.phases)
        early = item.to == "rigid" and before > 0  # the plan let it coast
        heated_s = item.heater_s - (self._lead_s(item) if before > 0 else 0.0)
        due = self.done >= before and (early or self.clock_s >= heated_s - SAME_TIME_S)
        return due and not (item.to == "soft" and self._coasts_beside(item, before))

    def _coasts_beside(self, item: Transition, before: int) -> bool:
        """True if liquid metal has yet to freeze before this melt: else bends would even out."""
        mode, belief = self.needs(before)[0], self.belief
        soft_C = self.plan.robot.heater.soft_setpoint_C
        asked = zip(mode, belief.reading.stiffness, belief.setpoint_C, strict=True)
        coasts = [not soft and now == "soft" and each_C < soft_C for soft, now, each_C in asked]
        return any(coasts[: item.segment - 1] + coasts[item.segment :])

    def _lead_s(self, item: Transition) -> float:
        """Time by which a melt is begun earlier than planned: other metal may freeze sooner.

        It is as long as the melt, which takes up to twice as long as described.
        """
        problem = self.plan.problem
        one_by_one = problem.heaters_at_once < len(problem.start_mode)
        return 0.0 if item.to == "rigid" or one_by_one else item.done_s - item.heater_s

    @property
    def soft_for_s(self) -> Array:
        """Time for which segments must stay soft, (n,); inf: nobody knows."""
        left_s = np.full(len(self.plan.problem.start_mode), np.inf)
        for item in reversed(self.plan.transitions):
            if item.to == "rigid" and not self._commanded(item):
                left_s[item.segment - 1] = item.onset_s - self.clock_s
        return left_s + _LONGER_S

    def end(self, phase: Phase) -> None:
        """End a phase; the clock goes on to its end, if it is not there yet."""
        self.done += 1
        self.clock_s = max(self.clock_s, phase.end_s)

    @property
    def begun(self) -> int:
        """Number of transitions commanded by now."""
        return sum(map(self._commanded, self.plan.transitions))

    def expected_s(self, segment: int, to: str) -> float:
        """Longest time the plan gives a segment (from 0) for such a transition [s]; 0: none."""
        own = own_transitions(self.plan.transitions, segment)
        return max((item.done_s - item.heater_s for item in own if item.to == to), default=0.0)

    @property
    def planned(self) -> Array:
        """Configuration of the plan now, (3 + n,); asked for several times a period."""
        if self._planned[0] != self.clock_s:
            q = self.plan.trajectory.configuration([self.clock_s])[0]
            self._planned = self.clock_s, q
        return self._planned[1]

    @property
    def away(self) -> Array:
        """How far from there the robot is, (3 + n,)."""
        away = self.belief.q - self.planned
        away[2] = wrapped(away[2])
        return away

    def name(self, index: int) -> str:
        """A phase in words; the number of phases is the plan's end."""
        phases = self.plan.phases
        if index == len(phases):
            return f"the end {mode_name(self.plan.last_mode)}"
        return f"phase {index + 1} of {len(phases)} {mode_name(phases[index].mode)}"

    def needs(self, index: int) -> tuple[Mode, float]:
        """Mode of a phase, or at the plan's end, and the time of the plan at which it is needed."""
        if index == len(self.plan.phases):
            return self.plan.last_mode, self.plan.trajectory.duration_s
        phase = self.plan.phases[index]
        return phase.mode, phase.start_s

    def held(self, setpoint_C: Array, mode: Mode) -> Array:
        """Set-points (n,) that keep soft what is soft in a mode, whatever the plan says."""
        return np.where(mode, self.plan.robot.heater.soft_setpoint_C, setpoint_C)


class PlanPolicy(Policy, Protocol):
    """A policy that carries a plan out."""

    course: Course

    def begin(self) -> Activity:
        """Wait for the first phase."""
        return Waiting(self, 0)

    @property
    def setpoint_C(self) -> Array:
        """Set-points of the plan now, (n,)."""
        return self.course.setpoint_C

    def ready(self, mode: Mode, planned_s: float) -> bool:
        """True if the robot may drive in ``mode``, planned from ``planned_s`` on; early or late."""
        return self.course.belief.mode == mode

    def arrived(self, index: int) -> Next:
        """Next activity when a phase may begin, or at the plan's end."""

    def learnt(self, index: int, what: str) -> Next | None:
        """Answer to news while a phase is waited for; None: wait on."""


class Waiting:
    """A robot that stands until a phase can begin; the plan's clock goes on to its start."""

    def __init__(self, policy: PlanPolicy, index: int) -> None:
        """Wait for a phase, or for the plan's end."""
        self._policy, self._index = policy, index
        self._begun_s = self._before_s = policy.course.belief.now_s
        self._from_s = policy.course.clock_s
        self._told, self._late = len(policy.course.belief.changes), False
        policy.during = f"waiting for {policy.course.name(index)}"

    def advance(self) -> Next:
        """Stand, or go on."""
        policy, course = self._policy, self._policy.course
        now_s, (mode, until_s) = course.belief.now_s, course.needs(self._index)
        course.clock_s = min(course.clock_s + now_s - self._before_s, max(until_s, course.clock_s))
        self._before_s = now_s
        ready = policy.ready(mode, until_s)
        if ready:
            course.clock_s = until_s
            return policy.arrived(self._index)
        if (what := self._learnt()) and (other := policy.learnt(self._index, what)) is not None:
            return other
        left_s, rest_s = until_s - course.clock_s, course.belief.patience.rest_s
        rest_s = min(left_s, rest_s) if left_s > SAME_TIME_S else rest_s
        return rest(course.belief, policy.setpoint_C, rest_s, course)

    def _learnt(self) -> str:
        """News since it was asked last, in words; empty if there are none."""
        course = self._policy.course
        changes, (mode, until_s) = course.belief.changes, course.needs(self._index)
        if len(changes) > self._told:
            self._told = len(changes)
            return f"segment {changes[-1].segment} is {changes[-1].to}"
        segments = enumerate(mode)
        planned_s = [course.expected_s(j, "soft" if s else "rigid") for j, s in segments]
        waited_s = course.belief.now_s - self._begun_s - (until_s - self._from_s)
        if self._late or waited_s <= course.belief.patience.slow * max(planned_s):
            return ""
        self._late = True
        return f"{course.name(self._index)} is {waited_s:z.0f} s late"
