"""What a segment's readings say that cannot be: a dead sensor or heater, a relay that is welded.

Every reading is compared with what the segment was asked to be and with its model's times. All that
is wrong is a `SegmentError` with the name of its cause.
"""

from __future__ import annotations

import math
from typing import Literal

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.control.thermistor import NtcDivider
from twosra_mpc.execution.robot_interface import RobotError
from twosra_mpc.execution.run import Ending
from twosra_mpc.execution.settings import Patience
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Stiffness

Cause = Literal["sensor", "fault", "hot", "relay", "cooling", "heater"]

ENDINGS: dict[Cause, Ending] = {
    "sensor": Ending.SENSOR_FAILED,
    "fault": Ending.HEATER_FAILED,
    "hot": Ending.TOO_HOT,
    "relay": Ending.HEATER_STUCK,
    "cooling": Ending.COOLS_SLOWLY,
    "heater": Ending.HEATER_FAILED,
}

_READABLE_C = NtcDivider().range_C
_TWICE = 2  # readings: single ones can be far off
_SAME_K = 0.5  # metal that freezes shows more between its set-point and its melting point
_WARMED_K, _SURELY_SOLID_K = 2.0, 5.0  # as the stiffness controller has it
_CAUGHT_UP_S = 30.0  # after which the sensor shows what the heater does
_LAGGED_S = 10.0  # what gets warmer from then on was not as warm before
_RISEN_K = 10.0  # more than a neighbour's heat; full current takes 10 s for it


class SegmentError(RobotError):
    """A segment that must not, or cannot, be heated any more.

    Attributes:
        cause: What is wrong with it.
        segment: Which, from 0.
    """

    def __init__(self, cause: Cause, segment: int, text: str) -> None:
        self.cause, self.segment, self.text = cause, segment, text
        super().__init__(f"segment {segment + 1}: {text}")

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.cause, self.segment, self.text))

    @property
    def ending(self) -> Ending:
        """How a run ends for that."""
        return ENDINGS[self.cause]


class SegmentWatch:
    """Watches one segment from reading to reading."""

    def __init__(
        self, robot: Robot, air_C: float, segment: int, patience: Patience, *, reports: bool
    ) -> None:
        """Watch a segment (from 0); ``reports``: whether its temperature must be reported."""
        self._segment, self._patience, self._reports = segment, patience, reports
        self._heater = robot.heater
        self._longest_s, self._dead_s = _longest_times_s(robot, air_C, segment, patience)
        self._unread_s = self._changed_s = self._apart_s = self._fault_s = math.nan
        self._asked: Stiffness | Literal["warm"] = "rigid"
        self._hot, self._lowest_C, self._first_C, self._last_C = 0, math.inf, math.nan, math.inf
        self._shown_C, self._cold = (math.inf, -math.inf), (math.nan, math.nan)

    def take(
        self,
        time_s: float,
        setpoint_C: float,
        temperature_C: float,
        stiffness: KnownStiffness | None,
        faulty: bool,
    ) -> None:
        """Look at a reading, and at the set-point in force before it.

        Raises:
            SegmentError: If something is wrong.
        """
        asked = self._asked_by(setpoint_C)
        if asked != self._asked or math.isnan(self._changed_s):
            self._asked, self._changed_s, self._apart_s = asked, time_s, time_s
            self._lowest_C, self._first_C = math.inf, math.nan
            self._shown_C, self._cold = (math.inf, -math.inf), (math.nan, math.nan)
        if not self._readable(time_s, temperature_C, stiffness):
            return
        since_s = time_s - self._changed_s
        pair_C, self._last_C = (self._last_C, temperature_C), temperature_C
        if since_s >= _LAGGED_S:
            self._lowest_C = min(self._lowest_C, max(pair_C))
        if math.isnan(self._first_C):
            self._first_C = temperature_C
        coldest_C, hottest_C = self._shown_C
        self._shown_C = min(coldest_C, temperature_C), max(hottest_C, temperature_C)
        self._check_heat(since_s, temperature_C, min(pair_C) - self._lowest_C)
        self._check_fault(time_s, temperature_C, stiffness, faulty)
        self._check_warming(time_s, temperature_C)
        self._check_progress(time_s, temperature_C, stiffness)

    def _asked_by(self, setpoint_C: float) -> Stiffness | Literal["warm"]:
        if setpoint_C >= self._heater.soft_setpoint_C:
            return "soft"
        return "rigid" if setpoint_C <= self._heater.rigid_setpoint_C else "warm"

    def _readable(
        self, time_s: float, temperature_C: float, stiffness: KnownStiffness | None
    ) -> bool:
        """Whether there is a temperature that a thermistor can show; not for long without."""
        coldest, hottest = _READABLE_C
        if coldest <= temperature_C <= hottest and stiffness is not None:
            self._unread_s = math.nan
            return True
        if not self._reports and stiffness is None and math.isnan(temperature_C):
            return False
        if math.isnan(self._unread_s):
            self._unread_s = time_s
        if time_s - self._unread_s >= self._patience.silent_s:
            since = f"for {time_s - self._unread_s:.0f} s"
            if coldest <= temperature_C <= hottest:
                known = f"its sensor reads {temperature_C:g} C, but its stiffness is None {since}"
                self._raise("sensor", f"{known}: report it as 'soft', 'rigid' or 'changing'")
            nothing = math.isnan(temperature_C)
            shown = "reports nothing" if nothing else f"reads {temperature_C:g} C"
            allowed = f"a thermistor reads from {coldest:g} to {hottest:g} C"
            words = f"its sensor {shown} {since}, {allowed}"
            self._raise("sensor", f"{words}: nobody knows how warm it is")
        return False

    def _check_heat(self, since_s: float, here_C: float, risen_K: float) -> None:
        """Too hot, or warmed by a heater that is told to be off."""
        limit_C, asked_C = self._heater.temperature_max_C, self._heater.soft_setpoint_C
        if self._asked == "soft" and here_C >= self._first_C + _RISEN_K / 2:
            limit_C = (asked_C + limit_C) / 2  # it warms on, and the sensor lags
        hot = here_C >= limit_C
        self._hot = self._hot + 1 if hot else 0
        if self._asked == "rigid":
            enough_K = _RISEN_K / 2 if self._hot else _RISEN_K
            if risen_K >= enough_K:  # since the sensor could show that it is off
                known = f"{here_C:.1f} C and rising, its heater off for {since_s:.0f} s"
                self._raise("relay", f"{known}: the heater does not go off (a welded relay?)")
            if since_s < _CAUGHT_UP_S:
                return  # it is off already, and the sensor lags
        if self._hot >= _TWICE:
            words = (
                f"too hot, {here_C:.1f} C: at most {limit_C:g} C, its set-point being {asked_C:g} C"
            )
            self._raise("hot", f"{words}; its heater does not go off")

    def _check_fault(
        self, time_s: float, here_C: float, stiffness: KnownStiffness | None, faulty: bool
    ) -> None:
        """A fault that does not pass with the heater off, while nobody knows what it is."""
        latched = faulty and self._asked == "rigid" and stiffness not in ("rigid", "soft")
        if not latched:
            self._fault_s = math.nan
        elif math.isnan(self._fault_s):
            self._fault_s = time_s
        elif time_s - self._fault_s >= self._patience.silent_s:
            words = "its controller keeps reporting a fault with its heater off"
            self._raise("fault", f"{words}, at {here_C:.1f} C: heater or sensor?")

    def _check_warming(self, time_s: float, here_C: float) -> None:
        """Heating that does not warm."""
        if self._asked != "soft" or here_C >= self._heater.melting_point_C - _SURELY_SOLID_K:
            self._cold = (math.nan, math.nan)
            return
        since_s, cold_C = self._cold
        if math.isnan(since_s) or here_C >= cold_C + _WARMED_K:
            self._cold = (time_s, here_C)
        elif time_s - since_s > self._dead_s:
            words = f"heating does not warm it, {here_C:.1f} C after {time_s - since_s:.0f} s"
            self._raise("heater", f"{words}: a dead heater, or a sensor that has come off")

    def _check_progress(
        self, time_s: float, here_C: float, stiffness: KnownStiffness | None
    ) -> None:
        """Changes that take longer than the model's times allow, once begun."""
        if self._asked == "warm" or stiffness == self._asked:
            self._apart_s = time_s
            return
        since_s, risen_K = time_s - self._apart_s, here_C - self._first_C
        if since_s <= self._longest_s[self._asked]:
            return
        known = f"{stiffness} at {here_C:.1f} C, not {self._asked} after {since_s:.0f} s"
        if self._asked == "soft":
            self._raise("heater", f"{known}: the heater is too weak")
        if self._shown_C[1] - self._shown_C[0] < _SAME_K:
            self._raise("sensor", f"{known}: its sensor shows the same all the time")
        if here_C >= self._lowest_C + _WARMED_K or risen_K >= 0:
            self._raise("relay", f"{known}, and not cooling: the heater does not go off")
        self._raise("cooling", f"{known}, {-risen_K:.1f} K down: it cools too slowly")

    def _raise(self, cause: Cause, text: str) -> None:
        raise SegmentError(cause, self._segment, text)


def _longest_times_s(
    robot: Robot, air_C: float, segment: int, patience: Patience
) -> tuple[dict[Stiffness, float], float]:
    """How long a melt from the air's temperature and a freeze may take, and no warming at all."""
    longest: dict[Stiffness, float] = dict.fromkeys(("soft", "rigid"), patience.longest_change_s)
    if not robot.describes_heat:
        return longest, _CAUGHT_UP_S
    model, heater = segment_model(robot, air_C, segment), robot.heater
    cold, warm = model.initial(air_C), model.initial(heater.soft_setpoint_C)
    takes: dict[Stiffness, float] = {
        "soft": model.time_until(cold, heater.melt_current_A, model.liquid_level),
        "rigid": model.time_until(warm, 0.0, model.solid_level),
    }
    for to, took_s in takes.items():
        if math.isfinite(took_s):
            longest[to] = patience.late * max(took_s, patience.least_transition_s)
    warmer = model.level_at(air_C + _RISEN_K)
    warms_s = model.time_until(cold, heater.melt_current_A, warmer)
    return longest, max(_CAUGHT_UP_S, patience.late * warms_s)
