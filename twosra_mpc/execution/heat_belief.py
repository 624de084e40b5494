"""Belief about the heat of a segment: the healthy segments that would have shown what it showed.

Healthy segments of every kind are warmed by the heater's known current beside the true one.
Whichever shows something else is replaced by one like those that are left, so all that a robot has
shown is known: the power of its heater, its latent heat, its loss, the lag of its sensor. Metal is
as hot as the hottest of those that are left, liquid where one of them is, and liquid for sure where
all are. Where none of them is like a reading, the heater is off; and once from one rest to the next
others are looked for that would have shown everything since. Such others are bounded by what was
shown before, else a sensor that sticks would be explained until the metal is too hot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.healthy_segments import HealthySegments, Heat, healthy_segments
from twosra_mpc.robot.description import Robot
from twosra_mpc.thermal.model import Array

UNLIKE_K = 1.1  # off by more is no healthy segment: of nearly all, one is nearer than 0.4 K
_DOUBT_K = 0.7  # off by more, the heater waits
_FITS_K, _AS_WELL = 0.45, 1.4  # so far off at most, or so many times as far as the best, it is left
_FORGET_S = 80.0  # over which a distance is forgotten: currents are known to a second only
_FORGET_UNKNOWN_S = 15.0  # of heat that nobody knows, over which a search forgets it
_RENEWED = 0.4  # share of those left below which the others are replaced
_LEARNED, _UNLEARNED = 0.1, 0.1  # of what others are not, the new are not; but near them
_SPREAD, _LEAST_SPREAD = 0.3, 0.003  # of the new: of those left, and of the ranges
_NEARER = 1 - math.sqrt(1 - _SPREAD**2)  # by which they are drawn in: as widely spread as before
_METAL_S = 0.02  # of full heat, by which their metal differs from what they replace
_BEFORE_LIMIT_K, _COOLED_K = 2.0, 3.0  # the heater goes off before the limit, and on again
_AHEAD_S = 1.0  # until the next reading the heater may go on
_QUIET_S = 30.0  # after which a sensor shows metal without its heater
_MOST = 2000  # readings that are remembered: half an hour
_ROUNDS, _ELITE = 6, 10  # of a search; one of so many is among the best, as others are drawn
_NEAR, _OVER = 0.1, 1.2  # spread of the first: of the ranges; of the others: of the best


@dataclass(frozen=True, eq=False)
class HeatBelief:
    """Healthy segments and what was shown; a value, which ``take`` replaces.

    Attributes:
        all: The segments.
        low: Least values of those that replace others, (p, 1).
        high: Largest; what a robot has shown draws both nearer.
        cut_C: Temperature of the hottest from which on the heater is off.
        cut: Whether the heater must be off, whatever a reading says.
        start: The segments when the metal was last surely solid, its heater off for a while.
        since: Heat and readings since.
        quiet_s: Time for which the heater has been off.
        looked: Whether others were looked for since then.
    """

    all: HealthySegments
    low: Array
    high: Array
    cut_C: float
    start: HealthySegments
    cut: bool = False
    since: tuple[tuple[Heat, float | None], ...] = ()
    quiet_s: float = 0.0
    looked: bool = False

    @property
    def off_K(self) -> float:
        """Distance of the readings from those of the most similar healthy segment."""
        return float(self.all.worst_K.min())

    @property
    def left(self) -> NDArray[np.bool_]:
        """Which are left, (n,)."""
        return self.all.worst_K <= max(_FITS_K, _AS_WELL * self.off_K)

    @property
    def shows_C(self) -> tuple[float, float]:
        """Lowest and highest reading of those that are left."""
        shown_C = self.all.lag_C[1][self.left]
        return float(shown_C.min()), float(shown_C.max())

    @property
    def metal_C(self) -> tuple[float, float]:
        """Coldest and hottest metal of those that are left."""
        metal_C = self.all.metal_C[self.left]
        return float(metal_C.min()), float(metal_C.max())

    @property
    def may_be_liquid(self) -> bool:
        """Whether one of those that are left is liquid."""
        return bool(self.all.liquid[self.left].any())

    @property
    def surely_liquid(self) -> bool:
        """Whether all that are left are liquid."""
        return bool(self.all.liquid[self.left].all())

    def begun(self, shown_C: float, start_C: float) -> HeatBelief:
        """Begin at rest: at the first reading where metal is solid, else as it is said to be."""
        start = self.all.begun(shown_C, start_C)
        return replace(self, all=start, start=start)

    def take(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Warm all, and compare them with a reading, if there is one."""
        now = replace(self, all=self.all.warmed(heat))
        if shown_C is None:
            return now._remembering(heat, shown_C)
        compared = now.all.compared(shown_C, math.exp(-heat.passed_s / _FORGET_S))
        now = replace(now, all=compared)._remembering(heat, shown_C)
        if now.off_K > UNLIKE_K and not now.looked:
            now = now._looked_for()
        return (now._renewed() if now.left.mean() < _RENEWED else now)._judged()

    def _remembering(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Remember a reading, or begin with it where it is surely of solid metal."""
        quiet_s = 0.0 if heat.share or heat.unknown else self.quiet_s + heat.passed_s
        fits = shown_C is not None and shown_C < self.all.kinds.solid_C and self.off_K <= _FITS_K
        now = replace(self, quiet_s=quiet_s)
        if (fits and quiet_s >= _QUIET_S) or len(self.since) >= _MOST:
            return replace(now, start=self.all, since=(), looked=False)
        return replace(now, since=(*self.since, (heat, shown_C)))

    def _looked_for(self) -> HeatBelief:
        """Look for healthy segments that would have shown all since the metal was solid.

        By the cross-entropy method: of those drawn within what was shown before and near those
        that are left, the best are kept, and others drawn as they are spread, some times.
        """
        rng, (parts, count) = self.all.rng(1), self.all.values.shape
        width, left = self.high - self.low, np.flatnonzero(self.left)

        def noise() -> Array:
            return width * rng.standard_normal((parts, count))

        near = self.all.values[:, rng.choice(left, count)] + _NEAR * noise()
        values = np.where(np.arange(count) % 2, near, self.low + width * rng.random((parts, count)))
        found: HealthySegments | None = None
        for _ in range(_ROUNDS):
            of = rng.choice(np.arange(count), count)
            tried = self.start.moved(of, values.clip(self.low, self.high))
            tried = replace(tried, worst_K=np.zeros(count), taken=self.all.taken)
            for heat, shown_C in self.since:
                tried = tried.warmed(heat)
                if shown_C is not None:
                    tried = tried.compared(shown_C, math.exp(-heat.unknown_s / _FORGET_UNKNOWN_S))
            found = tried if found is None else found.nearest(tried)
            best = found.values[:, np.argsort(found.worst_K)[: count // _ELITE]]
            middle = best.mean(axis=1, keepdims=True)
            mixed = rng.standard_normal((best.shape[1], count)) / math.sqrt(best.shape[1])
            values = middle + _OVER * (best - middle) @ mixed + _LEAST_SPREAD * noise()
        assert found is not None
        explained = found.worst_K.min() <= _FITS_K
        return replace(self, all=found if explained else self.all, looked=True)

    def _renewed(self) -> HeatBelief:
        """Replace those that are not left by some like those that are."""
        rng, kinds, left, gone = self.all.rng(), self.all.kinds, self.left, ~self.left
        of = np.arange(len(left))
        of[gone] = rng.choice(np.flatnonzero(left), int(gone.sum()))
        known, values = self.all.values[:, left], self.all.values[:, of]
        away = _SPREAD * known.std(axis=1, keepdims=True) + _LEAST_SPREAD * (kinds.high - kinds.low)
        low, high = self.low, self.high
        if self.off_K <= _FITS_K:
            margin = _UNLEARNED * (kinds.high - kinds.low)
            least, most = (known.min(axis=1, keepdims=True), known.max(axis=1, keepdims=True))
            low = np.maximum(low, low + _LEARNED * (least - margin - low))
            high = np.minimum(high, high + _LEARNED * (most + margin - high))
        nearer = _NEARER * (values - known.mean(axis=1, keepdims=True))
        values = values + gone * (away * rng.standard_normal(values.shape) - nearer)
        new = self.all.moved(of, values.clip(low, high))
        new = new.heated(_METAL_S * gone * rng.standard_normal(len(of)))
        return replace(self, all=new, low=low, high=high)

    def _judged(self) -> HeatBelief:
        """Switch off where metal may be too hot, or is that of no healthy segment."""
        hottest_C = float(self.all.ahead_C(_AHEAD_S)[self.left].max())
        hot = hottest_C >= self.cut_C - _COOLED_K * self.cut
        return replace(self, cut=hot or self.off_K > _DOUBT_K)


def heat_belief(robot: Robot, air_C: float, segment: int, start_C: float) -> HeatBelief:
    """Believe in a segment (from 0) that has rested at this temperature."""
    segments = healthy_segments(robot, air_C, segment, start_C)
    low, high = segments.kinds.low, segments.kinds.high
    cut_C = robot.heater.temperature_max_C - _BEFORE_LIMIT_K
    return HeatBelief(segments, low, high, cut_C, segments)
