"""What a robot can do, enclosed in intervals: bends, shapes, drives, melts and freezes.

A second account of the robot for ``checking.certificate``, which shares no code with the planner.
The lemmas it rests on are in sections 2 and 3 of ``docs/certificate.md``.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from flint import acb, arb

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.robot.modes import Mode
from twosra_mpc.robot.paths import ArcPath, CardioidPath
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.two_node import TwoNode
from twosra_mpc.thermal.uncertainty import EXACT, Windows, windows

_CELLS = 600  # of the table that inverts W
_OVERLAP_M = 1e-6  # by which units surely overlap


def low(x: arb) -> float:
    """A float that is surely no more; -inf if nothing is known."""
    return math.nextafter(float(x.lower()), -math.inf) if x.is_finite() else -math.inf


def between(a: Any, b: Any) -> arb:
    """The interval from a to b."""
    return arb(a).union(arb(b))


# Shapes and bends: section 2 of the lemmas.


@dataclass(frozen=True)
class Fibre:
    """The kinematics of a robot, in intervals; curvatures in 1/m, W as in the package."""

    robot: Robot

    def rate(self, k: int, alpha: arb) -> arb:
        """Bending angle per travel on curve I, II or III of a fitted path model [rad/m]."""
        path = self.robot.path
        if type(path) is CardioidPath:
            p = arb(path.phi_per_alpha[k])
            return 1 / (2 * p * path.radius_m[k] * (1 + (p * alpha).cos()))
        return path.angle_ratio[k] / self._radius(k, alpha, self._root)

    def _radius(self, k: int, alpha: Any, root: Callable[[Any], Any]) -> Any:
        path = self.robot.path
        size = root(alpha * alpha + arb(path.smoothing_rad) ** 2) - path.smoothing_rad
        late = k == 2 and path.model == "log_spiral_corrected"
        angle = size / path.angle_ratio[k] + (0 if late else arb.pi())
        scale = arb(path.scale[k]) * self.robot.geometry.lengths_m[0]
        return scale * (-path.growth[k] * angle).exp()

    def _root(self, square: arb) -> arb:
        return square.max(arb(self.robot.path.smoothing_rad) ** 2).sqrt()

    def share(self, j: int, kappa: arb) -> arb:
        """The factor g_j: how far segment j bends per W [rad per unit of W]."""
        lengths = self.robot.geometry.lengths_m
        if type(self.robot.path) is ArcPath:
            return arb(lengths[j]) / lengths[0]
        return arb(self.rate(2, kappa * lengths[j]))

    def coordinate(self, j: int, kappa: Any) -> arb:
        """W_j of a curvature: the integral of 1 / g_j over the bending angle."""
        path, lengths = self.robot.path, self.robot.geometry.lengths_m
        if type(path) is ArcPath:
            return arb(kappa) * lengths[0]
        alpha = arb(kappa) * lengths[j]
        if type(path) is CardioidPath:
            p = arb(path.phi_per_alpha[2])
            return 2 * arb(path.radius_m[2]) * (p * alpha + (p * alpha).sin())
        ends = [self._travelled(arb(0), end) for end in (alpha.lower(), alpha.upper())]
        return ends[0].union(ends[1])  # W grows with the curvature

    def _travelled(self, since: arb, until: arb) -> arb:
        """Integral of 1 / g between two bending angles, on spirals."""

        def density(z: acb, analytic: bool) -> acb:
            radius = self._radius(2, z, lambda square: square.sqrt(analytic=analytic))
            return acb(radius / self.robot.path.angle_ratio[2])

        return acb.integral(density, acb(since), acb(until)).real

    @cached_property
    def _table(self) -> tuple[list[float], list[arb], list[float]]:
        """A grid of curvatures a little beyond the limits, W there, and about there."""
        limit, length = 1.01 * self.robot.limits.curvature_per_m, self.robot.geometry.lengths_m[0]
        kappa, table = [limit * k / _CELLS for k in range(_CELLS + 1)], [arb(0)]
        for a, b in itertools.pairwise(kappa):
            if type(self.robot.path) is CardioidPath:
                table.append(self.coordinate(0, b))
            else:
                table.append(table[-1] + self._travelled(arb(a) * length, arb(b) * length))
        kappa, table = [-k for k in kappa[:0:-1]] + kappa, [-w for w in table[:0:-1]] + table
        return kappa, table, [float(w) for w in table]

    def curvature(self, j: int, w: arb) -> arb:
        """Curvatures of a segment whose W is in an interval, within the limits."""
        if type(self.robot.path) is ArcPath:
            return w / self.robot.geometry.lengths_m[0]
        kappa, table, about = self._table  # fitted curves: segments are alike
        ends = []
        for end in (w.lower(), w.upper()):
            k = min(max(bisect(about, float(end)) - 1, 0), len(table) - 2)
            cell = between(kappa[max(k - 1, 0)], kappa[min(k + 2, len(kappa) - 1)])
            slope = self.share(j, cell) / self.robot.geometry.lengths_m[j]
            ends.append(kappa[k] + (end - table[k]) * slope)
        return ends[0].union(ends[1])

    def bend(self, mode: Mode, kappa: Sequence[arb], unit: int) -> tuple[arb, ...]:
        """What the travel of a unit does in a soft mode: (u, v, r) of b0 and W, per metre."""
        geometry, path, side = self.robot.geometry, self.robot.path, (-1, 1)[unit]
        if type(path) is not ArcPath:
            own, other = unit, 1 - unit
            alpha = [k * geometry.lengths_m[0] for k in kappa]
            pace, turn = arb(1), self.share(other, kappa[other]) if mode[other] else arb(0)
            if not mode[other]:
                pace = self.rate(0, alpha[own]) / self.rate(2, alpha[own])
            elif not mode[own]:
                turn = self.rate(1, alpha[other])
                pace = turn / self.rate(2, alpha[other])
            x, y = self._displacement(alpha[other])
            middle = arb(geometry.middle_link_m) / 2
            return side * x * turn, (middle + y) * turn, side * turn, pace
        n, inner = len(kappa), geometry.inner_link_of_b0
        here = at_b0 = (arb(0), arb(0), arb(0))
        for number, j in enumerate(range(n) if unit else reversed(range(n))):
            t, v, r = here
            if number:
                v = v + r * geometry.middle_link_m
            length = arb(geometry.lengths_m[j])
            a, turn = kappa[j] * length, mode[j] * length / geometry.lengths_m[0]
            c, s, half = a.cos(), a.sin(), (a / 2).sinc()
            here = (
                c * t + s * v + length * (r * a * half * half / 2 + turn * _sagitta(a)),
                c * v - s * t + length * (r * a.sinc() + turn * half * half / 2),
                r + turn,
            )
            if j == (inner - 1 if unit else inner):
                at_b0 = (here[0], here[1] + here[2] * geometry.half_link_m, here[2])
        speed = self._speed(here, unit, side)
        return side * at_b0[0] / speed, at_b0[1] / speed, side * at_b0[2] / speed, 1 / speed

    def _speed(self, end: tuple[arb, arb, arb], unit: int, side: int) -> arb:
        t, n, r = end
        if getattr(self.robot.path, "speed_reference", "") == "fibre_end":
            return (t * t + n * n).sqrt()
        x, y, beta = self.robot.geometry.wheel_placement[2 * unit]
        along, across = side * round(math.cos(beta), 15), round(math.sin(beta), 15)
        rolled = across * (self.robot.geometry.lengths_m[0] / 2 + side * x) - along * y
        speed = along * (t - r * y) + across * (n + r * (side * x))
        return speed if rolled > 0 else -speed

    def _displacement(self, alpha: arb) -> tuple[arb, arb]:
        path = self.robot.path
        if type(path) is CardioidPath:
            p = arb(path.phi_per_alpha[0])
            arm = p * 4 * path.radius_m[0] * (p * alpha / 2).cos()
            turn = alpha - p * alpha * 3 / 2
        else:
            arm = self._radius(0, alpha, self._root) / path.angle_ratio[0]
            turn = alpha - alpha / path.angle_ratio[0]
        return arm * turn.sin(), arm * turn.cos()

    @property
    def rolls_v(self) -> bool:
        """Whether v_j is what a wheel of unit j rolls."""
        return getattr(self.robot.path, "speed_reference", "side_wheel") == "side_wheel"

    @property
    def unit_speed(self) -> arb:
        """Full speed of a locomotion unit [m/s]."""
        limits, radius = self.robot.limits, self.robot.geometry.wheel_radius_m
        speed = arb(limits.unit_speed_m_s)
        if type(self.robot.path) is ArcPath:
            return speed
        return speed.min(arb(limits.wheel_speed_rad_s) * radius)

    def end(self, kappa: Sequence[arb], unit: int) -> tuple[arb, arb, arb]:
        """Pose in b0 of the fibre end of a unit."""
        geometry, side = self.robot.geometry, (-1, 1)[unit]
        x, y, turn, inner = (
            side * arb(geometry.half_link_m),
            arb(0),
            arb(0),
            geometry.inner_link_of_b0,
        )
        outward = range(inner, len(kappa)) if unit else range(inner - 1, -1, -1)
        for number, j in enumerate(outward):
            link = geometry.middle_link_m if number else 0.0
            for run, bent in ((link, arb(0)), (geometry.lengths_m[j], kappa[j])):
                a = side * run * bent
                half = (a / 2).sinc()
                dx, dy = side * run * a.sinc(), side * run * a * half * half / 2
                c, s = turn.cos(), turn.sin()
                x, y, turn = x + c * dx - s * dy, y + s * dx + c * dy, turn + a
        return x, y, turn

    def overlaps(self, kappa: Sequence[arb]) -> bool:
        """Whether the units surely are nearer to each other than they may be (separating axes)."""
        geometry = self.robot.geometry
        half, centres, axes = arb(geometry.unit_side_m) / 2, [], []
        for unit, side in ((0, -1), (1, 1)):
            x, y, turn = self.end(kappa, unit)
            c, s = turn.cos(), turn.sin()
            along, across = side * (geometry.end_link_m + half), geometry.unit_offset_m
            centres.append((x + along * c - across * s, y + along * s + across * c))
            axes += [(c, s), (-s, c)]
        (x0, y0), (x1, y1) = centres
        for n, (a, b) in enumerate(axes):
            others = axes[2:] if n < 2 else axes[:2]
            extent = half * (1 + sum(abs(a * c + b * s) for c, s in others))
            apart = abs(a * (x1 - x0) + b * (y1 - y0)) - extent
            if not apart < self.robot.limits.unit_gap_m - _OVERLAP_M:
                return False
        return True


def _sagitta(a: arb) -> arb:
    """(a - sin a) / a^2, by its series near zero."""
    if a.abs_lower() > 0.5:
        return (a - a.sin()) / (a * a)
    square, total = a * a, arb(0, 1e-12)  # more than all that follows up to a full turn
    for k in reversed(range(16)):
        total = (-1) ** k / arb(math.factorial(2 * k + 3)) + square * total
    return a * total


# Melting and freezing: section 3 of the lemmas.


class Heat(NamedTuple):
    """What no heating of a segment can undercut; times in s.

    Attributes:
        lead: From t = 0 to the onset of the first transition.
        first: From its onset to its end.
        total: From t = 0 to its end.
        again: From the end of a freeze to the onset of the next melt.
        melt: From onset to end of a melt after that.
        freeze: (transitions made before, least time since the melt) -> onset to end of a freeze.
        first_J: Heater energy of a first melt.
        melt_J: Of any other.
        hold_W: Mean heater power from the end of a melt to the onset of the freeze after it.
    """

    lead: arb
    first: arb
    total: arb
    again: arb
    melt: arb
    freeze: Callable[[int, arb], arb]
    first_J: arb
    melt_J: arb
    hold_W: arb


def heat(problem: Problem, j: int) -> Heat:
    """Work out the least times of segment j (from 0)."""
    times, heater = problem.transition_times, problem.robot.heater
    soft, now = bool(problem.start_mode[j]), problem.temperatures[j]
    if type(times) is OverlappedTiming:
        full_W = arb(heater.melt_current_A) ** 2 * heater.resistance_ohm
        hold_W = arb(heater.hold_current_A) ** 2 * heater.resistance_ohm
        melting_C, melt_lead = (
            arb(heater.melting_point_C),
            arb(times.melt_s) - times.melt_changing_s,
        )
        coast = arb(times.freeze_s) - times.freeze_changing_s
        if soft:
            lead = coast * (now - melting_C) / (heater.soft_setpoint_C - melting_C)
        else:
            lead = melt_lead * (melting_C - now) / (melting_C - problem.ambient)
        melt, freeze = arb(times.melt_changing_s), arb(times.freeze_changing_s)
        share = times.superheat_s / (times.superheat_s + coast)
        return Heat(
            *(lead, freeze if soft else melt, arb(0), melt_lead, melt, lambda _k, _held: freeze),
            *((lead + melt) * full_W, (melt_lead + melt) * full_W, hold_W.min(share * full_W)),
        )
    model, window = segment_model(problem.robot, problem.ambient, j), EXACT
    if problem.transition_quantile is not None:
        ranges = tuple(problem.robot.thermal_segment(j).ranges.items())
        current, setpoint = heater.melt_current_A, heater.soft_setpoint_C
        window = windows(model, ranges, current, setpoint, problem.transition_quantile)
    if type(model) is Lumped:
        return _lumped(model, heater.melt_current_A, now, window, soft=soft)
    if type(model) is TwoNode:
        return _two_node(model, heater.soft_setpoint_C, now, window, soft=soft)
    raise InputError("robot.segment.model", type(model).__name__, "lumped or two_node")


def _lumped(model: Lumped, current_A: float, now: float, window: Windows, *, soft: bool) -> Heat:
    """One temperature: what is warmer stays warmer, and full current heats fastest."""
    air, melting, loss = arb(model.ambient_C), arb(model.melting_point_C), arb(model.loss_W_per_K)
    ohm, alpha = arb(current_A) ** 2 * model.resistance_ohm, model.temperature_coefficient_per_K

    def course(heat_J_per_K: float, since: arb, on: bool) -> tuple[arb, arb]:
        """Time from a temperature to the plateau, and the heat that is given meanwhile."""
        slope = (alpha * ohm if on else 0) - loss

        def rate(at: arb) -> arb:
            return (ohm * (1 + alpha * (at - 25)) if on else 0) - loss * (at - air)

        first, last, gained = rate(since), rate(melting), heat_J_per_K * (melting - since)
        if slope > 0 or slope < 0:
            time = heat_J_per_K / slope * (last / first).log()
            return time, gained + loss * (gained - (rate(air)) * time) / slope
        return gained / first.max(last), gained

    power = ohm * (1 + alpha * (melting - 25))
    frozen, molten = model.latent_J / (loss * (melting - air)), arb(model.latent_J)
    molten = molten / (power - loss * (melting - air))
    capacity = model.heat_liquid_J_per_K if soft else model.heat_solid_J_per_K
    lead, _ = course(capacity, arb(now), not soft)
    warm, given = course(model.heat_solid_J_per_K, arb(now).max(air).min(melting), on=True)
    late, early = window.melt_late, window.melt_early
    freeze = window.freeze_late * frozen
    if soft:
        lead, first = window.freeze_early * lead, freeze
        total = lead / window.freeze_early + freeze
    else:
        first, lead = late * molten + (late - early) * warm, early * lead
        total = lead + first
    hold_W = loss * (melting - air) if window == EXACT else arb(0)
    return Heat(
        *(lead, first, total, arb(0), late * molten, lambda _k, _held: freeze),
        *(given + power * molten, power * molten, hold_W),
    )


def _two_node(model: TwoNode, setpoint: float, now: float, window: Windows, *, soft: bool) -> Heat:
    """A core and a body: of two states the one that is nowhere colder stays so."""
    a, beta, b = arb(model.coupling_per_s), arb(model.body_ratio), arb(model.body_loss_per_s)
    air, p, solid, liquid = (
        arb(value)
        for value in (model.ambient_C, model.power_K_per_s, model.solid_level, model.liquid_level)
    )
    middle = -(a + a / beta + b) / 2
    root = (middle**2 - a * b).sqrt()
    fast, slow, leave = middle - root, middle + root, a / beta

    def course(core: arb, body: arb, on: bool, t: Any) -> tuple[arb, arb, arb]:
        """Core, body and the rate of the core after a time at full power, or without."""
        body_end = air + (p / (beta * b) if on else 0)
        core_end = body_end + (p / a if on else 0)
        c, rate = core - core_end, (p if on else 0) - a * (core - body)
        c_fast, c_slow = (rate - slow * c) / (fast - slow), (fast * c - rate) / (fast - slow)
        f, s = c_fast * (fast * t).exp(), c_slow * (slow * t).exp()
        body_t = body_end + f * (1 + fast / a) + s * (1 + slow / a)
        return core_end + f + s, body_t, fast * f + slow * s

    def passed(core: arb, body: arb, on: bool, level: arb) -> arb:
        """A time before which the core does not pass a level: its rate changes sign but once."""
        sign, before, after = 1 if on else -1, 0.0, 1.0
        while after < 1e5 and sign * (level - course(core, body, on, after)[0]) > 0:
            before, after = after, 2 * after
        for _ in range(60):
            half = (before + after) / 2
            short = sign * (level - course(core, body, on, half)[0]) > 0
            before, after = (half, after) if short else (before, half)
        return arb(before if sign * course(core, body, on, before)[2] >= 0 else 0.0)

    def settled(core: arb) -> arb:
        return (leave * core + b * air) / (leave + b)

    start, cold, warm = arb(now), arb(now).min(air), arb(now).max(air).min(solid)
    hottest = start.max(settled(arb(setpoint).max(start).max(liquid)))
    body = hottest.min(solid)
    late, early = window.melt_late, window.melt_early
    lead, slowest = passed(warm, warm, True, solid), passed(cold, cold, True, solid) + 1e-6
    ends = [course(warm, warm, True, t)[1] for t in (lead, slowest)]
    sure = course(cold, cold, True, slowest)[0] >= solid
    first = passed(solid, ends[0].max(ends[1]).min(solid) if sure else solid, True, liquid)
    melt = passed(solid, body, True, liquid)
    shortest = passed(warm, warm, True, liquid), melt

    def freeze(made: int, held: arb) -> arb:
        there = course(cold, cold, True, shortest[made > 1])[1]
        rest = settled(liquid)
        there = (rest + (there - rest) * (-(leave + b) * held).exp()).min(rest)
        return window.freeze_late * passed(liquid, there, False, solid)

    full_W, hold_W = model.core_heat_J_per_K * p, model.core_heat_J_per_K * a * (liquid - hottest)
    given = (
        full_W * (lead + first),
        full_W * melt,
        hold_W.max(arb(0)) if window == EXACT else arb(0),
    )
    if soft:
        plateau = passed(liquid, start.min(settled(liquid)), False, solid)
        total = passed(start, start, False, solid) + (window.freeze_late - 1) * plateau
        lead = window.freeze_early * passed(start, start, False, liquid)
        first = window.freeze_late * plateau
    else:
        first = late * first + (late - early) * lead
        lead = early * passed(start, start, True, solid)
        total = passed(start, start, True, liquid)
    return Heat(lead, first, total, arb(0), late * melt, freeze, *given)
