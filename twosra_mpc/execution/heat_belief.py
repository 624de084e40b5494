"""Belief about the heat of a segment: a moving horizon estimate of its kind and of its metal.

Metal warms without chance, as the segment's parameters have it: the power of its heater, its latent
heat, its loss, the lag of its sensor. Their most probable values, given all readings since the
metal last was at rest, are found by Gauss-Newton steps within the ranges of healthy robots; what
was known before is the prior. Beside a segment of these values others are warmed, a deviation off
along each principal axis of what is not known: their differences are the sensitivities of readings
and metal. The heater is off where metal may be too hot, or where no healthy segment would have
shown what was shown. A sensor that sticks near the melting point shows what metal that melts slowly
would: where by known heat alone metal may be too hot, such readings must not cost much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twosra_mpc.execution.healthy_segments import Heat, Kinds, Segments, Start, healthy_kinds
from twosra_mpc.robot.description import Robot
from twosra_mpc.thermal.model import Array, State
from twosra_mpc.validation import ArrayValue

_UNLIKE_K, _LAST = 1.6, 5.0  # root mean square of so many readings, off those of every segment
_UNLIKE_COST = 20.0  # of the prior; 10 at most in 400 runs of healthy segments
_UNLIKE_TOLD = 10.0  # of readings near the melting point of metal that may be hot; 4 in these
_GAIN = 0.1  # less is not worth a step
_DOUBT_K, _DOUBT_TOLD = 0.8, 5.0  # from which on the heater waits
_SLOWLY = 0.4  # share of a misfit that all readings have, and no healthy segment for half a minute
_NOISE_K = 1.0  # of a reading a second: neighbours err alike
_PRIOR = 0.6  # deviation of what is equally likely from -1 to 1
_EITHER = 1.2  # of what is at one end or the other
_KNOWN, _KNOWN_S = 0.1, 300.0  # deviation that comes with time
_ENDS = 1.05  # of the ranges: segments at their ends
_SURELY = 2.5  # deviations; metal may be so much hotter
CLEARLY = 0.5  # deviations; of what metal is beyond a plateau: neighbours do not err so much alike
_DEVIATION = 0.7  # by which others are off: as far as it matters, and within it all is smooth
_FAR, _FAR_K, _OFTEN = 2.0, 0.35, 5  # ranges, and distance, from which all is made anew; readings
_LEVELLED = 100.0  # times as well as it is known: a level to begin a search from
_STARTS, _ROUNDS = (0.0, -2.0, 2.0, -5.0, 5.0), 4  # deviations of the metal's heat, in doubt
_BEFORE_LIMIT_K, _COOLED_K = 2.0, 3.0  # the heater goes off before the limit, and on again
_AHEAD_S = 1.0  # until the next reading the heater may go on
_TURNS, _TURNED_K = 4, 0.15  # readings over which those of metal that has set fall by so much
_QUIET_S = 60.0  # after which metal is at rest
_UNKNOWN_S = 2.0  # of full heat, after which liquid metal is as warm as the reading has it
_EVERY_S, _OFF_EVERY_S = 0.9, 2.9  # between readings that say something new
_RESTS_S, _MOST = 30.0, 1800  # remembered at least, at rest; readings, at most

NONE = Heat(0.0, 0.0)
Since = tuple[tuple[Heat, float | None], ...]


class Prior(NamedTuple):
    """Normal distribution: most probable parameters (p,), and the inverse covariance (p, p)."""

    mean: Array
    precision: Array


@dataclass(frozen=True, eq=False, repr=False)
class Fit(ArrayValue):
    """Costs of some kinds, and their derivatives: twice the negative logarithm of a probability.

    Attributes:
        about: The kinds, (s, p).
        across: Inverse of the parameters of the others beside each, less its own, (p, p).
        segments: All of them, s times 1 + p.
        cost: Of the readings, (s,).
        gradient: Half of the negative gradient, (s, p).
        hessian: Half of it, (s, p, p).
    """

    about: Array
    across: Array
    segments: Segments
    cost: Array
    gradient: Array
    hessian: Array

    def slopes(self, values: Array) -> tuple[Array, Array]:
        """Values (s,) of the kinds, and their sensitivities (s, p)."""
        count, size = self.about.shape
        each = values.reshape(count, 1 + size)
        slopes: Array = (each[:, 1:] - each[:, :1]) @ self.across.T
        return each[:, 0], slopes

    def take(self, heat: Heat, shown_C: float | None) -> Fit:
        """Warm all, and compare them with a reading, if there is one."""
        segments = self.segments.warmed(heat)
        if shown_C is None:
            return replace(self, segments=segments)
        here_C, slope = self.slopes(segments.shown_C)
        weight, off_K = heat.passed_s / _NOISE_K**2, shown_C - here_C
        cost = self.cost + weight * off_K**2
        gradient = self.gradient + (weight * off_K)[:, None] * slope
        hessian = self.hessian + weight * slope[:, :, None] * slope[:, None, :]
        return Fit(self.about, self.across, segments, cost, gradient, hessian)

    def solved(self, prior: Prior) -> tuple[Array, Array, Array, Array]:
        """Gauss-Newton steps within the ranges.

        Returns:
            Covariance (s, p, p), steps (s, p), costs before them with the prior's (s,), and by how
            much they should become less (s,).
        """
        precision, off = self.hessian + prior.precision, self.about - prior.mean
        covariance, away = _inverse(precision), off @ prior.precision
        right, steps = self.gradient - away, np.empty_like(self.about)
        for k, about in enumerate(self.about):
            steps[k] = _within(covariance[k], right[k], -_ENDS - about, _ENDS - about)
        bent = (precision @ steps[:, :, None])[:, :, 0]
        gain = ((2 * right - bent) * steps).sum(axis=1)
        return covariance, steps, self.cost + (away * off).sum(axis=1), gain

    def only(self, k: int) -> Fit:
        """One of the kinds."""
        one, size = slice(k, k + 1), 1 + self.about.shape[1]
        segments = self.segments.some(slice(k * size, (k + 1) * size))
        own = (each[one] for each in (self.cost, self.gradient, self.hessian))
        return Fit(self.about[one], self.across, segments, *own)


def _fit(kinds: Kinds, start: Start, covariance: Array, points: Array, since: Since = ()) -> Fit:
    """Costs of kinds, (s, p), with heat and readings since the start, and a covariance there."""
    spread, axes = np.linalg.eigh(covariance)
    apart = _DEVIATION * (axes * np.sqrt(spread)).T
    apart *= np.where(np.abs(points[0] + apart).max(axis=1) > _ENDS, -1.0, 1.0)[:, None]
    every = points[:, None] + np.vstack([np.zeros(kinds.size), apart])
    segments = kinds.begun(every.reshape(-1, kinds.size), start)
    none = np.zeros((len(points), kinds.size, kinds.size))
    fit = Fit(points, _inverse(apart), segments, none[:, 0, 0], none[:, 0], none)
    for heat, shown_C in since:
        fit = fit.take(heat, shown_C)
    return fit


def _inverse(matrix: Array) -> Array:
    return np.linalg.inv(matrix).astype(float)


def _within(covariance: Array, right: Array, low: Array, high: Array) -> Array:
    """Solve a linear system; what leaves its bounds stays on them."""
    free = covariance @ right
    step, held = free, np.zeros(len(right), dtype=bool)
    while True:
        bounded: Array = np.clip(step, low, high)
        out = (step != bounded) & ~held
        if not out.any():
            return bounded
        held |= out
        off = np.linalg.solve(covariance[held][:, held], bounded[held] - free[held])
        step = np.where(held, bounded, free + covariance[:, held] @ off)


@dataclass(frozen=True, eq=False, repr=False)
class HeatBelief(ArrayValue):
    """Estimate of a segment; a value, which ``take`` replaces.

    Attributes:
        kinds: Of healthy segments.
        cut_C: Temperature of the hottest from which on the heater is off.
        prior: What was known at the start.
        start: Rest at the start.
        fit: Of one kind, which is near the most probable.
        blind: The same without readings near the melting point since those of solid or of liquid.
        step: Gauss-Newton step from there, (p,).
        covariance: Of the parameters, (p, p).
        cost: Of the prior, after the step: how unlikely such a segment was.
        told: Cost of readings near the melting point, beyond all others, where by known heat
            alone metal may be too hot; else 0.
        since: Heat and readings since the start.
        heat: Heat since the last of them.
        shown_C: Last reading; None if there was none.
        square_K2: Mean square distance of the last readings.
        quiet_s: Time for which the heater has been off.
        wait: Readings until all may be made anew.
        surely: Deviations up to which metal may be hotter.
        cut: True if the heater must be off, whatever a reading says.
    """

    kinds: Kinds
    cut_C: float
    prior: Prior
    start: Start
    fit: Fit
    blind: Fit
    step: Array
    covariance: Array
    cost: float = 0.0
    told: float = 0.0
    since: Since = ()
    heat: Heat = NONE
    shown_C: float | None = None
    square_K2: float = 0.0
    quiet_s: float = 0.0
    wait: int = 0
    surely: float = _SURELY
    cut: bool = False

    @property
    def most_probable(self) -> Array:
        """Parameters, (p,)."""
        return self.fit.about[0] + self.step

    @property
    def off_K(self) -> float:
        """Distance of the last readings from those of the most probable healthy segment."""
        return math.sqrt(self.square_K2)

    @property
    def misfit(self) -> float:
        """Misfit of the last readings, or of what explains all; healthy segments stay below 1."""
        told = self.told / _UNLIKE_TOLD
        return max(self.square_K2 / _UNLIKE_K**2, self.cost / _UNLIKE_COST, told)

    @property
    def doubt(self) -> float:
        """Doubt in the last readings: 1 where no healthy segment shows them, more than 0 if few."""
        told = _SLOWLY * self.told / _UNLIKE_TOLD
        return 1.0 if self.misfit >= 1.0 else max(self.square_K2 / _UNLIKE_K**2, told)

    @property
    def heated_s(self) -> float:
        """Time at full power since the start."""
        return sum(heat.passed_s * heat.share for heat, _ in self.since)

    @property
    def shows_C(self) -> tuple[float, float]:
        """Lowest and highest reading that is to be expected."""
        middle_C, deviation_C = self._estimate(self.fit.segments.shown_C)
        return middle_C - _SURELY * deviation_C, middle_C + _SURELY * deviation_C

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Lowest and highest level of the metal, as the nominal model's."""
        middle, deviation = self._level
        return middle - _SURELY * deviation, middle + self.surely * deviation

    @cached_property
    def _level(self) -> tuple[float, float]:
        """Most probable level of the metal, as the nominal model's, and its standard deviation."""
        return self._estimate(self.fit.segments.level)

    @property
    def metal_C(self) -> tuple[float, float]:
        """Coldest and hottest metal."""
        low, high = self.levels
        return self._at_C(low), self._at_C(high)

    @property
    def state(self) -> State:
        """Most probable state, as the nominal model's."""
        return self._state_at(self._level[0])

    @property
    def may_be_liquid(self) -> bool:
        """True if the metal may be liquid."""
        return self.levels[1] >= self.kinds.nominal.liquid_level

    def stays_liquid_s(self, deviations: float = CLEARLY) -> float:
        """Time for which metal so much colder stays liquid without heat; 0 if it is not liquid."""
        nominal, (middle, deviation) = self.kinds.nominal, self._level
        if (low := middle - deviations * deviation) < nominal.liquid_level:
            return 0.0
        return nominal.time_until(self._state_at(low), 0.0, nominal.liquid_level)

    @property
    def clearly_solid(self) -> bool:
        """True if the metal is solid."""
        middle, deviation = self._level
        return middle + CLEARLY * deviation <= self.kinds.nominal.solid_level

    @property
    def surely_liquid(self) -> bool:
        """True if the metal is liquid for sure."""
        return self.levels[0] >= self.kinds.nominal.liquid_level

    def begun(self, shown_C: float, said_C: float) -> HeatBelief:
        """Begin at rest: at the first reading where metal is solid, else as it is said to be."""
        return self._anew(self.kinds.start(shown_C, said_C), self.prior, self.covariance)

    def take(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Let heat in, and look at a reading, if there is one; most say nothing new."""
        now, before = self, self.heat
        if heat.off != before.off and before.passed_s >= _EVERY_S:
            now, before = self._compared(before, self.shown_C), NONE
        both = before.then(heat)
        rarely = both.off and (shown_C is None or not self._sets(shown_C))
        if both.passed_s >= (_OFF_EVERY_S if rarely else _EVERY_S):
            return now._compared(both, shown_C)
        return replace(now, heat=both, shown_C=shown_C)

    def _compared(self, heat: Heat, shown_C: float | None) -> HeatBelief:
        """Compare a reading with healthy ones."""
        quiet_s = self.quiet_s + heat.passed_s if heat.off else 0.0
        since, wait = (*self.since, (heat, shown_C)), self.wait - 1
        blind, fit = self.blind.take(heat, None), self.fit.take(heat, shown_C)
        now = replace(self, heat=NONE, since=since, quiet_s=quiet_s, wait=wait, blind=blind)
        if shown_C is None:
            return replace(now, fit=fit)
        now = now._about(fit)
        square_K2 = (shown_C - now._estimate(fit.segments.shown_C)[0]) ** 2
        part = 1 - (1 - 1 / _LAST) ** heat.passed_s
        now = replace(now, square_K2=self.square_K2 + part * (square_K2 - self.square_K2))
        far = now.off_K > _FAR_K or np.abs(now.step).max() > _FAR * _KNOWN
        doubtful = now.off_K > _DOUBT_K or now.cost > _UNLIKE_COST
        if (far and now.wait <= 0) or doubtful or now._sets(shown_C):
            now = now._searched(shown_C)
        if self.kinds.is_solid(shown_C) or self.kinds.is_liquid(shown_C):
            now = replace(now, blind=now.fit)
        now = now._judged()
        return now._begun_anew(shown_C) if now.off_K < _FAR_K and now._rests(shown_C) else now

    def _sets(self, shown_C: float) -> bool:
        """True if metal of some kinds is solid, of others not, and the reading tells which."""
        before_C = self.since[-_TURNS:][0][1] if self.since else None
        turned = self.quiet_s > 0.0 and before_C is not None and before_C - shown_C > _TURNED_K
        return turned and self.levels[0] < self.kinds.nominal.solid_level < self.levels[1]

    def _rests(self, shown_C: float) -> bool:
        """True if a reading tells the metal's heat, or the heater's does not any more."""
        if self.kinds.is_solid(shown_C) and self.quiet_s >= _QUIET_S:
            return sum(heat.passed_s for heat, _ in self.since) >= _RESTS_S
        if self.kinds.is_liquid(shown_C) and self.surely_liquid:
            unknown_s = sum(heat.unknown_s for heat, _ in self.since)
            return unknown_s >= _UNKNOWN_S or len(self.since) >= _MOST
        return len(self.since) >= _MOST

    def _about(self, fit: Fit) -> HeatBelief:
        """Make a step from one kind."""
        (covariance,), (step,), _, _ = fit.solved(self.prior)
        off = fit.about[0] + step - self.prior.mean
        cost = float(off @ self.prior.precision @ off)
        return replace(self, fit=fit, step=step, covariance=covariance, cost=cost)

    def _estimate(self, values: Array) -> tuple[float, float]:
        """Most probable value of what the segments have, and its standard deviation."""
        (middle,), (slope,) = self.fit.slopes(values)
        return float(middle + slope @ self.step), math.sqrt(float(slope @ self.covariance @ slope))

    def _state_at(self, level: float) -> State:
        state = tuple(float(value[0]) for value in self.fit.segments.state)
        return self.kinds.nominal.at_level(state, level)

    def _at_C(self, level: float) -> float:
        return self.kinds.nominal.temperature_C(self._state_at(level))

    def _fitted(self, points: Array) -> Fit:
        return _fit(self.kinds, self.start, self.covariance, points, self.since)

    def _hotter(self, deviations: Array) -> Array:
        """Most probable kinds within the ranges whose metal is hotter by so much (s,), (s, p)."""
        _, (slope,) = self.fit.slopes(self.fit.segments.level)
        weight = _LEVELLED / float(slope @ self.covariance @ slope)  # as if the level were seen
        covariance = _inverse(_inverse(self.covariance) + weight * np.outer(slope, slope))
        told = np.outer(deviations, slope * math.sqrt(_LEVELLED * weight))
        low, high = -_ENDS - self.most_probable, _ENDS - self.most_probable
        return self.most_probable + [_within(covariance, each, low, high) for each in told]

    def _searched(self, shown_C: float) -> HeatBelief:
        """Search the most probable kind by Gauss-Newton steps; in doubt, from several starts."""
        starts = np.array(_STARTS if self.off_K > _FAR_K else _STARTS[:1])
        points = self._hotter(starts)
        best, (least,) = self.fit, self.fit.solved(self.prior)[2]
        for _ in range(_ROUNDS):
            fit = self._fitted(points)
            _, steps, cost, gain = fit.solved(self.prior)
            k = int(cost.argmin())
            if cost[k] < least:
                best, least = fit.only(k), cost[k]
            if gain.max() < _GAIN:
                break
            points = points + steps
        now = replace(self._about(best), wait=max(_OFTEN, len(self.since) // 20))
        off_K = shown_C - now._estimate(best.segments.shown_C)[0]
        return replace(now, square_K2=min(now.square_K2, off_K**2))

    def _judged(self) -> HeatBelief:
        """Switch off where metal may be too hot, or is that of no healthy segment.

        Deviations are those of a linear problem: hotter metal that readings deny is left out.
        """
        now = replace(self, surely=_SURELY)
        if hot := now._hot(self.cut):
            reaches = np.linspace(0.0, _SURELY, 11)
            _, _, cost, _ = now._fitted(now._hotter(reaches)).solved(self.prior)
            now = replace(now, surely=float(reaches[cost <= cost[0] + _SURELY**2].max()))
            hot = now._hot(self.cut)
        now = replace(now, told=now._told())
        ahead = now.told + max(0.0, now.told - self.told)  # at the next reading
        doubted = self.off_K > _DOUBT_K or now.misfit >= 1.0 or ahead >= _DOUBT_TOLD
        return replace(now, cut=hot or doubted)

    def _told(self) -> float:
        """Cost of readings near the melting point where, by heat alone, metal may be too hot."""
        if self.blind is self.fit:
            return 0.0
        hot = replace(self._about(self.blind), surely=_SURELY)._hot(self.cut)
        return self._cost(self.fit) - self._cost(self.blind) if hot else 0.0

    def _cost(self, fit: Fit) -> float:
        _, _, (cost,), (gain,) = fit.solved(self.prior)
        return float(cost - gain)

    def _hot(self, cut: bool) -> bool:
        """True if metal may come too near to its limit before the next reading."""
        ahead = self.levels[1] + float(self.fit.segments.warms_by(_AHEAD_S)[0])
        return self._at_C(ahead) >= self.cut_C - _COOLED_K * cut

    def _begun_anew(self, shown_C: float) -> HeatBelief:
        """Begin anew with what is known by now: it is less certain by the time since."""
        covariance, mean = self.covariance.copy(), self.most_probable
        mean[-2:] = covariance[-2:] = covariance[:, -2:] = 0.0
        passed_s = sum(heat.passed_s for heat, _ in self.since)
        least = np.full(self.kinds.size, _KNOWN * min(1.0, math.sqrt(passed_s / _KNOWN_S)))
        least[-2:] = _PRIOR
        covariance += np.diag(least**2)
        metal_C = self._at_C(self._level[0])
        start = self.kinds.start(shown_C, metal_C, self.surely_liquid)
        return self._anew(start, Prior(mean, _inverse(covariance)), covariance)

    def _anew(self, start: Start, prior: Prior, covariance: Array) -> HeatBelief:
        now = replace(self, start=start, prior=prior, covariance=covariance, since=())
        fit = now._fitted(prior.mean[None])
        return replace(now, blind=fit)._about(fit)


def heat_belief(robot: Robot, air_C: float, segment: int, start_C: float) -> HeatBelief:
    """Believe in a segment (from 0) that has rested at this temperature."""
    kinds = healthy_kinds(robot, air_C, segment)
    wide = _PRIOR * (1 + np.abs(kinds.described))  # as the farther end of the range is far
    wide[kinds.either] = _EITHER
    prior = Prior(kinds.described, np.diag(wide**-2.0))
    covariance, start = _inverse(prior.precision), kinds.start(start_C, start_C)
    fit = _fit(kinds, start, covariance, prior.mean[None])
    cut_C = robot.heater.temperature_max_C - _BEFORE_LIMIT_K
    return HeatBelief(kinds, cut_C, prior, start, fit, fit, np.zeros(kinds.size), covariance)
