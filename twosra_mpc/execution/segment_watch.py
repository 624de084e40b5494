"""What a segment's readings say that cannot be: a dead sensor or heater, a relay that is welded.

Every reading is compared with what the segment was asked to be, with its model's times and with the
heat that was let in (`HeatAccount`), which also has the last word on the heater and on "soft". All
that is wrong is a `SegmentError` with the name of its cause.
"""

from __future__ import annotations

import math
from typing import Literal

from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.control.thermistor import NtcDivider
from twosra_mpc.execution.heat_account import HeatAccount
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

_COLDEST_C, _HOTTEST_C = NtcDivider().range_C
_TWICE = 2  # readings: single ones can be far off
_SAME_K = 0.5  # metal that freezes shows more between its set-point and its melting point
_WARMED_K, _SURELY_SOLID_K = 2.0, 5.0  # as the stiffness controller has it
_CAUGHT_UP_S = 30.0  # after which the sensor shows what the heater does
_LAGGED_S = 10.0  # what gets warmer from then on was not as warm before
_RISEN_K = 10.0  # more than a neighbour's heat; full current takes 10 s for it
_JUMP_K, _JUMP_K_S, _JUMPED_S = 2.5, 2.5, 2.0  # full current warms by 2 K/s
_COLD_K = 8.0  # below the air, and what was read first
_STUCK_K = 0.05  # a reading that moves less in `_CAUGHT_UP_S`, its heater off, is no reading
_FELL_K = 0.5  # the heater off: it follows the metal
_OFF_K = 1.0  # so far above its set-point no switch lets current flow
_SAME_S = 10.0  # to the last digit
_FLICKERS = 12  # times up and down: that is noise
_TIMES_STEADY = 5.0  # as long as ever before: digits may be coarse
_SLOW_S, _SLOW_SHARE = 50.0, 0.4  # after that it has cooled by so much of what its model says
_OFF_BY_K = 3.5  # above the melting point it may be metal that freezes, and a sensor 2 K off
_CONTRADICTED_S = 45.0  # called soft, by a sensor that is off by 2 K, of metal that begins to melt
_MORE_K = 3.0  # as much as a sensor may show too much
_HELD_K = 0.25  # below the set-point a sensor that is off by 2 K does not show metal that melts


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
    """Watches one segment from reading to reading.

    Attributes:
        doubted: Whether it did not bend although it was called soft: its sensor may show too much.
    """

    def __init__(
        self,
        robot: Robot,
        air_C: float,
        segment: int,
        patience: Patience,
        *,
        reports: bool,
        start_C: float | None = None,
    ) -> None:
        """Watch a segment (from 0).

        Args:
            robot: The robot.
            air_C: Temperature of the air.
            segment: Which segment, from 0.
            patience: How long it waits.
            reports: Whether the temperature must be reported.
            start_C: Temperature at which it has rested; default: the air's.
        """
        self._segment, self._patience, self._reports = segment, patience, reports
        self.doubted = self._molten = False
        self._heater = robot.heater
        self._longest_s, self._dead_s = _longest_times_s(robot, air_C, segment, patience)
        self._unread_s = self._changed_s = self._apart_s = self._fault_s = math.nan
        self._asked: Stiffness | Literal["warm"] = "rigid"
        self._hot, self._lowest_C, self._first_C, self._last_C = 0, math.inf, math.nan, math.inf
        self._shown_C, self._cold = (math.inf, -math.inf), (math.nan, math.nan)
        self._account: HeatAccount | None = None
        if robot.describes_heat and reports:
            begun_C = air_C if start_C is None else start_C
            self._account = HeatAccount(robot, air_C, segment, begun_C)
            self._model = segment_model(robot, air_C, segment)
        self._called_s, self._air_C, self._coldest_C = math.nan, air_C, _COLDEST_C
        self._taken_s = self._jumped_s = self._cut_s = self._doubtful_s = self._cold_s = math.nan
        self._same_s, self._sound_s = math.nan, math.nan
        self._steady_s, self._turns, self._rose, self._most_K = 0.0, 0, False, math.inf
        self._off_s, self._off_C = math.nan, (math.inf, -math.inf)

    @property
    def may_be_soft(self) -> bool:
        """Whether the segment has had enough heat to be soft.

        One that was doubted: for sure, or as long as a melt may take at most.
        """
        if self._account is None:
            return True
        return self._molten if self.doubted else self._account.may_be_liquid

    def allowed_C(self, setpoint_C: float) -> float:
        """Set-point that may be sent where this one is asked for.

        A sensor that shows too much makes its controller hold metal that is still melting, with
        little current: a segment that was doubted is asked for more until it must be liquid.
        """
        if self._account is not None and self._account.cut:
            return min(setpoint_C, self._heater.rigid_setpoint_C)
        melts = setpoint_C >= self._heater.soft_setpoint_C and self.doubted and not self._molten
        return setpoint_C + _MORE_K * melts

    def take(
        self,
        time_s: float,
        setpoint_C: float,
        temperature_C: float,
        stiffness: KnownStiffness | None,
        faulty: bool,
        current_A: float | None = None,
    ) -> None:
        """Look at a reading, and at the set-point that was asked for before it.

        Args:
            time_s: When it was read.
            setpoint_C: Set-point asked for since the one before.
            temperature_C: Of the segment, by its sensor.
            stiffness: As its controller reports it.
            faulty: Whether that has given up.
            current_A: Current it lets flow, if it tells.

        Raises:
            SegmentError: If something is wrong.
        """
        asked = self._asked_by(setpoint_C)
        if asked != self._asked or math.isnan(self._changed_s):
            self._asked, self._changed_s, self._apart_s = asked, time_s, time_s
            self._lowest_C, self._first_C = math.inf, math.nan
            self._shown_C, self._cold = (math.inf, -math.inf), (math.nan, math.nan)
        readable = self._readable(time_s, temperature_C, stiffness)
        sound = readable and not self._jumped(time_s, temperature_C)
        off = self._account_for(time_s, setpoint_C, temperature_C if sound else None, current_A)
        if not sound:
            return
        since_s = time_s - self._changed_s
        pair_C, self._last_C = (self._last_C, temperature_C), temperature_C
        self._check_sameness(time_s, temperature_C, pair_C)
        if since_s >= _LAGGED_S:
            self._lowest_C = min(self._lowest_C, max(pair_C))
        if math.isnan(self._first_C):
            self._first_C = temperature_C
        coldest_C, hottest_C = self._shown_C
        self._shown_C = min(coldest_C, temperature_C), max(hottest_C, temperature_C)
        self._check_heat(since_s, temperature_C, min(pair_C) - self._lowest_C)
        self._check_fault(time_s, temperature_C, stiffness, faulty)
        self._check_fall(time_s, temperature_C, off)
        self._check_account(time_s, temperature_C, stiffness)
        if self.allowed_C(setpoint_C) >= setpoint_C:
            self._check_warming(time_s, temperature_C)
        else:
            self._cold = (math.nan, math.nan)
        self._check_progress(time_s, temperature_C, stiffness)

    def _asked_by(self, setpoint_C: float) -> Stiffness | Literal["warm"]:
        if setpoint_C >= self._heater.soft_setpoint_C:
            return "soft"
        return "rigid" if setpoint_C <= self._heater.rigid_setpoint_C else "warm"

    def _account_for(
        self, time_s: float, setpoint_C: float, shown_C: float | None, current_A: float | None
    ) -> bool:
        """Account for the heat of the time that has passed; whether the heater was off for sure."""
        passed_s = 0.0 if math.isnan(self._taken_s) else time_s - self._taken_s
        self._taken_s = time_s
        in_force_C, last_C = self.allowed_C(setpoint_C), self._last_C
        if self._account is not None:
            known_C = last_C if shown_C is None else shown_C
            if math.isinf(last_C):
                last_C = known_C
            if math.isfinite(known_C):
                self._account.take(passed_s, in_force_C, current_A, min(known_C, last_C))
            if self._asked != "soft" or not self._account.may_be_liquid:
                self._called_s = time_s
            self._molten = time_s - self._called_s >= self._longest_s["soft"] or (
                time_s > self._called_s and (self._molten or self._account.surely_liquid)
            )
        if current_A is not None or in_force_C <= self._heater.rigid_setpoint_C:
            return not current_A
        return last_C >= in_force_C + _OFF_K

    def _jumped(self, time_s: float, here_C: float) -> bool:
        """Whether metal cannot have warmed or cooled so fast; not for long."""
        if math.isinf(self._last_C):
            self._sound_s = time_s
            return False
        if math.isnan(self._jumped_s):
            self._most_K = _JUMP_K + _JUMP_K_S * (time_s - self._sound_s)
        if abs(here_C - self._last_C) <= self._most_K:
            self._sound_s, self._jumped_s = time_s, math.nan
            return False
        if math.isnan(self._jumped_s):
            self._jumped_s = time_s
        elif time_s - self._jumped_s >= _JUMPED_S:
            jump = f"from {self._last_C:z.1f} to {here_C:z.1f} C"
            self._raise("sensor", f"its sensor jumped {jump}, faster than metal warms or cools")
        return True

    def _check_sameness(self, time_s: float, here_C: float, pair_C: tuple[float, float]) -> None:
        """A sensor that has flickered all the time, and shows the same to the last digit."""
        since_s = 0.0 if math.isnan(self._same_s) else time_s - self._same_s
        if pair_C[0] != here_C:
            rises = here_C > pair_C[0]
            alone = self._asked != "warm" and here_C < self._heater.melting_point_C + _OFF_BY_K / 2
            self._turns += alone and rises != self._rose  # it is not regulated there
            self._rose = rises
            self._same_s, self._steady_s = time_s, max(self._steady_s, since_s)
        elif self._stuck(time_s) and since_s > max(_CAUGHT_UP_S, _TIMES_STEADY * self._steady_s):
            words = f"{here_C:z.2f} C for {since_s:z.0f} s"
            self._raise("sensor", f"{words}: its sensor shows the same all the time")

    def _stuck(self, time_s: float) -> bool:
        """Whether a sensor that has flickered before shows the same to the last digit."""
        return self._turns >= _FLICKERS and time_s - self._same_s >= _SAME_S

    def _check_fall(self, time_s: float, here_C: float, off: bool) -> None:
        """A reading of liquid metal that does not fall although its heater is off."""
        if not off or self._account is None or here_C < self._account.liquid_above_C:
            self._off_s, self._off_C = math.nan, (math.inf, -math.inf)
            return
        if math.isnan(self._off_s):
            self._off_s = time_s
        self._off_C = min(here_C, self._off_C[0]), max(here_C, self._off_C[1])
        since_s, fell_K = time_s - self._off_s, self._off_C[1] - here_C
        same = self._off_C[1] - self._off_C[0] < _STUCK_K or self._stuck(time_s)
        if since_s >= _CAUGHT_UP_S and same:
            words = f"{here_C:z.1f} C for {since_s:z.0f} s, its heater off"
            self._raise("sensor", f"{words}: its sensor shows the same all the time")
        if since_s >= _SLOW_S:
            hot = self._model.initial(self._off_C[1])
            then_C = self._model.temperature_C(
                self._model.propagate(hot, 0.0, since_s - _CAUGHT_UP_S / 2)
            )
            then_C = max(then_C, self._heater.melting_point_C + _OFF_BY_K)
            if 0 <= fell_K < _SLOW_SHARE * (self._off_C[1] - then_C):
                words = f"{fell_K:z.1f} K down in {since_s:z.0f} s, its heater off"
                if self._asked == "rigid":
                    self._raise("cooling", f"{words}: it cools too slowly")
                self._raise("sensor", f"{here_C:z.1f} C, {words}: its sensor shows too much")

    def _check_account(
        self, time_s: float, here_C: float, stiffness: KnownStiffness | None
    ) -> None:
        """A reading that the heat that was let in contradicts."""
        account, solid_C = self._account, self._heater.melting_point_C - _SURELY_SOLID_K
        if account is None:
            return
        if here_C >= solid_C or self._shown_C[1] < solid_C or not account.half_molten:
            self._cold_s = math.nan
        elif math.isnan(self._cold_s):
            self._cold_s = time_s
        elif time_s - self._cold_s >= _LAGGED_S:
            self._raise(
                "sensor", f"{here_C:z.1f} C, too early for metal: its sensor shows too little"
            )
        if self._asked != "soft":
            self._cut_s = self._doubtful_s = math.nan
            return
        limit_C = account.liquid_above_C
        if (not account.cut and not account.must_be_liquid) or here_C >= limit_C:
            self._cut_s = math.nan
        elif math.isnan(self._cut_s) and account.cut:
            self._cut_s = time_s
        elif time_s - self._cut_s >= _CAUGHT_UP_S and here_C >= solid_C:
            words = f"{here_C:z.1f} C after heat for {account.at_least_C:z.0f} C"
            if self._stuck(time_s):
                self._raise("sensor", f"{words}: its sensor shows the same all the time")
            what = "a dead heater, a sensor that lies, or firmware that regulates"
            self._raise("heater", f"{words}: {what} (then hold_duty = 1 in the robot file)")
        held = here_C >= self._heater.soft_setpoint_C - _HELD_K
        melts = account.may_be_liquid if held else account.begins_to_melt
        if stiffness != "soft" or melts:
            self._doubtful_s = math.nan
        elif math.isnan(self._doubtful_s):
            self._doubtful_s = time_s
        elif time_s - self._doubtful_s >= _CONTRADICTED_S:
            words = f"{here_C:z.1f} C after heat for {account.at_most_C:z.0f} C"
            self._raise("sensor", f"{words}: its sensor shows too much")

    def _readable(
        self, time_s: float, temperature_C: float, stiffness: KnownStiffness | None
    ) -> bool:
        """Whether there is a temperature that a thermistor can show; not for long without."""
        coldest, hottest = self._coldest_C, _HOTTEST_C
        if coldest <= temperature_C <= hottest and stiffness is not None:
            self._unread_s = math.nan
            if math.isinf(self._last_C):
                self._coldest_C = max(coldest, min(self._air_C, temperature_C) - _COLD_K)
            return True
        if not self._reports and stiffness is None and math.isnan(temperature_C):
            return False
        if math.isnan(self._unread_s):
            self._unread_s = time_s
        if time_s - self._unread_s >= self._patience.silent_s:
            since = f"for {time_s - self._unread_s:z.0f} s"
            if coldest <= temperature_C <= hottest:
                known = f"its sensor reads {temperature_C:zg} C, but its stiffness is None {since}"
                self._raise("sensor", f"{known}: report it as 'soft', 'rigid' or 'changing'")
            nothing = math.isnan(temperature_C)
            shown = "reports nothing" if nothing else f"reads {temperature_C:zg} C"
            allowed = f"a thermistor in this air reads from {coldest:z.0f} to {hottest:zg} C"
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
                known = f"{here_C:z.1f} C and rising, its heater off for {since_s:z.0f} s"
                self._raise("relay", f"{known}: the heater does not go off (a welded relay?)")
            if since_s < _CAUGHT_UP_S:
                return  # it is off already, and the sensor lags
        if self._hot >= _TWICE:
            words = f"too hot, {here_C:z.1f} C: at most {limit_C:zg} C"
            asked = f"its set-point being {asked_C:zg} C"
            self._raise("hot", f"{words}, {asked}; its heater does not go off")

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
            self._raise("fault", f"{words}, at {here_C:z.1f} C: heater or sensor?")

    def _check_warming(self, time_s: float, here_C: float) -> None:
        """Heating that does not warm."""
        if self._asked != "soft" or here_C >= self._heater.melting_point_C - _SURELY_SOLID_K:
            self._cold = (math.nan, math.nan)
            return
        since_s, cold_C = self._cold
        if math.isnan(since_s) or here_C >= cold_C + _WARMED_K:
            self._cold = (time_s, here_C)
        elif time_s - since_s > self._dead_s:
            words = f"heating does not warm it, {here_C:z.1f} C after {time_s - since_s:z.0f} s"
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
        known = f"{stiffness} at {here_C:z.1f} C, not {self._asked} after {since_s:z.0f} s"
        if self._asked == "soft":
            self._raise("heater", f"{known}: the heater is too weak")
        if self._shown_C[1] - self._shown_C[0] < _SAME_K:
            self._raise("sensor", f"{known}: its sensor shows the same all the time")
        if here_C >= self._lowest_C + _WARMED_K or risen_K >= 0:
            self._raise("relay", f"{known}, and not cooling: the heater does not go off")
        self._raise("cooling", f"{known}, {-risen_K:z.1f} K down: it cools too slowly")

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
