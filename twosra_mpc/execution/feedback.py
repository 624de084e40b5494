"""By what a plan is run, if not by a camera: reports of temperatures, or its own times."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Trajectory
from twosra_mpc.robot.modes import Mode

if TYPE_CHECKING:
    from twosra_mpc.execution.runner import Abort, PlanRunner

Array = NDArray[np.float64]

_WHOLE = 1e-9  # rounding of a number of periods


class ByReports:
    """Heaters by events, phases when the reports confirm what they need, wheels as planned.

    A melt is not let begin before the phases are done that need the segment rigid, and a heater
    goes off when the last phase is done that needs the segment soft.
    """

    def setpoint_C(self, run: PlanRunner) -> Array:
        """Set-points of the plan now, (n,)."""
        return run.schedule.setpoints(run.progress)

    def ready(self, run: PlanRunner, mode: Mode, planned_s: float) -> bool:
        """Whether the robot may drive in ``mode``, planned from ``planned_s`` on; early or late."""
        return run.session.mode == mode

    def drive(self, run: PlanRunner, index: int) -> Abort | None:
        """Drive a phase of the plan, and stand while a segment is not as it must be."""
        phase, session = run.plan.phases[index], run.session
        for order in wheel_commands(run.plan.trajectory, phase, session.robot.camera.rate_Hz):
            if (left := run.wait_for(phase.mode, order.start_s, held=phase.mode)) is not None:
                return left
            session.drive(phase.mode, order.wheel_rad_s, run.setpoint_C, run.planned)
            run.clock_s = order.end_s
        return None


class ByClock(ByReports):
    """Heaters and phases at the plan's own times, for a robot that reports nothing."""

    def setpoint_C(self, run: PlanRunner) -> Array:
        """Set-points in force at the plan's time, (n,)."""
        setpoints: Array = run.plan.trajectory.heater_setpoint_C([run.clock_s])[0]
        return setpoints

    def ready(self, run: PlanRunner, mode: Mode, planned_s: float) -> bool:
        """Whether it is time."""
        return run.clock_s >= planned_s - SAME_TIME_S


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
