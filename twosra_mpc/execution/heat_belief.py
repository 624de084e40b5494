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
from typing import NamedTuple

import numpy as np

from twosra_mpc.control.stiffness import stiffness_rule
from twosra_mpc.control.thermistor import Lag, follow
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import SegmentModel, State, thresholds_C
from twosra_mpc.thermal.uncertainty import corners

SENSOR_OFF_K = 3.0  # thermistor of 1 % parts 1.1, melting point 1, model 1
LAGS_S = (4.0, 4.0)  # slowest healthy sensor; none is faster than no lag
ABOVE_K = 2.0  # over the highest temperature, of the hot corner: what is likely is 10 K below
_COOLED_K = 3.0  # below that the heater may be on again
_WINDOW_S = 6.0  # of a slope: 0.02 K of noise is 0.3 % of it
_SLOPE = 0.03  # relative error of one: thermistor's slope 2 %, loss 2 %
_PART = 0.5  # of its final slope a sensor must show at least: before, slopes tell too little
_SLOWED = 0.7  # of its steepest rise, at which a slow sensor is 3.9 s of that rise behind
_BEHIND_S = 4.0
_FULL = 0.95  # of the current
_SETTLED_S = 30.0  # heater off: sensor and metal are together
_MEAN_S = 12.0  # over which power is averaged
_QUIET_K = 11.0  # ahead of its sensor is metal that is kept warm, at most
_SPARE = 0.06  # of the latent heat, for a start that was known to 3 K
_HELD_K = 0.25  # below the set-point: lower ones may be of metal that melts, and a sensor 2 K off


class _Sample(NamedTuple):
    """Reading at full current, and a ramp of 1 K/s as the slowest healthy sensor would show it."""

    time_s: float
    shown_C: float
    ramp_C: float


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
        told: The same by this rise.
        start_C: Reading at its start; infinite if sensor and metal were not together.
        begun: States of the corners then.
        samples: Of the last `_WINDOW_S`, at full current.
        ramp: The slowest healthy sensor on a ramp of 1 K/s since full current began.
        full_s: For how long full current has flowed.
        off_s: For how long none has.
        mean: Share of the full current's heat, averaged over `_MEAN_S`.
        slow: Whether the sensor rises less than any healthy one, far from where metal melts.
        cut: Whether the heater must be off, whatever a reading says.
        enough: Level of the cold corner at which all earlier melts were done.
        whole: Whether all metal was solid when this melt began.
    """

    corners: Corners
    cold: State
    hot: State
    shown: Lag
    shown_C: float
    enough: float
    least: float
    most: float
    told: float = math.inf
    start_C: float = math.inf
    begun: tuple[State, State] = ((), ())
    samples: tuple[_Sample, ...] = ()
    ramp: Lag = (0.0, 0.0)
    full_s: float = 0.0
    off_s: float = math.inf
    mean: float = 0.0
    slow: bool = False
    cut: bool = False
    whole: bool = True

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
        return self.at_most_C + SENSOR_OFF_K

    @property
    def may_be_liquid(self) -> bool:
        """Whether the hot corner is liquid."""
        return self.corners.hot.level(self.hot) >= self.corners.hot.liquid_level

    @property
    def surely_liquid(self) -> bool:
        """Whether the cold corner has had the heat with which all earlier melts were done."""
        return self.corners.cold.level(self.cold) >= self.enough

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
        return self.least, max(self.least, min(self.most, self.told))

    def advance(self, current_A: float, passed_s: float) -> HeatBelief:
        """Propagate both corners with a current."""
        at, (least, most) = self.corners, self.power
        cold_A, hot_A = (current_A * math.sqrt(p) for p in (least, most * at.hot_needs))
        cold = at.cold.propagate(self.cold, cold_A, passed_s)
        hot = at.hot.propagate(self.hot, hot_A, passed_s)
        cold_C = self.at_least_C, at.cold.temperature_C(cold)
        heat, left = (current_A / at.full_A) ** 2, math.exp(-passed_s / _MEAN_S)
        full = current_A >= _FULL * at.full_A
        since_s = self.full_s + passed_s
        begun = replace(
            self,
            cold=cold,
            hot=hot,
            shown=follow(self.shown, LAGS_S, *cold_C, passed_s),
            off_s=0.0 if current_A > 0 else self.off_s + passed_s,
            mean=heat + (self.mean - heat) * left,
        )
        if full and self.full_s == 0.0:
            together = self.off_s >= _SETTLED_S
            start_C = self.shown_C if together else math.inf
            begun = replace(begun, start_C=start_C, begun=(self.cold, self.hot))
        if full:
            ramp = follow(self.ramp, LAGS_S, self.full_s, since_s, passed_s)
            return replace(begun, full_s=since_s, ramp=ramp)
        if self.full_s == 0.0:
            return begun
        told = replace(begun, most=self.power[1], told=math.inf, start_C=math.inf)
        return replace(told, samples=(), ramp=(0.0, 0.0), full_s=0.0, slow=False)

    def take(self, shown_C: float) -> HeatBelief:
        """Take in a reading."""
        read = replace(self, shown_C=shown_C)
        told = read._rising(shown_C)
        if told.power != self.power:
            told = told._anew()
        return told._together(shown_C)._judged(shown_C)

    def _anew(self) -> HeatBelief:
        """Propagate both corners anew since full current began, with what is now known of it."""
        at, (least, most) = self.corners, self.power
        cold_A, hot_A = (at.full_A * math.sqrt(p) for p in (least, most * at.hot_needs))
        cold = at.cold.propagate(self.begun[0], cold_A, self.full_s)
        hot = at.hot.propagate(self.begun[1], hot_A, self.full_s)
        return replace(self, cold=cold, hot=hot)

    def _rising(self, shown_C: float) -> HeatBelief:
        """Tell the power by the slope at full current, and whether it is a healthy sensor's."""
        if self.full_s == 0.0:
            return self
        here = _Sample(self.full_s, shown_C, self.ramp[1])
        samples = (*self.samples, here)
        while len(samples) > 2 and here.time_s - samples[1].time_s >= _WINDOW_S:
            samples = samples[1:]
        told = replace(self, samples=samples)
        span_s = here.time_s - samples[0].time_s
        if span_s < _WINDOW_S:
            return told
        part = (here.ramp_C - samples[0].ramp_C) / span_s
        time_s, shown = np.array([each[:2] for each in samples]).T
        slope = float(np.polyfit(time_s - time_s[0], shown, 1)[0])
        reached, middle_C = self.corners.cold, float(shown.mean())
        state = reached.at_level(self.cold, reached.level_at(middle_C))
        off, full = (_slope(reached, state, share * self.corners.full_A) for share in (0.0, 1.0))
        gap_K = thresholds_C(reached)[0] - shown_C
        expected = off + self.least * (full - off)
        slow = part >= _PART and slope < _SLOWED * part * expected
        slow &= gap_K > _BEHIND_S * expected + SENSOR_OFF_K
        power = (slope - off) / (full - off)
        least = max(self.least, min(power * (1 - _SLOPE), self.most)) if gap_K > 0 else self.least
        cold_level = reached.level_at(
            reached.ambient_C
        )  # with more power an earlier melt took more
        enough = cold_level + least / self.least * (self.enough - cold_level)
        enough = min(enough, reached.liquid_level)
        told = replace(told, slow=slow, least=least, enough=enough)
        if part < _PART:
            return told
        reached_C = self.start_C + max(expected, slope / part) * self.full_s
        solid = reached_C < thresholds_C(self.corners.hot)[0]
        return replace(told, told=(1 + _SLOPE) * power / part) if solid else told

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
        if self.mean * self.least <= at.quiet and (liquid or self.cut):
            hot = _within(at.hot, hot, (-math.inf, shown_C + _QUIET_K))
        return replace(told, cold=cold, hot=hot)

    def _judged(self, shown_C: float) -> HeatBelief:
        """Switch off where metal may be too hot, or must be liquid and is not said to be."""
        at, cold = self.corners, self.corners.cold
        cut = self.at_most_C >= at.cut_C - _COOLED_K * self.cut
        done = self.enough + cold.level_at(at.liquid_C) - cold.liquid_level
        return replace(self, cut=cut or (shown_C < at.liquid_C and cold.level(self.cold) >= done))


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
    powers = _power(cold, full_A, slow_s), _power(cold, full_A, quick_s)
    hottest = model.initial(heater.temperature_max_C)
    kept = model.holding_current_A(hottest, _LONG_S) / full_A
    at = Corners(
        cold=cold,
        hot=hot,
        hot_needs=_power(hot, full_A, _warms_s(cold, full_A)),
        powers=powers,
        quiet=kept**2 * _power(cold, full_A, _warms_s(model, full_A)),
        full_A=full_A,
        soft_C=heater.soft_setpoint_C,
        liquid_C=stiffness_rule(robot, air_C, segment).liquid_above_C,
        cut_C=heater.temperature_max_C + ABOVE_K,
    )
    states = cold.initial(start_C), hot.initial(start_C)
    return HeatBelief(
        at, *states, (start_C, start_C), start_C, cold.liquid_level, least=powers[0], most=powers[1]
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
