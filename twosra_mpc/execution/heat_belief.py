"""Belief about the heat of a segment: two bounds of its metal, and the power of its heater.

The bounds are the segment model at two corners of the healthy ranges, propagated with the heater's
current: the one that melts last, cold, and the one that melts first, hot. Both warm as steeply as
the segment does. The power follows from the steepest rise of the sensor at full current, is
remembered from melt to melt, and lies between what that rise shows and what a slow sensor may hide
of it. A lie that rises slowly makes a weak heater of a strong one, but no healthy sensor slows
down before its metal melts: see `HeatBelief.slow`. Otherwise a reading lowers what metal has at
most only where heat cannot harm: with the heater off, or hardly on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from twosra_mpc.control.stiffness import stiffness_rule
from twosra_mpc.control.thermistor import Lag, follow
from twosra_mpc.execution.rise import UNLIKE_K, Rise, rise
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import SegmentModel, State, thresholds_C
from twosra_mpc.thermal.uncertainty import corners

SENSOR_OFF_K = 4.0  # thermistor of 1 % parts 2, melting point 1, model 1
LAGS_S = (4.0, 4.0)  # slowest healthy sensor; none is faster than no lag
_COOLED_K = 1.0  # below that the heater may be on again
_FULL = 0.95  # of the current
_SETTLED_S = 30.0  # heater off: sensor and metal are together
_MEAN_S = 12.0  # over which power is averaged
_QUIET_K = 10.0  # ahead of its sensor is metal that is kept warm, at most
_RISES_K = 5.0  # below where metal melts a rise must begin to tell anything
_EVIDENT_K = 2.0  # may a thermistor show liquid metal too cold
_WEAK = 1.3  # times weaker than the weakest healthy heater may one be that still melts
_PAUSE_S, _PORTION_K = 3.0, 12.0  # more heat, while no liquid metal is shown
_SPARE = 0.06  # of the latent heat, for a start that was known to 3 K
_HELD_K = 0.25  # below the set-point: lower ones may be of metal that melts, and a sensor 2 K off


@dataclass(frozen=True)
class Corners:
    """Cold and hot corner of the healthy ranges; powers in shares of the cold corner's full power.

    Attributes:
        cold: Segment that melts last.
        hot: Segment that melts first.
        hot_needs: Power with which the hot corner warms as the cold one does at full power.
        powers: Least and largest power of healthy heaters.
        quiet: Power that holds the nominal segment at the highest temperature.
        full_A: Current of full power.
        soft_C: Set-point.
        liquid_C: Reading of liquid metal.
        evident: Level of the cold corner at which every healthy sensor shows liquid metal.
        cut_C: Temperature of the hot corner from which on the heater is off.
    """

    cold: SegmentModel
    hot: SegmentModel
    hot_needs: float
    powers: tuple[float, float]
    quiet: float
    full_A: float
    soft_C: float
    liquid_C: float
    evident: float
    cut_C: float


@dataclass(frozen=True)
class HeatBelief:
    """State of the belief; a value, which ``advance`` and ``take`` replace.

    Attributes:
        corners: What the segment may be.
        cold: State of the cold corner.
        hot: State of the hot corner.
        shown: The slowest healthy sensor on the cold corner [C].
        shown_C: Last reading.
        least: Least power, told by the steepest rise so far.
        most: Largest power, as it was told before this rise.
        rise: Healthy robots in the same rise; None while there is none from rest.
        begun: States of the corners when full current began.
        full_s: For how long full current has flowed.
        off_s: For how long none has.
        mean: Share of the full current's heat, averaged over `_MEAN_S`.
        cut: Whether the heater must be off, whatever a reading says.
        enough: Level of the cold corner at which all earlier melts were done.
        whole: Whether all metal was solid when this melt began.
        melted: Whether the sensor has shown liquid metal since the heater was off for long.
    """

    corners: Corners
    cold: State
    hot: State
    shown: Lag
    shown_C: float
    enough: float
    least: float
    most: float
    rise: Rise | None = None
    begun: tuple[State, State] = ((), ())
    full_s: float = 0.0
    off_s: float = math.inf
    mean: float = 0.0
    cut: bool = False
    whole: bool = True
    melted: bool = False

    @property
    def at_least_C(self) -> float:
        """Temperature of the cold corner."""
        return self.corners.cold.temperature_C(self.cold)

    @property
    def at_most_C(self) -> float:
        """Temperature of the hot corner."""
        return self.corners.hot.temperature_C(self.hot)

    @property
    def shows_at_least_C(self) -> float:
        """Lowest reading of a healthy sensor while the metal warms."""
        return min(self.shown[1], self.at_least_C) - SENSOR_OFF_K

    @property
    def shows_at_most_C(self) -> float:
        """Highest reading of a healthy sensor while the metal warms."""
        return self.at_most_C + 2 * SENSOR_OFF_K

    @property
    def may_be_liquid(self) -> bool:
        """Whether the hot corner is liquid."""
        return self.corners.hot.level(self.hot) >= self.corners.hot.liquid_level

    @property
    def surely_liquid(self) -> bool:
        """Whether the cold corner has had the heat with which all earlier melts were done."""
        at = self.corners.cold
        return at.level(self.cold) >= min(self.enough, at.liquid_level)

    @property
    def overdue(self) -> bool:
        """Whether a healthy sensor would have begun to show liquid metal."""
        return not self.melted and self.corners.cold.level(self.cold) >= self.enough

    @property
    def half_molten(self) -> bool:
        """Whether half the metal, at least, still has to freeze at its melting point."""
        model = self.corners.cold
        solid_C, liquid_C = thresholds_C(model)
        half = (model.solid_level + model.liquid_level) / 2
        return solid_C == liquid_C and model.level(self.cold) > half

    @property
    def power(self) -> tuple[float, float]:
        """Least and largest power of the heater."""
        if self.rise is None or not self.rise.tells:
            return self.least, self.most
        least, most = self.rise.powers
        return max(self.least, min(least, self.most)), min(self.most, max(most, self.least))

    @property
    def unlike(self) -> bool:
        """Whether the sensor rises as that of no healthy robot with such a heater."""
        return self.rise is not None and self.rise.off_K > UNLIKE_K

    def advance(self, current_A: tuple[float, float], passed_s: float) -> HeatBelief:
        """Propagate the cold corner with the least and the hot one with the largest current."""
        if passed_s == 0.0:
            return self
        at, (least, most) = self.corners, self.power
        cold_A, hot_A = (
            current_A[0] * math.sqrt(least),
            current_A[1] * math.sqrt(most * at.hot_needs),
        )
        cold = at.cold.propagate(self.cold, cold_A, passed_s)
        hot = at.hot.propagate(self.hot, hot_A, passed_s)
        cold_C = self.at_least_C, at.cold.temperature_C(cold)
        heat, left = (current_A[1] / at.full_A) ** 2, math.exp(-passed_s / _MEAN_S)
        full = current_A[0] >= _FULL * at.full_A
        since_s = self.full_s + passed_s
        begun = replace(
            self,
            cold=cold,
            hot=hot,
            shown=follow(self.shown, LAGS_S, *cold_C, passed_s),
            off_s=0.0 if current_A[1] > 0 else self.off_s + passed_s,
            mean=heat + (self.mean - heat) * left,
        )
        if full:
            rise = self.rise
            if self.full_s == 0.0:
                begun = replace(begun, begun=(self.cold, self.hot))
                solid = self.shown_C < thresholds_C(at.cold)[0] - _RISES_K
                rise = self._begin() if solid and self.off_s >= _SETTLED_S else None
            return replace(begun, full_s=since_s, rise=rise and rise.advance(passed_s))
        if self.full_s == 0.0:
            return begun
        (least, most), air = (
            self.power,
            at.cold.level_at(at.cold.ambient_C),
        )  # with more power earlier melts took more
        enough = min(at.evident, air + least / self.least * (self.enough - air))
        return replace(begun, least=least, most=most, enough=enough, full_s=0.0, rise=None)

    def unsure(self) -> HeatBelief:
        """Doubt that heat was let in at all: not every firmware keeps metal warm."""
        at, shown_C, stayed = self.corners, self.shown_C, self.shown_C < self.shows_at_least_C
        cold = _within(at.cold, self.cold, (-math.inf, shown_C))
        most_C = shown_C + SENSOR_OFF_K if stayed else math.inf
        hot = _within(at.hot, self.hot, (-math.inf, most_C))
        off_s, shown = math.inf if stayed else 0.0, (shown_C, shown_C)
        return replace(self, cold=cold, hot=hot, shown=shown, rise=None, full_s=0.0, off_s=off_s)

    def _begin(self) -> Rise:
        """Healthy robots at the same temperature, with heaters as they are known."""
        model, full_A = self.corners.cold, self.corners.full_A
        at = self.corners
        solid_C = thresholds_C(at.hot)[0], thresholds_C(at.cold)[0]
        known = self.shown_C, solid_C[0] - 0.1
        rates = []
        for at_C in known:
            state = model.at_level(self.cold, model.level_at(at_C))
            rates.append([_slope(model, state, share * full_A) for share in (0.0, 1.0)])
        return rise(self.shown_C, (self.least, self.most), solid_C, known, np.array(rates))

    def take(self, shown_C: float) -> HeatBelief:
        """Take in a reading."""
        read = replace(self, shown_C=shown_C)
        told = read
        if self.rise is not None and shown_C < thresholds_C(self.corners.hot)[0] - SENSOR_OFF_K:
            told = replace(read, rise=self.rise.take(shown_C))
        if told.power != self.power:
            told = told._anew()
        return told._together(shown_C)._judged()

    def _anew(self) -> HeatBelief:
        """Propagate both corners anew since full current began, with what is now known of it."""
        at, (least, most) = self.corners, self.power
        cold_A, hot_A = (at.full_A * math.sqrt(p) for p in (least, most * at.hot_needs))
        cold = at.cold.propagate(self.begun[0], cold_A, self.full_s)
        hot = at.hot.propagate(self.begun[1], hot_A, self.full_s)
        return replace(self, cold=cold, hot=hot)

    def _together(self, shown_C: float) -> HeatBelief:
        """Bring metal and reading together where they must be, or where it does no harm."""
        at, cold, hot = self.corners, self.cold, self.hot
        liquid, told = shown_C >= at.liquid_C, self
        if self.off_s >= _SETTLED_S and shown_C + SENSOR_OFF_K < thresholds_C(at.hot)[0]:
            cold = _within(at.cold, cold, (shown_C - SENSOR_OFF_K, shown_C))
            hot = _within(at.hot, hot, (shown_C, shown_C + SENSOR_OFF_K))
            told = replace(self, whole=True)
        elif liquid and self.whole and self.may_be_liquid:
            (least, most), solid = self.power, at.cold.solid_level
            spare = _SPARE * (at.cold.liquid_level - solid)
            spare += (1 - least / most) * (solid - at.cold.level_at(at.cold.ambient_C))
            enough = min(self.enough, max(at.cold.level(cold), at.cold.solid_level) + spare)
            told = replace(self, whole=False, enough=enough)
        if shown_C >= at.soft_C - _HELD_K and self.may_be_liquid:
            cold = _within(at.cold, cold, (at.liquid_C, math.inf))
        if self.cut and not self.melted and self.off_s >= _PAUSE_S:
            hot = _within(at.hot, hot, (-math.inf, at.cut_C - _PORTION_K))
        elif liquid and self.mean * self.least <= at.quiet:
            hot = _within(at.hot, hot, (-math.inf, shown_C + _QUIET_K))
        melted = liquid or (self.melted and self.off_s < _SETTLED_S)
        return replace(told, cold=cold, hot=hot, melted=melted)

    def _judged(self) -> HeatBelief:
        """Switch off where metal may be too hot, or must be liquid and is not said to be."""
        cut = self.at_most_C >= self.corners.cut_C - _COOLED_K * self.cut
        return replace(self, cut=cut or self.overdue)


def heat_belief(robot: Robot, air_C: float, segment: int, start_C: float) -> HeatBelief:
    """Believe in a segment (from 0) that has rested at this temperature."""
    heater, model = robot.heater, segment_model(robot, air_C, segment)
    full_A = heater.melt_current_A
    ranges = robot.thermal_segment(segment).ranges

    def warms_s(one: SegmentModel) -> float:
        return _warms_s(one, full_A)

    def melts(one: SegmentModel) -> float:
        """Time until it is liquid, of a segment that warms by 1 K/s: its slope is measured."""
        cold = one.initial(one.ambient_C)
        return one.time_until(cold, full_A, one.liquid_level) * _slope(one, cold, full_A)

    hot, cold = corners(model, ranges, melts)
    quick_s, slow_s = map(warms_s, corners(model, ranges, warms_s))
    powers = _power(cold, full_A, slow_s) / _WEAK, _power(cold, full_A, quick_s)
    hottest = model.initial(heater.temperature_max_C)
    kept = model.holding_current_A(hottest, _LONG_S) / full_A
    liquid_C = stiffness_rule(robot, air_C, segment).liquid_above_C
    off_K = liquid_C + _EVIDENT_K - thresholds_C(hot)[1]
    at = Corners(
        cold=cold,
        hot=hot,
        hot_needs=_power(hot, full_A, _warms_s(cold, full_A)),
        powers=powers,
        quiet=kept**2 * _power(cold, full_A, _warms_s(model, full_A)),
        full_A=full_A,
        soft_C=heater.soft_setpoint_C,
        liquid_C=liquid_C,
        evident=max(cold.liquid_level, cold.level_at(thresholds_C(cold)[1] + off_K)),
        cut_C=heater.temperature_max_C,
    )
    states = cold.initial(start_C), hot.initial(start_C)
    return HeatBelief(
        at, *states, (start_C, start_C), start_C, at.evident, least=powers[0], most=powers[1]
    )


_HALVINGS = 40
_SHORT_S, _LONG_S = 1e-3, 1e4


def _slope(model: SegmentModel, state: State, current_A: float) -> float:
    """Rate of the metal's temperature [K/s]."""
    after = model.propagate(state, current_A, _SHORT_S)
    return (model.temperature_C(after) - model.temperature_C(state)) / _SHORT_S


def _within(model: SegmentModel, state: State, bounds_C: tuple[float, float]) -> State:
    """State whose level is within those of two temperatures."""
    low, high = (b if math.isinf(b) else model.level_at(b) for b in bounds_C)
    level = min(max(model.level(state), low), high)
    return state if level == model.level(state) else model.at_level(state, level)


def _warms_s(model: SegmentModel, current_A: float) -> float:
    """Time from the air's temperature to the first melt."""
    return model.time_until(model.initial(model.ambient_C), current_A, model.solid_level)


def _power(model: SegmentModel, full_A: float, warms_s: float) -> float:
    """Power with which a segment warms so long, as a share of its full power."""
    low, high = 0.01, 20.0
    for _ in range(_HALVINGS):
        power = math.sqrt(low * high)
        slower = _warms_s(model, math.sqrt(power) * full_A) > warms_s
        low, high = (power, high) if slower else (low, power)
    return power
