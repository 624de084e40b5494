"""Belief about the heat of a segment: a moving horizon estimate of its kind and of its metal.

A segment warms without chance, as its parameters have it: its heater's power, its latent heat, its
loss, the lag of its sensor. Their most probable values given all readings since the metal last was
at rest are found by Gauss-Newton steps, within the ranges of healthy robots; what was known before
is the prior. Beside the segment itself one more is warmed for each parameter, a little off: their
differences are the sensitivities of readings and metal, which also give the covariance. Where no
healthy segment would have shown what was shown, the heater is off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import Array, SegmentModel, thresholds_C
from twosra_mpc.thermal.uncertainty import healthy_ranges

UNLIKE_K = 1.1  # a mean reading farther off is none of a healthy segment
_DOUBT_K = 0.7  # farther off, the heater waits
_NOISE_K = 1.0  # of one reading a second: neighbours err alike
_PRIOR = 0.6  # standard deviation of what is equally likely from -1 to 1
_WIDEST = 1.05  # times the ranges: segments at their ends
_STEP = 0.1  # by which the others are off
_SURELY = 2.5  # standard deviations
_MELTS_OFF_K, _AIR_OFF_K, _GAIN_OFF, _START_OFF_K = 1.0, 2.0, 0.03, 1.0
_LAGS, _LAG_SHARES = (0.18, 1.06), (0.5, 1.0)  # of the longest lag in all; of it in the first of two
_WARM_OFF_K = 3.0  # of metal that is said to be warm
_SOLID_K = 5.0  # below the melting point a reading is of solid metal
_HELD_S = 3.0  # in which a switch brings metal back to its set-point
_STEP_S = 0.5  # the fastest metal warms by 1 K in it
_MEMORY_S = 20.0  # of full heat that nobody knows
_MEAN = 3.0  # readings of which the mean distance counts
_SHARES, _APART = (0.0, 0.25, 0.5, 1.0), (-0.6, -0.2, 0.2, 0.6)
_DEVIATION = 0.7
_DEVIATIONS = (-4.0, -2.0, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 2.0, 4.0)
_ROUNDS = 4
_FAR, _FAR_K, _OFTEN = 2.0, 0.35, 5  # steps of a Gauss-Newton step that is made; readings to the next
_BEFORE_LIMIT_K, _COOLED_K = 2.0, 3.0  # the heater goes off before the limit, and on again
_AHEAD_S = 1.0  # until the next reading the heater may go on
_QUIET_S = 60.0  # after which metal is at rest
_MOST = 1800  # readings that are remembered
_EPS = 1e-6


class Heat(NamedTuple):
    """Heat of a heater from one reading to the next.

    Attributes:
        passed_s: Time.
        share: Share of full power.
        unknown: By how much more or less that may be.
        warm: Whether this was metal to be kept warm, not molten: not every firmware does.
        held_C: Reading about which a switch holds metal, with a share nobody knows; or NaN.
    """

    passed_s: float
    share: float
    unknown: float = 0.0
    warm: bool = False
    held_C: float = math.nan

    @property
    def kept(self) -> float:
        """Share of what is known that heat which nobody knows leaves."""
        unknown = self.unknown if math.isnan(self.held_C) else 1.0
        return math.exp(-self.passed_s * unknown / _MEMORY_S)

    def then(self, later: Heat) -> Heat:
        """Heat of both times."""
        passed_s = self.passed_s + later.passed_s
        if self.passed_s == 0.0 or later.passed_s == 0.0:
            return later if self.passed_s == 0.0 else self
        part = later.passed_s / passed_s
        share = self.share + part * (later.share - self.share)
        unknown = self.unknown + part * (later.unknown - self.unknown)
        held_C = math.nan if math.isnan(self.held_C) else later.held_C
        return Heat(passed_s, share, unknown, later.warm, held_C)


@dataclass(frozen=True, eq=False)
class Kinds:
    """Kinds of healthy segments, each parameter from -1 to 1 over its range.

    Attributes:
        nominal: The segment as described.
        full_A: Full current.
        names: Those of the model.
        middle: Of the model's, of the air, of the sensor's gain, lag and share of it in the first
            of two, of whether firmware keeps metal warm, and of the start, (p,).
        half: Half of each range, (p,).
    """

    nominal: SegmentModel
    full_A: float
    names: tuple[str, ...]
    middle: Array
    half: Array


class Course(NamedTuple):
    """Segments that are warmed side by side: the first, and one a little off for each parameter.

    Attributes:
        model: All as one, whose parameters are arrays (1 + p,).
        sensor: Gains, lags (2, 1 + p), and shares of heat to keep warm.
        parameters: Of each, (1 + p, p).
        state: Of the metal, each (1 + p,), as the nominal model's.
        lag_C: Of the sensor, (2, 1 + p).
    """

    model: SegmentModel
    sensor: tuple[Array, Array, Array, Array]
    parameters: Array
    inverse: Array
    state: tuple[Array, ...]
    lag_C: Array


@dataclass(frozen=True, eq=False)
class HeatBelief:
    """Estimate of a segment; a value, which ``take`` replaces.

    Attributes:
        kinds: Of healthy segments.
        cut_C: Temperature of the hottest from which on the heater is off.
        begun_C: Temperature of the metal and the sensor at the start.
        prior: Most probable parameters before, (p,).
        precision: Inverse of their covariance, (p, p).
        about: Parameters about which all is linear, (p,).
        course: Segments with these.
        hessian: Of the readings since, (p, p).
        gradient: Of the readings since, (p,).
        since: Heat and readings since the start.
        off_K: Mean distance of the last readings from the most probable.
        change: Gauss-Newton step from there, (p,).
        quiet_s: Time for which the heater has been off.
        again: Readings until a step may be made.
        cut: Whether the heater must be off, whatever a reading says.
    """

    kinds: Kinds
    cut_C: float
    begun_C: tuple[float, float]
    prior: Array
    precision: Array
    about: Array
    course: Course
    hessian: Array
    gradient: Array
    cost: float
    change: Array
    since: tuple[tuple[Heat, float | None], ...] = ()
    mean_K: float = 0.0
    quiet_s: float = 0.0
    again: int = 0
    cut: bool = False
    reach: float = _SURELY
    again_hot: int = 0
    bounds: tuple[float, float] = (-math.inf, -math.inf)
    wide_K: float = 0.0
    shows_C: tuple[float, float] = (0.0, 0.0)
    metal_C: tuple[float, float] = (0.0, 0.0)

    @property
    def off_K(self) -> float:
        """Distance of the readings from those of the most similar healthy segment."""
        return max(0.0, abs(self.mean_K) - self.wide_K)

    @property
    def may_be_liquid(self) -> bool:
        """Whether the metal may be liquid."""
        return self.bounds[1] >= self.kinds.nominal.liquid_level

    @property
    def surely_liquid(self) -> bool:
        """Whether the metal is liquid for sure."""
        return self.bounds[0] >= self.kinds.nominal.liquid_level

    def begun(self, shown_C: float, start_C: float) -> HeatBelief:
        """Begin at rest: at the first reading where metal is solid, else as it is said to be."""
        solid_C = thresholds_C(self.kinds.nominal)[0] - _SOLID_K
        metal_C = shown_C if shown_C < solid_C else start_C
        half = self.kinds.half.copy()
        half[-1] = _START_OFF_K if shown_C < solid_C else _WARM_OFF_K
        now = replace(self, kinds=replace(self.kinds, half=half), begun_C=(metal_C, shown_C))
        return now._again_about(self.about)

    def take(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Warm the segment, and compare it with a reading, if there is one."""
        quiet_s = 0.0 if heat.share or not math.isnan(heat.held_C) else self.quiet_s + heat.passed_s
        now = replace(self, since=(*self.since, (heat, shown_C)), quiet_s=quiet_s)
        now = now._with(heat, shown_C)
        if shown_C is None:
            return now
        now = now._solved()
        far_off = now.off_K > _FAR_K
        far = far_off or np.abs(now.change).max() > _FAR * _STEP
        if far and (now.again <= 0 or now.off_K > _DOUBT_K / 2):
            before, rounds = math.inf, 0
            while rounds < _ROUNDS and now.misfit < before - 1.0:
                before, rounds = now.misfit, rounds + 1
                now = now._again_about(now._best())._solved()
            now = replace(now, again=_OFTEN if rounds > 1 else max(_OFTEN, len(now.since) // 20))
        now = replace(now, again=now.again - 1, again_hot=now.again_hot-1, reach=now.reach if now.again_hot>0 else _SURELY)._judged(shown_C)
        at_rest = shown_C < thresholds_C(self.kinds.nominal)[0] - _SOLID_K and now.off_K < _DOUBT_K
        if (now.quiet_s >= _QUIET_S and at_rest) or len(now.since) >= _MOST:
            return now._rested(shown_C)
        return now

    @property
    def most_probable(self) -> Array:
        """Parameters, (p,)."""
        return self.about + self.change

    @property
    def misfit(self) -> float:
        """Cost of the most probable parameters, less that of the first."""
        matrix = self.hessian + self.precision
        off = self.prior - self.about
        return self.cost + float(off @ self.precision @ off - self.change @ matrix @ self.change)

    def _best(self) -> Array:
        """Most probable of some parameters: Gauss-Newton steps, in doubt about them, too."""
        steps = self.about + np.outer(_SHARES, self.change)
        spread, axes = np.linalg.eigh(np.linalg.inv(self.hessian + self.precision))
        axes = np.vstack([(axes * np.sqrt(spread)).T, self._toward()])
        apart = [np.outer(_DEVIATIONS, axis) for axis in axes]
        apart += [np.outer(_APART, row) for row in np.eye(len(self.about))]
        tried = np.vstack([steps, *(steps[-1] + one for one in apart)])
        tried = np.clip(tried, -_WIDEST, _WIDEST)
        best: Array = tried[self._costs(tried)[0].argmin()]
        return best

    def _toward(self) -> Array:
        """Most probable direction to hotter metal, of one standard deviation, (p,)."""
        slope = _slope(self.kinds.nominal.level(self.course.state), self.course)
        toward: Array = np.linalg.solve(self.hessian + self.precision, slope)
        return toward / math.sqrt(float(slope @ toward))

    def _costs(self, tried: Array) -> tuple[Array, Array]:
        """Twice the negative logarithms of the probabilities of parameters (n, p); levels, (n,)."""
        course, off = _course(self.kinds, tried, self.begun_C), tried - self.prior
        costs = np.zeros(len(tried))
        for heat, shown_C in self.since:
            course = _warmed(self.kinds, course, heat) if heat.passed_s else course
            if shown_C is not None:
                costs *= heat.kept
                costs += heat.passed_s * np.square((course.lag_C[1] - shown_C) / _NOISE_K)
        costs += np.einsum("ni,ij,nj->n", off, self.precision, off)
        return costs, self.kinds.nominal.level(course.state)

    def _again_about(self, about: Array) -> HeatBelief:
        """Warm segments with other parameters by all heat since the start."""
        size = len(about)
        now = replace(
            self,
            about=about,
            course=_course(self.kinds, _beside(about, self.hessian + self.precision, False), self.begun_C),
            hessian=np.zeros((size, size)),
            gradient=np.zeros(size),
            cost=0.0,
            change=np.zeros(size),
            mean_K=0.0,
        )
        for heat, shown_C in self.since:
            now = now._with(heat, shown_C)
        return now

    def _with(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Warm the segments, and add a reading to what is known."""
        course = _warmed(self.kinds, self.course, heat) if heat.passed_s else self.course
        if shown_C is None:
            return replace(self, course=course)
        slope, off_K = _slope(course.lag_C[1], course), shown_C - float(course.lag_C[1, 0])
        left_K = off_K - float(slope @ self.change)
        weight, kept = heat.passed_s / _NOISE_K**2, heat.kept
        return replace(
            self,
            course=course,
            hessian=kept * self.hessian + weight * np.outer(slope, slope),
            gradient=kept * self.gradient + weight * off_K * slope,
            cost=kept * self.cost + weight * off_K**2,
            mean_K=self.mean_K + (left_K - self.mean_K) / _MEAN,
        )

    def _solved(self) -> HeatBelief:
        """Make a Gauss-Newton step within the ranges."""
        matrix = self.hessian + self.precision
        right = self.gradient + self.precision @ (self.prior - self.about)
        low, high = -_WIDEST - self.about, _WIDEST - self.about
        change, free = np.zeros(len(right)), np.ones(len(right), dtype=bool)
        for _ in range(4):
            change[free] = np.linalg.solve(
                matrix[np.ix_(free, free)], right[free] - matrix[np.ix_(free, ~free)] @ change[~free]
            )
            out = free & ((change < low) | (change > high))
            if not out.any():
                break
            change, free = np.clip(change, low, high), free & ~out
        return replace(self, change=np.clip(change, low, high))

    def _judged(self, shown_C: float) -> HeatBelief:
        """Bound metal and readings; switch off where metal may be too hot, or is like none."""
        kinds, course = self.kinds, self.course
        nominal, change = kinds.nominal, self.change
        covariance = np.linalg.inv(self.hessian + self.precision)

        def about(values: Array, reach: float) -> tuple[float, float]:
            slope = _slope(values, course)
            middle = float(values[0] + slope @ change)
            wide = math.sqrt(float(slope @ covariance @ slope))
            return middle - _SURELY * wide, middle + reach * wide

        shows_C = about(course.lag_C[1], _SURELY)
        self = replace(self, shows_C=shows_C, wide_K=(shows_C[1] - shows_C[0]) / 2)
        low, high = bounds = about(nominal.level(course.state), self.reach)
        state = tuple(float(value[0]) for value in course.state)
        metal_C = [float(nominal.temperature_C(nominal.at_level(state, one))) for one in (low, high)]
        full = nominal.rates_in(nominal, tuple(map(np.atleast_1d, state)), kinds.full_A)
        ahead = high + _AHEAD_S * float(full[0][0])
        hot_C = float(nominal.temperature_C(nominal.at_level(state, ahead)))
        hot = hot_C >= self.cut_C - _COOLED_K * self.cut
        if hot and self.again_hot <= 0:
            reaches = np.linspace(0.0, _SURELY, 11)
            tried = self.most_probable + np.outer(reaches, self._toward())
            costs, _ = self._costs(np.clip(tried, -_WIDEST, _WIDEST))
            likely = costs <= costs[0] + _SURELY**2
            reach = float(reaches[likely].max())
            return replace(self, reach=reach, again_hot=_OFTEN)._judged(shown_C)
        cut = hot or self.off_K > _DOUBT_K
        return replace(
            self, cut=cut, bounds=bounds, metal_C=(metal_C[0], metal_C[1])
        )

    def _rested(self, shown_C: float) -> HeatBelief:
        """Begin anew with what is known by now."""
        prior = self.most_probable
        covariance = np.linalg.inv(self.hessian + self.precision)
        floor = np.full(len(prior), 0.1)
        floor[-1] = _PRIOR
        prior[-1] = 0.0
        covariance[-1] = covariance[:, -1] = 0.0
        precision = np.linalg.inv(covariance + np.diag(floor**2))
        now = replace(
            self,
            prior=prior,
            precision=precision,
            about=prior,
            since=(),
            begun_C=(shown_C, shown_C),
            change=np.zeros(len(prior)),
        )
        return now._again_about(prior)


def _slope(values: Array, course: Course) -> Array:
    """Sensitivities to the parameters, (p,)."""
    slope: Array = course.inverse @ (values[1:] - values[0])
    return slope


def _beside(about: Array, precision: Array, colder: bool) -> Array:
    """Parameters, and these a deviation off along each of their principal axes, (1 + p, p)."""
    spread, axes = np.linalg.eigh(np.linalg.inv(precision))
    apart = _DEVIATION * (axes * np.sqrt(spread)).T
    signs = np.where(np.abs(about + apart).max(axis=1) > _WIDEST, -1.0, 1.0)
    return about + np.vstack([np.zeros(len(about)), signs[:, None] * apart])


def _course(kinds: Kinds, parameters: Array, begun_C: tuple[float, float]) -> Course:
    """Begin at rest with parameters (n, p), of which the start is the last."""
    all_of, count = kinds.middle + kinds.half * parameters, len(kinds.names)
    inverse = np.zeros((0, 0))
    if len(parameters) == 1 + parameters.shape[1]:
        inverse = np.linalg.inv(parameters[1:] - parameters[0])
    model = replace(kinds.nominal, **dict(zip(kinds.names, all_of.T, strict=False)))
    gain, lag_s, share, keeps, bias, start_K = all_of.T[count:]
    lags_s = np.maximum([lag_s * share, lag_s * (1 - share)], _EPS)
    metal_C, shown_C = begun_C
    about_C = model.temperature_in(kinds.nominal, kinds.nominal.initial(metal_C)) - metal_C
    starts_C = np.broadcast_to(metal_C + start_K - about_C, start_K.shape)
    state = np.array([kinds.nominal.initial(one) for one in starts_C.tolist()]).T
    lag_C = np.tile(shown_C + start_K * (metal_C == shown_C), (2, 1))
    return Course(model, (gain, lags_s, keeps, bias), parameters, inverse, tuple(state), lag_C)


def _warmed(kinds: Kinds, course: Course, heat: Heat) -> Course:
    """Let time pass."""
    nominal, model, state, lag_C = kinds.nominal, course.model, course.state, course.lag_C
    (gain, lags_s, keeps, bias), air_C = course.sensor, model.ambient_C
    share = np.clip(heat.share + heat.unknown * bias, 0.0, 1.0) * (np.clip(keeps, 0.0, 1.0) if heat.warm else 1.0)
    if not math.isnan(heat.held_C):
        share = _holding(kinds, course, heat.held_C)
    steps = max(1, math.ceil(heat.passed_s / _STEP_S - 1e-9))
    step_s, current_A = heat.passed_s / steps, kinds.full_A * np.sqrt(share)
    kept = np.exp(-step_s / lags_s)
    touched_C = air_C + gain * (model.temperature_in(nominal, state) - air_C)
    for _ in range(steps):
        state = _after(nominal, model, state, current_A, step_s)
        before_C, touched_C = touched_C, air_C + gain * (model.temperature_in(nominal, state) - air_C)
        middle_C = (before_C + touched_C) / 2
        first_C = middle_C + (lag_C[0] - middle_C) * kept[0]
        middle_C = (lag_C[0] + first_C) / 2
        lag_C = np.array([first_C, middle_C + (lag_C[1] - middle_C) * kept[1]])
    return course._replace(state=state, lag_C=lag_C)


def _holding(kinds: Kinds, course: Course, shown_C: float) -> Array:
    """Shares with which metal goes to where a reading shows it."""
    nominal, model, (gain, *_) = kinds.nominal, course.model, course.sensor
    here_C = model.temperature_in(nominal, course.state)
    cools_C, warms_C = (
        model.temperature_in(nominal, _after(nominal, model, course.state, current_A, 1.0))
        for current_A in (0.0, kinds.full_A)
    )
    to_C = model.ambient_C + (shown_C - model.ambient_C) / gain
    wanted_C = here_C + (to_C - here_C) / _HELD_S
    range_K = np.maximum(warms_C - cools_C, _EPS)  # none of metal that melts
    share: Array = np.clip((wanted_C - cools_C) / range_K, 0.0, 1.0)
    return share


def _after(
    nominal: SegmentModel,
    model: SegmentModel,
    state: tuple[Array, ...],
    current_A: Array | float,
    for_s: float,
) -> tuple[Array, ...]:
    """Metal after a short time."""
    rates = model.rates_in(nominal, state, current_A)
    return tuple(value + for_s * rate for value, rate in zip(state, rates, strict=True))


def heat_belief(robot: Robot, air_C: float, segment: int, start_C: float) -> HeatBelief:
    """Believe in a segment (from 0) that has rested at this temperature."""
    nominal, described = segment_model(robot, air_C, segment), robot.thermal_segment(segment)
    gain, lags_s = described.sensor_gain_and_lags_s
    longest_s = 2 * described.ranges.get("sensor_lag_s", (0.0, max(lags_s)))[1]
    within = healthy_ranges(nominal, described.ranges)
    if "melting_point_C" in within:
        low, high = within["melting_point_C"]
        within["melting_point_C"] = low - 0.3, high + 0.3
    within["ambient_C"] = air_C - _AIR_OFF_K, air_C + _AIR_OFF_K
    low, high = described.ranges.get("sensor_gain", (gain, gain))
    ends = [
        *within.values(),
        (low - _GAIN_OFF, high + _GAIN_OFF),
        (_LAGS[0] * longest_s, _LAGS[1] * longest_s),
        _LAG_SHARES,
        (0.0, 1.0),
        (-1.0, 1.0),
        (-_START_OFF_K, _START_OFF_K),
    ]
    low_, high_ = np.array(ends).T
    kinds = Kinds(
        nominal,
        robot.heater.melt_current_A,
        tuple(within),
        (low_ + high_) / 2,
        (high_ - low_) / 2,
    )
    nowhere = np.zeros(len(ends))
    return HeatBelief(
        kinds,
        robot.heater.temperature_max_C - _BEFORE_LIMIT_K,
        (start_C, start_C),
        nowhere,
        np.eye(len(ends)) / _PRIOR**2,
        nowhere,
        _course(kinds, _beside(nowhere, np.eye(len(ends)) / _PRIOR**2, False), (start_C, start_C)),
        np.zeros((len(ends), len(ends))),
        nowhere,
        0.0,
        nowhere,
    )
