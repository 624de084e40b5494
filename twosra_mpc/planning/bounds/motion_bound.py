r"""Least time that plans move, of any sequence of some modes.

Let S = p . (x, y) + V(phi, kappa), with V a trigonometric polynomial of degree K in the heading and
a polynomial in both curvatures. If S grows by at most 1 per second in each of the modes and in
every shape whose parts do not overlap, then every plan with these modes moves for at least what S
gains from start to goal: S is a subsolution of the Hamilton-Jacobi equation. And nothing moves
while metal melts or freezes: both add up, for sequences whose bends are a choice too, and for all
that begin alike.

Growth is linear in the speeds of the units, and of a rigid drive in its twist: it is largest at
the corners of what the limits allow. At a shape it is a trigonometric polynomial T of degree K in
the heading, so N > 2 K samples bound it everywhere: as T(phi + d) >= T(phi) cos(K d) around its
maximum (M. Riesz), abs(T) is at most their largest over cos(pi K / N). In a box of shapes the
motions are enclosed, and V is expanded about the middle, which is exact; what is not constant there
is bounded by the amplitudes of its waves.

Phases begin and end at rest. While wheels and units get to full speed, S grows by no more than what
they may do besides all other limits, as they speed up: until it may grow as fast as ever, a ramp
takes r. A plan that gains g so moves for g + min(g, r), however it is cut into phases.

The S that gains most at a number of shapes and headings is a linear program, to which what grows
too fast is added. Boxes in which it may grow much faster are halved then, and S is divided by what
is left of its growth.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.bounds.bends import BendingTask
from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.planning.bounds.pose_phases import PhaseMotions, PoseTask, corners
from twosra_mpc.problem.tolerances import BEYOND_PER_M
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, is_rigid

_TWO = 2  # segments
_DEGREE = 3  # of V in both curvatures together; more gains 2 % and takes four times as long
_TURNS = 2  # K
_HEADINGS = 64  # N
_SAMPLED = 4  # every so many of them is sampled by the linear program
_LARGEST_S = 100.0  # coefficients of V are smaller
_BOXES = 24  # of each curvature
_POINTS = 17  # of each, at which motions are sampled
_NEAR = 0.03  # of the largest curvature: how near to an allowed shape a sample is
_FIRST, _CUTS, _ROUNDS = 800, 250, 20  # rows: the first, those added, how often
_ENOUGH = 0.98  # share of what might be gained
_MANY, _IDLE = 1500, 0.7  # rows of which some are left out, and growth of those
_CLOSE, _HALVINGS, _MOST = 1.04, 5, 3000  # growth that is left, halvings, boxes to be halved
_FINE = 0.05  # rad, and of the largest curvature: boxes of the goal
_FIXED = 5  # unknowns before the coefficients of V
_EXACT = 1e-9  # allowance for rounding of motions, relative or in m/s
_ROUNDING = 1e-6  # of the bound

_TURN: Array = math.tau / _HEADINGS * np.arange(_HEADINGS, dtype=np.float64)
_WAVES = 2 * _TURNS + 1  # 1, cosines, sines
_POWERS = np.array([(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]).T


class _Shapes(NamedTuple):
    """Boxes of shapes: middles (m, 2), half-widths (2,), in terms of the largest curvatures."""

    middles: Array
    half: Array

    def halved(self) -> _Shapes:
        """Each as four."""
        aside = np.array([*itertools.product((-0.5, 0.5), repeat=_TWO)])[:, None] * self.half
        return _Shapes((self.middles + aside).reshape(-1, _TWO), self.half / 2)


class _Moves(NamedTuple):
    """Extreme motions in m boxes, as sums of those of w units; of two that are opposite, one.

    Attributes:
        units: (u, v, r, kappa) of each unit, (w, 5, m), for a pace of 1.
        off: How far off they may be, (w, 5, m).
        paces: In the middles, (w, m).
        tilt: How they change with shape, (2, w, m).
        spread: How far off that may be, (w, m).
        shares: Of the paces, in every motion, (k, w, m).
    """

    units: Array
    off: Array
    paces: Array
    tilt: Array
    spread: Array
    shares: Array


def least_motion_s(task: BendingTask, modes: Sequence[Mode]) -> float:
    """Lower bound on the time in which a plan with these modes moves [s]; 0 if none is known.

    Known of robots with two segments that drive no faster than some speed in any shape.
    """
    if task.pose is None or len(task.change) != _TWO:
        return 0.0
    program = _Program(task, task.pose, tuple(modes))
    return program.bound() if program.limited else 0.0


@dataclass(frozen=True, eq=False)
class _Program:
    """The linear program for p, split in two, the least V at the goal, and the coefficients of V.

    These are (waves, powers), the constant being 0.
    """

    task: BendingTask
    pose: PoseTask
    modes: Sequence[Mode]

    # --- Shapes, and how the robot moves in them

    @cached_property
    def most_per_m(self) -> Array:
        """The largest curvatures, (2,)."""
        rooms = zip(self.task.origin, self.task.room, strict=True)
        ends = zip(*([w + low, w + high] for w, (low, high) in rooms), strict=True)
        return np.abs([self.task.curvature(w) for w in ends]).max(axis=0) + BEYOND_PER_M

    def _grid(self, count: int, at: float) -> _Shapes:
        """So many boxes of each curvature, or points where ``at`` is 0, of what is allowed."""
        along = np.linspace(-1.0, 1.0, count) * (1 - at)
        middles = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, _TWO)
        return self._allowed(_Shapes(middles, np.full(_TWO, at or _NEAR)))

    def _allowed(self, shapes: _Shapes) -> _Shapes:
        most = self.most_per_m
        apart = ~self.pose.overlaps(shapes.middles * most, shapes.half * most)
        return shapes._replace(middles=shapes.middles[apart])

    @cached_property
    def shapes(self) -> _Shapes:
        """Boxes that hold all shapes within the limits."""
        return self._grid(_BOXES, 1 / _BOXES)

    @cached_property
    def drives(self) -> PhaseMotions | None:
        """Motions of rigid drives; None if nothing limits them."""
        most = tuple(self.most_per_m.tolist())
        return self.pose.rigid_phase(tuple(-k for k in most), most)

    @cached_property
    def limited(self) -> bool:
        """Whether motions are limited in every shape."""
        if self.drives is None:
            return False
        moves = (self._moves(mode, self.shapes) for mode in self.modes)
        return all(np.isfinite(part).all() for each in moves for part in each)

    def _moves(self, mode: Mode, shapes: _Shapes, starting: bool = False) -> _Moves:
        """Motions of a mode in boxes of shapes: as quickly as they may be, or as they start."""
        count = len(shapes.middles)
        if is_rigid(mode):
            assert self.drives is not None, "that is asked first"
            twists = ((starting and self.drives.starting) or self.drives).motions[:, :3]
            twists = twists[twists[:, 0] >= -_EXACT]  # without most opposites
            units = np.repeat(np.eye(3, 5)[..., None], count, axis=2)
            shares, paces = np.repeat(twists[..., None], count, axis=2), np.ones((3, count))
            still = np.zeros((_TWO, 3, count))
            return _Moves(units, 0 * units, paces, still, 0 * paces, shares)
        most, soft = self.most_per_m, np.flatnonzero(mode)
        around = (shapes.middles * most).T, shapes.half * most
        middle, ends = self.pose.changes(mode, *around)
        off = np.tensordot(around[1], np.abs(ends).max(axis=0), 1) + _EXACT * np.abs(middle)
        steep, wide = (ends[1] + ends[0])[:, :, 0] / 2, (ends[1] - ends[0])[:, :, 0] / 2
        spread = np.tensordot(around[1], wide, 1) + _EXACT * np.abs(middle[:, 0])
        turning = (
            np.maximum(side[:, :1], 0.0) * np.maximum(side[:, 4 + soft], 0.0)
            for side in (middle - off, middle + off)
        )
        quickest = self.pose.bend_rates_per_m_s[soft] * (math.inf if starting else 1.0)
        shares = corners(quickest, *turning)
        for each in (middle, off):
            each[:, 4:] /= most[:, None]
        tilt = np.broadcast_to(steep * most[:, None, None], (_TWO, 2, count))
        spread = np.broadcast_to(spread, (2, count))
        return _Moves(middle[:, 1:], off[:, 1:], middle[:, 0], tilt, spread, shares)

    # --- S, its growth and its gain

    def _slopes(self, x: Array, middles: Array) -> Array:
        """Taylor coefficients of slopes of V about shapes, by wave, (3, 4, 4, m, waves)."""
        v = np.einsum("abpm,wp->abmw", _taylor(middles), x[_FIXED:].reshape(_WAVES, -1))
        found, order = np.zeros((3, *v.shape)), np.arange(1, _DEGREE + 1)[:, None, None, None]
        found[0] = _turned(v)
        found[1, :-1], found[2, :, :-1] = order * v[1:], order[:, 0] * v[:, 1:]
        return found

    def _pose(self, x: Array, moves: Array) -> Array:
        """Growth of p . (x, y) by moves (..., 5, m), by wave, (..., m, waves)."""
        c, s = math.cos(self.pose.heading), math.sin(self.pose.heading)
        p, (u, v) = np.array([[c, s], [-s, c]]) @ (x[:2] - x[2:4]), np.moveaxis(moves, -2, 0)[:2]
        found = np.zeros((*u.shape, _WAVES))
        found[..., 1], found[..., 1 + _TURNS] = u * p[0] + v * p[1], u * p[1] - v * p[0]
        return found

    def growth(self, x: Array, mode: Mode, shapes: _Shapes, starting: bool = False) -> Array:
        """Proved growth of S in boxes of shapes, at every heading, (m,)."""
        units, off, paces, tilt, spread, shares = self._moves(mode, shapes, starting)
        charge(Cost.ENCLOSURE, shares.shape[0] * shares.shape[2] // 2)  # measured
        reach, higher = (_reach(shapes.half, _DEGREE + more) for more in (0, 1))
        slopes = self._slopes(x, shapes.middles)
        sizes = np.einsum("ab,iabm->im", reach, _amplitude(slopes))
        loose = np.hypot(*(x[:2] - x[2:4])) * np.hypot(off[:, 0], off[:, 1])
        loose += np.einsum("wim,im->wm", off[:, 2:], sizes)
        grows = np.einsum("wim,iabmf->wabmf", units[:, 2:], slopes)
        grows[:, 0, 0] += self._pose(x, units)
        quickest = np.abs(paces) + spread + np.tensordot(shapes.half, np.abs(tilt), 1)
        more = spread * np.einsum("ab,wabm->wm", reach, _amplitude(grows))
        more += (spread + quickest) * loose
        whole = np.zeros((len(units), _DEGREE + 2, _DEGREE + 2, *grows.shape[3:]))
        whole[:, :-1, :-1] = paces[:, None, None, :, None] * grows
        whole[:, 1:, :-1] += tilt[0][:, None, None, :, None] * grows
        whole[:, :-1, 1:] += tilt[1][:, None, None, :, None] * grows
        most = np.zeros(len(shapes.middles))
        for share in shares:
            each = np.einsum("wm,wabmf->abmf", share, whole)
            here = np.abs(each[0, 0] @ _waves(_TURN)).max(axis=1)
            each[0, 0] = 0.0
            bound = here / math.cos(math.pi * _TURNS / _HEADINGS)
            bound += np.tensordot(higher, _amplitude(each)) + (np.abs(share) * more).sum(axis=0)
            most = np.maximum(most, bound)
        return most

    @cached_property
    def goal(self) -> tuple[Array, Array, Array]:
        """Boxes that hold headings and shapes of the goal: middles (m,), (m, 2), halves (3,)."""
        around, most = self.pose.turn_reach, self.most_per_m.tolist()
        ends = [(self.pose.turn - around, self.pose.turn + around)]
        for asked, k in zip(self.task.goal, most, strict=True):
            ends.append((-1.0, 1.0) if asked is None else (asked[0] / k, asked[1] / k))
        edges = [np.linspace(*each, 2 + int((each[1] - each[0]) / _FINE)) for each in ends]
        grid = np.meshgrid(*((at[1:] + at[:-1]) / 2 for at in edges), indexing="ij")
        heading, *shapes = (axis.ravel() for axis in grid)
        return (
            heading,
            np.stack(shapes, axis=-1),
            np.array([(at[1] - at[0]) / 2 for at in edges]),
        )

    def gain(self, x: Array) -> float:
        """Proved least gain of S from start to goal."""
        headings, middles, half = self.goal
        v = np.einsum("abpm,wp->abmw", _taylor(middles), x[_FIXED:].reshape(_WAVES, -1))
        waves, reach = _waves(headings), _reach(half[1:], _DEGREE)
        here = (v[0, 0] * waves.T).sum(axis=1)
        off = half[0] * _amplitude(_turned(v[0, 0]))
        v[0, 0] = 0.0
        off += np.tensordot(reach, _amplitude(v))
        least, rest = float((here - off).min()), self.objective * x
        return least + float(rest.sum() - rest[_FIXED - 1])

    # --- The linear program

    @cached_property
    def objective(self) -> Array:
        """Gain of S of the unknowns."""
        given = np.isfinite(self.pose.reach)
        along, reach = (np.where(given, each, 0.0) for each in (self.pose.shift, self.pose.reach))
        before = self._rise(np.zeros(1), np.array([self.task.start]) / self.most_per_m)[0]
        return np.concatenate([along - reach, -along - reach, [1.0], -before])

    @staticmethod
    def _rise(headings: Array, middles: Array) -> Array:
        """V of every coefficient at headings and in shapes, (m, coefficients)."""
        values = np.einsum("wm,pm->mwp", _waves(headings), _taylor(middles)[0, 0])
        return np.asarray(values.reshape(len(middles), -1))

    def bound(self) -> float:
        """Lower bound on the time in which a plan moves [s]."""
        x = self._solved()
        if x is None or (gain := self.gain(x)) <= 0.0:
            return 0.0
        most = max(self._grows(x, mode) for mode in self.modes)
        ramp_s = min(self._ramp_s(x, mode, most) for mode in self.modes)
        return (gain / most + min(ramp_s, gain / most)) * (1 - _ROUNDING)

    def _ramp_s(self, x: Array, mode: Mode, most: float) -> float:
        """Least time from rest until S grows as fast as it ever does, in a phase of a mode [s]."""
        starts = float(self.growth(x, mode, self.shapes, starting=True).max(initial=0.0))
        assert self.drives is not None, "that is asked first"
        full_s = self.drives.ramp_s if is_rigid(mode) else self.pose.ramp_s
        return full_s * most / max(starts, most)

    def _solved(self) -> Array | None:
        """The S that gains most where it is sampled; None if the solver gives up."""
        headings = _TURN[::_SAMPLED]
        points = self._grid(_POINTS, 0.0)._replace(half=np.zeros(_TWO))
        each = [self._moves(mode, points) for mode in self.modes]
        moves = np.concatenate(
            [np.einsum("kwm,wm,wcm->kcm", one.shares, one.paces, one.units) for one in each]
        )
        rise = self._rise(*self.goal[:2])
        at_goal = np.column_stack([np.zeros((len(rise), 4)), np.ones(len(rise)), -rise])
        size = len(moves), len(points.middles), len(headings)
        added = np.arange(0, math.prod(size), max(1, math.prod(size) // _FIRST))
        signs, rows = np.where(np.arange(len(added)) % 2, 1.0, -1.0), at_goal[:0]
        inside, found = np.zeros(len(self.objective)), False
        for _ in range(_ROUNDS):
            k, m, n = np.unravel_index(added, size)
            new = self._rows(moves[k, :, m], headings[n], points.middles[m])
            rows = np.concatenate([rows, signs[:, None] * new])
            if (outside := self._best(rows, at_goal)) is None:
                break
            x = (inside + outside) / 2
            slopes = self._slopes(x, points.middles)[:, 0, 0]
            grows = self._pose(x, moves) + np.einsum("kim,imf->kmf", moves[:, 2:], slopes)
            grows = grows @ _waves(headings)
            worst = np.abs(grows).argmax(axis=0)
            most = np.take_along_axis(grows, worst[None], axis=0)[0].ravel()
            order = np.argsort(-np.abs(most))[:_CUTS]
            grown = x / max(abs(most[order[0]]), 0.5)
            if self.objective @ grown > self.objective @ inside:
                inside, found = grown, True
            if self.objective @ inside > _ENOUGH * (self.objective @ outside):
                break
            rows = rows[rows @ outside > _IDLE] if len(rows) > _MANY else rows
            signs, added = np.sign(most[order]), worst.ravel()[order] * most.size + order
        return inside if found else None

    def _best(self, rows: Array, at_goal: Array) -> Array | None:
        """The x that gains most and grows by at most 1 in these rows; None if none is found."""
        limits = np.append(np.ones(len(rows)), np.zeros(len(at_goal)))
        most = np.where(np.tile(np.isfinite(self.pose.reach), 2), np.inf, 0.0)
        bounds = [*((0.0, float(end)) for end in most), (None, None), (0.0, 0.0)]
        bounds += [(-_LARGEST_S, _LARGEST_S)] * (len(self.objective) - len(bounds))
        try:
            found = minimise(-self.objective, np.vstack([rows, at_goal]), limits, bounds)
        except ArithmeticError:
            return None
        return None if found is None else found.x

    def _rows(self, moves: Array, headings: Array, middles: Array) -> Array:
        """Growth of all unknowns by motions (m, 5), at headings and in shapes, (m, unknowns)."""
        waves, powers = _waves(headings), _taylor(middles)
        c, s = np.cos(self.pose.heading + headings), np.sin(self.pose.heading + headings)
        u, v, r, *bend = moves.T
        x, y = c * u - s * v, s * u + c * v
        turning = np.einsum("wm,pm->mwp", r * _turning(headings), powers[0, 0])
        bending = np.einsum("wm,pm->mwp", waves, bend[0] * powers[1, 0] + bend[1] * powers[0, 1])
        grows = (turning + bending).reshape(len(moves), -1)
        return np.column_stack([x, y, -x, -y, np.zeros(len(x)), grows])

    def _grows(self, x: Array, mode: Mode) -> float:
        """Proved growth of S in a mode; boxes are halved where it may be much more than 1."""
        shapes, largest = self.shapes, 1.0
        for halving in range(_HALVINGS + 1):
            if not len(shapes.middles):
                break
            each = self.growth(x, mode, shapes)
            halve = each > _CLOSE
            if halving == _HALVINGS or halve.sum() > _MOST:
                halve[:] = False
            largest = max(largest, float(each[~halve].max(initial=0.0)))
            shapes = self._allowed(shapes._replace(middles=shapes.middles[halve]).halved())
        return largest


def _waves(headings: Array) -> Array:
    """Waves at headings from the start's, (waves, m)."""
    turns = np.arange(1, _TURNS + 1)[:, None] * headings
    return np.concatenate([np.ones((1, len(headings))), np.cos(turns), np.sin(turns)])


def _turning(headings: Array) -> Array:
    """Slopes of the waves, (waves, m)."""
    return _turned(np.eye(_WAVES)) @ _waves(headings)


def _turned(v: Array) -> Array:
    """Slopes in the heading, by wave, of what is told by wave, (..., waves)."""
    cosines, sines = v[..., 1 : _TURNS + 1], v[..., _TURNS + 1 :]
    turns = np.arange(1, _TURNS + 1)
    return np.concatenate([0 * v[..., :1], turns * sines, -turns * cosines], axis=-1)


def _amplitude(v: Array) -> Array:
    """Bound of what is told by wave, (..., waves), at every heading."""
    most = np.hypot(v[..., 1 : _TURNS + 1], v[..., _TURNS + 1 :]).sum(axis=-1)
    return np.asarray(np.abs(v[..., 0]) + most)


def _taylor(middles: Array) -> Array:
    """Taylor coefficients of the powers about shapes, (4, 4, powers, m)."""
    order = np.arange(_DEGREE + 1)
    choose = np.array([[math.comb(i, a) for i in order] for a in order])
    drop = np.maximum(order - order[:, None], 0)
    first, last = (
        (choose[..., None] * axis ** drop[..., None])[:, power]
        for axis, power in zip(middles.T, _POWERS, strict=True)
    )
    return np.asarray(first[:, None] * last[None])


def _reach(half: Array, degree: int) -> Array:
    """Largest powers of what is within half-widths (2,), up to a degree in each."""
    first, last = half[:, None] ** np.arange(degree + 1)
    return np.outer(first, last)
