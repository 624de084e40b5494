"""Belief about the heat of a segment: the healthy segments that would have shown what it showed.

Healthy segments of every kind, drawn over the ranges of the robot file, are warmed by the heater's
known current beside the true one, each under a sensor of its own. Whichever shows something else is
replaced by one like those that are left. So all that a robot has shown is known: the power of its
heater, its latent heat, its loss, the lag of its sensor. Metal is as hot as the hottest of those
that are left, liquid where one of them is, and liquid for sure where all are. A reading that none
of them can show is of no healthy segment: until it is, the heater is off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import Array, thresholds_C
from twosra_mpc.thermal.uncertainty import healthy_ranges

COUNT = 600  # of segments: with fewer, the one most like a true one may be lost
UNLIKE_K = 1.1  # off by more is no healthy segment: of nearly all, one is nearer than 0.4 K
_DOUBT_K = 0.7  # off by more, the heater waits
_FITS_K, _AS_WELL = 0.45, 1.4  # so far off at most, or so many times as far as the best, it is left
_FORGET_S = 80.0  # over which a distance is forgotten: currents are known to a second only
_RENEWED = 0.4  # share of those left below which the others are replaced
_SPREAD, _LEAST_SPREAD = 0.3, 0.003  # of the new: of those left, and of the ranges
_NEARER = 1 - math.sqrt(1 - _SPREAD**2)
_METAL_S = 0.02  # of full heat, by which their metal differs from what they replace
_BEFORE_LIMIT_K, _COOLED_K = 2.0, 3.0  # the heater goes off before the limit, and on again
_AHEAD_S = 1.0  # until the next reading the heater may go on
_WIDER = 0.03  # share by which ranges are wider than the robot file's: segments at their ends
_MELTS_OFF_K, _AIR_OFF_K, _GAIN_OFF = 1.3, 2.0, 0.0  # thermistors and dividers of 1 % parts
_LAGS, _SHARES = (0.18, 1.06), (0.5, 1.0)  # of the longest lag in all; of it in one of the two
_START_OFF_K = 3.0  # of metal that is said to be warm
_SOLID_K = 5.0  # below the melting point a first reading is believed
_STEP_S = 0.5
_QUIET_S, _MOST, _LOOK_AGAIN, _ROUNDS, _ELITE = 30.0, 2000, 2, 6, 10
_HELD_S = 3.0  # in which a switch brings metal back to its set-point
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


@dataclass(frozen=True, eq=False)
class HeatBelief:
    """Healthy segments; a value, which ``take`` replaces.

    Attributes:
        nominal: The segment as described.
        model: All segments as one, whose parameters are arrays.
        full_A: Full current.
        cut_C: Temperature of the hottest from which on the heater is off.
        solid_C: Reading below which all metal is solid.
        names: Parameters of the model that differ.
        low: Least values of these; of gain, lag and its share in the first of two; of whether
            firmware keeps metal warm, if rounded, (p, 1).
        high: Largest, (p, 1).
        values: Of each segment, (p, n).
        state: Of its metal, by the model, each (n,).
        lag_C: Of its sensor, (2, n).
        worst_K: Largest distance from the readings, which is forgotten slowly, (n,).
        left: Which are left, (n,).
        taken: Steps so far, the seed of what is drawn.
        cut: Whether the heater must be off, whatever a reading says.
        start: This belief when the metal was last surely solid, its heater off for a while.
        since: Heat and readings since.
        quiet_s: Time for which the heater has been off.
        looked: Readings since all were last looked for.
    """

    nominal: Any
    model: Any
    full_A: float
    cut_C: float
    solid_C: float
    names: tuple[str, ...]
    low: Array
    high: Array
    values: Array
    state: tuple[Array, ...]
    lag_C: Array
    worst_K: Array
    left: NDArray[np.bool_]
    taken: int = 0
    cut: bool = False
    start: HeatBelief | None = None
    since: tuple[tuple[Heat, float], ...] = ()
    quiet_s: float = 0.0
    looked: int = 0

    @property
    def off_K(self) -> float:
        """Distance of the readings from those of the most similar healthy segment."""
        return float(self.worst_K.min())

    @property
    def shows_C(self) -> tuple[float, float]:
        """Lowest and highest reading of those that are left."""
        shown_C = self.lag_C[1][self.left]
        return float(shown_C.min()), float(shown_C.max())

    @property
    def metal_C(self) -> tuple[float, float]:
        """Coldest and hottest metal of those that are left."""
        metal_C = self.model.temperature_C(self.state)[self.left]
        return float(metal_C.min()), float(metal_C.max())

    @property
    def may_be_liquid(self) -> bool:
        """Whether one of those that are left is liquid."""
        return bool(self._liquid[self.left].any())

    @property
    def surely_liquid(self) -> bool:
        """Whether all that are left are liquid."""
        return bool(self._liquid[self.left].all())

    def take(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Warm all, and compare them with a reading, if there is one."""
        now = self._warmed(heat) if heat.passed_s else self
        if shown_C is None:
            return now._remembering(heat, math.nan)
        forgotten = math.exp(-heat.passed_s / _FORGET_S)
        now = now._compared(shown_C, forgotten)._remembering(heat, shown_C)
        if now.off_K > _DOUBT_K and now.looked >= _LOOK_AGAIN:
            now = now._looked_for()
        return (now._renewed() if now.left.mean() < _RENEWED else now)._judged()

    def _compared(self, shown_C: float, forgotten: float) -> HeatBelief:
        worst_K = np.maximum(np.abs(self.lag_C[1] - shown_C), self.worst_K * forgotten)
        left = worst_K <= max(_FITS_K, _AS_WELL * float(worst_K.min()))
        return replace(self, worst_K=worst_K, left=left)

    def _remembering(self, heat: Heat, shown_C: float) -> HeatBelief:
        """Remember a reading, or begin anew where the metal is surely solid."""
        quiet_s = 0.0 if heat.share + heat.unknown > 0.0 else self.quiet_s + heat.passed_s
        solid = quiet_s >= _QUIET_S and self.off_K <= _FITS_K and (shown_C or math.inf) < self.solid_C
        if solid or self.start is None or len(self.since) >= _MOST:
            start = replace(self, start=None, since=())
            return replace(self, start=start, since=(), quiet_s=quiet_s, looked=self.looked + 1)
        since = (*self.since, (heat, shown_C))
        return replace(self, since=since, quiet_s=quiet_s, looked=self.looked + 1)

    def _looked_for(self) -> HeatBelief:
        """Look for healthy segments that would have shown all since the metal was solid.

        By the cross-entropy method: of those drawn over all ranges and near those that are left,
        the best are kept, and others drawn as they are spread, some times.
        """
        rng, (parts, count) = np.random.default_rng([self.taken, 1]), self.values.shape
        width, left = self.high - self.low, np.flatnonzero(self.left)
        of = rng.choice(left, count)
        near = self.values[:, of] + 0.1 * width * rng.standard_normal((parts, count))
        anywhere = self.low + width * rng.random((parts, count))
        values = np.where(np.arange(count) % 2, near, anywhere)
        found: HeatBelief | None = None
        for _ in range(_ROUNDS):
            tried = self._replayed(values.clip(self.low, self.high), rng.integers(0, count, count))
            found = tried if found is None else found._best_of(tried)
            best = found.values[:, np.argsort(found.worst_K)[: count // _ELITE]]
            middle, apart = best.mean(axis=1, keepdims=True), (best - best.mean(axis=1, keepdims=True))
            mixed = rng.standard_normal((best.shape[1], count)) / math.sqrt(best.shape[1])
            values = middle + 1.2 * apart @ mixed + 0.003 * width * rng.standard_normal((parts, count))
        assert found is not None
        if found.off_K >= self.off_K:
            return replace(self, looked=0)
        left_ = found.worst_K <= max(_FITS_K, _AS_WELL * found.off_K)
        return replace(found, left=left_, looked=0)

    def _replayed(self, values: Array, of: NDArray[np.intp]) -> HeatBelief:
        """Segments of these parameters that were as warm as some when the metal was solid."""
        assert self.start is not None
        now = replace(self.start._moved(of, values), worst_K=np.zeros(len(of)), taken=self.taken)
        for heat, shown_C in self.since:
            now = now._warmed(heat) if heat.passed_s else now
            if not math.isnan(shown_C):
                now = now._compared(shown_C, math.exp(-heat.passed_s / _FORGET_S))
        return replace(
            self,
            values=values,
            model=now.model,
            state=now.state,
            lag_C=now.lag_C,
            worst_K=now.worst_K,
        )

    def _best_of(self, other: HeatBelief) -> HeatBelief:
        """As many of the segments of two beliefs as one has, those nearest to what was shown."""
        best = np.argsort(np.concatenate([self.worst_K, other.worst_K]), kind="stable")
        best = best[: len(self.worst_K)]

        def of(mine: Array, others: Array) -> Array:
            both: Array = np.concatenate([mine, others], axis=-1)[..., best]
            return both

        values = of(self.values, other.values)
        mine = replace(
            self,
            values=values,
            model=_as_one(self.nominal, self.names, values),
            state=tuple(map(of, self.state, other.state)),
            lag_C=of(self.lag_C, other.lag_C),
            worst_K=of(self.worst_K, other.worst_K),
        )
        return mine

    def _moved(self, of: NDArray[np.intp], values: Array) -> HeatBelief:
        """Segments as warm and as far molten as some, of these parameters."""
        copied = _as_one(self.nominal, self.names, self.values[:, of])
        model = _as_one(self.nominal, self.names, values)
        return replace(
            self,
            values=values,
            model=model,
            state=model.as_in(copied, tuple(value[of] for value in self.state)),
            lag_C=self.lag_C[:, of],
            worst_K=self.worst_K[of],
            left=self.left[of],
        )

    def begun(self, shown_C: float, start_C: float) -> HeatBelief:
        """Begin at rest: at the first reading where metal is solid, else as it is said to be."""
        gain, *_ = self._sensor()
        air_C = self.model.ambient_C
        metal_C = air_C + (shown_C - air_C) / gain
        if shown_C >= self.solid_C:
            metal_C = start_C + self._rng().uniform(-_START_OFF_K, _START_OFF_K, len(gain))
        each = [self.nominal.initial(one_C) for one_C in metal_C.tolist()]
        state = self.model.as_in(self.nominal, tuple(map(np.array, zip(*each, strict=True))))
        touched_C = air_C + gain * (self.model.temperature_C(state) - air_C)
        return replace(self, state=state, lag_C=np.array([touched_C, touched_C]))

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.taken)

    @property
    def _liquid(self) -> NDArray[np.bool_]:
        return np.asarray(self.model.level(self.state) >= self.model.liquid_level)

    def _sensor(self) -> tuple[Array, Array, Array]:
        """Gains, time constants (2, n), and 1 or 0: whether firmware keeps metal warm."""
        gain, lag_s, share, keeps = self.values[len(self.names) :]
        return gain, np.array([lag_s * share, lag_s * (1 - share)]) + _EPS, keeps.round()

    def _warmed(self, heat: Heat) -> HeatBelief:
        """Let time pass for all."""
        model, state, lag_C = self.model, self.state, self.lag_C
        (gain, lags_s, keeps), air_C = self._sensor(), model.ambient_C
        share = np.full(len(gain), heat.share)
        if heat.unknown:
            share += heat.unknown * self._rng().uniform(-1.0, 1.0, len(gain))
        share = np.clip(share, 0.0, 1.0) * (keeps if heat.warm else 1.0)
        if not math.isnan(heat.held_C):
            share = np.where(self._liquid, self._holding(heat.held_C), share)
        steps = max(1, math.ceil(heat.passed_s / _STEP_S - 1e-9))
        step_s, current_A = heat.passed_s / steps, self.full_A * np.sqrt(share)
        kept = np.exp(-step_s / lags_s)
        touched_C = air_C + gain * (model.temperature_C(state) - air_C)
        for _ in range(steps):
            state = self._after(state, current_A, step_s)
            before_C, touched_C = touched_C, air_C + gain * (model.temperature_C(state) - air_C)
            middle_C = (before_C + touched_C) / 2
            first_C = middle_C + (lag_C[0] - middle_C) * kept[0]
            middle_C = (lag_C[0] + first_C) / 2
            lag_C = np.array([first_C, middle_C + (lag_C[1] - middle_C) * kept[1]])
        return replace(self, state=state, lag_C=lag_C, taken=self.taken + 1)

    def _after(
        self, state: tuple[Array, ...], current_A: Array | float, for_s: Array | float
    ) -> tuple[Array, ...]:
        """Metal after a short time."""
        rates = self.model.rates(state, current_A)
        return tuple(value + for_s * rate for value, rate in zip(state, rates, strict=True))

    def _holding(self, shown_C: float) -> Array:
        """Shares with which metal goes to where a reading shows it."""
        model, (gain, *_) = self.model, self._sensor()
        here_C = model.temperature_C(self.state)
        cools_C, warms_C = (
            model.temperature_C(self._after(self.state, current_A, 1.0))
            for current_A in (0.0, self.full_A)
        )
        to_C = model.ambient_C + (shown_C - model.ambient_C) / gain
        wanted_C = here_C + (to_C - here_C) / _HELD_S
        range_K = np.maximum(warms_C - cools_C, _EPS)  # none of metal that melts
        share: Array = np.clip((wanted_C - cools_C) / range_K, 0.0, 1.0)
        return share

    def _renewed(self) -> HeatBelief:
        """Replace those that are not left by some like those that are."""
        rng, left, gone = self._rng(), np.flatnonzero(self.left), np.flatnonzero(~self.left)
        of = np.arange(len(self.left))
        of[gone] = rng.choice(left, len(gone))
        known, values = self.values[:, left], self.values[:, of]
        away = _SPREAD * known.std(axis=1, keepdims=True) + _LEAST_SPREAD * (self.high - self.low)
        moved = away * rng.standard_normal(values.shape) * ~self.left
        nearer = (values - known.mean(axis=1, keepdims=True)) * ~self.left  # as widely spread
        new = self._moved(of, np.clip(values + moved - _NEARER * nearer, self.low, self.high))
        more_s = _METAL_S * rng.standard_normal(len(of)) * ~self.left
        warm, cool = (new.model.rates(new.state, current_A) for current_A in (self.full_A, 0.0))
        heated = zip(new.state, warm, cool, strict=True)
        return replace(new, state=tuple(value + more_s * (w - c) for value, w, c in heated))

    def _judged(self) -> HeatBelief:
        """Switch off where metal may be too hot, or is that of no healthy segment."""
        ahead = self._after(self.state, self.full_A, _AHEAD_S)
        hottest_C = float(self.model.temperature_C(ahead)[self.left].max())
        hot = hottest_C >= self.cut_C - _COOLED_K * self.cut
        return replace(self, cut=hot or self.off_K > _DOUBT_K)


def _as_one(nominal: Any, names: tuple[str, ...], values: Array) -> Any:
    return replace(nominal, **dict(zip(names, values, strict=False)))


def heat_belief(robot: Robot, air_C: float, segment: int, start_C: float) -> HeatBelief:
    """Believe in a segment (from 0) that has rested at this temperature."""
    nominal, described = segment_model(robot, air_C, segment), robot.thermal_segment(segment)
    gain, lags_s = described.sensor_gain_and_lags_s
    gains = described.ranges.get("sensor_gain", (gain, gain))
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
        (gains[0] - _GAIN_OFF, gains[1] + _GAIN_OFF),
        (_LAGS[0] * longest_s, _LAGS[1] * longest_s),
        _SHARES,
        (0.0, 1.0),
    ]
    low, high = np.array(ends).T[:, :, None]
    values = low + (high - low) * np.random.default_rng(segment).random((len(ends), COUNT))
    nowhere = np.zeros(COUNT)
    drawn = HeatBelief(
        nominal=nominal,
        model=_as_one(nominal, tuple(within), values),
        full_A=robot.heater.melt_current_A,
        cut_C=robot.heater.temperature_max_C - _BEFORE_LIMIT_K,
        solid_C=thresholds_C(nominal)[0] - _SOLID_K,
        names=tuple(within),
        low=low,
        high=high,
        values=values,
        state=(nowhere,),
        lag_C=np.array([nowhere, nowhere]),
        worst_K=nowhere,
        left=nowhere == 0.0,
    )
    return drawn.begun(start_C, start_C)
