"""Healthy segments of every kind, warmed by one heater's current, each under a sensor of its own.

They are drawn over the ranges of the robot file, and a little wider. All are one segment model
whose parameters are arrays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import Array, SegmentModel, thresholds_C
from twosra_mpc.thermal.uncertainty import healthy_ranges

COUNT = 600  # with fewer, the one most like a true one may be lost
_WIDER = 0.03  # share by which ranges are wider than the robot file's: segments at their ends
_MELTS_OFF_K, _AIR_OFF_K = 1.3, 2.0  # thermistors and dividers of 1 % parts
_LAGS, _SHARES = (0.18, 1.06), (0.5, 1.0)  # of the longest lag in all; of it in one of the two
_START_OFF_K = 3.0  # of metal that is said to be warm
_SOLID_K = 5.0  # below the melting point a reading is of solid metal
_HELD_S = 3.0  # in which a switch brings metal back to its set-point
_STEP_S = 0.5  # the fastest metal warms by 1 K in it
_EPS = 1e-6


class Heat(NamedTuple):
    """What a heater did from one reading to the next.

    Attributes:
        passed_s: Time.
        share: Share of it at full current, or of the full current's heat.
        unknown: By how much more or less that may be.
        warm: Whether this was metal to be kept warm, not molten: not every firmware does.
        held_C: Reading about which a switch holds liquid metal, with a share nobody knows; or NaN.
    """

    passed_s: float
    share: float
    unknown: float = 0.0
    warm: bool = False
    held_C: float = math.nan

    @property
    def unknown_s(self) -> float:
        """Time at full current that nobody knows of."""
        return self.passed_s * (self.unknown if math.isnan(self.held_C) else 1.0)

    def then(self, later: Heat) -> Heat:
        """Heat of both times."""
        passed_s = self.passed_s + later.passed_s
        if self.passed_s == 0.0 or later.passed_s == 0.0:
            return later if self.passed_s == 0.0 else self
        part = later.passed_s / passed_s
        share, unknown = (
            before + part * (after - before)
            for before, after in ((self.share, later.share), (self.unknown, later.unknown))
        )
        held_C = math.nan if math.isnan(self.held_C) else later.held_C
        return Heat(passed_s, share, unknown, later.warm, held_C)


@dataclass(frozen=True)
class Kinds:
    """Kinds of segments that are healthy.

    Attributes:
        nominal: The segment as described.
        full_A: Full current.
        solid_C: Reading below which all metal is solid.
        names: Parameters of the model that differ.
        low: Least values of these; of gain, lag and its share in the first of two; of whether
            firmware keeps metal warm, if rounded, (p, 1).
        high: Largest, (p, 1).
    """

    nominal: SegmentModel
    full_A: float
    solid_C: float
    names: tuple[str, ...]
    low: Array
    high: Array

    def drawn(self, rng: np.random.Generator) -> Array:
        """Values of segments drawn evenly, (p, n)."""
        return self.low + (self.high - self.low) * rng.random((len(self.low), COUNT))

    def model(self, values: Array) -> SegmentModel:
        """All as one, whose parameters are arrays."""
        return replace(self.nominal, **dict(zip(self.names, values, strict=False)))


@dataclass(frozen=True, eq=False)
class HealthySegments:
    """Segments, their metal and what their sensors show.

    Attributes:
        kinds: What they are drawn from.
        values: Of each segment, (p, n).
        model: All as one.
        state: Of its metal, by the model, each (n,).
        lag_C: Of its sensor, (2, n); the last is what it shows.
        worst_K: Largest distance from the readings, which is forgotten slowly, (n,).
        taken: Times that have passed, the seed of what is drawn.
    """

    kinds: Kinds
    values: Array
    model: SegmentModel
    state: tuple[Array, ...]
    lag_C: Array
    worst_K: Array
    taken: int = 0

    @property
    def metal_C(self) -> Array:
        """Temperature of each."""
        return self.model.temperature_C(self.state)

    @property
    def liquid(self) -> NDArray[np.bool_]:
        """Which are liquid."""
        return np.asarray(self.model.level(self.state) >= self.model.liquid_level)

    def rng(self, *more: int) -> np.random.Generator:
        """Chance that is the same in every run."""
        return np.random.default_rng([self.taken, *more])

    def begun(self, shown_C: float, start_C: float) -> HealthySegments:
        """Begin at rest: at the first reading where metal is solid, else as it is said to be."""
        (gain, *_), air_C = self._sensor(), self.model.ambient_C
        metal_C = air_C + (shown_C - air_C) / gain
        if shown_C >= self.kinds.solid_C:
            metal_C = start_C + self.rng().uniform(-_START_OFF_K, _START_OFF_K, len(gain))
        nominal = self.kinds.nominal
        each = [nominal.initial(one_C) for one_C in metal_C.tolist()]
        state = self.model.as_in(nominal, tuple(map(np.array, zip(*each, strict=True))))
        touched_C = air_C + gain * (self.model.temperature_C(state) - air_C)
        return replace(self, state=state, lag_C=np.array([touched_C, touched_C]))

    def warmed(self, heat: Heat) -> HealthySegments:
        """Let time pass for all."""
        if not heat.passed_s:
            return self
        model, state, lag_C = self.model, self.state, self.lag_C
        (gain, lags_s, keeps), air_C = self._sensor(), model.ambient_C
        share = np.full(len(gain), heat.share)
        if heat.unknown:
            share += heat.unknown * self.rng().uniform(-1.0, 1.0, len(gain))
        share = np.clip(share, 0.0, 1.0) * (keeps if heat.warm else 1.0)
        if not math.isnan(heat.held_C):
            share = np.where(self.liquid, self._holding(heat.held_C), share)
        steps = max(1, math.ceil(heat.passed_s / _STEP_S - 1e-9))
        step_s, current_A = heat.passed_s / steps, self.kinds.full_A * np.sqrt(share)
        kept = np.exp(-step_s / lags_s)
        touched_C = air_C + gain * (model.temperature_C(state) - air_C)
        for _ in range(steps):
            state = _after(model, state, current_A, step_s)
            before_C, touched_C = touched_C, air_C + gain * (model.temperature_C(state) - air_C)
            middle_C = (before_C + touched_C) / 2
            first_C = middle_C + (lag_C[0] - middle_C) * kept[0]
            middle_C = (lag_C[0] + first_C) / 2
            lag_C = np.array([first_C, middle_C + (lag_C[1] - middle_C) * kept[1]])
        return replace(self, state=state, lag_C=lag_C, taken=self.taken + 1)

    def compared(self, shown_C: float, kept: float) -> HealthySegments:
        """Compare all with a reading, of what was before keeping a share."""
        off_K = np.abs(self.lag_C[1] - shown_C)
        return replace(self, worst_K=np.maximum(off_K, self.worst_K * kept))

    def moved(self, of: NDArray[np.intp], values: Array) -> HealthySegments:
        """Segments as warm and as far molten as some of these are, of other values."""
        copied, model = self.kinds.model(self.values[:, of]), self.kinds.model(values)
        state = model.as_in(copied, tuple(value[of] for value in self.state))
        lag_C, worst_K = self.lag_C[:, of], self.worst_K[of]
        return replace(self, values=values, model=model, state=state, lag_C=lag_C, worst_K=worst_K)

    def heated(self, more_s: Array | float) -> HealthySegments:
        """Give each the heat of so long at full current, or take it away."""
        warm, cool = (self.model.rates(self.state, a) for a in (self.kinds.full_A, 0.0))
        each = zip(self.state, warm, cool, strict=True)
        return replace(self, state=tuple(value + more_s * (w - c) for value, w, c in each))

    def ahead_C(self, for_s: float) -> Array:
        """Temperatures after a short time at full current."""
        return self.model.temperature_C(_after(self.model, self.state, self.kinds.full_A, for_s))

    def nearest(self, others: HealthySegments) -> HealthySegments:
        """As many of both as are here, those that are nearest to what was shown."""
        far_K = np.concatenate([self.worst_K, others.worst_K])
        best = np.argsort(far_K, kind="stable")[: len(self.worst_K)]

        def of(mine: Array, theirs: Array) -> Array:
            both: Array = np.concatenate([mine, theirs], axis=-1)[..., best]
            return both

        values = of(self.values, others.values)
        return replace(
            self,
            values=values,
            model=self.kinds.model(values),
            state=tuple(map(of, self.state, others.state)),
            lag_C=of(self.lag_C, others.lag_C),
            worst_K=far_K[best],
        )

    def _sensor(self) -> tuple[Array, Array, Array]:
        """Gains, time constants (2, n), and 1 or 0: whether firmware keeps metal warm."""
        gain, lag_s, share, keeps = self.values[len(self.kinds.names) :]
        return gain, np.array([lag_s * share, lag_s * (1 - share)]) + _EPS, keeps.round()

    def _holding(self, shown_C: float) -> Array:
        """Shares with which metal goes to where a reading shows it."""
        model, (gain, *_) = self.model, self._sensor()
        here_C = self.metal_C
        cools_C, warms_C = (
            model.temperature_C(_after(model, self.state, current_A, 1.0))
            for current_A in (0.0, self.kinds.full_A)
        )
        to_C = model.ambient_C + (shown_C - model.ambient_C) / gain
        wanted_C = here_C + (to_C - here_C) / _HELD_S
        range_K = np.maximum(warms_C - cools_C, _EPS)  # none of metal that melts
        share: Array = np.clip((wanted_C - cools_C) / range_K, 0.0, 1.0)
        return share


def _after(
    model: SegmentModel, state: tuple[Array, ...], current_A: Array | float, for_s: float
) -> tuple[Array, ...]:
    """Metal after a short time."""
    rates = model.rates(state, current_A)
    return tuple(value + for_s * rate for value, rate in zip(state, rates, strict=True))


def healthy_segments(robot: Robot, air_C: float, segment: int, start_C: float) -> HealthySegments:
    """Draw segments of all kinds that have rested at this temperature; from 0."""
    nominal, described = segment_model(robot, air_C, segment), robot.thermal_segment(segment)
    gain, lags_s = described.sensor_gain_and_lags_s
    longest_s = 2 * described.ranges.get("sensor_lag_s", (0.0, max(lags_s)))[1]
    within = {
        name: (low - _MELTS_OFF_K, high + _MELTS_OFF_K)
        if name == "melting_point_C"
        else (low * (1 - _WIDER), high * (1 + _WIDER))
        for name, (low, high) in healthy_ranges(nominal, described.ranges).items()
    }
    within["ambient_C"] = (air_C - _AIR_OFF_K, air_C + _AIR_OFF_K)
    ends = [
        *within.values(),
        described.ranges.get("sensor_gain", (gain, gain)),
        (_LAGS[0] * longest_s, _LAGS[1] * longest_s),
        _SHARES,
        (0.0, 1.0),
    ]
    low, high = np.array(ends).T[:, :, None]
    solid_C = thresholds_C(nominal)[0] - _SOLID_K
    kinds = Kinds(nominal, robot.heater.melt_current_A, solid_C, tuple(within), low, high)
    values, nowhere = kinds.drawn(np.random.default_rng(segment)), np.zeros(COUNT)
    drawn = HealthySegments(
        kinds, values, kinds.model(values), (nowhere,), np.array([nowhere, nowhere]), nowhere
    )
    return drawn.begun(start_C, start_C)
