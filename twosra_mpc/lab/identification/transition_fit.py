r"""Identify the two-node model from logged melts and freezes of a robot in use.

Two CSV files: a row for each transition (``transition``, ``target1``, ``target2``, ...: 1 soft, 0
rigid; ``kind``: melt or freeze; ``duration_s``), and readings of all segments while they lasted
(``transition``, ``time_s`` from its begin, ``reading1_C``, ``reading2_C``, ...).

A melt lasts until every segment that should be soft reads ``liquid_above_C``, a freeze until every
one that was soft reads ``solid_below_C``. Where a robot's file lists its segments, each is fitted
to the times at which it crossed these itself.

A melt is predicted from the readings at its begin, core and body alike, at full power up to the
set-point. A freeze begins where the melt before it ended, core and sensor moved so that the reading
is the logged one. Readings follow the core through the
sensor of the robot file, whose gain and lag are kept; four parameters are fitted to logarithms of
durations, with a loss (soft L1) that bears outliers, the body's heat near that of the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, cast, get_args

import numpy as np

from twosra_mpc import InputError, Robot
from twosra_mpc.arguments import public
from twosra_mpc.lab.csv_table import read_csv
from twosra_mpc.lab.identification import log_fit
from twosra_mpc.lab.identification.heating_log import Flags, check_readings
from twosra_mpc.lab.identification.log_fit import Fitted
from twosra_mpc.lab.identification.log_response import SensorLag, TwoNodePlant, driven
from twosra_mpc.lab.identification.thermal_fit import (
    SEGMENT_PARAMETERS,
    UNIT,
    OnProgress,
    described,
    two_node_segment,
)
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.segment import Heater, TwoNodeSegment
from twosra_mpc.thermal.two_node import TwoNode
from twosra_mpc.validation import ArrayValue

Kind = Literal["melt", "freeze"]

LEAST_OF_A_KIND = 5  # melts, and freezes, that a fit needs
SHORTEST_S = 2.0  # what is shorter was no transition: it is shown, but not fitted
PARTS = 10  # as many fits leave a part of the transitions out
LARGEST_MEDIAN = 0.35  # of relative errors of the durations that are fitted

_STEP_S, _LONGEST_MELT_S, _LONGEST_FREEZE_S = 1.0, 200.0, 600.0  # of predictions
_BEGIN_S = 1.0  # readings in this time are those at the begin
_SCALE = 0.15  # relative errors beyond this count less
# Durations hardly tell the body's heat: it is taken as known to this factor, as one transition is.
_BODY_RATIO_WITHIN = 1.5
_NEARLY_K = 3.0  # from a threshold: what ended so near to it has crossed it
_ENDS_S, _ENDS = 3.0, 0.1  # by which a duration and the last reading may differ: s, relative
_FITTED = tuple(name for name in SEGMENT_PARAMETERS if name != "sensor_lag_s")
_BODY = _FITTED.index("body_ratio")


@public
@dataclass(frozen=True, eq=False, repr=False)
class LoggedTransition(ArrayValue):
    """A melt or freeze.

    Attributes:
        number: In the log.
        kind: Melt or freeze.
        target: For each segment 1 (soft) or 0.
        duration_s: Until the last segment, or the one that is looked at, was as it should be [s].
        begin_C: Readings at its begin.
        end_C: Readings at its end.
        readings: Times [s] and readings of the segments [C], (m, 1 + n).
        heated_s: How long heaters were on, if not as long as that [s].
    """

    number: int
    kind: Kind
    target: tuple[int, ...]
    duration_s: float
    begin_C: tuple[float, ...]
    end_C: tuple[float, ...]
    readings: Array
    heated_s: float | None = None

    def crossed_s(self, segment: int, level_C: float) -> float | None:
        """Time at which a reading crossed a level: its end if it nearly did, None if not [s]."""
        time_s, reading = self.readings[:, 0], self.readings[:, 1 + segment]
        sign = 1 if self.kind == "melt" else -1
        beyond = np.flatnonzero(sign * (reading - level_C) >= 0)
        if not len(beyond):
            near = sign * (level_C - reading[-1]) < _NEARLY_K
            return self.duration_s if near else None
        last = int(beyond[0])
        if last == 0:
            return 0.0
        some = slice(last - 1, last + 1)
        order = slice(None, None, sign)
        return float(np.interp(level_C, reading[some][order], time_s[some][order]))


class Prediction(NamedTuple):
    """A transition, its duration by the fit, and by the fit that has not seen it [s]."""

    logged: LoggedTransition
    fitted_s: float
    left_out_s: float

    @property
    def error(self) -> float:
        """Relative error by the fit that has not seen it."""
        return self.left_out_s / self.logged.duration_s - 1


@dataclass(frozen=True)
class TransitionFit:
    """Fit of a robot's segments to a log of transitions.

    Attributes:
        source: Name of the file of transitions.
        robot: Name of the robot.
        segment: Its segment with the fitted parameters and their ranges.
        smallest: Of each fitted parameter over the fits that leave a part, or a half, out.
        largest: The same.
        predictions: For every transition of the log.
    """

    source: str
    robot: str
    segment: TwoNodeSegment
    smallest: dict[str, float]
    largest: dict[str, float]
    predictions: tuple[Prediction, ...]

    @property
    def fitted(self) -> tuple[str, ...]:
        """Fields of the segment that were fitted."""
        return _FITTED

    @property
    def summary(self) -> str:
        """Source of the fit, for the robot file."""
        name, count = Path(self.source).name, len(self.predictions)
        median = 100 * self.quantile(0.5)
        left_out = f"left out of the fit, off by {median:z.0f} % (median)"
        return f"{count} transitions of {name}: {left_out}"

    def quantile(self, share: float) -> float:
        """Relative error that this share of the transitions keeps, each left out of the fit."""
        return float(np.quantile([abs(each.error) for each in self.predictions], share))

    def within(self, share: float) -> int:
        """Number of transitions that, each left out of the fit, are off by no more than this."""
        return sum(abs(each.error) <= share for each in self.predictions)


def read_transitions(
    path: str | Path, readings: str | Path, segments: int
) -> tuple[LoggedTransition, ...]:
    """Read a log of transitions.

    Args:
        path: The file of transitions.
        readings: That of the readings.
        segments: How many segments the robot has.

    Raises:
        InputError: If a file cannot be read, lacks a column, or cannot be in these units.
    """
    source, other = str(path), str(readings)
    numbers = range(1, segments + 1)
    targets, sensors = [f"target{j}" for j in numbers], [f"reading{j}_C" for j in numbers]
    columns = ("transition", "time_s", *sensors)
    rows = read_csv(readings, columns).numbers(*columns)
    check_readings(rows[:, 2:], ", ".join(sensors), other)
    table = read_csv(path, ("transition", "kind", *targets, "duration_s"))
    told = table.numbers("transition", "duration_s", *targets).tolist()
    found = []
    rows_of = zip(table.texts("kind"), told, strict=True)
    for i, (kind, (number, duration_s, *soft)) in enumerate(rows_of, start=1):
        index, here = int(number), rows[rows[:, 0].astype(int) == int(number), 1:]
        if not len(here):
            allowed = f"a transition that {other} has readings of"
            raise InputError(f"transition, row {i}", index, allowed, source)
        last_s = float(here[-1, 0] - here[0, 0])
        if duration_s <= 0 or abs(last_s - duration_s) > _ENDS_S + _ENDS * last_s:
            allowed = f"seconds, about those of its readings ({last_s:zg}): minutes, hours?"
            raise InputError(f"duration_s, row {i}", duration_s, allowed, source)
        if kind not in get_args(Kind) or not set(soft) <= {0.0, 1.0}:
            allowed = f"{' or '.join(get_args(Kind))}, targets 1 (soft) or 0 (rigid)"
            raise InputError(f"kind, row {i}", f"{kind}, {soft}", allowed, source)
        begin = np.median(here[here[:, 0] <= here[0, 0] + _BEGIN_S], axis=0)
        target = tuple(map(int, soft))
        begin_C, end_C = (tuple(at[1:].tolist()) for at in (begin, here[-1]))
        known = index, cast(Kind, kind), target, duration_s, begin_C, end_C, here
        found.append(LoggedTransition(*known))
    _check(found, source)
    return tuple(found)


def of_segment(
    logged: tuple[LoggedTransition, ...], segment: int, own: TwoNodeSegment
) -> tuple[LoggedTransition, ...]:
    """The melts and freezes of one segment (from 0) alone, as long as it took itself."""
    found, soft = [], False
    for each in logged:
        wanted = bool(each.target[segment])
        if wanted == soft or wanted != (each.kind == "melt"):
            continue
        crossed_s = each.crossed_s(segment, own.liquid_above_C if wanted else own.solid_below_C)
        told = crossed_s is not None and crossed_s > SHORTEST_S
        soft = wanted and told
        if crossed_s is not None and told:
            alone = replace(each, target=(int(wanted),), duration_s=crossed_s)
            begin_C, end_C = (ends[segment : segment + 1] for ends in (each.begin_C, each.end_C))
            found.append(replace(alone, begin_C=begin_C, end_C=end_C, heated_s=each.duration_s))
    return tuple(found)


def identify_transitions(
    logged: tuple[LoggedTransition, ...],
    robot: Robot,
    source: str,
    on_progress: OnProgress = lambda done, of: None,
    segment: int = 0,
) -> TransitionFit:
    """Fit the two-node model to logged durations, and predict each by a fit that leaves it out.

    Args:
        logged: The transitions, in order.
        robot: Whose they are; its thresholds, set-point, air, sensor gain and lag count.
        source: Name of the log.
        on_progress: Called with the number of fits done and to do.
        segment: Which segment is fitted, from 0, where the robot's file lists them.

    Raises:
        InputError: If the robot's segments are not described by two nodes, or the fit is not
            plausible.
    """
    own = two_node_segment(robot, segment)
    if robot.segments:
        logged = of_segment(logged, segment, own)
        _check(logged, source)
    counted = np.array([each.duration_s > SHORTEST_S for each in logged])
    start = tuple(SEGMENT_PARAMETERS[name].start for name in _FITTED)
    predict = _predictor(logged, own, robot.heater)

    def fitted(kept: Flags, near: tuple[float, ...]) -> Fitted:
        return _fitted(predict, logged, counted & kept, near, own.body_ratio)

    number = np.arange(len(logged))
    best = fitted(number >= 0, start)
    on_progress(1, PARTS + 1)
    fitted_s = predict(best.values)
    off = np.abs(fitted_s / [each.duration_s for each in logged] - 1)[counted]
    if (median := float(np.median(off))) > LARGEST_MEDIAN:
        allowed = (
            f"a median of at most {LARGEST_MEDIAN:zg} in what is fitted: check units, kinds,"
            f" targets, and {robot.name}'s thresholds, {own.solid_below_C:zg} and"
            f" {own.liquid_above_C:zg} C"
        )
        raise InputError("error of durations", round(median, 2), allowed, source)
    searched = {name: SEGMENT_PARAMETERS[name] for name in _FITTED}
    log_fit.check_bounds(searched, best.values, source)
    left_out_s, parts = np.empty(len(logged)), [best.values]
    for part in range(PARTS):
        out = number * PARTS // len(logged) == part  # a stretch of the log: days differ
        if (out & counted).any():
            parts.append(fitted(~out, best.values).values)
        left_out_s[out] = predict(parts[-1])[out]
        on_progress(part + 2, PARTS + 1)
    if len(logged) >= 4 * LEAST_OF_A_KIND:  # logs differ by more than a tenth of one does
        half = number < len(logged) / 2
        parts += [fitted(kept, best.values).values for kept in (half, ~half)]
    ends = (pick(np.array(parts), axis=0).tolist() for pick in (np.min, np.max))
    values, errors, smallest, largest = (
        dict(zip(_FITTED, each, strict=True)) for each in (*best[:2], *ends)
    )
    predictions = zip(logged, fitted_s.tolist(), left_out_s.tolist(), strict=True)
    return TransitionFit(
        source=source,
        robot=robot.name,
        segment=described(own, values, errors, smallest, largest),
        smallest=smallest,
        largest=largest,
        predictions=tuple(Prediction(*each) for each in predictions),
    )


def _fitted(
    predict: Callable[[tuple[float, ...]], Array],
    logged: tuple[LoggedTransition, ...],
    counted: Flags,
    start: tuple[float, ...],
    body_ratio: float,
) -> Fitted:
    """Fit logarithms of the parameters to logarithms of the durations that count."""
    duration = np.array([each.duration_s for each in logged])

    def off(values: Array) -> Array:
        found = predict(tuple(values.tolist()))
        known = _SCALE * np.log(values[_BODY] / body_ratio) / np.log(_BODY_RATIO_WITHIN)
        return np.append(np.log(np.maximum(found, 0.5) / duration)[counted], known)

    def errors(jacobian: Array, left: Array) -> Array:
        spread = np.median(np.abs(left)) / 0.6745  # of a normal distribution without outliers
        return spread * np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)))

    return log_fit.search(
        off,
        [SEGMENT_PARAMETERS[name] for name in _FITTED],
        start,
        errors,
        loss="soft_l1",
        f_scale=_SCALE,
        diff_step=[1e-3] * len(start),  # durations are read off a grid
        ftol=1e-5,
        max_nfev=30,
    )


def _predictor(
    logged: tuple[LoggedTransition, ...], own: TwoNodeSegment, heater: Heater
) -> Callable[[tuple[float, ...]], Array]:
    """Function from parameters to predicted durations (n,) [s]."""

    def predict(values: tuple[float, ...]) -> Array:
        course = _Course(values, own, heater)
        melts: dict[int, LoggedTransition] = {}  # by which each soft segment became so
        found = []
        for each in logged:
            times = [0.0]
            for j, soft in enumerate(each.target):
                if soft and j not in melts:
                    melts[j] = each
                    times.append(course.melt_s(each.begin_C[j]))
                elif not soft and j in melts:
                    melt = melts.pop(j)
                    heated_s = melt.duration_s if melt.heated_s is None else melt.heated_s
                    warm = course.melted(melt.begin_C[j], heated_s)
                    times.append(course.freeze_s(warm, each.begin_C[j]))
            found.append(max(times))
        return np.array(found)

    return predict


class _Course:
    """A segment and its sensor in steps; states are (core, body, both lags), K above the air."""

    def __init__(self, values: tuple[float, ...], own: TwoNodeSegment, heater: Heater) -> None:
        power, coupling, ratio, loss = values
        self._plant = TwoNodePlant(TwoNode(power, coupling, ratio, loss, *UNIT), _STEP_S)
        lag_s = max(own.sensor_lag_s, 1e-3)
        self._sensor = SensorLag(own.sensor_gain, lag_s, _STEP_S)
        self._air_C, self._setpoint_K = heater.ambient_C, heater.soft_setpoint_C - heater.ambient_C
        self._solid_K = own.solid_below_C - heater.ambient_C
        self._liquid_K = own.liquid_above_C - heater.ambient_C

    def melt_s(self, begin_C: float) -> float:
        """Time until a rested segment reads liquid."""
        reading = self._heated(begin_C, _LONGEST_MELT_S)[:, 3]
        return _until(reading - self._sensor.gain * self._liquid_K)

    def melted(self, begin_C: float, duration_s: float) -> Array:
        """State of a rested segment after it has been heated."""
        grid = self._heated(begin_C, duration_s + _STEP_S)
        times = _STEP_S * np.arange(len(grid))
        return np.array([np.interp(duration_s, times, column) for column in grid.T])

    def freeze_s(self, state: Array, begin_C: float) -> float:
        """Time until a segment reads solid, without heat; core and lags moved to this reading."""
        moved = begin_C - self._air_C - state[3]
        core = state[0] + moved / self._sensor.gain
        states = driven(self._plant, (core, state[1]), np.zeros(round(_LONGEST_FREEZE_S / _STEP_S)))
        reading = self._sensor.follow(states[:, 0], state[2:] + moved)[:, 1]
        return _until(self._sensor.gain * self._solid_K - reading)

    def _heated(self, begin_C: float, duration_s: float) -> Array:
        """States (n, 4) at full power up to the set-point, then held there."""
        reading = begin_C - self._air_C
        core = reading / self._sensor.gain
        full = np.ones(math.ceil(duration_s / _STEP_S))
        free = driven(self._plant, (core, core), full)[:, 0]
        held = np.minimum(free, max(core, self._setpoint_K))
        body = self._plant.led(core, held)[:, 1]
        lags = self._sensor.follow(held, np.array([reading, reading]))
        return np.column_stack([held, body, lags])


def _until(rising: Array) -> float:
    """Time at which values on the grid first reach 0; that of the last if they do not."""
    reached = np.flatnonzero(rising >= 0)
    if not len(reached):
        return _STEP_S * (len(rising) - 1)
    k = int(reached[0])
    part = rising[k] / (rising[k] - rising[k - 1]) if k else 0.0
    return _STEP_S * float(k - part)


def _check(logged: Sequence[LoggedTransition], source: str) -> None:
    """Refuse too few transitions, a freeze of what never melted, and swapped kinds.

    Raises:
        InputError: Naming what is wrong.
    """
    for kind in get_args(Kind):
        of_kind = [each for each in logged if each.kind == kind]
        if len(of_kind) < LEAST_OF_A_KIND:
            allowed = f"at least {LEAST_OF_A_KIND} of a kind"
            raise InputError("kind", f"{len(of_kind)} of {kind}", allowed, source)
        told = [any(each.target) if kind == "melt" else not all(each.target) for each in of_kind]
        sign = 1 if kind == "melt" else -1
        rises = [(sign * np.subtract(each.end_C, each.begin_C)).max() for each in of_kind]
        if np.median(rises) < log_fit.LEAST_CHANGE_K or not all(told):
            value = f"{kind}: {np.median(rises):+z.3g} K in the right direction (median)"
            allowed = (
                "readings that rise in melts, targets 1 (soft), and fall in freezes, 0 (rigid):"
            )
            allowed += " are labels swapped?"
            raise InputError("kind", value, allowed, source)
        if kind == "melt":
            rates = [rise / each.duration_s for rise, each in zip(rises, of_kind, strict=True)]
            log_fit.check_rate(float(np.median(rates)), "duration_s", source)
    if logged[0].kind == "freeze":
        raise InputError("kind, first row", "freeze", "a melt: what freezes has melted", source)
