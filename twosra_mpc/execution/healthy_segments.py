"""Healthy segments of every kind, warmed side by side by one heater, each under its own sensor.

A kind is a point of a box: each parameter of the segment's model, of the air, of the sensor and of
the firmware, from -1 to 1 over the range of robots that nothing ails. All segments are one model
whose parameters are arrays; their metal is counted as the described segment's would be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import Array, SegmentModel, thresholds_C
from twosra_mpc.thermal.uncertainty import healthy_ranges
from twosra_mpc.validation import ArrayValue

_MELTS_OFF_K, _AIR_OFF_K, _GAIN_OFF = 0.3, 2.0, 0.03  # thermistors and dividers of 1 % parts
_LAGS, _SHARES = (0.18, 1.3), (0.5, 1.0)  # of the longest, and of reports; of it in the first
_REST_OFF_K, _WARM_OFF_K = 1.0, 3.0  # of metal at rest; of metal that is said to be warm
_SOLID_K, _NOISE_K = 5.0, 0.1  # below the melting point a reading is of solid metal; of readings
_HELD_S = 3.0  # in which a switch brings metal back to its set-point
_STEP_S, _COOLS_S = 0.5, 1.5  # the fastest metal warms by 1 K in the one, and cools in the other
_EPS = 1e-6


class Heat(NamedTuple):
    """Heat of a heater from one reading to the next.

    Attributes:
        passed_s: Time.
        share: Share of full power.
        unknown: By how much more or less that may be.
        warm: True if this was metal to be kept warm, not molten: not every firmware does.
        held_C: Reading about which a switch holds metal, with a share nobody knows.
    """

    passed_s: float
    share: float
    unknown: float = 0.0
    warm: bool = False
    held_C: float | None = None

    @property
    def off(self) -> bool:
        """True if there was none."""
        return not self.share and not self.unknown and self.held_C is None

    @property
    def unknown_s(self) -> float:
        """Time at full power that nobody knows of."""
        return self.passed_s * (self.unknown if self.held_C is None else 1.0)

    def then(self, later: Heat) -> Heat:
        """Heat of both times."""
        passed_s = self.passed_s + later.passed_s
        if self.passed_s == 0.0 or later.passed_s == 0.0:
            return later if self.passed_s == 0.0 else self
        part = later.passed_s / passed_s
        share = self.share + part * (later.share - self.share)
        unknown = self.unknown + part * (later.unknown - self.unknown)
        held_C = None if self.held_C is None else later.held_C
        return Heat(passed_s, share, unknown, later.warm, held_C)


class Start(NamedTuple):
    """Rest at the start: temperatures of metal and sensor, and by how much the metal's may be off.

    The metal's is the last parameter of a kind; it is at least ``least_C``.
    """

    metal_C: float
    shown_C: float
    off_K: float
    least_C: float = -math.inf


@dataclass(frozen=True, eq=False, repr=False)
class Kinds(ArrayValue):
    """Kinds of healthy segments.

    Attributes:
        nominal: The segment as described.
        full_A: Full current.
        names: Parameters of the model that differ.
        middle: Middle of their ranges, and of those of the sensor's gain, of its lag, of the lag's
            share in the first of two, of whether firmware keeps metal warm, of the sign of unknown
            heat, and of the start, (p,).
        half: Half of each range, (p,).
    """

    nominal: SegmentModel
    full_A: float
    names: tuple[str, ...]
    middle: Array
    half: Array

    @property
    def size(self) -> int:
        """Number of parameters p."""
        return len(self.middle)

    @property
    def either(self) -> int:
        """Which parameter says whether firmware keeps metal warm: it does, or does not."""
        return len(self.names) + 3

    @property
    def described(self) -> Array:
        """Point of the segment as described, and of the middle of what is not, (p,)."""
        described = self.middle.copy()
        described[: len(self.names)] = [getattr(self.nominal, name) for name in self.names]
        return (described - self.middle) / self.half

    @cached_property
    def melts_to_C(self) -> float:
        """Highest reading of metal that melts, of any kind."""
        names, most = self.names, self.middle + self.half
        melts_C = thresholds_C(replace(self.nominal, **dict(zip(names, most, strict=False))))[1]
        air_C = self.nominal.ambient_C
        return air_C + float(most[len(names)]) * (melts_C - air_C) + _NOISE_K

    def is_solid(self, shown_C: float) -> bool:
        """True if a reading is surely of solid metal."""
        return shown_C < thresholds_C(self.nominal)[0] - _SOLID_K

    def is_liquid(self, shown_C: float) -> bool:
        """True if a reading is above that of metal that melts."""
        return shown_C > self.melts_to_C

    def start(self, shown_C: float, said_C: float, liquid: bool = False) -> Start:
        """Rest as the first reading has it where metal is solid, else as it is said to be."""
        if self.is_solid(shown_C):
            return Start(shown_C, shown_C, _REST_OFF_K)
        least_C = thresholds_C(self.nominal)[1] + _EPS if liquid else -math.inf
        return Start(said_C, shown_C, _WARM_OFF_K, least_C)

    def begun(self, points: Array, start: Start) -> Segments:
        """Begin with segments of some kinds (n, p) at rest."""
        bodies, nominal = Bodies(self, (self.middle + self.half * points).T), self.nominal
        off_K = start.off_K * bodies.values[-1]
        at_start = tuple(map(np.atleast_1d, nominal.initial(start.metal_C)))
        melts_K = bodies.model.temperature_in(nominal, at_start) - start.metal_C
        starts_C = np.maximum(start.metal_C + off_K - melts_K, start.least_C)
        each = [nominal.initial(one) for one in starts_C.tolist()]
        shown_C = start.shown_C + off_K * (start.metal_C == start.shown_C)
        return Segments(bodies, tuple(np.array(each).T), shown_C, shown_C)


class Sensor(NamedTuple):
    """Sensors and firmware, each (n,): gain, lags (2, n), heat to keep warm, unknown heat."""

    gain: Array
    lags_s: Array
    keeps: Array
    bias: Array


@dataclass(frozen=True, eq=False, repr=False)
class Bodies(ArrayValue):
    """Segments of some kinds, all as one.

    Attributes:
        kinds: What they are of.
        values: Their parameters, (p, n).
    """

    kinds: Kinds
    values: Array

    @cached_property
    def model(self) -> SegmentModel:
        """Model whose parameters are arrays."""
        own = dict(zip(self.kinds.names, self.values, strict=False))
        return replace(self.kinds.nominal, **own)

    @cached_property
    def sensor(self) -> Sensor:
        """Their sensors."""
        gain, lag_s, share, keeps, bias, _ = self.values[len(self.kinds.names) :]
        lags_s = np.maximum([lag_s * share, lag_s * (1 - share)], _EPS)
        return Sensor(gain, lags_s, np.clip(keeps, 0.0, 1.0), bias)


@dataclass(frozen=True, eq=False, repr=False)
class Segments(ArrayValue):
    """Segments, their metal and what their sensors show.

    Attributes:
        bodies: What they are.
        state: Of their metal, as the nominal model's, each (n,).
        between_C: Temperatures between the two lags of their sensors, (n,).
        shown_C: Readings, (n,).
    """

    bodies: Bodies
    state: tuple[Array, ...]
    between_C: Array
    shown_C: Array

    @property
    def level(self) -> Array:
        """Levels of the metal, as the nominal model's, (n,)."""
        return self.bodies.kinds.nominal.level(self.state)

    def some(self, which: slice) -> Segments:
        """Some of them."""
        bodies = Bodies(self.bodies.kinds, self.bodies.values[:, which])
        state = tuple(value[which] for value in self.state)
        return Segments(bodies, state, self.between_C[which], self.shown_C[which])

    def warmed(self, heat: Heat) -> Segments:
        """Let time pass."""
        nominal, model = self.bodies.kinds.nominal, self.bodies.model
        sensor, state = self.bodies.sensor, self.state
        steps = max(1, math.ceil(heat.passed_s / (_COOLS_S if heat.off else _STEP_S) - 1e-9))
        step_s, current_A = heat.passed_s / steps, self._current_A(heat)
        between_C, shown_C, half = self.between_C, self.shown_C, sensor.gain / 2
        untouched_C = model.ambient_C * (1 - sensor.gain)
        caught_up = -np.expm1(-step_s / sensor.lags_s)
        here_C = model.temperature_in(nominal, state)
        for _ in range(steps):
            rates = model.rates_in(nominal, state, here_C, current_A)
            state = tuple(value + step_s * rate for value, rate in zip(state, rates, strict=True))
            before_C, here_C = here_C, model.temperature_in(nominal, state)
            touched_C = untouched_C + half * (before_C + here_C)
            last_C, between_C = between_C, between_C + (touched_C - between_C) * caught_up[0]
            shown_C = shown_C + ((last_C + between_C) / 2 - shown_C) * caught_up[1]
        return Segments(self.bodies, state, between_C, shown_C)

    def warms_by(self, for_s: float) -> Array:
        """Rise of the level at full current, (n,)."""
        kinds, nominal = self.bodies.kinds, self.bodies.kinds.nominal
        here_C = self.bodies.model.temperature_in(nominal, self.state)
        ahead = self._after(here_C, kinds.full_A, for_s)
        return nominal.level(ahead) - nominal.level(self.state)

    def _current_A(self, heat: Heat) -> Array | float:
        if heat.off:
            return 0.0
        sensor = self.bodies.sensor
        known = heat.share if heat.held_C is None else self._holding(heat.held_C)
        share = np.clip(known + heat.unknown * sensor.bias, 0.0, 1.0)
        if heat.warm:
            share = share * sensor.keeps
        return self.bodies.kinds.full_A * np.sqrt(share)

    def _after(self, here_C: Array, current_A: Array | float, for_s: float) -> tuple[Array, ...]:
        nominal = self.bodies.kinds.nominal
        rates = self.bodies.model.rates_in(nominal, self.state, here_C, current_A)
        return tuple(value + for_s * rate for value, rate in zip(self.state, rates, strict=True))

    def _holding(self, shown_C: float) -> Array:
        """Shares with which metal goes to where a reading shows it."""
        kinds, model = self.bodies.kinds, self.bodies.model
        nominal, air_C = kinds.nominal, model.ambient_C
        here_C = model.temperature_in(nominal, self.state)
        cools_C, warms_C = (
            model.temperature_in(nominal, self._after(here_C, current_A, 1.0))
            for current_A in (0.0, kinds.full_A)
        )
        to_C = air_C + (shown_C - air_C) / self.bodies.sensor.gain
        wanted_C = here_C + (to_C - here_C) / _HELD_S
        range_K = np.maximum(warms_C - cools_C, _EPS)  # none of metal that melts
        return np.clip((wanted_C - cools_C) / range_K, 0.0, 1.0)


def healthy_kinds(robot: Robot, air_C: float, segment: int) -> Kinds:
    """Kinds that a segment (from 0) in this air may be of."""
    nominal, described = segment_model(robot, air_C, segment), robot.thermal_segment(segment)
    gain, lags_s = described.sensor_gain_and_lags_s
    longest_s = 2 * described.ranges.get("sensor_lag_s", (0.0, max(lags_s)))[1]
    within = healthy_ranges(nominal, described.ranges)
    if "melting_point_C" in within:
        least_C, most_C = within["melting_point_C"]
        within["melting_point_C"] = least_C - _MELTS_OFF_K, most_C + _MELTS_OFF_K
    within["ambient_C"] = air_C - _AIR_OFF_K, air_C + _AIR_OFF_K
    low, high = described.ranges.get("sensor_gain", (gain, gain))
    sensor = (low - _GAIN_OFF, high + _GAIN_OFF), (_LAGS[0] * longest_s, _LAGS[1] * longest_s)
    ends = np.array([*within.values(), *sensor, _SHARES, (0.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)])
    middle, half = ends.mean(axis=1), np.diff(ends, axis=1)[:, 0] / 2
    return Kinds(nominal, robot.heater.melt_current_A, tuple(within), middle, half)
