"""Playing a plan as it is, without a camera: by reports of the segments, or by the clock."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twosra_mpc.execution.belief import Belief
from twosra_mpc.execution.controller import Activity, Next, Trouble, rest
from twosra_mpc.execution.course import Course, PlanPolicy, Waiting
from twosra_mpc.execution.robot_interface import Command
from twosra_mpc.execution.run import Ending, Verdict
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Trajectory
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode

_WHOLE = 1e-9  # rounding of a number of periods


class WheelCommand(NamedTuple):
    """Wheel speeds [rad/s], (4,), for one period, and the plan's time at its start and end [s]."""

    wheel_rad_s: Array
    start_s: float
    end_s: float


def wheel_commands(trajectory: Trajectory, phase: Phase, rate_Hz: float) -> list[WheelCommand]:
    """Divide a phase into equal parts, one a period of the controller.

    In each period the wheels turn exactly as far as in that part of the phase. A phase that does
    not last a whole number of periods is stretched to the next: the robot follows the same path a
    little slower, never faster.
    """
    count = max(1, math.ceil((phase.end_s - phase.start_s) * rate_Hz - _WHOLE))
    ends = np.linspace(phase.start_s, phase.end_s, count + 1)
    turned = np.diff(trajectory.wheel_travel_rad(ends), axis=0)
    return [
        WheelCommand(turned[k] * rate_Hz, float(ends[k]), float(ends[k + 1])) for k in range(count)
    ]


class Playing(PlanPolicy):
    """A policy: phases begin when reports confirm what they need, wheels turn as planned.

    A robot that reports nothing begins its phases, and switches its heaters, at the plan's times.

    Attributes:
        course: The plan on its way.
        during: What the run is at, in words.
    """

    longest_s = math.inf

    def __init__(self, belief: Belief, plan: Plan, *, reports: bool) -> None:
        """The robot is where the plan starts."""
        self.course, self._reports = Course(belief, plan), reports
        self.during = "before the plan begins"

    @property
    def setpoint_C(self) -> Array:
        """Set-points of the plan now, (n,)."""
        course = self.course
        planned_C: Array = course.plan.trajectory.heater_setpoint_C([course.clock_s])[0]
        return course.setpoint_C if self._reports else planned_C

    def ready(self, mode: Mode, planned_s: float) -> bool:
        """True if the robot may drive in ``mode``, planned from ``planned_s`` on."""
        in_time = self.course.clock_s >= planned_s - SAME_TIME_S
        return super().ready(mode, planned_s) if self._reports else in_time

    def arrived(self, index: int) -> Next:
        """Play a phase, or end."""
        course, plan = self.course, self.course.plan
        if index == len(plan.phases):
            return self.verdict(Ending.LOGGED, "the plan was sent to its end")
        self.during = f"in {course.name(index)}"
        course.belief.tell("drive", f"{course.name(index)} begins")
        return _Phase(self, index)

    def verdict(self, ending: Ending, reason: str) -> Verdict:
        """An ending of the run."""
        return Verdict("stream", ending, reason, (self.course.plan,), (self.course.begun,))

    def learnt(self, index: int, what: str) -> None:
        """Go on: without poses nothing is planned again."""

    def troubled(self, trouble: Trouble) -> Activity:
        """End the run: without poses nothing is planned again.

        Raises:
            SegmentError: Always, or what else it is.
        """
        raise trouble


class _Phase:
    """A phase that is played; a robot that loses its mode stands meanwhile."""

    def __init__(self, policy: Playing, index: int) -> None:
        self._policy, self._index, course = policy, index, policy.course
        self._phase = course.plan.phases[index]
        rate_Hz = course.belief.camera.rate_Hz
        self._orders = wheel_commands(course.plan.trajectory, self._phase, rate_Hz)

    def advance(self) -> Next:
        policy, course, belief = self._policy, self._policy.course, self._policy.course.belief
        mode = self._phase.mode
        if not self._orders:
            course.end(self._phase)
            return Waiting(policy, self._index + 1)
        ready = policy.ready(mode, course.clock_s)
        if not ready:
            setpoint_C = course.held(policy.setpoint_C, mode)
            return rest(belief, setpoint_C, belief.patience.rest_s, course)
        order = self._orders.pop(0)
        command = Command(
            policy.setpoint_C, belief.camera.period_s, order.wheel_rad_s, mode, course.planned
        )
        course.clock_s = order.end_s
        return command
