"""What a segment's readings say that cannot be: a dead sensor or heater, a relay that is welded.

Every reading is compared with what the segment was asked to be, with its model's times and with the
heat that was let in. That estimate (`HeatBelief`) has the last word on the heater and on "soft"; it
stays within the ranges of healthy robots, from which simulated ones are drawn, too. All that is
wrong is a `SegmentError` with the name of its cause.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from twosra_mpc.control.stiffness import KnownStiffness, stiffness_rule
from twosra_mpc.control.thermistor import NtcDivider
from twosra_mpc.errors import RobotError
from twosra_mpc.execution.healthy_segments import Heat
from twosra_mpc.execution.heat_belief import CLEARLY, HeatBelief, heat_belief
from twosra_mpc.execution.run import Ending
from twosra_mpc.execution.settings import Patience
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Stiffness
from twosra_mpc.thermal.model import SegmentModel, State
from twosra_mpc.thermal.uncertainty import corners

Cause = Literal["sensor", "fault", "hot", "relay", "cooling", "heater"]
Asked = Stiffness | Literal["warm"]

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
_SAME_K = 0.3  # a smoothed reading that moves less stands still
_WARMED_K, _SURELY_SOLID_K = 2.0, 5.0  # as the stiffness controller has it
_CAUGHT_UP_S = 30.0  # after which the sensor shows what the heater does
_LAGGED_S = 10.0  # what gets warmer from then on was not as warm before
_RISEN_K = 10.0  # more than a neighbour's heat; full current takes 10 s for it
_JUMP_K, _JUMP_K_S, _JUMPED_S = 2.5, 2.5, 2.0  # full current warms by 2 K/s
_COLD_K = 8.0  # below the air, and what was read first
_USUAL, _AS_EVER = 200, 3.0  # readings that move, and how much more or less others may flicker
_FLICKERS, _FLICKER_K = 20, 2.0  # readings that are averaged; of one from the line of two before
_OFF_BY_K = 3.5  # above the melting point it may be metal that freezes, and a sensor 2 K off
_RECENT, _APART_S = 20, 0.9  # readings, so far apart, that tell whether it warms or cools
_QUICKENS, _QUICKENS_K = 3, 0.1  # of them, and by so much the later ones rise more
_UNLIKE_S = 3.0  # after which what no healthy segment shows is not believed
_USUAL_DOUBT, _USUAL_OFF = 0.12, 0.8  # of healthy ones for long; with the heater off: no hurry
_HELD_K = 0.25  # above the set-point is a reading about which a switch holds metal
_BAND_K, _NEAR_K = 4.0, 1.5  # below it a regulator lowers the current; and holds metal
_EDGE = 0.4  # share of a period within which a switch changed
_MORE_K = 3.0  # as much as a sensor may show too much


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


@dataclass
class _Stretch:
    """Readings since the set-point was changed, or since the segment last was what it asks for.

    Attributes:
        since_s: When that was.
        apart_s: Since when the segment is not what is asked.
        first_C: First reading.
        lowest_C: Lowest pair of readings since the sensor can have caught up.
        coldest_C: Lowest reading.
        hottest_C: Highest reading.
    """

    since_s: float = math.nan
    apart_s: float = math.nan
    first_C: float = math.nan
    lowest_C: float = math.inf
    coldest_C: float = math.inf
    hottest_C: float = -math.inf


class SegmentWatch:
    """Watches one segment from reading to reading.

    Attributes:
        doubted: True if it did not bend although it was called soft: its sensor may show too much.
        soft_for_s: Time for which it must stay soft; inf: nobody knows.
        belief: About its heat; None of a robot that does not describe, or not report, it.
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
            reports: True if the temperature must be reported.
            start_C: Temperature at which it has rested; default: the air's.
        """
        self._segment, self._patience, self._reports = segment, patience, reports
        self._heater, self._air_C = robot.heater, air_C
        self.doubted, self.soft_for_s = False, math.inf
        self._longest_s, self._dead_s = _longest_times_s(robot, air_C, segment, patience)
        self._start_C = air_C if start_C is None else start_C
        self.belief: HeatBelief | None = None
        if robot.describes_heat and reports:
            self.belief = heat_belief(robot, air_C, segment, self._start_C)
        self._asked: Asked = "rigid"
        self._stretch, self._begun_s = _Stretch(), dict[str, tuple[float, float]]()
        self._hot, self._last_C, self._coldest_C = 0, math.inf, _COLDEST_C
        self._taken_s = self._sound_s = math.nan
        self._molten, self._before_C, self._flicker_K = False, math.inf, 0.0
        self._usual_K, self._readings = 0.0, 0
        self._recent_s, self._unlike_s = -math.inf, 0.0
        self._recent_C: deque[float] = deque(maxlen=_RECENT)

    @property
    def may_be_soft(self) -> bool:
        """True if the segment has had enough heat to be soft.

        One that was doubted: for sure, or as long as a melt may take at most.
        """
        if self.belief is None:
            return True
        return self._molten if self.doubted else self.belief.may_be_liquid

    @property
    def shown_C(self) -> float:
        """Last temperature that could be read; at first that of the start."""
        return self._start_C if math.isinf(self._last_C) else self._last_C

    @property
    def state(self) -> State | None:
        """Most probable state, as the described segment's; None if nobody knows."""
        return None if self.belief is None or self.doubted else self.belief.state

    def coasts_s(self, deviations: float = CLEARLY) -> float:
        """Time for which the segment, so much colder, stays soft without heat."""
        if self.belief is None or self.doubted:
            return 0.0
        return self.belief.stays_liquid_s(deviations)

    @property
    def _leaves_plateau(self) -> bool:
        """True if the reading rises faster and faster: one that catches up becomes slower."""
        shown = list(self._recent_C)[::-_QUICKENS][:3]
        return len(shown) == 3 and shown[0] - 2 * shown[1] + shown[2] >= _QUICKENS_K

    @property
    def clearly_solid(self) -> bool:
        """True if all of the metal is solid."""
        return self.belief is not None and self._asked != "soft" and self.belief.clearly_solid

    @property
    def moved_K(self) -> float:
        """Change of the reading in the last seconds: metal that melts or freezes stands still."""
        return self._recent_C[-1] - self._recent_C[0] if self._recent_C else 0.0

    def allowed_C(self, setpoint_C: float) -> float:
        """Set-point that may be sent where this one is asked for.

        Heat that metal does not need must be lost before it freezes. A sensor that shows too much
        makes its controller hold metal that is still melting, with little current: a segment that
        was doubted is asked for more until it must be liquid.
        """
        coasts_s = self.coasts_s(0.0 if self._leaves_plateau else CLEARLY)
        if coasts_s >= self.soft_for_s or (self.belief is not None and self.belief.cut):
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
            faulty: True if that has given up.
            current_A: Root mean square of its current since the one before, if it tells.

        Raises:
            SegmentError: If something is wrong.
        """
        asked = self._asked_by(setpoint_C)
        if asked != self._asked or math.isnan(self._stretch.since_s):
            self._asked, self._stretch = asked, _Stretch(time_s, time_s)
        readable = self._readable(time_s, temperature_C, stiffness)
        sound = readable and not self._jumped(time_s, temperature_C)
        shown_C = temperature_C if sound else None
        passed_s = self._account_for(time_s, setpoint_C, shown_C, current_A)
        if not sound:
            return
        self._check_life(temperature_C, (self._before_C, self._last_C))
        stretch, pair_C = self._stretch, (self._last_C, temperature_C)
        self._before_C, self._last_C = pair_C
        if time_s - stretch.since_s >= _LAGGED_S:
            stretch.lowest_C = min(stretch.lowest_C, max(pair_C))
        if math.isnan(stretch.first_C):
            stretch.first_C = temperature_C
        stretch.coldest_C = min(stretch.coldest_C, temperature_C)
        stretch.hottest_C = max(stretch.hottest_C, temperature_C)
        self._check_heat(time_s - stretch.since_s, temperature_C, min(pair_C) - stretch.lowest_C)
        self._check_fault(time_s, temperature_C, stiffness, faulty)
        if self.belief is not None:
            self._check_likeness(passed_s, temperature_C, self.belief)
        heats = self.allowed_C(setpoint_C) >= setpoint_C
        self._check_warming(time_s, temperature_C, heats)
        self._check_progress(time_s, temperature_C, stiffness)

    def _asked_by(self, setpoint_C: float) -> Asked:
        if setpoint_C >= self._heater.soft_setpoint_C:
            return "soft"
        return "rigid" if setpoint_C <= self._heater.rigid_setpoint_C else "warm"

    def _lasts_s(self, name: str, holds: bool, time_s: float, here_C: float = math.nan) -> float:
        """Time for which something has held; -1 if it does not. It begins with a reading."""
        if not holds:
            self._begun_s.pop(name, None)
            return -1.0
        return time_s - self._begun_s.setdefault(name, (time_s, here_C))[0]

    def _account_for(
        self, time_s: float, setpoint_C: float, shown_C: float | None, current_A: float | None
    ) -> float:
        """Account for the heat of the time that has passed, which is returned."""
        first = math.isnan(self._taken_s)
        passed_s, self._taken_s = 0.0 if first else time_s - self._taken_s, time_s
        if self.belief is None:
            return passed_s
        if first and shown_C is not None:
            self.belief = self.belief.begun(shown_C, self._start_C)
        heat = self._heat_of(passed_s, setpoint_C, shown_C, current_A)
        self.belief = self.belief.take(heat, shown_C)
        if shown_C is not None and time_s >= self._recent_s + _APART_S:
            self._recent_C.append(shown_C)
            self._recent_s = time_s
        called = self._asked == "soft" and self.belief.may_be_liquid
        called_s = self._lasts_s("called", called, time_s)
        sure = self._molten or self.belief.surely_liquid
        self._molten = called and (called_s >= self._longest_s["soft"] or sure)
        return passed_s

    def _heat_of(
        self, passed_s: float, setpoint_C: float, shown_C: float | None, current_A: float | None
    ) -> Heat:
        """Heat since the last reading: as told, or by a switch at the set-point in force."""
        heater, sent_C = self._heater, self.allowed_C(setpoint_C)
        now_C = self._last_C if shown_C is None else shown_C
        soft, before_C = self._asked == "soft", min(self._last_C, _HOTTEST_C)
        if current_A is not None:
            return Heat(passed_s, (current_A / heater.melt_current_A) ** 2)
        if sent_C <= heater.rigid_setpoint_C or before_C >= sent_C <= now_C:
            held = soft and sent_C <= max(before_C, now_C) <= sent_C + _HELD_K
            return Heat(passed_s, 0.0, _EDGE, held_C=now_C) if held else Heat(passed_s, 0.0)
        if soft and heater.hold_duty == 1.0 and now_C > sent_C - _BAND_K:
            share = min(1.0, ((sent_C - now_C) / _BAND_K) ** 2)
            return Heat(passed_s, share, _EDGE, held_C=now_C if now_C > sent_C - _NEAR_K else None)
        low_C, high_C = sorted((before_C, now_C))
        if high_C <= sent_C:
            return Heat(passed_s, 1.0, warm=not soft)
        return Heat(passed_s, (sent_C - low_C) / (high_C - low_C), _EDGE, not soft)

    def _jumped(self, time_s: float, here_C: float) -> bool:
        """True if metal cannot have warmed or cooled so fast; not for long."""
        if math.isinf(self._last_C):
            self._sound_s = time_s
            return False
        most_K = _JUMP_K + _JUMP_K_S * min(time_s - self._sound_s, _JUMPED_S)
        jumped = abs(here_C - self._last_C) > most_K
        if not jumped:
            self._sound_s = time_s
        if self._lasts_s("jumped", jumped, time_s) >= _JUMPED_S:
            jump = f"from {self._last_C:z.1f} to {here_C:z.1f} C"
            self._raise("sensor", f"its sensor jumped {jump}, faster than metal warms or cools")
        return jumped

    def _check_life(self, here_C: float, pair_C: tuple[float, float]) -> None:
        """A sensor that flickers far more than any."""
        if math.isfinite(pair_C[0]):
            bend_K = abs(here_C - 2 * pair_C[1] + pair_C[0])
            self._flicker_K += (bend_K - self._flicker_K) / _FLICKERS
            if abs(self.moved_K) >= _WARMED_K:  # else it may be stuck, and err at random
                self._readings = min(self._readings + 1, _USUAL)
                self._usual_K += (bend_K - self._usual_K) / self._readings
        if self._flicker_K > _FLICKER_K:
            words = f"its sensor flickers by {self._flicker_K:z.1f} K from one to the next"
            self._raise("sensor", words)

    def _check_likeness(self, passed_s: float, here_C: float, belief: HeatBelief) -> None:
        """Readings that no healthy segment shows after so much heat, or few do for so long."""
        off = self._asked == "rigid"
        doubt = belief.misfit - _USUAL_OFF if off else belief.doubt - _USUAL_DOUBT
        self._unlike_s = max(0.0, self._unlike_s + doubt * passed_s)
        if self._unlike_s < _UNLIKE_S:
            return
        low_C, high_C = belief.shows_C
        words = f"{here_C:z.1f} C, where healthy ones show {low_C:z.0f} to {high_C:z.0f} C"
        risen_K, above = self.moved_K, here_C > (low_C + high_C) / 2
        alive = self._usual_K / _AS_EVER <= self._flicker_K <= self._usual_K * _AS_EVER
        melts = alive and abs(here_C - self._heater.melting_point_C) < _OFF_BY_K  # else it sticks
        if belief.heated_s > 0.0 and here_C <= high_C and self._asked != "rigid":
            cold = self._air_C - _WARMED_K < here_C < belief.start.shown_C + _WARMED_K
            dead = "warm" if cold and abs(risen_K) < _WARMED_K else ""
            if dead := "melt" if melts and risen_K < _SAME_K else dead:
                self.belief = None  # one may go on without it, and nobody knows its state
                words = f"heating does not {dead} it, {words}"
                self._raise("heater", f"{words}: a dead heater, or a sensor that has come off")
        if self._asked == "soft" and not above:
            what = "or its firmware regulates (then hold_duty = 1 in the robot file)"
            self._raise("sensor", f"{words}: its sensor lies, {what}")
        falls = max(self._recent_C) - here_C >= max(_SAME_K / 2, 5 * self._flicker_K)
        if above and (falls or (melts and self._asked == "rigid")):
            self._raise("cooling", f"{words}: it cools too slowly")
        rises = risen_K >= max(_WARMED_K, 5 * self._flicker_K) and here_C >= max(self._recent_C)
        if above and rises and self._recent_C[-1] > self._recent_C[-2]:
            if self._asked == "rigid":
                self._raise("relay", f"{words}: the heater does not go off (a welded relay?)")
            if here_C > self._heater.soft_setpoint_C + _HELD_K:
                self._raise("hot", f"{words}: its heater does not go off")
        self._raise("sensor", f"{words}: its sensor shows too {'much' if above else 'little'}")

    def _readable(
        self, time_s: float, temperature_C: float, stiffness: KnownStiffness | None
    ) -> bool:
        """True if there is a temperature that a thermistor can show; not for long without."""
        coldest, hottest = self._coldest_C, _HOTTEST_C
        if coldest <= temperature_C <= hottest and stiffness is not None:
            self._begun_s.pop("unread", None)
            if math.isinf(self._last_C):
                self._coldest_C = max(coldest, min(self._air_C, temperature_C) - _COLD_K)
            return True
        if not self._reports and stiffness is None and math.isnan(temperature_C):
            return False
        unread_s = self._lasts_s("unread", True, time_s)
        if unread_s >= self._patience.silent_s:
            since = f"for {unread_s:z.0f} s"
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
        if self._asked == "soft" and here_C >= self._stretch.first_C + _RISEN_K / 2:
            limit_C = (asked_C + limit_C) / 2  # it warms on, and the sensor lags
        self._hot = self._hot + 1 if here_C >= limit_C else 0
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
        if self._lasts_s("fault", latched, time_s) >= self._patience.silent_s:
            words = "its controller keeps reporting a fault with its heater off"
            self._raise("fault", f"{words}, at {here_C:z.1f} C: heater or sensor?")

    def _check_warming(self, time_s: float, here_C: float, heats: bool) -> None:
        """Heating that does not warm."""
        solid = here_C < self._heater.melting_point_C - _SURELY_SOLID_K
        _, cold_C = self._begun_s.get("cold", (math.nan, here_C))
        cold = heats and self._asked == "soft" and solid and here_C < cold_C + _WARMED_K
        since_s = self._lasts_s("cold", cold, time_s, here_C)
        if since_s > self._dead_s:
            words = f"heating does not warm it, {here_C:z.1f} C after {since_s:z.0f} s"
            self._raise("heater", f"{words}: a dead heater, or a sensor that has come off")

    def _check_progress(
        self, time_s: float, here_C: float, stiffness: KnownStiffness | None
    ) -> None:
        """Changes that take longer than the model's times allow, also with the heater at rest."""
        stretch = self._stretch
        if self._asked == "warm" or stiffness == self._asked:
            stretch.apart_s = time_s
            return
        since_s, risen_K = time_s - stretch.apart_s, here_C - stretch.first_C
        if since_s <= self._longest_s[self._asked]:
            return
        known = f"{stiffness} at {here_C:z.1f} C, not {self._asked} after {since_s:z.0f} s"
        if self._asked == "soft":
            self._raise("heater", f"{known}: the heater is too weak")
        if stretch.hottest_C - stretch.coldest_C < _SAME_K:
            self._raise("sensor", f"{known}: its sensor shows the same all the time")
        if here_C >= stretch.lowest_C + _WARMED_K or risen_K >= 0:
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
    cold, solid_C = model.initial(air_C), stiffness_rule(robot, air_C, segment).solid_below_C

    def freezes_s(one: SegmentModel) -> float:
        hot = one.initial(heater.soft_setpoint_C + _RISEN_K)
        return one.time_until(hot, 0.0, one.level_at(solid_C - _OFF_BY_K))

    slowest = corners(model, robot.thermal_segment(segment).ranges, freezes_s)[1]
    melts_s = model.time_until(cold, heater.melt_current_A, model.liquid_level)
    if math.isfinite(melts_s):
        longest["soft"] = patience.late * max(melts_s, patience.least_transition_s)
    if math.isfinite(frozen_s := freezes_s(slowest)):
        longest["rigid"] = frozen_s + _CAUGHT_UP_S
    warmer = model.level_at(air_C + _RISEN_K)
    warms_s = model.time_until(cold, heater.melt_current_A, warmer)
    return longest, max(_CAUGHT_UP_S, patience.late * warms_s)
