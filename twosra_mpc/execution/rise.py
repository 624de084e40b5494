"""A rise of a segment's sensor at full current, beside those of all healthy robots.

Solid metal that has rested is warmed through heaters of every power, up to where it melts, and read
through sensors of every lag: whichever stay within a fraction of a kelvin of the true reading tell
power and lag together, however short the rise is. If none does, the sensor lies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twosra_mpc.robot.coordinates import Array

_LAG_S = np.array([1.0, 2.5, 4.0, 5.5, 7.0, 8.5])  # in all: half and half, and nearly all in one
LAGS_S = np.hstack([np.outer(shares, _LAG_S) for shares in ((0.5, 0.5), (0.95, 0.05))])
UNLIKE_K = 1.6  # from every healthy robot: thermistors of 1 % parts err by 1 K from 25 to 60 C
_STEP = 0.03  # of one power to the next
_KNOWN = 1.05  # times the steepest of them: losses, and the slope of the thermistor
_FITS_K, _AS_WELL = 0.3, 1.3  # so far off at most; or so many times as far as the best
_RISEN_K = 6.0  # from which on a rise tells
_LONGEST_S = 0.25  # step of the integration


@dataclass(frozen=True, eq=False)
class Rise:
    """Healthy robots that warm: powers along the first axis, lags along the second.

    Attributes:
        power: Of their heaters, (p,).
        solid_C: Where the first and the last melt, (2, 1, 1).
        at_C: Two temperatures,
        rates: and rates there without current and at full current, (2, 2) [K/s].
        metal_C: Temperatures, (2, p, l).
        lag_C: Of the two lags, (2, 2, p, l).
        worst_K: Largest distance from the reading so far, (p, l).
        begun_C: Reading at the start.
        shown_C: Last reading.
    """

    power: Array
    solid_C: Array
    at_C: tuple[float, float]
    rates: Array
    metal_C: Array
    lag_C: Array
    worst_K: Array
    begun_C: float
    shown_C: float

    @property
    def tells(self) -> bool:
        """Whether it has risen far enough."""
        return self.shown_C >= self.begun_C + _RISEN_K

    @property
    def off_K(self) -> float:
        """Distance from the most similar robot."""
        return float(self.worst_K.min())

    @property
    def powers(self) -> tuple[float, float]:
        """Least and largest power of those that are similar."""
        fits = (self.worst_K <= max(_FITS_K, _AS_WELL * self.off_K)).any(axis=1)
        similar = self.power[fits]
        return float(similar.min()), float(similar.max()) * _KNOWN

    def advance(self, passed_s: float) -> Rise:
        """Warm them."""
        steps = max(1, int(np.ceil(passed_s / _LONGEST_S - 1e-9)))
        step_s, metal, (first, second) = passed_s / steps, self.metal_C, self.lag_C
        left = np.exp(-step_s / LAGS_S)
        (low_C, high_C), (cold, warm) = self.at_C, self.rates
        for _ in range(steps):
            share = (metal - low_C) / (high_C - low_C)
            off, full = (cold[k] + share * (warm[k] - cold[k]) for k in (0, 1))
            rate = off + self.power[:, None] * (full - off)
            after = np.minimum(self.solid_C, metal + rate * step_s)
            middle, metal = (metal + after) / 2, after
            before, first = first, middle + (first - middle) * left[0]
            second = (before + first) / 2 + (second - (before + first) / 2) * left[1]
        return replace(self, metal_C=metal, lag_C=np.array([first, second]))

    def take(self, shown_C: float) -> Rise:
        """Compare them with a reading: between those that melt first and last."""
        first, last = self.lag_C[1]
        worst_K = np.maximum(self.worst_K, np.maximum(first - shown_C, shown_C - last))
        return replace(self, worst_K=worst_K, shown_C=shown_C)


def rise(
    begun_C: float,
    powers: tuple[float, float],
    solid_C: tuple[float, float],
    at_C: tuple[float, float],
    rates: Array,
) -> Rise:
    """Begin at a reading, off for long, with powers from the least to the largest.

    What cools is ahead of its sensor: metal by both lags.
    """
    count = 2 + int(np.log(powers[1] / powers[0]) / _STEP)
    power, even = np.geomspace(*powers, count), np.zeros((count, LAGS_S.shape[1]))
    behind_K = rates[0][0] * LAGS_S
    second = np.array([even, even]) + begun_C
    first = second + behind_K[1]
    metal = first + behind_K[0]
    lag = np.array([first, second])
    melts_C = np.array(solid_C)[:, None, None]
    return Rise(power, melts_C, at_C, rates, metal, lag, even, begun_C, begun_C)
