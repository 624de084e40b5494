"""Heater set-points of a plan that is executed by events.

A melt is not let begin before every phase in which the segment must be solid is done, however long
that takes; until then the segment is only kept warm. A heater goes off when the last phase in which
the segment must be soft is done, not at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twosra_mpc.control.stiffness import stiffness_rule
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode
from twosra_mpc.timing import Transition
from twosra_mpc.timing.transitions import own_transitions

_WARM_SHARE = 0.7  # of the way from the air to where a segment may begin to melt, as observed


class Progress(NamedTuple):
    """How far the execution of a plan has come.

    Attributes:
        clock_s: Time of the plan; it stands at a phase's start until the phase can begin.
        done: How many phases have ended.
    """

    clock_s: float = 0.0
    done: int = 0


@dataclass(frozen=True)
class HeaterSchedule:
    """Set-points by progress.

    Attributes:
        plan: The plan.
    """

    plan: Plan

    @cached_property
    def warm_C(self) -> float:
        """Set-point at which a segment is kept warm, surely solid."""
        return warm_setpoint_C(self.plan.problem)

    @cached_property
    def _start_mode(self) -> Mode:
        """Asked for in every period of a run."""
        return self.plan.problem.start_mode

    @property
    def last_mode(self) -> Mode:
        """Mode that the plan ends in: the goal's, or as the last task leaves the segments."""
        mode = list(self._start_mode)
        for item in sorted(self.plan.transitions, key=lambda item: item.done_s):
            mode[item.segment - 1] = int(item.to == "soft")
        return tuple(mode)

    def setpoints(self, now: Progress) -> Array:
        """Set-points of the segments [C], (n,)."""
        planned = self.plan.trajectory.heater_setpoint_C([now.clock_s])[0].tolist()
        values = np.array([self._setpoint(j, now, each_C) for j, each_C in enumerate(planned)])
        heater, warm = self.plan.robot.heater, values == self.warm_C
        heated = np.count_nonzero(values == heater.soft_setpoint_C) + np.cumsum(warm)
        # As many are kept warm as may be heated besides those that melt.
        values[warm & (heated > self.plan.problem.heaters_at_once)] = heater.rigid_setpoint_C
        return values

    def begun(self, now: Progress) -> int:
        """How many transitions have been commanded by now."""
        return sum(self._commanded(item, now) for item in self.plan.transitions)

    def expected_s(self, segment: int, to: str) -> float:
        """Longest time the plan gives a segment (from 0) for such a transition [s]; 0: none."""
        own = own_transitions(self.plan.transitions, segment)
        return max((item.done_s - item.heater_s for item in own if item.to == to), default=0.0)

    def _setpoint(self, segment: int, now: Progress, planned_C: float) -> float:
        heater = self.plan.robot.heater
        soft, rigid = heater.soft_setpoint_C, heater.rigid_setpoint_C
        value = soft if self._start_mode[segment] else rigid
        for item in own_transitions(self.plan.transitions, segment):
            if self._commanded(item, now):
                value = soft if item.to == "soft" else rigid
            elif item.to == "soft" and _reached(now, item.heater_s):
                value = self.warm_C
        kept_warm = rigid < planned_C < soft  # by the plan itself
        return self.warm_C if value == rigid and kept_warm else value

    def _commanded(self, item: Transition, now: Progress) -> bool:
        before = sum(phase.end_s <= item.onset_s + SAME_TIME_S for phase in self.plan.phases)
        early = item.to == "rigid" and before > 0  # the plan let it coast
        return now.done >= before and (early or _reached(now, item.heater_s))


def _reached(now: Progress, time_s: float) -> bool:
    return now.clock_s >= time_s - SAME_TIME_S


def warm_setpoint_C(problem: Problem) -> float:
    """Temperature at which a segment is surely solid, even if its heater is a third stronger."""
    robot, air = problem.robot, problem.ambient
    segments = range(robot.coordinates.segments)
    melts_from_C = min(stiffness_rule(robot, air, j).rigid_until_C for j in segments)
    return air + _WARM_SHARE * (melts_from_C - air)
