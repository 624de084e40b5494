"""Fitting a family of models to a log by least squares, with uncertainty and cross-validation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from twosra_mpc.lab.identification.heating_log import EvenLog
from twosra_mpc.lab.identification.log_response import Response
from twosra_mpc.robot.coordinates import Array

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
    nominal = [each.start for each in family.parameters]
    starts = [[v * factors.get(i, 1.0) for i, v in enumerate(nominal)] for factors in family.starts]
    results = [_search(family, log, start) for start in ([near] if near else [nominal, *starts])]
    return min(results, key=lambda result: result.cost)


def _search(family: Family, log: EvenLog, start: Sequence[float]) -> Fitted:
    """Find a local minimum, positive parameters in their logarithm."""
    positive = np.array([each.positive for each in family.parameters])
    bounds = [each[1:3] for each in family.parameters]
    given = np.column_stack([bounds, start])
    low, high, first = np.log(given, out=given, where=positive[:, None]).T

    def values(coordinates: Array) -> Array:
        return np.where(positive, np.exp(coordinates), coordinates)

    def off(coordinates: Array) -> Array:
        found = family.respond(values(coordinates).tolist(), log)
        return (found.sensor_C - log.sensor_C)[log.scored]

    result = least_squares(
        off,
        np.clip(first, low + 1e-9, high - 1e-9),
        bounds=(low, high),
        x_scale="jac",
        ftol=1e-6,  # of the sum of squares: a fiftieth of a standard error
        max_nfev=60,
    )
    best = values(result.x)
    errors = _standard_errors(np.asarray(result.jac), result.fun, log)
    errors *= np.where(positive, best, 1.0)
    return Fitted(tuple(best.tolist()), tuple(errors.tolist()), float(result.cost))


def _standard_errors(jacobian: Array, off: Array, log: EvenLog) -> Array:
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
