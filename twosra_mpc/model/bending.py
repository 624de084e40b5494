"""Facts about bending that planning needs as numbers: invariant coordinates and fastest rates.

W_j(kappa) is the *bending coordinate* of segment j: the integral of 1 / g_j from 0 to kappa l_j,
with g_j the path model's ``share``. In a soft mode the W of all soft segments change by the same
amount, so their differences are conserved, and the W of rigid segments rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.path_models import path_model
from twosra_mpc.model.rows import by_rows
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Body
from twosra_mpc.robot.modes import Mode, soft_segments

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
# Edges of the quadrature's panels [rad]; fine at 0, where spirals bend.
_PANELS = np.array([0.0, 0.02, 0.1, 0.5, 1.5, 4.0, 8.0, math.inf])
_TABLE = 2001  # points of the table that inverts W


@per_body(256)
def bending_coordinate(body: Body, segment: int, kappa: float) -> float:
    """W of a segment (from 0) at a curvature [1/m]."""
    return float(bending_coordinates(body, segment, np.array([kappa]))[0])


def bending_coordinates(body: Body, segment: int, kappa: Array) -> Array:
    """W of a segment (from 0) at curvatures (m,) [1/m]."""
    edges = np.minimum(_PANELS, np.abs(kappa)[:, None] * body.geometry.lengths_m[segment])
    half = np.diff(edges)[..., None] / 2
    points = edges[:, :-1, None] + half * (1 + _NODES)
    values, used = np.zeros(points.shape), half[..., 0] > 0
    (values[used],) = by_rows(_density(body, segment), points[used])
    parts = half * _WEIGHTS * values
    return np.sign(kappa) * parts.sum(axis=(1, 2))


@per_body(4)
def _density(body: Body, segment: int) -> ca.Function:
    """1 / g at as many bends of a segment [rad] as a panel has nodes."""
    alpha = ca.SX.sym("alpha", len(_NODES))
    shares = [path_model(body).share(segment, each) for each in ca.vertsplit(alpha)]
    return ca.Function("density", [alpha], [ca.densify(1 / ca.vertcat(*shares))])


@per_body(4)
def inverse_table(body: Body, segment: int) -> tuple[Array, Array]:
    """A grid of curvatures a little beyond the limits, and W there."""
    limit, length = 1.01 * body.limits.curvature_per_m, body.geometry.lengths_m[segment]
    half = np.linspace(0.0, limit, _TABLE // 2 + 1)
    widths = np.diff(half) * length
    points = half[:-1, None] * length + widths[:, None] / 2 * (1 + _NODES)
    (values,) = by_rows(_density(body, segment), points)
    cumulative = np.concatenate([[0.0], np.cumsum(values @ _WEIGHTS * widths / 2)])
    kappa = np.concatenate([-half[:0:-1], half])
    return kappa, np.concatenate([-cumulative[:0:-1], cumulative])


class Inverse(NamedTuple):
    """W -> kappa: cubic in every cell of a table, clipped at its ends.

    Attributes:
        table: W at the ends of the cells, (m + 1,).
        powers: Factors of the powers of what W is beyond a cell's lower end, cubic first, (4, m).
    """

    table: Array
    powers: Array

    def __call__(self, coordinates: Array) -> Array:
        """Curvatures [1/m] with these W."""
        table, powers = self
        w = np.minimum(np.maximum(coordinates, table[0]), table[-1])
        cell = np.searchsorted(table[1:-1], w, side="right")
        beyond, (cubic, square, slope, value) = w - table[cell], powers[:, cell]
        return ((cubic * beyond + square) * beyond + slope) * beyond + value


@per_body(4)
def inverse(body: Body, segment: int) -> Inverse:
    """Hermite's interpolation of the table, with the slope dkappa / dW = g / l at its points."""
    kappa, table = inverse_table(body, segment)
    length = body.geometry.lengths_m[segment]
    points = np.resize(kappa * length, (math.ceil(len(kappa) / len(_NODES)), len(_NODES)))
    slopes = 1 / (length * by_rows(_density(body, segment), points)[0].ravel()[: len(kappa)])
    widths = np.diff(table)
    secants = np.diff(kappa) / widths
    bent = (slopes[:-1] + slopes[1:] - 2 * secants) / widths
    square = (secants - slopes[:-1]) / widths - bent
    return Inverse(table, np.array([bent / widths, square, slopes[:-1], kappa[:-1]]))


Intervals = Sequence[tuple[float, float]]
Known = tuple[tuple[float, float] | None, ...]  # (low, high) of each curvature [1/m], or anything

_BOXES = (1, 200, 40, 14, 7)  # boxes per curvature range, by number of unknown curvatures
_KNOWN_PER_M = 1e-4  # wider ranges count as unknown
_MOVES = 1e-5  # of W: plans may leave out what is less, and still end at the goal
_INVERSE_RAD = 1e-8  # more than the error of the inverse of W
# More than the error of W, of the largest W: 1 / g is analytic but at +- i smoothing_rad, where
# spirals bend. On the panel next to it 24 points err by rho^-48 (1e-22 where it is 0.01 rad) of
# what is not analytic, which fades with smoothing_rad: 2e-12 at worst. Elsewhere it is rounding.
_QUADRATURE = 1e-11
_PIECES = 40  # pieces of a bend whose least time is proved
_ENDS = np.linspace(0.0, 1.0, _PIECES + 1)  # theirs, as shares of the bend


@dataclass(frozen=True)
class Bending:
    """Bending coordinates of a robot, and proved bounds on how fast they can change."""

    body: Body

    def coordinate(self, kappa: float, segment: int = 0) -> float:
        """W_j(kappa), odd and increasing; unit [m] for spirals and cardioids, [rad] for arcs."""
        return bending_coordinate(self.body, segment, kappa)

    def coordinates(self, kappa: ArrayLike) -> Array:
        """W of every segment in one shape or several, from the curvatures (n,) or (m, n) [1/m]."""
        shapes = np.asarray(kappa, dtype=float)
        of_segments = np.atleast_2d(shapes).T
        found = [bending_coordinates(self.body, j, each) for j, each in enumerate(of_segments)]
        return np.stack(found, axis=-1).reshape(shapes.shape)

    def curvature(self, coordinates: Array | float, segment: int = 0) -> Array:
        """Inverse of ``coordinate``, interpolated to 1e-9 rad; clipped just beyond the limits."""
        return inverse(self.body, segment)(np.asarray(coordinates))

    def curvatures(self, coordinates: Sequence[float]) -> tuple[float, ...]:
        """Curvatures of all segments [1/m] from their W."""
        return tuple(float(self.curvature(w, j)) for j, w in enumerate(coordinates))

    def fastest(self, mode: Mode, kappa: Known) -> float:
        """Upper bound of abs(dW/dt) of soft segments with both locomotion units at full speed.

        ``kappa`` holds (low, high) of a segment's curvature [1/m]; None lets it be anything within
        the limits.
        """
        return _fastest(self.body, mode, kappa)

    def least_time(self, mode: Mode, origin: Intervals, bend: float) -> float:
        """Lower bound on the time in which ``mode`` changes W by at least ``bend``, rest to rest.

        Whatever the path, W passes every value in between, each at no more than the fastest rate
        there; so the sum over pieces of abs(dW) / (enclosed rate) is a lower bound, which the ramps
        up to full speed and down to rest raise. No segment bends faster than its limit either, and
        no phase that moves is shorter than its limit.

        Args:
            mode: A soft mode.
            origin: Bounds of the W of every segment before.
            bend: Least change of W, with its sign.
        """
        low, high = zip(*origin, strict=True)
        limits, turned = self.body.limits, [0.0]
        for j in soft_segments(mode):
            ends = (low[j] + bend, high[j]) if bend > 0 else (low[j], high[j] + bend)
            least = float(np.subtract(*self.curvature(np.array(ends), j)))
            turned.append(least * self.body.geometry.lengths_m[j] - _INVERSE_RAD)
        steady = max(turned) / (limits.bend_rate_rad_s or math.inf)
        shortest = limits.phase_s if abs(bend) > _MOVES else 0.0
        return max(_by_speed_s(self.body, mode, tuple(origin), bend), steady, shortest)

    def least_time_of_more(
        self, mode: Mode, origin: Intervals, bend: float, most: float
    ) -> tuple[float, float]:
        """Lower bound on the time of every bend d from ``bend`` to ``most``, as a line.

        What goes beyond ``bend`` takes a second for what the fastest rate there bends, at least.

        Args:
            mode: A soft mode.
            origin: Bounds of the W of every segment before.
            bend: Least change of W, with its sign.
            most: Largest change of W, with the same sign.

        Returns:
            (a, b), the bound being a + b abs(d - bend) [s].
        """
        low, high = zip(*origin, strict=True)
        ends = (_along(mode, end, bend, most) for end in (low, high))
        rate = float(_largest_rate(self.body, mode, *_boxes(self.body, *ends)).max())
        return _by_speed_s(self.body, mode, tuple(origin), bend), 1 / rate

    def least_effort_s2(self, mode: Mode, origin: Intervals, bend: float) -> float:
        """Lower bound on effort times duration of such a bend [s2]; 0 where no wheel rolls v_j.

        Else wheels of radius R turn at v_j / R. With p_j the bend dW per travel of unit j,
        abs(dW/dt) <= |p| |v|, so the effort is at least the integral of
        (dW/dt / (|p| R omega_max))^2. By Cauchy and Schwarz, that times the duration is at least
        the square of the integral of abs(dW) / (|p| R omega_max), which is bounded by pieces as
        in ``least_time``.

        Args:
            mode: A soft mode.
            origin: Bounds of the W of every segment before.
            bend: Least change of W, with its sign.
        """
        if not path_model(self.body).rolls_v:
            return 0.0
        low, high = zip(*origin, strict=True)
        boxes = _boxes(self.body, _along(mode, low, 0.0, bend), _along(mode, high, 0.0, bend))
        paces = np.hypot(*_largest_paces(self.body, mode, *boxes))
        full_m_s = self.body.limits.wheel_speed_rad_s * self.body.geometry.wheel_radius_m
        return float(np.sum(_surely(self.body, mode, bend) / _PIECES / (paces * full_m_s))) ** 2

    def shapes_on_the_way(
        self, mode: Mode, origin: Intervals, bend: float, begin: float = 0.0
    ) -> tuple[Array, Array]:
        """Shapes that every such bend passes, and how far off they may be, (m, n) and (n,) [1/m].

        Args:
            mode: A soft mode.
            origin: Bounds of the W of every segment before.
            bend: Change of W, with its sign.
            begin: From where on the way to look, as a change of W.
        """
        low, high = zip(*origin, strict=True)
        ends = zip(_along(mode, low, begin, bend), _along(mode, high, begin, bend), strict=True)
        both = [self.curvature(np.array(w), j) for j, w in enumerate(ends)]
        least, most = np.stack(both, axis=-1)
        return (least + most) / 2, ((most - least) / 2).max(axis=0)

    def motions_between(self, mode: Mode, low: Array, high: Array) -> tuple[Array, Array]:
        """Enclose what each locomotion unit at full speed does to the robot in boxes of W.

        Args:
            mode: A soft mode.
            low: Least W of every segment in each box, (n, m).
            high: Largest.

        Returns:
            Lower and upper bounds in each box, each (2, 4 + n, m): for LU1 and LU2 b0's twist
            (u, v, r) [m/s, m/s, rad/s], dW/dt and the rate of every curvature [1/m/s].
        """
        boxes = _corners(self.body, low, high)
        twists = enclose(_twists(self.body, mode), *boxes)
        rates = enclose(_rates(self.body, mode), *boxes)
        speed = _unit_speed(self.body)
        least, most = (
            speed * np.insert(twist.reshape(2, -1, twist.shape[-1]), POSE, rate, axis=1)
            for twist, rate in zip(twists, rates, strict=True)
        )
        return least, most

    def changes_around(self, mode: Mode, kappa: Array, half: Array) -> tuple[Array, Array]:
        """What each locomotion unit at full speed does to the robot in boxes of shapes.

        Args:
            mode: A soft mode.
            kappa: Middles of the boxes, (n, m) [1/m].
            half: Their half-widths, (n,) [1/m].

        Returns:
            In the middles (2, 4 + n, m), for LU1 and LU2: dW/dt, then b0's twist (u, v, r) and the
            change of all curvatures per dW; and bounds of their slopes, (2, n, 2, 4 + n, m).
        """
        changes, slopes = _changes(self.body, mode)
        middle, ends = by_rows(changes, kappa.T)[0].T, np.zeros((2, len(half), 2, 4 + len(half), 1))
        if half.any():
            bounds = enclose(slopes, kappa - half[:, None], kappa + half[:, None])
            ends = np.reshape(bounds, (2, len(half), 2, -1, kappa.shape[1]))
        here, speed = middle.reshape(2, -1, kappa.shape[1]), _unit_speed(self.body)
        here[:, 0], ends[..., 0, :] = speed * here[:, 0], speed * ends[..., 0, :]
        return here, ends

    def largest_speed_m_s(self, mode: Mode) -> float:
        """Upper bound of the speed of b0 in a soft mode, both locomotion units at full speed."""
        return _largest_speed(self.body, mode)


def from_rest_to_rest(at_speed_s: float, ramp_s: float) -> float:
    """Least time of what takes ``at_speed_s`` at full speed, which takes ``ramp_s`` to reach.

    The speed is at most min(1, t / ramp, (T - t) / ramp) of full speed; its integral is at_speed_s.
    """
    if at_speed_s >= ramp_s:
        return at_speed_s + ramp_s
    return 2 * math.sqrt(at_speed_s * ramp_s)


def _along(mode: Mode, origin: Sequence[float], begin: float, end: float) -> list[Array]:
    """W of every segment while a bend goes from ``begin`` to ``end``."""
    pieces = begin + (end - begin) * _ENDS
    return [w + soft * pieces for w, soft in zip(origin, mode, strict=True)]


def _boxes(body: Body, low: list[Array], high: list[Array]) -> tuple[Array, Array]:
    """Lower and upper corners of boxes of curvatures between neighbouring W, each (n, m).

    Args:
        body: The robot.
        low: Least W of each segment at the ends of the boxes, (m + 1,).
        high: Largest W there.
    """
    least, most = _corners(body, low, high)
    return np.minimum(least[:, :-1], least[:, 1:]), np.maximum(most[:, :-1], most[:, 1:])


def _corners(body: Body, low: Iterable[Array], high: Iterable[Array]) -> tuple[Array, Array]:
    """Curvatures surely no larger than with W ``low``, and no less than with ``high``: neighbours.

    On the grid of the inverse of W.
    """
    grids = [inverse_table(body, j) for j in range(body.geometry.segments)]
    least = [k[np.searchsorted(at[1:-1], w)] for w, (k, at) in zip(low, grids, strict=True)]
    most = [k[np.searchsorted(at[1:-1], w) + 1] for w, (k, at) in zip(high, grids, strict=True)]
    return np.array(least), np.array(most)


def _surely(body: Body, mode: Mode, bend: float) -> float:
    """Size of a change of W less what may be wrong with it, which follows from up to four W."""
    return max(0.0, abs(bend) - 4 * _QUADRATURE * _largest_coordinate(body, mode))


@per_body(8)
def _largest_coordinate(body: Body, mode: Mode) -> float:
    """Largest W of the soft segments within the curvature limit."""
    limit = body.limits.curvature_per_m
    return max(bending_coordinate(body, j, limit) for j in soft_segments(mode))


@per_body(16)  # a bend is asked for more than once while its problem is planned
def _by_speed_s(
    body: Body, mode: Mode, origin: tuple[tuple[float, float], ...], bend: float
) -> float:
    """Lower bound on the time of a bend by what the units' speeds allow [s]."""
    low, high = zip(*origin, strict=True)
    boxes = _boxes(body, _along(mode, low, 0.0, bend), _along(mode, high, 0.0, bend))
    rates = _largest_rate(body, mode, *boxes)
    at_speed = float(np.sum(_surely(body, mode, bend) / _PIECES / rates))
    return from_rest_to_rest(at_speed, unit_ramp_s(body))


@per_body()
def bending(body: Body) -> Bending:
    """Describe how a robot bends."""
    return Bending(body)


@per_body(8)
def _rates(body: Body, mode: Mode) -> ca.Function:
    """Kappa (n,) -> dW/ds of the soft segments per travel of LU1 and of LU2."""
    lengths = body.geometry.lengths_m
    kappa = ca.SX.sym("kappa", len(lengths))
    alpha = ca.vertcat(*(kappa[j] * length for j, length in enumerate(lengths)))
    paces = [bend.pace for bend in path_model(body).bends(alpha, mode)]
    return ca.Function("rates", [kappa], [ca.densify(ca.vertcat(*paces))])


def _largest_rate(body: Body, mode: Mode, lower: Array, upper: Array) -> Array:
    """Enclosed maximum of abs(dW/dt) in each box of curvatures, both units at full speed."""
    return _largest_paces(body, mode, lower, upper).sum(axis=0) * _unit_speed(body)


def _largest_paces(body: Body, mode: Mode, lower: Array, upper: Array) -> Array:
    """Enclosed maximum of abs(dW/ds) in each box, per travel of LU1 and of LU2, (2, m)."""
    low, high = enclose(_rates(body, mode), lower, upper)
    per_travel = np.maximum(np.abs(low), np.abs(high))
    return np.where(np.isnan(per_travel), np.inf, per_travel)


@per_body(8)
def _twists(body: Body, mode: Mode) -> ca.Function:
    """Kappa (n,) -> (u, v, r) of b0 and kappa per travel of LU1 and of LU2, (2 (3 + n),)."""
    kappa = ca.SX.sym("kappa", body.geometry.segments)
    jacobian = kinematics(body).jacobian(ca.vertcat(0, 0, 0, kappa), mode)
    stacked = ca.vertcat(jacobian[:, 0], jacobian[:, 1])
    return ca.Function("twists", [kappa], [ca.densify(stacked)])


@per_body(8)
def _changes(body: Body, mode: Mode) -> tuple[ca.Function, ca.Function]:
    """Kappa (n,) -> dW/ds and (u, v, r, kappa) per dW by LU1, by LU2; and their slopes."""
    lengths = ca.DM(body.geometry.lengths_m)
    kappa, told = ca.SX.sym("kappa", body.geometry.segments), list[ca.SX]()
    for bend in path_model(body).bends(kappa * lengths, mode):
        bent = ca.vertcat(*bend.bending) / lengths
        told += [bend.pace, *(each / bend.pace for each in (*bend.twist, *ca.vertsplit(bent)))]
    stacked = ca.densify(ca.vertcat(*told))
    steep = ca.densify(ca.vec(ca.jacobian(stacked, kappa)))
    return ca.Function("changes", [kappa], [stacked]), ca.Function("slopes", [kappa], [steep])


@per_body()
def _unit_speed(body: Body) -> float:
    """Full speed of a locomotion unit [m/s]."""
    speed = body.limits.unit_speed_m_s
    if path_model(body).wheel_map == "paper":  # there a side wheel rolls as far as its unit goes
        return min(speed, body.limits.wheel_speed_rad_s * body.geometry.wheel_radius_m)
    return speed


@per_body()
def unit_ramp_s(body: Body) -> float:
    """Least time in which a locomotion unit gets from rest to full speed [s]; 0: it is not known.

    It is where v_j is what the side wheel of unit j rolls.
    """
    most = body.limits.wheel_acceleration_rad_s2
    if most is None or not path_model(body).rolls_v:
        return 0.0
    return _unit_speed(body) / (body.geometry.wheel_radius_m * most)


@per_body(128)
def _fastest(body: Body, mode: Mode, kappa: Known) -> float:
    return float(_largest_rate(body, mode, *_grid(body, kappa)).max())


@per_body(8)
def _largest_speed(body: Body, mode: Mode) -> float:
    with np.errstate(invalid="ignore"):  # wide boxes may hold shapes of unbounded speed
        low, high = enclose(_twists(body, mode), *_grid(body, (None,) * len(mode)))
    most = np.maximum(np.abs(low), np.abs(high)).reshape(2, POSE + len(mode), -1)
    speed = np.hypot(most[:, 0], most[:, 1]).sum(axis=0) * _unit_speed(body)
    return float(np.where(np.isnan(speed), np.inf, speed).max())


def _grid(body: Body, kappa: Known) -> tuple[Array, Array]:
    """Lower and upper corners of boxes that hold all curvatures allowed, each (n, boxes)."""
    limit = body.limits.curvature_per_m
    ranges = [(-limit, limit) if one is None else one for one in kappa]
    boxes = _BOXES[sum(high - low > _KNOWN_PER_M for low, high in ranges)]
    edges = [
        np.linspace(low, high, max(1, math.ceil(boxes * (high - low) / (2 * limit))) + 1)
        for low, high in ranges
    ]
    lower, upper = (
        np.array(list(itertools.product(*(edge[part] for edge in edges)))).T
        for part in (slice(None, -1), slice(1, None))
    )
    return lower, upper
