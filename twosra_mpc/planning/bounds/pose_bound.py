r"""Bound on what the change of pose costs a mode sequence whose bends are known, or nearly so.

Let S_i be functions of pose and bend, one for each phase i, with common gradients p and a,

.. math:: S_i = p \cdot (x, y) + a \phi + C_i(\phi) + B_i(W),

C_i of period 2 pi and piecewise linear in the heading, B_i piecewise linear in the bending
coordinate, 0 where the phase begins. If S_i grows by at most g_i per second whatever the robot
does in phase i, and C_{i+1} - C_i <= e_i at every heading, then summing over the phases of a plan

.. math:: \sum_i g_i\,(t_{end,i} - t_{start,i}) \;\ge\;
    p \cdot \Delta(x, y) + a \Delta\phi + C_n(\phi_{goal}) - C_0(0) + \sum_i B_i(d_i) - \sum_i e_i,

a linear constraint on the event times, and the least cost of the temporal network with this
constraint is a lower bound. It holds for any p, C and B, however the robot moves: it may rest, turn
about, or bend too far and back. Where a bend d_i is known to within bounds, B_i is flat between
them; of the goal poses the one counts that gains the least, so p has no part along a coordinate
that is free, and of a free heading the least C_n counts. Plans that turn left by some angle modulo
2 pi, or by more, gain at least a times that where a >= 0, and those that turn right where a <= 0:
each are bounded by a program of their own, and the worse bound is that of all.

In a rigid phase g_i is a maximum over the vertices of a polytope of twists; in a soft phase over
boxes of shapes on the line of its bends, out to the curvature limits, and the corners of the two
units' speeds (growth is linear in both, and what limits the wheels besides is left out).

On a panel of headings of half-width h about phi_m the arc R(phi) w lies in the triangle of its ends
and R(phi_m) w / cos h, so testing these three points proves a growth on the whole panel.

The S_i that give the highest bound solve a linear program together with the dual of the temporal
network (y are its multipliers, and g_i the price of time in phase i). Most of its rows are idle, so
it is solved with few of them and those that are violated are added. What is returned is always
proved by the true maxima, whether or not the program was solved to the end, or well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.planning.bounds.linear_program import Rows, minimise
from twosra_mpc.planning.bounds.pose_phases import BOXES, Indices, PhaseMotions, PoseTask
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.timing import EventLayout

PANELS = 32  # of headings, and one edge more near the goal's
_GRID = 5  # decimals of a turn to which edges are rounded, so that no panel is tiny
_ROUNDS = 14  # of adding rows
_CUTS = 120  # rows added a phase and round
_VIOLATED = 1e-4  # s/s
_STEEPEST = 3.0  # largest B', in terms of the fastest bending
_ROUNDING = 1e-5  # relative allowance for rounding, and for shapes known to 1e-9 rad


class PoseConstraint(NamedTuple):
    """sum of rates[i] (duration of phase i, at full speed) >= need for every plan [s]."""

    rates: Array
    need: float


class PoseProgram:
    """The linear program for p, C, B, g, e, y, the least C_n at the goal, the sizes of p, and a.

    Columns are in this order.

    Args:
        task: The change of pose.
        phases: What the phases can do.
        layout: Numbering of the events.
        least: {(u, v): w} meaning t[v] - t[u] >= w [s].
        cost: Cost of the event times, by event.
        side: Of the turns that are bounded, as in ``PoseTask.sides``.
    """

    def __init__(
        self,
        task: PoseTask,
        phases: Sequence[PhaseMotions],
        layout: EventLayout,
        least: dict[tuple[int, int], float],
        cost: Array,
        side: tuple[float, float],
    ) -> None:
        self.side = side
        turns = [*np.linspace(0.0, 1.0, PANELS + 1), task.turn / math.tau % 1.0]
        edges = sorted({*np.round(turns, _GRID)})  # np.unique loads masked arrays, for 10 ms
        self.edges = math.tau * np.array(edges)  # of the panels, from the start's
        half = np.diff(self.edges) / 2
        middle = (self.edges[1:] + self.edges[:-1]) / 2
        self.widths, self.panels = 2 * half, len(half)
        angles = task.heading + np.stack([self.edges[:-1], self.edges[1:], middle], axis=1)
        size = np.stack([np.ones_like(half), np.ones_like(half), 1 / np.cos(half)], axis=1)
        self.cos, self.sin = np.cos(angles) * size, np.sin(angles) * size
        self.task, self.phases, self.given = task, phases, np.isfinite(task.reach)
        self.goal = self._goal_headings(task)
        self.settled = np.concatenate([phase.settled for phase in phases])
        n = len(phases)
        pieces = [len(phase.bends) for phase in phases]
        self.c = 2 + self.panels * np.arange(n)
        self.b = 2 + self.panels * n + np.concatenate([[0], np.cumsum(pieces)])
        self.g = int(self.b[-1])
        self.e = self.g + n
        self.y = self.e + n - 1
        self.m = self.y + len(least)
        self.a = self.m + 3
        self.width = self.a + 1
        self.gain = self._gain(list(least.values()))
        self.bounds = self._bounds(task)
        self.cost = cost[: layout.origin]
        # Then follow those of the growth.
        self.rows = [self._balance(layout, least), self._switches(), self._least_gain()]
        for i, phase in enumerate(phases):
            first = np.arange(len(phase.motions))
            if len(phase.bends) > 1:
                first = first[BOXES // 2 :: max(BOXES, 2 * len(first) // _CUTS)]
            motion, panel = np.meshgrid(
                first, np.arange(0, self.panels, 3 if len(first) > 40 else 1)
            )
            self._add(i, motion.ravel(), panel.ravel(), np.full(motion.size, 2))

    def _goal_headings(self, task: PoseTask) -> Array:
        """Headings of the goal at one of which C_n is least, as shares of edges, (n, panels)."""
        inner, half = task.turn % math.tau, task.turn_reach
        inside = np.abs(np.remainder(self.edges[:-1] - inner + math.pi, math.tau) - math.pi) < half
        ends = np.remainder([inner, inner - half, inner + half], math.tau)
        panel = np.minimum(np.searchsorted(self.edges, ends, "right"), self.panels) - 1
        part = ((ends - self.edges[panel]) / self.widths[panel])[:, None]
        shares = np.eye(self.panels)
        between = (1 - part) * shares[panel] + part * shares[(panel + 1) % self.panels]
        return np.concatenate([between, shares[inside]])

    def _gain(self, least: list[float]) -> Array:
        """Gain of S from start to goal."""
        gain = np.zeros(self.width)
        gain[:2] = self.task.shift
        gain[self.b[0] : self.g] = np.concatenate([phase.bends for phase in self.phases])
        gain[self.e : self.y] = -1.0
        gain[self.y : self.m] = least
        gain[self.m] = 1.0
        gain[self.m + 1 : self.a] = -np.where(self.given, self.task.reach, 0.0)
        gain[self.a] = self.side[1]
        return gain

    def _bounds(self, task: PoseTask) -> Array:
        """Bounds that leave room for every sensible S and keep the program well scaled."""
        bounds = np.tile([-np.inf, np.inf], (self.width, 1))
        most = 1.5 * max(task.known_s, 1.0)
        along = 2.0 * most / max(float(np.hypot(*task.shift)), 0.05) * self.given
        bounds[:2] = np.outer(along, [-1, 1])
        bounds[2 : self.b[0]] = -most, most
        bounds[self.c] = 0.0  # at the heading of the start
        for i, phase in enumerate(self.phases):
            fastest = np.abs(phase.motions[:, 3]).max()
            steepest = _STEEPEST / fastest if fastest else 0.0
            bounds[self.b[i] : self.b[i + 1]] = -steepest, steepest
        bounds[self.b[0] : self.g][~self.settled] = 0.0
        bounds[self.g : self.e, 0] = bounds[self.y : self.m, 0] = 0.0
        bounds[self.a] = np.sort([0.0, self.side[0] * most])
        return bounds

    def _balance(self, layout: EventLayout, least: dict[tuple[int, int], float]) -> Rows:
        """At every event what flows in costs no more than the event: the dual of the network."""
        rows = np.zeros((layout.count, self.width))
        for column, (u, v) in enumerate(least, start=self.y):
            rows[v, column] += 1.0
            rows[u, column] -= 1.0
        for i in range(len(self.phases)):
            rows[layout.end(i), self.g + i] += 1.0
            rows[layout.start(i), self.g + i] -= 1.0
        return Rows.of(rows[: layout.origin])

    def _switches(self) -> Rows:
        """C_{i+1} - C_i <= e_i at every edge of a panel, hence everywhere."""
        rows = np.zeros((len(self.phases) - 1, self.panels, self.width))
        at = np.arange(self.panels)
        for i, row in enumerate(rows):
            row[at, self.c[i + 1] + at] = 1.0
            row[at, self.c[i] + at] = -1.0
            row[at, self.e + i] = -1.0
        return Rows.of(rows.reshape(-1, self.width))

    def _least_gain(self) -> Rows:
        """What is gained is no more than C_n at a heading of the goal; abs(p) are at least p."""
        rows = np.zeros((len(self.goal) + 4, self.width))
        rows[:-4, self.c[-1] : self.c[-1] + self.panels] = -self.goal
        rows[:-4, self.m] = 1.0
        rows[-4:, :2] = np.vstack([np.eye(2), -np.eye(2)])
        rows[-4:, self.m + 1 : self.a] = -np.vstack([np.eye(2), np.eye(2)])
        return Rows.of(rows)

    def _add(self, i: int, motion: Indices, panel: Indices, point: Indices) -> None:
        """Rows: growth of S_i by some motions, at some points of some panels, is at most g_i."""
        phase, count = self.phases[i], len(motion)
        u, v, r, bending = phase.motions[motion].T
        c, s = self.cos[panel, point], self.sin[panel, point]
        steep = r / self.widths[panel]
        pieces = phase.piece[motion].T
        values = [c * u - s * v, s * u + c * v, steep, -steep, -np.ones(count), r]
        values += [bending] * len(pieces)
        columns = [
            np.zeros(count, dtype=np.intp),
            np.ones(count, dtype=np.intp),
            self.c[i] + (panel + 1) % self.panels,
            self.c[i] + panel,
            np.full(count, self.g + i),
            np.full(count, self.a),
            *(self.b[i] + pieces),
        ]
        row, column = np.tile(np.arange(count), len(columns)), np.concatenate(columns)
        self.rows.append(Rows.summed(count, row, column, np.concatenate(values)))

    def best(self, value: Callable[[PoseConstraint], float], enough: float) -> float:
        """The highest value of what is proved, up to what is enough; -inf if there is none."""
        best = -math.inf
        for _ in range(_ROUNDS):
            if (x := self.solve()) is None:
                break
            constraint, violated = self.read(x)
            best = max(best, value(constraint))
            if best >= enough or not violated:
                break
        return best

    def solve(self) -> Array | None:
        """Optimum of the program with the rows it has; None if the solver gives up."""
        rows = Rows.stacked(self.rows)
        limits = np.pad(self.cost, (0, len(rows.starts) - 1 - len(self.cost)))
        bounds = [(low, high) for low, high in self.bounds.tolist()]
        try:
            optimum = minimise(-self.gain, rows, limits, bounds)
        except ArithmeticError:
            return None
        return None if optimum is None else optimum[1]

    def read(self, x: Array) -> tuple[PoseConstraint, bool]:
        """Prove what S in x is worth; add the rows it violates, and tell whether there are any."""
        n, p = len(self.phases), x[:2] * self.given
        levels = x[2 : self.b[0]].reshape(n, self.panels)
        steps = np.diff(levels, axis=0).max(axis=1)
        rates, violated = np.zeros(n), False
        for i, phase in enumerate(self.phases):
            growth, loose = self.growth(phase, p, *self.slopes(x, i))
            rates[i] = max(0.0, float((growth.max(axis=2) + loose).max()))
            violated |= self._cut(i, growth - x[self.g + i])
        bent = self.gain[self.b[0] : self.g] * x[self.b[0] : self.g] * self.settled
        parts = [p * self.task.shift, (self.goal @ levels[-1]).min(), -levels[0, 0], bent, -steps]
        parts += [-np.where(self.given, self.task.reach, 0.0) * np.abs(p), x[self.a] * self.side[1]]
        gain, size = (sum(float(np.sum(f(part))) for part in parts) for f in (np.array, np.abs))
        return PoseConstraint(rates * (1 + _ROUNDING), gain - _ROUNDING * size), violated

    def slopes(self, x: Array, i: int) -> tuple[Array, Array]:
        """Slopes a + C' in every panel and B' in every piece of a phase."""
        levels = x[self.c[i] : self.c[i] + self.panels]
        settled = self.settled[self.b[i] - self.b[0] : self.b[i + 1] - self.b[0]]
        slopes = x[self.a] + (np.roll(levels, -1) - levels) / self.widths
        return slopes, x[self.b[i] : self.b[i + 1]] * settled

    def growth(
        self, phase: PhaseMotions, p: Array, slopes: Array, steep: Array
    ) -> tuple[Array, Array]:
        """Growth of S by every motion at three points of every panel, and how much it may be off.

        Shapes (n, panels, 3) and (n, panels).
        """
        bend = steep[phase.piece].sum(axis=1)
        u, v, r, bending = phase.motions.T[:, :, None, None]
        along, across = p[0] * self.cos + p[1] * self.sin, p[1] * self.cos - p[0] * self.sin
        growth: Array = u * along + v * across + r * slopes[:, None]
        growth += bending * bend[:, None, None]
        loose = np.hypot(*p) * np.hypot(phase.slack[:, 0], phase.slack[:, 1])
        loose = loose + phase.slack[:, 3] * np.abs(bend)
        return growth, loose[:, None] + phase.slack[:, 2, None] * np.abs(slopes)

    def _cut(self, i: int, excess: Array) -> bool:
        """Add the worst motion of every panel and piece, where it violates its row."""
        worst, point = excess.max(axis=2), excess.argmax(axis=2)
        panel = np.arange(self.panels)
        alike = np.unique(self.phases[i].piece, axis=0, return_inverse=True)[1]
        groups = np.split(np.argsort(alike, kind="stable"), np.cumsum(np.bincount(alike))[:-1])
        chosen = [np.stack([each[worst[each].argmax(axis=0)], panel]) for each in groups]
        motion, where = np.concatenate(chosen, axis=1)
        order = np.argsort(-worst[motion, where])[:_CUTS]
        order = order[worst[motion[order], where[order]] > _VIOLATED]
        if len(order):
            motion, where = motion[order], where[order]
            self._add(i, motion, where, point[motion, where])
        return bool(len(order))
