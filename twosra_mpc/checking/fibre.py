"""Bending of the fibre, in intervals: section 2 of ``docs/certificate.md``.

A second account of ``model`` for ``checking.certificate``, which shares no code with it.
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

from twosra_mpc.checking.body import nearest
from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode
from twosra_mpc.robot.paths import ArcPath, CardioidPath, LogSpiralPath

_CELLS = 600  # of the table that inverts W, on either side of zero
_PIECES = 120  # of a bend
_MOVES = 1e-5  # of W: a phase that bends by less may be left out
_CLOSE_M, _LOOKS = 0.01, 2  # gaps in which to look closer, and how often


def low(x: arb) -> float:
    """A float that is surely no more; -inf if nothing is known."""
    return math.nextafter(float(x.lower()), -math.inf) if x.is_finite() else -math.inf


def between(a: Any, b: Any) -> arb:
    """The interval from a to b."""
    return arb(a).union(arb(b))


class Least(NamedTuple):
    """Least duration of a phase [s], and least effort times duration [s2]."""

    time: arb
    effort: arb


NO_TIME = Least(arb(0), arb(0))


@dataclass(frozen=True)
class Fibre:
    """The kinematics of a robot, in intervals; curvatures in 1/m, W as in the package."""

    robot: Robot

    @property
    def path(self) -> Any:
        """The robot's path model, of one of three kinds."""
        if type(self.robot.path) not in (ArcPath, CardioidPath, LogSpiralPath):
            raise InputError("path.model", self.robot.path.model, "arcs, spirals or cardioids")
        return self.robot.path

    def rate(self, k: int, alpha: arb) -> arb:
        """Bending angle per travel on curve I, II or III of a fitted path model [rad/m]."""
        path = self.path
        if type(path) is CardioidPath:
            p = arb(path.phi_per_alpha[k])
            return 1 / (2 * p * path.radius_m[k] * (1 + (p * alpha).cos()))
        return arb(path.angle_ratio[k] / self._radius(k, alpha, self._root))

    def _radius(self, k: int, alpha: Any, root: Callable[[Any], Any]) -> Any:
        path = self.path
        size = root(alpha * alpha + arb(path.smoothing_rad) ** 2) - path.smoothing_rad
        late = k == 2 and path.model == "log_spiral_corrected"
        angle = size / path.angle_ratio[k] + (0 if late else arb.pi())
        scale = arb(path.scale[k]) * self.robot.geometry.lengths_m[0]
        return scale * (-path.growth[k] * angle).exp()

    def _root(self, square: arb) -> arb:
        return square.max(arb(self.path.smoothing_rad) ** 2).sqrt()

    def share(self, j: int, kappa: arb) -> arb:
        """The factor g_j: how far segment j bends per W [rad per unit of W]."""
        lengths = self.robot.geometry.lengths_m
        if type(self.path) is ArcPath:
            return arb(lengths[j]) / lengths[0]
        return arb(self.rate(2, kappa * lengths[j]))

    def coordinate(self, j: int, kappa: Any) -> arb:
        """W_j of a curvature: the integral of 1 / g_j over the bending angle."""
        path, lengths = self.path, self.robot.geometry.lengths_m
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
            return acb(radius / self.path.angle_ratio[2])

        return acb.integral(density, acb(since), acb(until)).real

    @cached_property
    def _table(self) -> tuple[list[float], list[arb], list[float]]:
        """A grid of curvatures a little beyond the limits, W there, and about there."""
        limit, length = 1.01 * self.robot.limits.curvature_per_m, self.robot.geometry.lengths_m[0]
        kappa, table = [limit * k / _CELLS for k in range(_CELLS + 1)], [arb(0)]
        for a, b in itertools.pairwise(kappa):
            if type(self.path) is CardioidPath:
                table.append(self.coordinate(0, b))
            else:
                table.append(table[-1] + self._travelled(arb(a) * length, arb(b) * length))
        kappa, table = [-k for k in kappa[:0:-1]] + kappa, [-w for w in table[:0:-1]] + table
        return kappa, table, [float(w) for w in table]

    def curvature(self, j: int, w: arb) -> arb:
        """Curvatures of a segment whose W is in an interval, within the limits."""
        if type(self.path) is ArcPath:
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
        """Effect of a unit's travel in a soft mode: (u, v, r) of b0 and W, per metre."""
        geometry, path, side = self.robot.geometry, self.path, (-1, 1)[unit]
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
        if getattr(self.path, "speed_reference", "") == "fibre_end":
            return (t * t + n * n).sqrt()
        x, y, beta = self.robot.geometry.wheel_placement[2 * unit]
        along, across = side * round(math.cos(beta), 15), round(math.sin(beta), 15)
        rolled = across * (self.robot.geometry.lengths_m[0] / 2 + side * x) - along * y
        speed = along * (t - r * y) + across * (n + r * (side * x))
        return speed if rolled > 0 else -speed

    def _displacement(self, alpha: arb) -> tuple[arb, arb]:
        path = self.path
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
        """True if v_j is what a wheel of unit j rolls."""
        return getattr(self.path, "speed_reference", "side_wheel") == "side_wheel"

    @property
    def unit_speed(self) -> arb:
        """Full speed of a locomotion unit [m/s]."""
        limits, radius = self.robot.limits, self.robot.geometry.wheel_radius_m
        speed = arb(limits.unit_speed_m_s)
        if type(self.path) is ArcPath:
            return speed
        return speed.min(arb(limits.wheel_speed_rad_s) * radius)

    def meets_itself(self, mode: Mode, here: Sequence[arb], bend: arb) -> bool:
        """True if a bend surely passes a shape in which parts overlap, more than plans may."""
        begin, end = arb(0), bend
        for _ in range(_LOOKS):
            step = (end - begin) / _PIECES
            shapes = [self._shapes(mode, here, begin + k * step) for k in range(_PIECES + 1)]
            number, apart_m, meet = nearest(self.robot, shapes)
            if meet or apart_m > _CLOSE_M:
                return meet
            end = begin + min(number + 1, _PIECES) * step
            begin += max(number - 1, 0) * step
        return False

    def least(self, mode: Mode, here: Sequence[arb], bend: arb) -> Least | None:
        """Least duration of a bend from rest to rest; None if it passes a forbidden shape.

        Args:
            mode: A soft mode.
            here: W of every segment where it begins.
            bend: Change of W; what it surely is counts.
        """
        ends = bend.lower(), bend.upper()
        surely = ends[0] if ends[0] > 0 else ends[1] if ends[1] < 0 else arb(0)
        if surely == 0:
            return NO_TIME
        key = mode, *((w.mid(), w.rad()) for w in (*here, bend))  # exact, as intervals are not
        if key not in self._known:
            self._known[key] = self._least(mode, here, surely)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[Any, Least | None]:
        """Least durations of bends: the sequences of a proof have many in common."""
        return {}

    def _least(self, mode: Mode, here: Sequence[arb], surely: arb) -> Least | None:
        limits = self.robot.limits
        if self.meets_itself(mode, here, surely):
            return None
        at_speed, rolled, turned = arb(0), arb(0), [arb(0) for _ in mode]
        piece = abs(surely) / _PIECES
        full_m_s = arb(limits.wheel_speed_rad_s) * self.robot.geometry.wheel_radius_m
        for k in range(_PIECES):
            kappa = self._shapes(mode, here, between(k, k + 1) * surely / _PIECES)
            rate, pace = self.rate_of_w(mode, kappa)
            at_speed += piece / rate if rate.is_finite() else arb(0)
            rolled += piece / (pace * full_m_s) if pace.is_finite() and self.rolls_v else arb(0)
            for j, soft in enumerate(mode):
                turned[j] += soft * piece * self.share(j, kappa[j]).abs_lower()
        ramp = arb(0)
        if limits.wheel_acceleration_rad_s2 is not None and self.rolls_v:
            radius = self.robot.geometry.wheel_radius_m
            ramp = self.unit_speed / (arb(limits.wheel_acceleration_rad_s2) * radius)
        time = at_speed + ramp if at_speed > ramp else 2 * (at_speed * ramp).sqrt()
        if limits.bend_rate_rad_s is not None:
            for turn in turned:
                time = time.max(turn / limits.bend_rate_rad_s)
        time = time.max(arb(limits.phase_s)) if abs(surely) > _MOVES else time
        return Least(time, rolled * rolled)

    def rate_of_w(self, mode: Mode, kappa: Sequence[arb]) -> tuple[arb, arb]:
        """Largest abs(dW/dt), and abs(dW) per travel (v1, v2), in a box, if finite."""
        one, two = (abs(self.bend(mode, kappa, unit)[3]).upper() for unit in (0, 1))
        return (one + two) * self.unit_speed, (one * one + two * two).sqrt()

    def _shapes(self, mode: Mode, here: Sequence[arb], moved: arb) -> list[arb]:
        """Curvatures where the W of the soft segments have changed by so much."""
        moves = zip(here, mode, strict=True)
        return [self.curvature(j, w + soft * moved) for j, (w, soft) in enumerate(moves)]


_SAGITTA = [(-1) ** k / arb(math.factorial(2 * k + 3)) for k in range(16)]


def _sagitta(a: arb) -> arb:
    """(a - sin a) / a^2, by its series near zero."""
    if a.abs_lower() > 0.5:
        return (a - a.sin()) / (a * a)
    square, total = a * a, arb(0, 1e-12)  # more than all that follows up to a full turn
    for coefficient in reversed(_SAGITTA):
        total = coefficient + square * total
    return a * total
