r"""Least time that every plan moves, whatever its mode sequence.

Let S = p . (x, y) + V(phi, kappa), with V a trigonometric polynomial of degree K in the heading and
a polynomial in the curvatures. If S grows by at most 1 per second in every mode and in every shape
whose parts do not overlap, then every plan moves for at least what S gains from start to goal. And
nothing moves while metal melts or freezes: both add up, for sequences whose bends are a choice too,
and for all that begin alike.

Growth is linear in the speeds of the units, and of a rigid drive in its twist: it is largest at
the corners of what the limits allow. At a shape it is a trigonometric polynomial T of degree K in
the heading, so N > 2 K samples bound it everywhere: as T(phi + d) >= T(phi) cos(K d) around its
maximum (M. Riesz), abs(T) is at most their largest over cos(pi K / N). In a box of shapes the
motions are enclosed, and V is expanded about the middle, which is exact.

The S that gains most at a number of shapes and headings is a linear program, to which what grows
too fast is added. Boxes in which it may grow much faster are halved then, and S is divided by what
is left of its growth.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.bounds.bends import BendingTask
from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.planning.bounds.pose_phases import PoseTask
from twosra_mpc.problem.tolerances import BEYOND_PER_M
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, is_rigid

_TWO = 2  # segments
_DEGREE = 3  # of V in both curvatures together; more gains 2 % and takes four times as long
_TURNS = 2  # K
_HEADINGS = 32  # N
_SAMPLED = 2  # every so many of them is sampled by the linear program
_LARGEST = 100.0  # s: coefficients of V are smaller
_BOXES = 24  # of each curvature
_POINTS = 17  # of each, at which motions are sampled
_NEAR = 0.03  # of the largest curvature: how near to an allowed shape a sample is
_FIRST, _CUTS, _ROUNDS = 800, 250, 20  # rows: the first, those added, how often
_ENOUGH = 0.98  # share of what might be gained
_MANY, _IDLE = 1500, 0.7  # rows of which some are left out, and growth of those
_CLOSE, _HALVINGS, _MOST = 1.04, 5, 3000  # growth that is left, halvings, boxes to be halved
_AT_ONCE = 200  # boxes, so that no array is large
_FINE = 0.05  # rad, and of the largest curvature: boxes of the goal
_FIXED = 5  # unknowns before the coefficients of V
_HASTE = 2.0  # by how much more S grows than allowed while units get up to speed
_EXACT = 1e-9  # relative allowance for rounding, of motions
_ROUNDING = 1e-6  # of the bound


class _Shapes(NamedTuple):
    """Boxes of shapes: middles (m, 2), half-widths (2,), in terms of the largest curvatures."""

    middles: Array
    half: Array

    def halved(self) -> _Shapes:
        """Each as four."""
        aside = np.array([*itertools.product((-0.5, 0.5), repeat=_TWO)])[:, None] * self.half
        return _Shapes((self.middles + aside).reshape(-1, _TWO), self.half / 2)


class _Moves(NamedTuple):
    """Extreme motions in m boxes, as sums of those of w units.

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
    """The linear program for p, split in two, the least V at the goal, and the coefficients of V."""

    task: BendingTask
    pose: PoseTask
    modes: Sequence[Mode]

    # --- Shapes, and how the robot moves in them

    @cached_property
    def most_per_m(self) -> Array:
        """The largest curvatures, (2,)."""
        ends = [
            [w + at for w, at in zip(self.task.origin, each, strict=True)]
            for each in zip(*self.task.room, strict=True)
        ]
        return np.abs([self.task.curvature(w) for w in ends]).max(axis=0) + BEYOND_PER_M

    @cached_property
    def shapes(self) -> _Shapes:
        """Boxes that hold all shapes within the limits."""
        at = (np.arange(_BOXES) + 0.5) * 2 / _BOXES - 1
        middles = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, _TWO)
        return self._allowed(_Shapes(middles, np.full(_TWO, 1 / _BOXES)))

    def _allowed(self, shapes: _Shapes) -> _Shapes:
        most = self.most_per_m
        apart = ~self.pose.overlaps(shapes.middles * most, shapes.half * most)
        return shapes._replace(middles=shapes.middles[apart])

    @cached_property
    def twists(self) -> Array | None:
        """Extreme twists of rigid drives, one of each pair; None if nothing limits them."""
        most = tuple(self.most_per_m.tolist())
        found = self.pose.rigid_phase(tuple(-k for k in most), most)
        return None if found is None else found.motions[found.motions[:, 0] >= 0, :3]

    @cached_property
    def limited(self) -> bool:
        """Whether motions are limited in every shape."""
        if self.twists is None:
            return False
        moves = (self._moves(mode, self.shapes) for mode in self.modes)
        return all(np.isfinite(part).all() for each in moves for part in each)

    def _moves(self, mode: Mode, shapes: _Shapes) -> _Moves:
        """Motions of a mode in boxes of shapes; of two extreme ones that are opposite, one.

        Those of both units, as far as bends are allowed to be so quick; and a share of all they can,
        which bounds how S grows while they get up to speed.
        """
        count = len(shapes.middles)
        if is_rigid(mode):
            assert self.twists is not None, "that is asked first"
            units = np.repeat(np.eye(3, 5)[..., None], count, axis=2)
            shares, full = np.repeat(self.twists[..., None], count, axis=2), np.ones((3, count))
            still = np.zeros((_TWO, 3, count))
            return _Moves(units, 0 * units, full, still, 0 * full, shares)
        most, soft = self.most_per_m, np.flatnonzero(mode)
        around = (shapes.middles * most).T, shapes.half * most
        middle, ends = self.pose.changes(mode, *around)
        off = np.tensordot(around[1], np.abs(ends).max(axis=0), 1) + _EXACT * np.abs(middle)
        steep, wide = (ends[1] + ends[0])[:, :, 0] / 2, (ends[1] - ends[0])[:, :, 0] / 2
        spread = np.tensordot(around[1], wide, 1) + _EXACT * np.abs(middle[:, 0])
        least = middle - off
        rates = np.maximum(least[:, :1] * least[:, 4 + soft], 1e-300)
        quickest = self.pose.bend_rates_per_m_s[soft, None]
        first, last = (
            np.clip(((quickest - other) / own).min(axis=0), -1.0, 1.0)
            for own, other in (rates, rates[::-1])
        )
        full = np.ones(count)
        shares = np.array([[first, full], [full, last], [full, -full], [full / _HASTE] * 2])
        for each in (middle, off):
            each[:, 4:] /= most[:, None]
        tilt = np.broadcast_to(steep * most[:, None, None], (_TWO, 2, count))
        spread = np.broadcast_to(spread, (2, count))
        return _Moves(middle[:, 1:], off[:, 1:], middle[:, 0], tilt, spread, shares)

    # --- V, its growth and its gain

    @cached_property
    def terms(self) -> NDArray[np.intp]:
        """Wave of the heading, and powers of both curvatures, of each term of V, (3, terms)."""
        powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
        waves = itertools.product(range(2 * _TURNS + 1), powers)
        return np.array([(wave, *power) for wave, power in waves if wave or any(power)]).T

    def _waves(self, headings: Array) -> Array:
        """Waves of the terms at headings from the start's, and their slopes, (2, terms, m)."""
        turns, one = np.arange(1, _TURNS + 1)[:, None], np.ones((1, len(headings)))
        c, s = np.cos(turns * headings), np.sin(turns * headings)
        both = np.concatenate([one, c, s]), np.concatenate([0 * one, -turns * s, turns * c])
        return np.array(both)[:, self.terms[0]]

    def _powers(self, middles: Array) -> Array:
        """Taylor coefficients of the powers of the terms about shapes, (4, 4, terms, m)."""
        order = np.arange(_DEGREE + 1)
        choose = np.array([[math.comb(i, a) for i in order] for a in order])
        drop = np.maximum(order - order[:, None], 0)
        first, last = (
            (choose[..., None] * axis ** drop[..., None])[:, power]
            for axis, power in zip(middles.T, self.terms[1:], strict=True)
        )
        return np.asarray(first[:, None] * last[None])

    def _slopes(self, x: Array, headings: Array, middles: Array) -> Array:
        """Taylor coefficients of V and its slopes about shapes, at headings, (4, 4, 4, m, k)."""
        waves = self._waves(headings) * x[_FIXED:, None]
        v, turning = np.einsum("abtm,wtk->wabmk", self._powers(middles), waves, optimize=True)
        order = np.arange(1, _DEGREE + 1)[:, None, None, None]
        found = np.stack([v, turning, np.zeros_like(v), np.zeros_like(v)])
        found[2, :-1], found[3, :, :-1] = order * v[1:], order[:, 0] * v[:, 1:]
        return found

    def _pose(self, x: Array, moves: Array, headings: Array) -> Array:
        """Growth of p . (x, y) by moves (..., 5, m) at headings (k,), (..., m, k)."""
        c, s = np.cos(self.pose.heading + headings), np.sin(self.pose.heading + headings)
        p = x[:2] - x[2:4]
        u, v = moves[..., 0, :, None], moves[..., 1, :, None]
        return np.asarray(u * (p[0] * c + p[1] * s) + v * (p[1] * c - p[0] * s))

    def growth(self, x: Array, mode: Mode, shapes: _Shapes) -> Array:
        """Proved growth of S in boxes of shapes, at every heading, (m,)."""
        headings = math.tau / _HEADINGS * np.arange(_HEADINGS)
        units, off, paces, tilt, spread, shares = self._moves(mode, shapes)
        _, *slopes = self._slopes(x, headings, shapes.middles)
        reach, higher = (_reach(shapes.half, _DEGREE + more) for more in (0, 1))
        sizes = [np.tensordot(reach, np.abs(slope)) for slope in slopes]
        loose = np.hypot(*(x[:2] - x[2:4])) * np.hypot(off[:, 0], off[:, 1])[..., None]
        loose = loose + sum(off[:, 2 + i, :, None] * size for i, size in enumerate(sizes))
        grows = [
            sum(unit[2 + i, :, None] * slope for i, slope in enumerate(slopes)) for unit in units
        ]
        for each, pose in zip(grows, self._pose(x, units, headings), strict=True):
            each[0, 0] += pose
        more = np.array([np.tensordot(reach, np.abs(each)) for each in grows]) + loose
        quickest = np.abs(paces) + spread + np.tensordot(shapes.half, np.abs(tilt), 1)
        more = spread[..., None] * more + quickest[..., None] * loose
        grows = [self._tilted(*each) for each in zip(grows, paces, *tilt, strict=True)]
        most = np.zeros(len(shapes.middles))
        for share in shares:
            whole = sum(w[:, None] * each for w, each in zip(share, grows, strict=True))
            bound = np.tensordot(higher, np.abs(whole)) + (np.abs(share)[..., None] * more).sum(
                axis=0
            )
            most = np.maximum(most, bound.max(axis=1))
        return most / math.cos(math.pi * _TURNS / _HEADINGS)

    @staticmethod
    def _tilted(grows: Array, pace: Array, first: Array, last: Array) -> Array:
        """Taylor coefficients, times a pace that changes with shape."""
        found = pace[:, None] * np.pad(grows, ((0, 1), (0, 1), (0, 0), (0, 0)))
        found[1:, :-1] += first[:, None] * grows
        found[:-1, 1:] += last[:, None] * grows
        return found

    @cached_property
    def goal(self) -> tuple[Array, Array, Array]:
        """Boxes of headings and shapes that hold those of the goal: middles, (m,), (m, 2), halves, (3,)."""
        around, most = self.pose.turn_reach, self.most_per_m.tolist()
        ends = [(self.pose.turn - around, self.pose.turn + around)]
        for asked, k in zip(self.task.goal, most, strict=True):
            ends.append((-1.0, 1.0) if asked is None else (asked[0] / k, asked[1] / k))
        edges = [np.linspace(*each, 2 + int((each[1] - each[0]) / _FINE)) for each in ends]
        grid = np.meshgrid(*((at[1:] + at[:-1]) / 2 for at in edges), indexing="ij")
        heading, *shapes = (axis.ravel() for axis in grid)
        return heading, np.stack(shapes, axis=-1), np.array([(at[1] - at[0]) / 2 for at in edges])

    def gain(self, x: Array) -> float:
        """Proved least gain of S from start to goal."""
        headings, middles, half = self.goal
        waves, powers = self._waves(headings), self._powers(middles)
        v, turning = ((wave * x[_FIXED:, None] * powers).sum(axis=2) for wave in waves)
        reach = _reach(half[1:], _DEGREE)
        curved = (np.abs(x[_FIXED:]) * self.terms[0] ** 2) @ np.tensordot(reach, np.abs(powers))
        off = np.tensordot(reach, np.abs(v)) - np.abs(v[0, 0])
        off += half[0] * (np.tensordot(reach, np.abs(turning)) + half[0] * curved)
        least, driven = float((v[0, 0] - off).min()), self.objective[:4] @ x[:4]
        return float(least + driven + self.objective[_FIXED:] @ x[_FIXED:])

    # --- The linear program

    @cached_property
    def objective(self) -> Array:
        """Gain of S of the unknowns."""
        given, reach = (
            np.isfinite(self.pose.reach),
            np.where(np.isfinite(self.pose.reach), self.pose.reach, 0.0),
        )
        along = np.where(given, self.pose.shift, 0.0)
        start = np.array([self.task.start]) / self.most_per_m
        before = self._waves(np.zeros(1))[0] * self._powers(start)[0, 0]
        return np.concatenate([along - reach, -along - reach, [1.0], -before[:, 0]])

    def bound(self) -> float:
        """Lower bound on the time in which a plan moves [s]."""
        x = self._solved()
        if x is None or (gain := self.gain(x)) <= 0.0:
            return 0.0
        at_speed_s = gain / max(self._grows(x, mode) for mode in self.modes) * (1 - _ROUNDING)
        return at_speed_s + self.lost_s()

    def _solved(self) -> Array | None:
        """The S that gains most where it is sampled; None if the solver gives up."""
        headings = math.tau / _HEADINGS * np.arange(0, _HEADINGS, _SAMPLED)
        at = np.linspace(-1.0, 1.0, _POINTS)
        middles = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, _TWO)
        points = self._allowed(_Shapes(middles, np.full(_TWO, _NEAR)))
        points = points._replace(half=np.zeros(_TWO))
        middles, moves = (
            points.middles,
            np.concatenate(
                [
                    np.einsum("kwm,wm,wcm->kcm", each.shares, each.paces, each.units)
                    for each in (self._moves(mode, points) for mode in self.modes)
                ]
            ),
        )
        at_goal = self._waves(self.goal[0])[0] * self._powers(self.goal[1])[0, 0]
        at_goal = np.column_stack(
            [np.zeros((at_goal.shape[1], 4)), np.ones(at_goal.shape[1]), -at_goal.T]
        )
        size = len(moves), len(middles), len(headings)
        added = np.arange(0, math.prod(size), max(1, math.prod(size) // _FIRST))
        signs, rows = np.where(np.arange(len(added)) % 2, 1.0, -1.0), at_goal[:0]
        inside, found = np.zeros(len(self.objective)), False
        for _ in range(_ROUNDS):
            k, m, n = np.unravel_index(added, size)
            new = signs[:, None] * self._rows(moves[k, :, m], headings[n], middles[m])
            rows = np.concatenate([rows, new])
            if (outside := self._best(rows, at_goal)) is None:
                break
            x = (inside + outside) / 2
            _, *slopes = self._slopes(x, headings, middles)
            grows = self._pose(x, moves, headings)
            grows += sum(moves[:, 2 + i, :, None] * slope[0, 0] for i, slope in enumerate(slopes))
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
        """The x that gains most and grows by at most 1 in these rows; None if the solver gives up."""
        limits = np.append(np.ones(len(rows)), np.zeros(len(at_goal)))
        most = np.where(np.tile(np.isfinite(self.pose.reach), 2), np.inf, 0.0)
        bounds = [(0.0, float(end)) for end in most] + [(None, None)]
        bounds += [(-_LARGEST, _LARGEST)] * len(self.terms[0])
        try:
            found = minimise(-self.objective, np.vstack([rows, at_goal]), limits, bounds)
        except ArithmeticError:
            return None
        return None if found is None else found.x

    def _rows(self, moves: Array, headings: Array, middles: Array) -> Array:
        """Growth by motions (m, 5), each at a heading and in a shape, of every unknown, (m, unknowns)."""
        (waves, turning), powers = self._waves(headings), self._powers(middles)
        c, s = np.cos(self.pose.heading + headings), np.sin(self.pose.heading + headings)
        u, v, r, *bend = moves.T
        x, y = c * u - s * v, s * u + c * v
        grows = r * turning * powers[0, 0] + waves * (
            bend[0] * powers[1, 0] + bend[1] * powers[0, 1]
        )
        return np.column_stack([x, y, -x, -y, np.zeros(len(x)), grows.T])

    def lost_s(self) -> float:
        """Time that is lost at least while units get up to speed for soft phases, and to rest [s].

        Of c in both, W_j - c is left to each alone. What a mode loses is concave in its bends: so it
        is least where one of the three is none.
        """
        ramp_s, most = self.pose.ramp_s / _HASTE, dict[Mode, float]()
        if not ramp_s:
            return 0.0
        for mode in ((1, 0), (0, 1), (1, 1)):
            moves = self._moves(mode, self.shapes)
            quickest = (
                np.abs(moves.paces)
                + moves.spread
                + np.tensordot(self.shapes.half, np.abs(moves.tilt), 1)
            )
            most[mode] = float((np.abs(moves.shares[:3]) * quickest).sum(axis=1).max())

        def lost(mode: Mode, low: float, high: float) -> float:
            least = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
            some = min(1.0, least / most[mode] / (2 * ramp_s))
            return ramp_s * (1 - (1 - some) ** 2)

        (a, b), (c, d) = self.task.met
        return min(
            lost((1, 0), a, b) + lost((0, 1), c, d),
            lost((1, 1), a, b) + lost((0, 1), c - b, d - a),
            lost((1, 1), c, d) + lost((1, 0), a - d, b - c),
        )

    def _grows(self, x: Array, mode: Mode) -> float:
        """Proved growth of S in a mode; boxes are halved where it may be much more than 1."""
        shapes, largest = self.shapes, 1.0
        for halving in range(_HALVINGS + 1):
            parts = np.array_split(shapes.middles, 1 + len(shapes.middles) // _AT_ONCE)
            each = np.concatenate(
                [self.growth(x, mode, shapes._replace(middles=part)) for part in parts]
            )
            halve = each > _CLOSE
            if halving == _HALVINGS or not halve.any() or halve.sum() > _MOST:
                return max(largest, float(each.max(initial=0.0)))
            largest = max(largest, float(each[~halve].max(initial=0.0)))
            shapes = self._allowed(shapes._replace(middles=shapes.middles[halve]).halved())
            if not len(shapes.middles):
                break
        return largest


def _reach(half: Array, degree: int) -> Array:
    """Largest powers of what is within half-widths (2,), up to a degree in each."""
    first, last = half[:, None] ** np.arange(degree + 1)
    return np.outer(first, last)
