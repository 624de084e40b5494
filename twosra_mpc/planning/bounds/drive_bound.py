r"""A tighter proved lower bound on the time of a rigid motion, in which turning takes time.

The bound of ``rigid_motion`` lets a robot turn to a better heading and back at no cost. Here, for a
direction p, let V(phi, t) be the most that p . (x, y) can still gain from heading phi in the time
t that is left, so that the motion ends at a heading of the goal:

.. math:: V_t = \max_{(w, r) \in P} \left( p \cdot R(\phi) w + V_\phi\, r \right),
    \quad V(\phi, 0) = 0 \text{ in the goal.}

A motion of duration T exists only if p . shift <= V(0, T), and a robot may rest: if no motion lasts
T, none is shorter. The best p is a search in one variable, and every p proves something.

V is bounded from above by functions C_k that are linear between headings i h, at times k dt, where
the fastest turn passes m headings per step. The mean twist of a step lies in P, and P between the
slices at r = j h / dt lies in the hull of sets Q_j there (``_slices``). Then with
mu = (phi_i + phi_j) / 2 halfway

.. math:: C_{k+1}(\phi_i) = \max_{|j - i| \le m} \left( C_k(\phi_j) + dt \max_{w \in Q_{j-i}}
    p \cdot R(\mu) w \right) + \frac{m + 2}{4}\, h\, dt \max_j \max_{w \in Q_j} |w|

bounds V at all headings, not only these: a pair of headings (begin, end) lies in a triangle of
pairs of the grid, none of which turns by more than m h. C_k is linear on it, as are the shares of
the slices. Halfway differs there by at most h / 2 on average, and a heading on the way differs from
halfway by m h / 4 on average; R by no more than that.

Where turning left is as good as turning right no p proves much, as points between the ends of two
motions count as reached. So motions are split by their heading at a fixed time before the end
(C_k is -inf at all others there), each part with a p of its own, the least bound first.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.planning.bounds.rigid_motion import (
    FAR_RAD,
    PoseChange,
    headings_visited,
    twist_vertices,
)
from twosra_mpc.robot.coordinates import Array

_COARSE, _FINE = 100, 1200  # headings, to look for p and to prove with it
_SPLITS = 7  # of the headings midway
_GAIN = 1e-3  # what the first split must gain for another
_DIRECTIONS = 12  # golden sections
_FINEST_SLICES = 32
_STEEP = 10.0  # slope of C_0 outside the goal, times what the fastest turn may gain meanwhile
_ROUNDING = 1e-9


def least_drive_time(speed_rows: Array, change: PoseChange, until_s: float) -> float:
    """Lower bound on the duration of any rigid motion with this change of pose, up to until_s [s].

    Takes a hundred times as long as ``rigid_motion.least_time``, whose arguments these are.
    """
    vertices = twist_vertices(speed_rows)
    if vertices is None or not np.isfinite(change.shift).any() or until_s <= 0:
        return 0.0
    reach = float(vertices[:, 2].max()) * until_s
    if reach > FAR_RAD:  # turning takes little of the time
        return 0.0
    goals = change.headings(reach)
    drives = [_Drive(speed_rows, vertices, change, goal, until_s) for goal in goals]
    order = itertools.count()
    queue = [(each.disproved(each.headings), next(order), each, each.headings) for each in drives]
    heapq.heapify(queue)
    first = queue[0][0] if queue else until_s
    for k in range(_SPLITS):
        if not queue or queue[0][0] >= until_s or (k and queue[0][0] <= first * (1 + _GAIN)):
            break
        least, _, drive, (low, high) = heapq.heappop(queue)
        for half in ((low, (low + high) / 2), ((low + high) / 2, high)):
            heapq.heappush(queue, (max(least, drive.disproved(half)), next(order), drive, half))
    return min((least for least, *_ in queue), default=until_s) * (1 - _ROUNDING)


class _Drive:
    """A change of position that must end at a heading of one interval."""

    def __init__(
        self,
        rows: Array,
        vertices: Array,
        change: PoseChange,
        goal: tuple[float, float],
        until_s: float,
    ) -> None:
        self.goal, self.until_s, self.asked = goal, until_s, np.isfinite(change.shift)
        self.along, self.box = np.where(self.asked, [change.shift, change.box], 0.0)
        self.fastest_turn = float(vertices[:, 2].max())
        self.headings = headings_visited(goal, self.fastest_turn * until_s)
        self.slices = _best_slices(rows, vertices, (self.headings[1] - self.headings[0]) / _FINE)
        self.fastest = float(np.hypot(*np.vstack(self.slices).T).max())

    def disproved(self, midway: tuple[float, float]) -> float:
        """Longest time disproved for motions with this heading half of ``until_s`` before the end.

        Directions p are tried on a coarse grid of headings, the best one on a fine grid.
        """
        angle = math.atan2(self.along[1], self.along[0])
        if self.asked.all():
            angle = _largest(
                lambda angle: self._reached(angle, _COARSE, midway)[1],
                angle - math.pi / 2,
                angle + math.pi / 2,
            )
        return self._reached(angle, _FINE, midway)[0]

    def _reached(
        self, angle: float, count: int, midway: tuple[float, float]
    ) -> tuple[float, float]:
        """When p . (x, y) may gain what is asked: proved, and as interpolated [s]."""
        p = np.array([math.cos(angle), math.sin(angle)])
        gain = float(p @ self.along - np.abs(p) @ self.box)
        if gain <= 0:
            return 0.0, gain
        grid, origin = self._grid(count)
        h, m = float(grid[1] - grid[0]), len(self.slices) // 2
        step_s = m * h / self.fastest_turn
        gains = self._gains(p, grid, h, step_s)
        most = np.full(len(grid) + 2 * m, -np.inf)
        inner = most[m : m + len(grid)]
        outside = np.maximum(self.goal[0] - grid, grid - self.goal[1]).clip(min=0.0)
        inner[:] = -_STEEP * self.fastest / self.fastest_turn * outside
        inner -= np.interp(np.clip(self.goal, grid[0], grid[-1]), grid, inner).min()
        shifted = [most[j : j + len(grid)] for j in range(2 * m + 1)]
        half = round(self.until_s / 2 / step_s)
        elsewhere = (grid < midway[0] - h) | (grid > midway[1] + h)
        for k in range(math.ceil(self.until_s / step_s)):
            charge(Cost.HEADING_STEP, len(self.slices))
            before = float(inner[origin])
            if before >= gain:
                return 0.0, 0.0
            if k == half:
                inner[elsewhere] = -np.inf
            inner[:] = np.max([a + b for a, b in zip(shifted, gains, strict=True)], axis=0)
            if (after := float(inner[origin])) >= gain:
                share = (gain - before) / (after - before)
                return k * step_s, (k + share) * step_s
        return self.until_s, self.until_s * (1 + gain - float(inner[origin]))

    def _gains(self, p: Array, grid: Array, h: float, step_s: float) -> list[Array]:
        """Gain of p . (x, y), at most, in a step from each heading to those m before to m after."""
        m, gains = len(self.slices) // 2, []
        loss = (m + 2) / 4 * h * self.fastest
        for j, points in enumerate(self.slices, start=-m):
            c, s = np.cos(grid + j * h / 2), np.sin(grid + j * h / 2)
            turned = np.array([p[0] * c + p[1] * s, p[1] * c - p[0] * s])
            gains.append(step_s * ((points @ turned).max(axis=0) + loss))
        return gains

    def _grid(self, count: int) -> tuple[Array, int]:
        """Headings at even distances, one of them 0 and one the goal's nearest; where 0 is."""
        low, high = self.headings
        width = max(high - low, 1e-6) / count
        near = abs(min(max(0.0, self.goal[0]), self.goal[1]))
        width = near / max(round(near / width), 1) if near > width / 2 else width
        first, last = math.floor(low / width) - 1, math.ceil(high / width) + 1
        grid: Array = np.arange(first, last + 1, dtype=float) * float(width)
        return grid, -first


def _largest(value: Callable[[float], float], low: float, high: float) -> float:
    """Maximiser of a function with one hill, by golden sections."""
    ratio = (math.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = value(a), value(b)
    for _ in range(_DIRECTIONS):
        if at_a >= at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = value(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = value(b)
    return a if at_a >= at_b else b


def _best_slices(rows: Array, vertices: Array, width: float) -> list[Array]:
    """The slices with which least is lost: few are coarse, many take steps of many headings."""
    best, least = list[Array](), math.inf
    for m in range(1, _FINEST_SLICES + 1):
        if (m + 2) / 4 * width >= least:
            break
        found, over = _slices(rows, vertices, m)
        if over + (m + 2) / 4 * width < least:
            best, least = found, over + (m + 2) / 4 * width
    return best


def _slices(rows: Array, vertices: Array, count: int) -> tuple[list[Array], float]:
    """Points (u, v) at 2 count + 1 even rates of turn whose hulls in 3-D hold P; how far they go.

    A vertex between two rates is a mean of two points on a line through it, one at each.
    """
    rate = float(vertices[:, 2].max()) / count
    twists, turns = vertices[:, :2], vertices[:, 2] / rate
    points: list[list[Array]] = [[] for _ in range(2 * count + 1)]
    over = 0.0
    for j in range(-count, count + 1):
        low, high = turns <= j + 1e-12, turns >= j - 1e-12
        between = turns[high] - turns[low][:, None]
        share = np.divide(
            j - turns[low][:, None], between, where=between > 1e-12, out=np.zeros_like(between)
        ).clip(0.0, 1.0)[..., None]
        met = twists[low][:, None] * (1 - share) + twists[high] * share
        points[j + count] += list(met.reshape(-1, 2))
    for twist, turn in zip(twists, turns, strict=True):
        below = math.floor(turn + 1e-12)
        if turn - below <= 1e-12:
            continue
        apart = turns - turn
        slopes = (twists - twist)[np.abs(apart) > 1e-6] / apart[np.abs(apart) > 1e-6][:, None]
        ends = np.array([twist + slopes * (j - turn) for j in (below, below + 1)])
        at = np.dstack([ends, np.full(ends.shape[:2], rate) * np.array([[below], [below + 1]])])
        sizes = np.abs(at @ rows.T).max(axis=(0, 2))
        best = int(sizes.argmin())
        over = max(over, float(sizes[best]) - 1)
        points[below + count].append(ends[0, best])
        points[below + 1 + count].append(ends[1, best])
    return [_hull(np.array(each)) for each in points], over


def _hull(points: Array) -> Array:
    """Corners of the convex hull of points in the plane, (n, 2), by Andrew's monotone chain."""
    ordered = sorted(set(map(tuple, points.tolist())))
    corners: list[tuple[float, float]] = []
    for chain in (ordered, ordered[::-1]):
        half: list[tuple[float, float]] = []
        for x, y in chain:
            while len(half) > 1 and (half[-1][0] - half[-2][0]) * (y - half[-2][1]) <= (
                half[-1][1] - half[-2][1]
            ) * (x - half[-2][0]):
                half.pop()
            half.append((x, y))
        corners += half
    return np.array(corners)
