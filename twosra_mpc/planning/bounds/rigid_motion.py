r"""A proved lower bound on the time of a rigid motion within wheel speed limits.

A rigid body moves with body twists xi = (u, v, r) in the polytope P = {|M xi| <= 1}. Let
S(x, y, phi) = p . (x, y) + C(phi). If, for every heading phi that can occur and every vertex
(w, r) of P, with w = (u, v),

.. math:: p \cdot R(\phi) w + C'(\phi)\, r \le 1,

then S grows by at most 1 per second along any admissible motion, so S(goal) - S(start) bounds its
duration from below. Since x and y do not enter the limits, S is a complete integral of the
Hamilton-Jacobi equation of the minimum-time problem: the best p makes the bound tight for motions
that turn one way. With C' constant on panels of headings the best bound is a linear program. On a
panel of half-width h about phi_m the arc R(phi) w lies in the triangle of its ends and
R(phi_m) w / cos h, so testing these three points proves the inequality on the whole panel.

Only headings that a motion faster than a known one can visit need to be covered.

Where wheels accelerate by at most a, a drive has twists in t {|V xi| <= a} a time t after its start
and before its end. Then S grows by at most g t, where g is the most that (p R(phi), C') gains over
{|V xi| <= a}, for headings phi that can be turned to or from in t; so a drive from rest to rest
takes at least as long as the integral of min(1, g t, g (T - t)) needs to be what S gains. Where a
screw turns much, another S with a smaller g near the ends may prove more: a price of acceleration.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.planning.bounds.linear_program import minimise
from twosra_mpc.robot.coordinates import Array

_PANEL_RAD = 0.06
_CELLS = 64  # of the time in which all speeds are reached
# Further programs: share of g that is left, for headings not farther from the ends than this.
_PRICED = ((1.0, math.inf), (0.6, 0.25), (0.6, math.inf), (0.3, math.inf))
FAR_RAD = 3 * math.tau  # turns in a drive from which on headings are covered once, not once a turn
_SAME = 1e-6  # s/m or s: rows that differ by less do not depend on the shape
_ROUNDING = 1e-9  # relative allowance for rounding in the vertices and the linear program


class PoseChange(NamedTuple):
    """Change of pose that a rigid motion must bring about, in the start frame of heading.

    Attributes:
        shift: Of (x, y) [m]; NaN where free.
        box: Half-width of the goal box along the same axes [m], (2,).
        turns: (low, high) of the change of heading [rad]; infinite where free.
        modulo: Whether headings that differ by full turns are equal.
    """

    shift: Array
    box: Array
    turns: tuple[float, float]
    modulo: bool

    def headings(self, reach: float) -> list[tuple[float, float]]:
        """Intervals of goal headings, relative to the start's, that can be turned to by a reach."""
        low, high = self.turns
        if not (math.isfinite(low) and math.isfinite(high)):
            return [(-reach, reach)]
        first = math.ceil((-reach - high) / math.tau) if self.modulo else 0
        last = math.floor((reach - low) / math.tau) if self.modulo else 0
        return [(low + k * math.tau, high + k * math.tau) for k in range(first, last + 1)]

    def program(self, further: Array) -> tuple[Array, Array]:
        """Gain of S from start to goal per unknown, and the unknowns' bounds, (n,) and (n, 2).

        The first four are p = plus - minus, both >= 0: so the box costs box . (plus + minus).
        """
        asked = np.isfinite(self.shift)
        along, box = np.where(asked, [self.shift, self.box], 0.0)
        gain = np.concatenate([along - box, -along - box, further])
        ends = np.tile([-np.inf, np.inf], (len(gain), 1))
        ends[:4, 0], ends[:4][~np.tile(asked, 2), 1] = 0.0, 0.0
        return gain, ends


def least_time(
    speed_rows: Array,
    change: PoseChange,
    known_s: float,
    wheel_rows: Array | None = None,
    priced: bool = False,
) -> float:
    """Lower bound on the duration of any rigid motion with this change of pose [s].

    Args:
        speed_rows: M, (m, 3), per body twist [s/m, s/m, s].
        change: What is asked for.
        known_s: Duration of a known motion; the bound never exceeds it.
        wheel_rows: V / a, (4, 3), if wheels accelerate by a from rest and back to it.
        priced: Whether to look for a better bound with further programs.
    """
    vertices = twist_vertices(speed_rows)
    if vertices is None:
        return 0.0
    ramps = _NO_RAMPS if wheel_rows is None else _Ramps.of(vertices, wheel_rows)
    reach = float(vertices[:, 2].max()) * known_s
    if reach > FAR_RAD:
        if not all(map(math.isfinite, change.turns)):
            change = change._replace(turns=(-math.pi, math.pi), modulo=True)
        found = _bound_around(vertices, change, ramps)
        return min(found, known_s) * (1 - _ROUNDING)
    best = known_s
    for goal in change.headings(reach):
        best = min(best, _bound_to(vertices, change, goal, reach, ramps, priced))
    return best * (1 - _ROUNDING)


class _Ramps(NamedTuple):
    """Gains of twist in a second, and how long it takes to reach every speed.

    Attributes:
        gains: Vertices of {|V xi| <= a}, (n, 3) [per s].
        longest_s: In which every twist of P is reached from rest.
    """

    gains: Array
    longest_s: float

    @classmethod
    def of(cls, vertices: Array, wheel_rows: Array) -> _Ramps:
        """The ramps of P by its vertices."""
        gains = twist_vertices(wheel_rows)
        if gains is None:
            return _NO_RAMPS
        return cls(gains, float(np.abs(vertices @ wheel_rows.T).max()))

    def least_s(self, gained: float, growth: Array, off: Sequence[Array]) -> float:
        """Least time from rest to rest in which S gains so much [s].

        Args:
            gained: In units of what it grows by in a second at full speed.
            growth: g on each panel of headings, (k,).
            off: How far panels are from where it starts, and from where it ends, (k,) each [rad].
        """
        if not len(self.gains) or gained <= 0.0:
            return gained
        cell_s = self.longest_s / _CELLS
        ends = cell_s * np.arange(1, _CELLS + 1)
        reached = float(self.gains[:, 2].max()) * ends**2 / 2
        rates = []
        for far in off:
            order = np.argsort(far)
            most = np.maximum.accumulate(growth[order])
            near = np.searchsorted(far[order], reached, side="right")
            rates.append(np.minimum(1.0, most[np.maximum(near, 1) - 1] * (ends - cell_s / 2)))
        # Both grow with time from the ends, so the slowest cells are those of a drive that ends.
        area = np.append(0.0, np.cumsum(np.sort(np.concatenate(rates)))) * cell_s
        if gained >= area[-1]:
            return 2 * self.longest_s + gained - float(area[-1])
        return float(np.interp(gained, area, cell_s * np.arange(len(area))))


_NO_RAMPS = _Ramps(np.empty((0, 3)), 0.0)


def twist_vertices(speed_rows: Array) -> Array | None:
    """Vertices (u, v, r) of the polytope of body twists, (n, 3); None if it is unbounded."""
    if len(speed_rows) < 3 or np.linalg.matrix_rank(speed_rows) < 3:
        return None
    squares = speed_rows[[*itertools.combinations(range(len(speed_rows)), 3)]]
    regular = np.abs(np.linalg.det(squares)) >= 1e-9 * np.abs(squares).max(axis=(1, 2)) ** 3
    signs = np.array([*itertools.product((-1.0, 1.0), repeat=3)])
    twists = np.linalg.solve(squares[regular, None], signs[None, ..., None]).reshape(-1, 3)
    return twists[np.abs(twists @ speed_rows.T).max(axis=1) <= 1 + 1e-9]


def rows_of_any(rows: Array, off: Array) -> Array:
    """Rows M of a bounded {|M xi| <= 1} that holds those of all rows within ``off``; none if none.

    Let X be the largest abs(xi) with |M xi| <= 1, of rows for which it is bounded. A twist has
    t = max |M xi| <= 1 + a t there with a = max off X: so abs(xi) <= X / (1 - a), and each row of
    it is at most 1 + off X / (1 - a). Where that fails the rows of which all are the same may do.
    """
    for kept in (off < np.inf, off < _SAME):
        use = kept.all(axis=1)
        if (twists := twist_vertices(rows[use])) is None:
            continue
        most = np.abs(twists).max(axis=0)
        if (more := float((off[use] @ most).max())) < 1:
            known = (off < np.inf).all(axis=1)
            return rows[known] / (1 + off[known] @ most / (1 - more))[:, None]
    return rows[:0]


def _bound_to(
    vertices: Array,
    change: PoseChange,
    goal: tuple[float, float],
    reach: float,
    ramps: _Ramps,
    priced: bool,
) -> float:
    """Best bound of the form above for one interval of goal headings, relative to the start's."""
    near = min(max(0.0, goal[0]), goal[1])  # what must be turned in any case
    low, high = headings_visited(goal, reach)
    marks = {low, min(0.0, near), max(0.0, near), high, *np.clip(goal, low, high).tolist()}
    edges = _panels(sorted(marks))
    if len(edges) < 2:
        return 0.0
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    between = (middle > min(0.0, near)) & (middle < max(0.0, near))
    uncertain = (middle > goal[0]) & (middle < goal[1])

    count = len(middle)
    growth, gains = (_growth(middle, half, np.eye(count), of) for of in (vertices, ramps.gains))
    gain, ends = change.program(np.sign(near) * 2 * half * between)
    ends[4:][uncertain] = 0.0
    off = [
        np.maximum(np.maximum(a - middle, middle - b) - half, 0.0) for a, b in ((0.0, 0.0), goal)
    ]
    rows, limits, best, first = growth, np.ones(len(growth)), 0.0, np.empty(0)
    for share, within in _PRICED if priced and len(gains) else _PRICED[:1]:
        if len(first):
            at_ends = np.flatnonzero(np.minimum(*off) <= within)
            some = gains.reshape(-1, count, len(gain))[:, at_ends].reshape(-1, len(gain))
            rows, most = np.vstack([growth, some]), share * float(first[at_ends].max())
            limits = np.append(np.ones(len(growth)), np.full(len(some), most))
        optimum = minimise(-gain, rows, limits, [(a, b) for a, b in ends.tolist()])
        if optimum is None:
            break
        s = np.clip(optimum[1], *ends.T)
        s /= float((growth @ s).max(initial=1.0))  # S, made to grow as it may
        own = (gains @ s).reshape(-1, count).max(axis=0, initial=0.0)
        first = first if len(first) else own
        best = max(best, ramps.least_s(float(gain @ s), own, off))
    return best


def _growth(middle: Array, half: Array, slopes: Array, twists: Array) -> Array:
    """Rows of what S grows by on panels of headings, for every twist, (points, panels, unknowns).

    Unknowns are p, split in two, and those of which ``slopes`` make C'. On a panel the arc of
    headings lies in the triangle of its ends and its middle, stretched.
    """
    blocks = [np.empty((0, 4 + slopes.shape[1]))]
    for angle, stretch in ((middle - half, None), (middle + half, None), (middle, np.cos(half))):
        c, s = np.cos(angle), np.sin(angle)
        size = 1.0 if stretch is None else 1.0 / stretch
        for u, v, r in twists:
            turned = np.column_stack([(c * u - s * v) * size, (s * u + c * v) * size])
            blocks.append(np.hstack([turned, -turned, slopes * r]))
    return np.vstack(blocks)


def _bound_around(vertices: Array, change: PoseChange, ramps: _Ramps) -> float:
    """Best bound with C(phi) = a phi + what has a period of 2 pi; a = 0 if full turns are equal.

    The goal's headings lie in panels in which the periodic part does not change.
    """
    low, high = change.turns
    here, wide = low % math.tau, min(high - low, math.tau)
    marks = {0.0, here, (here + wide) % math.tau, math.tau}
    edges = _panels(sorted(marks))
    middle, half, count = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2, len(edges) - 1
    level = np.eye(count)  # C where panels begin
    slopes = (np.roll(level, -1, axis=0) - level) / (2 * half)[:, None]
    flat = slopes[(middle - here) % math.tau < wide]
    of_turns = np.hstack([np.ones((count, 1)), -np.ones((count, 1)), slopes])
    growth, gains = (_growth(middle, half, of_turns, of) for of in (vertices, ramps.gains))
    reached = level[int(np.argmin(np.abs(edges[:-1] - here)))]
    gain, ends = change.program(np.append([low, -high], reached - level[0]))
    ends[4:6] = 0.0, 0.0 if change.modulo else np.inf
    ends[6] = 0.0  # C at the start's heading
    level_rows = np.pad(np.vstack([flat, -flat]), ((0, 0), (6, 0)))
    limits = np.concatenate([np.ones(len(growth)), np.zeros(len(level_rows))])
    rows = np.vstack([growth, level_rows])
    optimum = minimise(-gain, rows, limits, [(a, b) for a, b in ends.tolist()])
    if optimum is None:
        return 0.0
    s = np.clip(optimum[1], *ends.T)
    fall = float(np.abs(flat @ s[6:]).sum()) * 2 * float(half.max())  # within the goal's headings
    size = float((growth @ s).max(initial=1.0))
    own = (gains @ s / size).reshape(-1, count).max(axis=0, initial=0.0)
    return ramps.least_s(max(0.0, float(gain @ s) - fall) / size, own, [np.zeros(count)] * 2)


def headings_visited(goal: tuple[float, float], reach: float) -> tuple[float, float]:
    """Least and largest heading of all motions from 0 into ``goal`` that turn by at most ``reach``.

    One that turns up to h and ends at g turns by h + (h - g) at least, so h <= (reach + g) / 2.
    """
    low = min(0.0, (max(goal[0], -reach) - reach) / 2)
    return low, max(0.0, (min(goal[1], reach) + reach) / 2)


def _panels(marks: list[float]) -> Array:
    """Panel edges no further apart than 0.06 rad that include every mark."""
    pieces = [np.array(marks[:1])]
    for low, high in itertools.pairwise(marks):
        if high > low:
            pieces.append(np.linspace(low, high, math.ceil((high - low) / _PANEL_RAD) + 1)[1:])
    return np.concatenate(pieces)
