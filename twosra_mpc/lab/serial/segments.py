"""Heaters of segments: on by temperature reports, or by the model's energy without any.

What firmware makes of "heat this segment" is not published: it may regulate, or let full current
flow for as long as it is told to, which takes a segment to 85 C and more. So the host switches
heaters itself, and leaves one on only where a ``hold_duty`` of 1 in the robot file says that the
firmware is known to regulate.
"""

from __future__ import annotations

import math
import statistics

from twosra_mpc.control.stiffness import KnownStiffness, stiffness_controller
from twosra_mpc.errors import RobotError
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Stiffness

MEDIAN_OF = 3  # reports: single ones can be far off
PULSE_S = 0.5  # a heater that holds by duty is on for at least so long
ABOVE_K = 1.0  # a hold begins so far above the set-point, for plans count on no less than that
MOST_K = 2.0  # and so far above it nothing is heated


class ModelledSegment:
    """A segment that reports nothing: heated by the energy that its model needs.

    ``melt_current_A`` is on until the model is a little above the soft set-point, and then for the
    robot's duty of the time, as long as the model, propagated with what was switched, is not below
    the set-point.
    """

    temperature_C, stiffness, faulty, current_A = math.nan, None, False, None
    _told, _asked = "", False

    def __init__(
        self, robot: Robot, air_C: float, segment: int, start_C: float, now_s: float
    ) -> None:
        """Start with a segment that has rested at this temperature."""
        self._unreadable = 0
        self.model, self._heater = segment_model(robot, air_C, segment), robot.heater
        self.state, self._last_s = self.model.initial(start_C), now_s
        self._on, self._held, self._owed_s = False, False, 0.0

    def switched(self, asked: bool, time_s: float) -> bool:
        """Propagate the model to now, and decide."""
        passed_s, self._last_s = time_s - self._last_s, time_s
        if passed_s > 0:
            current_A = self._heater.melt_current_A if self._on else 0.0
            self.state = self.model.propagate(self.state, current_A, passed_s)
        share = self._share() if asked else 0.0
        self._held = asked and share < 1.0
        self._owed_s = self._owed_s + (share - self._on) * passed_s if self._held else 0.0
        if not 0.0 < share < 1.0:
            self._on = share == 1.0
        elif self._owed_s <= 0.0 or self._owed_s >= PULSE_S:
            self._on = self._owed_s > 0.0
        return self._on

    def _share(self) -> float:
        """Share of the time for which the heater should be on."""
        if self._heater.hold_duty == 1.0:  # the firmware regulates
            return 1.0
        above_K = self.model.temperature_C(self.state) - self._heater.soft_setpoint_C
        if above_K < (0.0 if self._held else ABOVE_K):
            return 1.0
        return 0.0 if above_K > MOST_K else self._heater.duty_of_hold

    def take(self, readings_C: list[float], asked: bool, time_s: float) -> None:
        """Remember a report that should not come: it contradicts trust in the model."""
        self._asked = asked
        for reading_C in readings_C:
            if math.isfinite(reading_C):
                words = "drive it by its reports, one at least every 5 s"
                self._told = f"it reports {reading_C:z.1f} C, but is heated by its model: {words}"
            else:
                self._unreadable += 1
        if self._unreadable >= MEDIAN_OF:
            self._told = "nobody can read the temperatures it reports"

    def trouble(self, time_s: float, silent_s: float) -> str | None:
        """A segment that reports after all must not be heated by trust in its model."""
        return self._told if self._told and self._asked else None


class ColdSegment:
    """A segment that nothing is known of, neither by reports nor by a model: it is never heated."""

    temperature_C, stiffness, faulty, current_A = math.nan, None, False, None

    def __init__(self, segment: int) -> None:
        """Name it, from 0."""
        self._segment = segment

    def switched(self, asked: bool, time_s: float) -> bool:
        """Leave its heater off.

        Raises:
            RobotError: If it is asked to be soft.
        """
        if asked:
            words = f"segment {self._segment + 1} reports nothing, and there is no [segment]"
            raise RobotError(f"{words} in the robot file: nobody knows when it is hot")
        return False

    def take(self, readings_C: list[float], asked: bool, time_s: float) -> None:
        """Ignore reports: no controller reads them."""

    def trouble(self, time_s: float, silent_s: float) -> str | None:
        """None: no fault can be seen."""
        return None


class ReportedSegment:
    """A segment known by the last of its reports; each line counts, changed or not.

    Its heater is on while the stiffness controller, run beside the firmware, would apply the
    current that holds, or more: so it goes off a little before the set-point.

    Attributes:
        current_A: Root mean square since the last reading, for it is switched once in between;
            None where a ``hold_duty`` of 1 says that the firmware regulates: it does not tell.
    """

    def __init__(
        self, robot: Robot, air_C: float, segment: int, first_C: list[float], now_s: float
    ) -> None:
        """Start with the first reports of a segment that has rested."""
        self._controller = stiffness_controller(robot, air_C, segment)
        self._heater, self._recent_C = robot.heater, first_C[-MEDIAN_OF:]
        self.current_A: float | None = None if robot.heater.hold_duty == 1.0 else 0.0
        self._last_s, self._state = now_s, self._controller.start(statistics.median(self._recent_C))

    @property
    def stiffness(self) -> KnownStiffness:
        """Stiffness by the controller, which only lags, unless the reading says the opposite."""
        known, rule = self._state.stiffness, self._controller.rule
        frozen = known == "soft" and self.temperature_C < rule.solid_below_C
        molten = known == "rigid" and self.temperature_C > rule.liquid_above_C
        return "changing" if frozen or molten else known

    @property
    def temperature_C(self) -> float:
        """Temperature of the segment, by the median of the last reports."""
        return self._controller.segment_C(statistics.median(self._recent_C))

    @property
    def faulty(self) -> bool:
        """True if heating does not warm it."""
        return self._state.protection == "fault"

    def switched(self, asked: bool, time_s: float) -> bool:
        """True if the controller would let the current flow that holds, or more."""
        heater = self._heater
        on = asked and self._state.current_A >= heater.hold_current_A
        self.current_A = None if heater.hold_duty == 1.0 else on * heater.melt_current_A
        return on

    def take(self, readings_C: list[float], asked: bool, time_s: float) -> None:
        """Take in the reports since the last time, during which it was asked to be soft or not."""
        readings_C = [reading_C for reading_C in readings_C if math.isfinite(reading_C)]
        self._recent_C = [*self._recent_C, *readings_C][-MEDIAN_OF:]
        if readings_C and (duration_s := time_s - self._last_s) > 0:
            setpoint: Stiffness = "soft" if asked else "rigid"
            measured_C = statistics.median(self._recent_C)
            self._state = self._controller.step(self._state, setpoint, measured_C, duration_s)
            self._last_s = time_s

    def trouble(self, time_s: float, silent_s: float) -> str | None:
        """Reason why the robot must be stopped now, in words."""
        if time_s - self._last_s > silent_s:
            return f"no readable temperature report for {time_s - self._last_s:z.0f} s"
        if self._state.protection == "tripped":
            return f"too hot, {self.temperature_C:z.1f} C"
        return None
