"""What lets a phase begin: reports that the segments are soft and rigid as it needs, or the time.

A report is the raw reading of a thermistor. What it means is decided by the same stiffness
controller that the simulated robot has, run beside the real one: it assumes the current that it
would apply itself, and knows soft from rigid by the reading and by its observer.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from twosra_mpc.control.controller import StiffnessController, stiffness_controller
from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.execution.heater_schedule import HeaterSchedule, Progress, heater_schedule
from twosra_mpc.execution.serial.firmware_lines import Report
from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.modes import Mode, Stiffness

SILENT_S = 5.0  # the follow-up robot reports every second
LATE = 2.0  # a transition may take so many times the planned time more than the planned time,
LEAST_TRANSITION_S = 20.0  # of which so much is taken at least

_SAME_TIME_S = 1e-6


class Confirmation(Protocol):
    """Decides which heaters are on, and whether a mode is there. ``now`` is the plan's progress."""

    def heated(self, now: Progress) -> Mode:
        """1 for each segment to heat now, 0 for one to let cool."""

    def take(self, reports: Sequence[Report], heated: Mode, time_s: float) -> None:
        """Take in the reports since the last call, during which ``heated`` was commanded."""

    def trouble(self, time_s: float) -> str | None:
        """Why the robot must be stopped now, in words."""

    def ready(self, mode: Mode, now: Progress, planned_s: float) -> bool:
        """Whether the robot may drive in ``mode``, planned from ``planned_s`` on."""

    def patience_s(self, mode: Mode) -> float:
        """How much later than planned a mode may come."""

    def describe(self) -> str:
        """What is known about the segments, in words."""


class ByTime:
    """Heaters and phases at the plan's own times, for firmware that reports nothing."""

    def __init__(self, plan: Plan) -> None:
        """Take a plan that has samples."""
        assert plan.samples is not None
        self._t_s = plan.samples.t_s
        self._soft = plan.samples.heater_setpoint_C >= plan.robot.heater.soft_setpoint_C

    def heated(self, now: Progress) -> Mode:
        """Whether the plan's set-points are the soft one."""
        at = int(np.searchsorted(self._t_s, now.clock_s + _SAME_TIME_S, side="right")) - 1
        first, second = self._soft[max(at, 0)].tolist()
        return int(first), int(second)

    def take(self, reports: Sequence[Report], heated: Mode, time_s: float) -> None:
        """Ignore them."""

    def trouble(self, time_s: float) -> str | None:
        """None that would be known."""
        del time_s
        return None

    def ready(self, mode: Mode, now: Progress, planned_s: float) -> bool:
        """Whether it is time."""
        del mode
        return now.clock_s >= planned_s - _SAME_TIME_S

    def patience_s(self, mode: Mode) -> float:
        """No limit: time passes."""
        del mode
        return math.inf

    def describe(self) -> str:
        """That nothing is known."""
        return "by the plan's times"


class ByReports:
    """Heaters by events, phases when the reports confirm what they need.

    A melt is not let begin before the phases are done that need the segment rigid, and a heater
    goes off when the last phase is done that needs the segment soft.
    """

    def __init__(self, plan: Plan, first: Sequence[Report], time_s: float) -> None:
        """Start with the first reports of both segments, which have rested."""
        self._schedule: HeaterSchedule = heater_schedule(plan)
        self._soft_C = plan.robot.heater.soft_setpoint_C
        self._segments = tuple(
            _ReportedSegment(
                stiffness_controller(plan.robot, plan.problem.ambient, j),
                [report.temperature_C for report in first if report.segment == j],
                time_s,
            )
            for j in range(plan.robot.coordinates.segments)
        )

    def heated(self, now: Progress) -> Mode:
        """Whether the schedule's set-points are the soft one."""
        first, second = (self._schedule.setpoints(now) >= self._soft_C).tolist()
        return int(first), int(second)

    def take(self, reports: Sequence[Report], heated: Mode, time_s: float) -> None:
        """Tell each segment's controller."""
        for j, segment in enumerate(self._segments):
            readings = [report.temperature_C for report in reports if report.segment == j]
            if readings:
                segment.take(readings, "soft" if heated[j] else "rigid", time_s)

    def trouble(self, time_s: float) -> str | None:
        """A segment that is silent, too hot, or does not warm."""
        troubles = (segment.trouble(time_s) for segment in self._segments)
        named = (f"segment {j}: {text}" for j, text in enumerate(troubles, 1) if text)
        return next(named, None)

    def ready(self, mode: Mode, now: Progress, planned_s: float) -> bool:
        """Whether both segments are confirmed, early or late."""
        del now, planned_s
        return all(
            segment.stiffness == ("soft" if soft else "rigid")
            for segment, soft in zip(self._segments, mode, strict=True)
        )

    def patience_s(self, mode: Mode) -> float:
        """As long as the plan gives the slowest segment for such a transition, twice."""
        planned = (self._schedule.expected_s(j, "soft" if mode[j] else "rigid") for j in (0, 1))
        return LATE * max(LEAST_TRANSITION_S, *planned)

    def describe(self) -> str:
        """Stiffness and temperature of both segments."""
        return ", ".join(
            f"segment {j} {segment.stiffness} at {segment.temperature_C:.1f} C"
            for j, segment in enumerate(self._segments, 1)
        )


class _ReportedSegment:
    """One segment, known by the last three of its reports: single ones can be far off."""

    def __init__(
        self, controller: StiffnessController, first_C: list[float], time_s: float
    ) -> None:
        self._controller, self._recent_C, self._last_s = controller, first_C[-3:], time_s
        self._state = controller.start(statistics.median(self._recent_C))

    @property
    def stiffness(self) -> KnownStiffness:
        """What the controller knows, unless the reading says the opposite: it only ever lags."""
        known, rule = self._state.stiffness, self._controller.rule
        frozen = known == "soft" and self.temperature_C < rule.solid_below_C
        molten = known == "rigid" and self.temperature_C > rule.liquid_above_C
        return "changing" if frozen or molten else known

    @property
    def temperature_C(self) -> float:
        return self._controller.segment_C(statistics.median(self._recent_C))

    def take(self, readings_C: list[float], setpoint: Stiffness, time_s: float) -> None:
        self._recent_C = [*self._recent_C, *readings_C][-3:]
        if (duration_s := time_s - self._last_s) > 0:
            measured_C = statistics.median(self._recent_C)
            self._state, _ = self._controller.step(self._state, setpoint, measured_C, duration_s)
            self._last_s = time_s

    def trouble(self, time_s: float) -> str | None:
        if time_s - self._last_s > SILENT_S:
            return f"no readable temperature report for {time_s - self._last_s:.0f} s"
        match self._state.protection:
            case "tripped":
                return f"too hot, {self.temperature_C:.1f} C"
            case "fault":
                return f"heating does not warm it, {self.temperature_C:.1f} C: heater or sensor?"
            case "none":
                return None
