"""Running a plan without a camera: by its own times, or by reports of temperatures."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.runner import Abort, PlanRunner
from twosra_mpc.plans.trajectory import SAME_TIME_S, Phase, Trajectory
from twosra_mpc.robot.modes import Mode

Array = NDArray[np.float64]

_WHOLE = 1e-9  # rounding of a number of periods


class ByClock:
    """Heaters and phases at the plan's own times, for a robot that reports nothing."""

    def setpoint_C(self, run: PlanRunner) -> Array:
        """Set-points in force at the plan's time, (n,)."""
        setpoints: Array = run.plan.trajectory.at([run.clock_s]).heater_setpoint_C[0]
        return setpoints

    def ready(self, run: PlanRunner, mode: Mode, planned_s: float) -> bool:
        """Whether it is time."""
        return run.clock_s >= planned_s - SAME_TIME_S

    def drive(self, run: PlanRunner, index: int) -> Abort | None:
        """Turn the wheels as planned."""
        return _turn_wheels(run, index)


class ByReports:
    """Heaters by events, phases when the reports confirm what they need.

    A melt is not let begin before the phases are done that need the segment rigid, and a heater
    goes off when the last phase is done that needs the segment soft.
    """

    def setpoint_C(self, run: PlanRunner) -> Array:
        """Set-points by progress, (n,)."""
        return run.schedule.setpoints(run.progress)

    def ready(self, run: PlanRunner, mode: Mode, planned_s: float) -> bool:
        """Whether every segment is reported to be what the mode needs, early or late."""
        return run.session.mode == mode

    def drive(self, run: PlanRunner, index: int) -> Abort | None:
        """Turn the wheels as planned; stand while a segment is not as it must be."""
        return _turn_wheels(run, index)


def _turn_wheels(run: PlanRunner, index: int) -> Abort | None:
    phase, session = run.plan.phases[index], run.session
    for order in wheel_commands(run.plan.trajectory, phase, session.robot.camera.rate_Hz):
        if (left := run.wait_for(phase.mode, order.start_s, held=phase.mode)) is not None:
            return left
        session.drive(phase.mode, order.wheel_rad_s, run.setpoint_C, run.planned)
        run.clock_s = order.end_s
    return None


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
