"""Logs of heating and cooling: reading, checking, and putting on an even grid without spikes.

A log is a CSV file with the columns ``time_s``, ``temp_C`` (the raw sensor) and ``mode``:

- heating: the heater melts the segment, as hard as its firmware lets it;
- hold (or flexible, the word of the follow-up robot's logs): the firmware keeps it soft;
- cooling: the heater is off.

A cycle starts with each heating. Other columns are ignored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.lab.csv_table import finer_unit, read_csv
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import ReadOnlyArrays

Flags = NDArray[np.bool_]
Mode = Literal["heating", "hold", "cooling"]

MODES: tuple[Mode, ...] = get_args(Mode)
SYNONYMS: dict[str, Mode] = {"flexible": "hold"}
COLUMNS = ("time_s", "temp_C", "mode")

LEAST_SAMPLES = 20  # of heating, and of cooling
LEAST_RISE_K = 5.0  # less says nothing about a segment
LONGEST_STEP_S = 5.0  # slower samples miss the sensor's lag
LONGEST_GAP_S = 60.0  # how long readings may be missing
COLDER_THAN_AIR_K = 1.0  # noise and drift of the room

READINGS_C = (-40.0, 125.0)  # what thermistors are made for
_OTHER_UNITS = (
    ("kelvin", (240.0, 420.0), "subtract 273.15"),
    ("Fahrenheit", (50.0, 230.0), "subtract 32 and divide by 1.8"),
)
_STEPS_S = (0.5, 1.0)  # finest and coarsest grid: the sensor lags by seconds
_SPIKE_K = 0.5  # a reading this far from its neighbours', and farther than they can have moved
_FASTEST_K_PER_S = 1.0  # that a reading changes by, behind the sensor's lags


@public
@dataclass(frozen=True, eq=False, repr=False)
class HeatingLog(ReadOnlyArrays):
    """A checked log; arrays (n,), read-only.

    Attributes:
        source: Name of the file.
        time_s: Times of the samples, increasing.
        sensor_C: Raw readings.
        mode: A word of ``MODES`` for each sample.
        ambient_C: Temperature of the air.

    Raises:
        InputError: Naming the column, the row (from 1, below the heading) and what is allowed.
    """

    source: str
    time_s: Array
    sensor_C: Array
    mode: NDArray[np.str_]
    ambient_C: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_samples()
        self._check_course()

    @property
    def step_s(self) -> float:
        """Median time between samples."""
        return float(np.median(np.diff(self.time_s)))

    @cached_property
    def cycle(self) -> NDArray[np.int_]:
        """Number of the cycle of each sample, from 0 (which also holds what came before)."""
        heating = self.mode == "heating"
        starts = heating & ~np.append(False, heating[:-1])
        return np.maximum(np.cumsum(starts) - 1, 0)

    @cached_property
    def spikes(self) -> Flags:
        """Readings that no segment can have between their neighbours, (n,)."""
        return spikes(self.time_s, self.sensor_C)

    @cached_property
    def despiked_C(self) -> Array:
        """Readings, spikes replaced by the median of their neighbours, (n,)."""
        return np.where(self.spikes, _running_median(self.sensor_C, 5), self.sensor_C)

    def _refuse(self, field: str, value: object, allowed: str) -> InputError:
        hint = finer_unit(self.time_s) if field.startswith("time") else ""
        return InputError(field, value, allowed, self.source, hint=hint)

    def _check_samples(self) -> None:
        for column, values in (("time_s", self.time_s), ("temp_C", self.sensor_C)):
            bad = np.flatnonzero(~np.isfinite(values))
            if len(bad):
                row, value = int(bad[0]) + 1, float(values[bad[0]])
                raise self._refuse(f"{column}, row {row}", value, "a finite number")
        for i, word in enumerate(self.mode.tolist()):
            if word not in MODES:
                allowed = f"{', '.join(MODES)} or {', '.join(SYNONYMS)}"
                raise self._refuse(f"mode, row {i + 1}", word, allowed)
        gaps = np.diff(self.time_s)
        wrong = np.flatnonzero((gaps <= 0) | (gaps > LONGEST_GAP_S))
        if len(wrong):
            before, value = self.time_s[wrong[0] : wrong[0] + 2].tolist()
            allowed = f"later than the row before it ({before:zg} s), {LONGEST_GAP_S:zg} s at most"
            raise self._refuse(f"time_s, row {wrong[0] + 2}", value, allowed)

    def _check_course(self) -> None:
        check_readings(self.despiked_C, "temp_C", self.source)
        for word in ("heating", "cooling"):
            count = int(np.sum(self.mode == word))
            if count < LEAST_SAMPLES:
                allowed = f"at least {LEAST_SAMPLES} rows of {word}: heating and cooling are fitted"
                raise self._refuse("mode", f"{count} rows of {word}", allowed)
        if self.mode[0] == "hold":
            allowed = "heating or cooling: before a hold, the segment's warmth has to be known"
            raise self._refuse("mode, row 1", "hold", allowed)
        if self.step_s > LONGEST_STEP_S:
            allowed = f"at most {LONGEST_STEP_S:zg} s between rows, as a median"
            raise self._refuse("time_s", self.step_s, allowed)
        if not math.isfinite(self.ambient_C):
            raise self._refuse("ambient_C", self.ambient_C, "a finite number")
        coldest, hottest = float(self.despiked_C.min()), float(self.despiked_C.max())
        if coldest < self.ambient_C - COLDER_THAN_AIR_K:
            allowed = f"at most the coldest reading ({coldest:zg} C); give it if a log starts warm"
            raise self._refuse("ambient_C", self.ambient_C, allowed)
        if hottest < self.ambient_C + LEAST_RISE_K:
            allowed = f"readings that rise {LEAST_RISE_K:zg} K above the air, {self.ambient_C:zg} C"
            raise self._refuse("temp_C", hottest, allowed)


@dataclass(frozen=True, eq=False, repr=False)
class EvenLog(ReadOnlyArrays):
    """A log on an even grid of n points, spikes removed; arrays read-only.

    Attributes:
        step_s: Time between points.
        time_s: Their times, (n,).
        sensor_C: Readings there, (n,).
        held: Whether the point is in a hold, where the heater's power is unknown, (n,).
        scored: Whether there is a reading of a heating or cooling segment at the point, (n,).
        heating: Whether the point is in a heating, (n,).
        heating_share: Share of the step from each point on in which the heater heats, (n - 1,).
        cycle: Number of the point's cycle, from 0, (n,).
        ambient_C: Temperature of the air.
    """

    step_s: float
    time_s: Array
    sensor_C: Array
    held: Flags
    scored: Flags
    heating: Flags
    heating_share: Array
    cycle: NDArray[np.int_]
    ambient_C: float

    def scoring(self, chosen: Flags) -> EvenLog:
        """Return the same log scored only where ``chosen`` (n,)."""
        return replace(self, scored=self.scored & chosen)


@public
def read_heating_log(path: str | Path, ambient_C: float | None = None) -> HeatingLog:
    """Read a CSV file.

    Args:
        path: The file.
        ambient_C: Temperature of the air; default: the first reading that is no spike.

    Raises:
        InputError: If the file cannot be read, lacks a column, or is no such log.
    """
    table = read_csv(path, COLUMNS)
    time, sensor = table.numbers("time_s", "temp_C").T
    words = [SYNONYMS.get(word, word) for word in table.texts("mode")]
    if ambient_C is None:
        first = sensor[~spikes(time, sensor)]
        ambient_C = float(first[0]) if len(first) else math.nan
    return HeatingLog(table.source, time, sensor, np.array(words), ambient_C)


def check_readings(readings_C: Array, column: str, source: str) -> None:
    """Refuse readings that are no temperatures in degrees Celsius.

    Raises:
        InputError: Saying what they look like: kelvin, Fahrenheit, or counts of a converter.
    """
    low, high = float(readings_C.min()), float(readings_C.max())
    if READINGS_C[0] <= low and high <= READINGS_C[1]:
        return
    looks = "counts or volts of a converter: turn them into degrees Celsius"
    for unit, (least, most), turned in _OTHER_UNITS:
        if least <= low and high <= most:
            looks = f"{unit}: {turned}"
    allowed = f"degrees Celsius, from {READINGS_C[0]:zg} to {READINGS_C[1]:zg}; these look like "
    raise InputError(column, f"{low:zg} to {high:zg}", allowed + looks, source)


def resample(log: HeatingLog) -> EvenLog:
    """Put a log on an even grid.

    Samples that are closer than the grid are smoothed by a running median as long as its step;
    gaps in between are bridged, but not scored.
    """
    step = min(max(log.step_s, _STEPS_S[0]), _STEPS_S[1])
    count = int((log.time_s[-1] - log.time_s[0]) / step + 1e-6) + 1
    time = log.time_s[0] + step * np.arange(count)
    smooth = _running_median(log.despiked_C, 2 * round(step / log.step_s / 2) + 1)
    middles = (log.time_s[1:] + log.time_s[:-1]) / 2
    nearest = np.searchsorted(middles, time)
    mode = log.mode[nearest]
    there = np.abs(log.time_s[nearest] - time) <= step / 2 + 1e-9
    # Time spent heating until each sample's end, where the next one is nearer.
    edges = np.concatenate([log.time_s[:1], middles, log.time_s[-1:]])
    heated = np.append(0.0, np.cumsum(np.diff(edges) * (log.mode == "heating")))
    return EvenLog(
        step_s=step,
        time_s=time,
        sensor_C=np.interp(time, log.time_s, smooth),
        held=mode == "hold",
        scored=there & (mode != "hold"),
        heating=mode == "heating",
        heating_share=np.diff(np.interp(time, edges, heated)) / step,
        cycle=log.cycle[nearest],
        ambient_C=log.ambient_C,
    )


def runs(flags: Flags) -> list[tuple[int, int]]:
    """(first, end) of each unbroken run of true flags."""
    changes = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(changes[::2], changes[1::2], strict=True)]


def spikes(time_s: Array, sensor_C: Array) -> Flags:
    """Flag the readings (n,) that are too far from the median of the five around them."""
    off = np.abs(sensor_C - _running_median(sensor_C, 5))
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    return off > _SPIKE_K + _FASTEST_K_PER_S * step


def _running_median(values: Array, width: int) -> Array:
    return median_filter(values, min(width, len(values)), mode="mirror")
