r"""Path models: how the bend of the fibre follows from the travel of a locomotion unit (LU).

With alpha_j = kappa_j l_j the bending angle of segment j and s the travel of the moving LU [m], the
other LU held, a path model gives

``bends``  what the travel of each LU does to the robot in a mode (`Bend`).
``share``  g_j(alpha): how soft segments split a bend among them: whoever moves, d alpha_j / g_j is
           the same for all of them. W_j, the integral of 1 / g_j, is the *bending coordinate*.

In every model b0 turns with what bends between it and the LU that is held. ``speed`` says what v_j
measures, ``wheel_map`` which wheel speeds belong to it: the paper's V (a side wheel rolls v_j, the
others rest) or the exact map.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal, NamedTuple, Protocol

import casadi as ca

from twosra_mpc.errors import InputError
from twosra_mpc.model import series
from twosra_mpc.model.cache import BODIES
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.paths import ArcPath, CardioidPath, LogSpiralPath

WheelMap = Literal["paper", "exact"]
Stiffnesses = Sequence[ca.SX | float]  # of the segments, 1 soft: symbols, or the numbers of a mode

_BOTH = 2  # case III among I, II, III
_LEAST_ROLL = 0.1  # share of its travel that a wheel must roll to measure a speed

Twist = tuple[ca.SX, ca.SX, ca.SX]  # motion of a frame: along, across, turn


class Bend(NamedTuple):
    """Effect of the travel of one locomotion unit in a soft mode, per metre.

    Attributes:
        twist: Of b0 in its own frame, (u, v, r) [1, 1, rad/m].
        bending: d alpha_j / d s of every segment [rad/m].
        pace: d W / d s, the same for all soft segments.
    """

    twist: list[ca.SX]
    bending: list[ca.SX]
    pace: ca.SX


class PathModel(Protocol):
    """Path model, as the kinematics needs it."""

    @property
    def speed(self) -> str:
        """Point whose speed v_j is, in words."""

    @property
    def wheel_map(self) -> WheelMap:
        """Wheel map that belongs to the model."""

    @property
    def rolls_v(self) -> bool:
        """True if v_j is the speed at which a wheel of unit j rolls."""

    @property
    def conserved(self) -> tuple[str, str, float]:
        """Conserved quantity of two soft segments: name, unit, factor to W_i - W_j."""

    def bends(self, alpha: ca.SX, sigma: Stiffnesses) -> tuple[Bend, Bend]:
        """Effects of LU1's and of LU2's travel; meaningless where no segment is soft."""

    def share(self, segment: int, alpha: ca.SX) -> ca.SX:
        """The factor g_j(alpha) of a segment's bend."""


class FittedCurves(ABC):
    """Path models of two equal segments that replace the moving LU's path by fitted curves.

    Case I: the LU next to the only soft segment moves. II: the other LU does. III: both are soft.
    Each segment bends at a rate of its own curvature alone, whatever the other one does.
    """

    wheel_map: ClassVar[WheelMap] = "paper"
    rolls_v: ClassVar[bool] = True  # so says the paper's map
    conserved = "W{0} - W{1} (W: travel that bends a segment from straight)", "m", 1.0

    link_m: float

    @abstractmethod
    def rate(self, k: int, alpha: ca.SX) -> ca.SX:
        """Bending angle per travel on the curve of case I, II or III (k = 0, 1, 2) [rad/m]."""

    @abstractmethod
    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Displacement of b0 along and across its x axis per bending angle [m/rad]."""

    def share(self, segment: int, alpha: ca.SX) -> ca.SX:
        return self.rate(_BOTH, alpha)

    def bends(self, alpha: ca.SX, sigma: Stiffnesses) -> tuple[Bend, Bend]:
        return self._bend(alpha, sigma, 0), self._bend(alpha, sigma, 1)

    def _bend(self, alpha: ca.SX, sigma: Stiffnesses, unit: int) -> Bend:
        own, other = unit, 1 - unit  # the segment next to the LU that moves, and the other one
        adjacent, opposite = sigma[own] * (1 - sigma[other]), (1 - sigma[own]) * sigma[other]
        both = sigma[own] * sigma[other]
        near, far = self.rate(0, alpha[own]), self.rate(1, alpha[other])
        shares = self.rate(_BOTH, alpha[own]), self.rate(_BOTH, alpha[other])
        turn, side = opposite * far + both * shares[1], (-1, 1)[unit]
        x, y = self.displacement(alpha[other])
        bending = [ca.SX(0), ca.SX(0)]
        bending[own], bending[other] = adjacent * near + both * shares[0], turn
        return Bend(
            twist=[side * x * turn, (self.link_m / 2 + y) * turn, side * turn],
            bending=bending,
            pace=adjacent * (near / shares[0]) + opposite * (far / shares[1]) + both,
        )


@dataclass(frozen=True)
class LogSpiral(FittedCurves):
    """The paper's spirals in autonomous form: q_0 of its Algorithm 1 is the current q.

    rho_k = a_k exp(-b_k (abs(alpha) / m_k + pi)), d alpha / d s = m_k / rho_k (eq. kappa). The
    absolute value is rounded to sqrt(alpha^2 + eps^2) - eps, so that it is smooth at alpha = 0. The
    derivative of rho is left out of the displacement, as published.
    """

    speed = "fibre end along its spiral (eq. kappa), taken as a side wheel's rolling speed"

    length_m: float
    link_m: float
    path: LogSpiralPath

    def _radius(self, k: int, alpha: ca.SX) -> ca.SX:
        eps = self.path.smoothing_rad
        size = ca.sqrt(alpha**2 + eps**2) - eps
        a, b, m = self.path.scale[k], self.path.growth[k], self.path.angle_ratio[k]
        in_phase = k == _BOTH and self.path.model == "log_spiral_corrected"
        return a * self.length_m * ca.exp(-b * (size / m + (0.0 if in_phase else math.pi)))

    def rate(self, k: int, alpha: ca.SX) -> ca.SX:
        return self.path.angle_ratio[k] / self._radius(k, alpha)

    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        m = self.path.angle_ratio[0]
        arm = self._radius(0, alpha) / m
        turn = alpha - alpha / m
        return arm * ca.sin(turn), arm * ca.cos(turn)


@dataclass(frozen=True)
class Cardioid(FittedCurves):
    """The follow-up robot's cardioids r_k = 2 a_k (1 - cos phi_k), as meant.

    d phi / d s = 1 / r leaves out the factor sin(phi / 2) of the true arc length; the displacement
    is that of a point on cardioid I, derivative of r included.
    """

    speed = "fibre end about the cusp of its cardioid, taken as a side wheel's rolling speed"

    link_m: float
    path: CardioidPath

    def _angle(self, k: int, alpha: ca.SX) -> ca.SX:
        return math.pi + self.path.phi_per_alpha[k] * alpha

    def rate(self, k: int, alpha: ca.SX) -> ca.SX:
        radius = 2 * self.path.radius_m[k] * (1 - ca.cos(self._angle(k, alpha)))
        return 1 / (self.path.phi_per_alpha[k] * radius)

    def displacement(self, alpha: ca.SX) -> tuple[ca.SX, ca.SX]:
        phi = self._angle(0, alpha)
        arm = self.path.phi_per_alpha[0] * 4 * self.path.radius_m[0] * ca.sin(phi / 2)
        turn = alpha - 1.5 * (phi - math.pi)
        return arm * ca.sin(turn), arm * ca.cos(turn)


@dataclass(frozen=True)
class Arc:
    """Exact constant-curvature arcs: soft segments all bend by the same curvature per metre.

    v_j is the speed of the fibre end along its path, or what the side wheel rolls. Twists are
    followed from the held end outwards: (t, n, r) are the components of a frame's motion along and
    across its own outward axis and its turn, per W = kappa l_1.
    """

    wheel_map: ClassVar[WheelMap] = "exact"

    geometry: Geometry
    at_wheel: bool

    @property
    def speed(self) -> str:
        if self.at_wheel:
            return "rolling speed of the side wheel, exact"
        return "fibre end along its exact path"

    @property
    def rolls_v(self) -> bool:
        return self.at_wheel

    @property
    def conserved(self) -> tuple[str, str, float]:
        return "kappa{0} - kappa{1}", "1/m", 1 / self.geometry.lengths_m[0]

    def share(self, segment: int, alpha: ca.SX) -> ca.SX:
        return ca.SX(self._per_bend(segment))

    def _per_bend(self, segment: int) -> float:
        lengths = self.geometry.lengths_m
        return lengths[segment] / lengths[0]

    def bends(self, alpha: ca.SX, sigma: Stiffnesses) -> tuple[Bend, Bend]:
        twists, bendings, paces = _bends_of_arc(self)(alpha, ca.vertcat(*sigma))
        first, second = (
            Bend(ca.vertsplit(twists[:, unit]), ca.vertsplit(bendings[:, unit]), paces[unit])
            for unit in (0, 1)
        )
        return first, second

    def written(self, alpha: ca.SX, sigma: Stiffnesses) -> tuple[Bend, Bend]:
        """Write ``bends`` down; calling them as a function is ten times faster."""
        turned = [s * self._per_bend(j) for j, s in enumerate(sigma)]
        passed = [self._passed(j, alpha[j], turned[j]) for j in range(len(turned))]
        rigid = ca.SX(math.prod((1 - s for s in sigma), start=ca.SX(1)))
        return self._bend(passed, turned, rigid, 0), self._bend(passed, turned, rigid, 1)

    def _passed(self, segment: int, alpha: ca.SX, turn: ca.SX | float) -> Callable[..., Twist]:
        """(t, n, r) beyond a segment from that before it; the segment turns by ``turn`` per W."""
        length, c, s = self.geometry.lengths_m[segment], ca.cos(alpha), ca.sin(alpha)
        across, along = length * series.versine_ratio(alpha), length * series.sinc(alpha)
        a = length * series.sagitta_ratio(alpha)
        b = length * series.versine_ratio_squared(alpha)

        def beyond(t: ca.SX, n: ca.SX, r: ca.SX) -> Twist:
            moved = c * t + s * n + r * across + turn * a, c * n - s * t + r * along + turn * b
            return (*moved, r + turn)

        return beyond

    def _bend(
        self,
        passed: Sequence[Callable[..., Twist]],
        turned: Sequence[ca.SX | float],
        rigid: ca.SX,
        unit: int,
    ) -> Bend:
        """From the held LU to the moving one."""
        count, side = len(passed), (-1, 1)[unit]
        order = range(count) if unit == 1 else range(count - 1, -1, -1)
        inner = self.geometry.inner_link_of_b0  # b0 lies between segments inner - 1 and inner
        here = at_b0 = (ca.SX(0), ca.SX(0), ca.SX(0))
        for number, segment in enumerate(order):
            if number:
                here = _along_link(here, self.geometry.middle_link_m)
            here = passed[segment](*here)
            if segment == (inner - 1 if unit == 1 else inner):
                at_b0 = _along_link(here, self.geometry.half_link_m)
        pace = 1 / (self._speed_of(here, unit) + rigid)
        return Bend(
            twist=[side * at_b0[0] * pace, at_b0[1] * pace, side * at_b0[2] * pace],
            bending=[turn * pace for turn in turned],
            pace=pace,
        )

    def _speed_of(self, end: Twist, unit: int) -> ca.SX:
        """Speed v of a unit whose fibre end moves so."""
        t, n, r = end
        if not self.at_wheel:
            return ca.sqrt(t**2 + n**2)
        along, across, x, y = self._side_wheel(unit)
        return along * (t - r * y) + across * (n + r * x)

    def _side_wheel(self, unit: int) -> tuple[float, float, float, float]:
        """Drive direction and place of a unit's first wheel, outwards and across its end frame.

        The direction is the one in which it rolls when its unit bends a straight segment to +y.
        """
        x, y, beta = self.geometry.wheel_placement[2 * unit]
        side, length = (-1, 1)[unit], self.geometry.lengths_m[0]
        along, across = side * round(math.cos(beta), 15), round(math.sin(beta), 15)
        rolled = across * (length / 2 + side * x) - along * y
        if abs(rolled) < _LEAST_ROLL * math.hypot(length / 2 + side * x, y):
            allowed = "a first wheel of each unit that rolls when the unit bends a straight segment"
            raise InputError(f"geometry.wheels.{2 * unit}", (x, y, beta), allowed)
        sign = math.copysign(1.0, rolled)
        return sign * along, sign * across, side * x, y


@lru_cache(maxsize=BODIES)
def _bends_of_arc(arc: Arc) -> ca.Function:
    """(alpha, sigma) -> the twists, bendings and paces of both units, a column each."""
    segments = arc.geometry.segments
    alpha, sigma = ca.SX.sym("alpha", segments), ca.SX.sym("sigma", segments)
    bends = arc.written(alpha, ca.vertsplit(sigma))
    twists = ca.horzcat(*(ca.vertcat(*bend.twist) for bend in bends))
    bendings = ca.horzcat(*(ca.vertcat(*bend.bending) for bend in bends))
    paces = ca.horzcat(*(bend.pace for bend in bends))
    return ca.Function("bends", [alpha, sigma], [twists, bendings, paces])


def _along_link(twist: Twist, length_m: float) -> Twist:
    t, n, r = twist
    return t, n + r * length_m, r


def path_model(robot: Robot | Body) -> PathModel:
    """Build the path model that the robot description names.

    Raises:
        InputError: If v_j is to be the rolling speed of wheels that do not roll.
    """
    body = robot.body
    length, link = body.geometry.lengths_m[0], body.geometry.middle_link_m
    match body.path:
        case LogSpiralPath() as spiral:
            return LogSpiral(length, link, spiral)
        case CardioidPath() as cardioid:
            return Cardioid(link, cardioid)
        case ArcPath() as arc:
            return Arc(body.geometry, arc.speed_reference == "side_wheel")
        case other:
            raise NotImplementedError(f"path model {other.model}")
