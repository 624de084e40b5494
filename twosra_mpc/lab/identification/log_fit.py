"""Fitting a family of models to a log by least squares, with uncertainty and cross-validation.

A fit finds numbers for anything, also for a log in kelvin or in minutes. So what is not plausible,
of a log or of a fit, is refused with what it looks like and what to do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from twosra_mpc import InputError, Robot
from twosra_mpc.lab.identification.heating_log import LEAST_SAMPLES, EvenLog, HeatingLog, runs
from twosra_mpc.lab.identification.log_response import Response
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.segment import Segment

# Residuals are taken as correlated up to this time: five of the sensor's two lags. What a model
# lacks shows in residuals that keep their sign for so long.
CORRELATED_S = 30.0


class Bounded(NamedTuple):
    """A parameter to be fitted: where to start, and between which values to search.

    Positive parameters are searched in their logarithm.
    """

    start: float
    low: float
    high: float
    positive: bool = True


class Family(NamedTuple):
    """Models that differ in parameters.

    Attributes:
        parameters: Their parameters.
        respond: What the model with some values of them makes of a log.
        starts: Further points to start from: factors on the starting values.
    """

    parameters: tuple[Bounded, ...]
    respond: Callable[[Sequence[float], EvenLog], Response]
    starts: tuple[dict[int, float], ...] = ()


class Fitted(NamedTuple):
    """A member of a family.

    Attributes:
        values: Its parameters.
        standard_errors: Of these; infinite where the log does not tell.
        cost: Half the sum of squares.
    """

    values: tuple[float, ...]
    standard_errors: tuple[float, ...]
    cost: float


class Residuals(NamedTuple):
    """Measured against modelled readings, where a segment heats or cools; NaN if nowhere.

    Attributes:
        heating_rms_C: Root mean square while heating.
        cooling_rms_C: The same while cooling.
        rms_C: The same in both.
        max_C: Largest absolute residual in both.
        points: Number of points of the grid that count.
    """

    heating_rms_C: float
    cooling_rms_C: float
    rms_C: float
    max_C: float
    points: int


def residuals(log: EvenLog, response: Response) -> Residuals:
    """Compare a response with the readings it is meant to explain."""
    off = response.sensor_C - log.sensor_C
    heating, cooling = off[log.scored & log.heating], off[log.scored & ~log.heating]
    both = off[log.scored]
    largest = float(np.abs(both).max()) if len(both) else math.nan
    return Residuals(_rms(heating), _rms(cooling), _rms(both), largest, len(both))


def pooled_rms_C(parts: Sequence[Residuals]) -> float:
    """Root mean square over several parts of a log; NaN without any."""
    squares = sum(part.points * part.rms_C**2 for part in parts if part.points)
    points = sum(part.points for part in parts)
    return math.sqrt(squares / points) if points else math.nan


def fit(family: Family, log: EvenLog, near: Sequence[float] | None = None) -> Fitted:
    """Fit a family to a log: the best of all its starts, or from ``near`` alone."""

    def off(values: Array) -> Array:
        found = family.respond(values.tolist(), log)
        return (found.sensor_C - log.sensor_C)[log.scored]

    nominal = [each.start for each in family.parameters]
    starts = [[v * factors.get(i, 1.0) for i, v in enumerate(nominal)] for factors in family.starts]
    # The sum of squares is found to a fiftieth of a standard error.
    settings: dict[str, Any] = {"x_scale": "jac", "ftol": 1e-6, "max_nfev": 60}
    errors = partial(_standard_errors, log)
    every = [near] if near else [nominal, *starts]
    results = [search(off, family.parameters, start, errors, **settings) for start in every]
    return min(results, key=lambda result: result.cost)


def search(
    off: Callable[[Array], Array],
    parameters: Sequence[Bounded],
    start: Sequence[float],
    errors: Callable[[Array, Array], Array],
    **settings: Any,
) -> Fitted:
    """Find a local minimum of a sum of squares, positive parameters in their logarithm.

    Args:
        off: Residuals (n,) of values of the parameters (m,).
        parameters: The parameters.
        start: Where to start.
        errors: Standard errors (m,), by Jacobian (n, m) and residuals at the minimum, of what is
            searched.
        settings: Of SciPy's ``least_squares``.
    """
    positive = np.array([each.positive for each in parameters])
    given = np.array([(*each[1:3], at) for each, at in zip(parameters, start, strict=True)])
    low, high, first = np.log(given, out=given, where=positive[:, None]).T

    def values(coordinates: Array) -> Array:
        return np.where(positive, np.exp(coordinates), coordinates)

    def residuals_at(coordinates: Array) -> Array:
        return off(values(coordinates))

    begin = np.clip(first, low + 1e-9, high - 1e-9)
    result = least_squares(residuals_at, begin, bounds=(low, high), **settings)
    best = values(result.x)
    deviations = errors(np.asarray(result.jac), result.fun) * np.where(positive, best, 1.0)
    return Fitted(tuple(best.tolist()), tuple(deviations.tolist()), float(result.cost))


def _standard_errors(log: EvenLog, jacobian: Array, off: Array) -> Array:
    """Standard errors (m,) that allow for correlated residuals.

    Sandwich estimate with Bartlett's weights (Newey and West 1987), but no less than what
    independent residuals give. Points that are not scored count as zero, so that points on both
    sides of a hold stay apart.
    """
    points, count = jacobian.shape
    scores = np.zeros((len(log.time_s), count))
    scores[log.scored] = jacobian * off[:, None]
    spread = scores.T @ scores
    reach = round(CORRELATED_S / log.step_s)
    for lag in range(1, min(reach, len(scores))):
        together = scores[lag:].T @ scores[:-lag]
        spread += (1 - lag / reach) * (together + together.T)
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    plain, correlated = np.diag(bread) * np.mean(off**2), np.diag(bread @ spread @ bread)
    variance = np.maximum(np.maximum(plain, correlated), 0.0) * points / max(1, points - count)
    known = np.linalg.norm(jacobian, axis=0) > 1e-9 * np.linalg.norm(jacobian)
    return np.where(known, np.sqrt(variance), np.inf)


def _rms(off: Array) -> float:
    return float(np.sqrt(np.mean(off**2))) if len(off) else math.nan


AIR_C = (-10.0, 45.0)  # of a place where people work
FASTEST_K_PER_S = 8.0  # heaters of these robots warm their segments by 1 to 3 K/s
SLOWEST_K_PER_S = 0.02  # a segment that takes an hour to melt
LEAST_CHANGE_K = 2.0  # of all heatings, and of all coolings
FAR_AIR_K = 10.0  # from the robot's own air: worth a warning
HELD_K, HELD_S = 1.0, 30.0  # what is called heating and rests so long; the firmware's law: 11 s
LARGEST_RMS_C = 2.5  # logs that are told right leave 0.1 to 0.8 C

_AT_BOUND = 1e-3  # of a bound, relative (absolute where a parameter may be negative)


def check_log(log: HeatingLog) -> None:
    """Refuse a log whose units or labels cannot be what they should.

    Raises:
        InputError: Naming the column, and saying what it looks like.
    """
    if not AIR_C[0] <= log.ambient_C <= AIR_C[1]:
        allowed = (
            f"air of {AIR_C[0]:zg} to {AIR_C[1]:zg} C: if the log starts warm, give the air's "
            "temperature (--ambient); if it is in Fahrenheit, turn it into degrees Celsius"
        )
        raise InputError("ambient_C", log.ambient_C, allowed, log.source)
    rise_K, heated_s = _change(log, "heating")
    fall_K, _ = _change(log, "cooling")
    if rise_K < LEAST_CHANGE_K or fall_K > -LEAST_CHANGE_K:
        value = f"{rise_K:+z.3g} K while heating, {fall_K:+z.3g} K while cooling"
        allowed = "readings that rise while heating and fall while cooling: are labels swapped?"
        raise InputError("mode", value, allowed, log.source)
    check_rate(rise_K / heated_s, "time_s", log.source)


def check_rate(rate_K_per_s: float, column: str, source: str) -> None:
    """Refuse a mean rate of heating that no heater of these robots has.

    Raises:
        InputError: Saying in which unit the times seem to be.
    """
    if SLOWEST_K_PER_S <= rate_K_per_s <= FASTEST_K_PER_S:
        return
    unit = "hours" if rate_K_per_s > 60 * FASTEST_K_PER_S else "minutes"
    if rate_K_per_s < SLOWEST_K_PER_S:
        unit = "milliseconds"
    allowed = (
        f"seconds, in which heating warms by {SLOWEST_K_PER_S:zg} to {FASTEST_K_PER_S:zg} K/s; "
        f"these look like {unit}"
    )
    raise InputError(column, f"{rate_K_per_s:z.3g} K/s", allowed, source)


def check_scored(log: EvenLog, source: str) -> None:
    """Refuse a log of which too little can be compared with a model.

    Raises:
        InputError: If heating or cooling has too few points that count.
    """
    for word, flags in (("heating", log.heating), ("cooling", ~log.heating)):
        count = int(np.sum(log.scored & flags))
        if count < LEAST_SAMPLES:
            allowed = f"at least {LEAST_SAMPLES} points {log.step_s:zg} s apart: a longer log"
            raise InputError("mode", f"{count} scored points of {word}", allowed, source)


def check_fit(
    parameters: Mapping[str, Bounded], found: Fitted, off: Residuals, source: str
) -> None:
    """Refuse a fit that does not explain its log, or whose parameters the log does not tell.

    Raises:
        InputError: Naming the residual or the parameter.
    """
    if off.rms_C > LARGEST_RMS_C:
        allowed = (
            f"a residual of at most {LARGEST_RMS_C:zg} C (RMS) in what is fitted: check the units "
            "of time_s and temp_C, the labels in mode, and the air's temperature (--ambient)"
        )
        raise InputError("residual", f"{off.rms_C:z.3g} C", allowed, source)
    check_bounds(parameters, found.values, source)
    for (name, each), value, error in zip(parameters.items(), *found[:2], strict=True):
        if each.positive and not error < value:
            allowed = "less than the parameter: a longer log that starts cold, or more cycles"
            raise InputError(f"standard error of {name}", float(f"{error:z.3g}"), allowed, source)


def check_bounds(parameters: Mapping[str, Bounded], values: Sequence[float], source: str) -> None:
    """Refuse parameters at the ends of where they were searched.

    Raises:
        InputError: Naming the parameter.
    """
    for (name, each), value in zip(parameters.items(), values, strict=True):
        for bound in (each.low, each.high):
            if abs(value - bound) <= _AT_BOUND * (abs(bound) if each.positive else 1.0):
                allowed = (
                    f"inside {each.low:zg} to {each.high:zg}; at a bound the log does not tell it: "
                    "check units and labels, or if it starts warm, give the air (--ambient)"
                )
                raise InputError(name, float(f"{value:z.4g}"), allowed, source)


def doubts(
    robot: Robot, segment: Segment, fitted: Sequence[str], air_C: float, number: int = 0
) -> list[str]:
    """Findings that are possible, but unlike the robot's own file: sentences for who reads them.

    Args:
        robot: Whose log it is.
        segment: Its segment with what was fitted.
        fitted: Fields that were fitted.
        air_C: Temperature of the air while it was logged.
        number: Which segment of the robot it is, from 0.
    """
    found = []
    for name in fitted:
        low, high = robot.thermal_segment(number).ranges.get(name, (0.0, np.inf))
        if not low <= getattr(segment, name) <= high:
            value = f"{name} = {getattr(segment, name):z.4g}"
            own = f"outside {low:zg} to {high:zg}, the range of {robot.name}"
            found.append(f"{value} lies {own}: check the units of time and the labels")
    own_C = robot.heater.ambient_C
    if (apart_K := abs(air_C - own_C)) >= FAR_AIR_K:
        told = f"The log's air, {air_C:z.4g} C, is {apart_K:z.0f} K from heater.ambient_C"
        found.append(f"{told} ({own_C:zg} C) of {robot.name}: check the sensor, or give --ambient")
    return found


def holds_called_heating(log: HeatingLog) -> list[str]:
    """Ends of heatings in which readings rest as in a hold: a sentence for each."""
    found = []
    for first, end in runs(log.mode == "heating"):
        away = np.abs(log.despiked_C[first:end] - log.despiked_C[end - 1]) > HELD_K
        since = first + int(np.flatnonzero(away)[-1]) + 1 if away.any() else first
        if (rests_s := float(log.time_s[end - 1] - log.time_s[since])) >= HELD_S:
            told = f"Heating up to {log.time_s[end - 1]:z.4g} s rests for {rests_s:z.0f} s"
            found.append(f"{told}: is it a hold? Then call it so in mode, its power is unknown")
    return found


def _change(log: HeatingLog, word: str) -> tuple[float, float]:
    """Sum of what the readings rose in this mode, and of the time it took."""
    spans = [(a, b - 1) for a, b in runs(log.mode == word)]
    rises, times = (
        sum(float(of[last] - of[first]) for first, last in spans)
        for of in (log.despiked_C, log.time_s)
    )
    return rises, max(times, 1e-9)
