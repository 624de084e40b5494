r"""Bound on what the change of pose costs a mode sequence whose bends are known, or nearly so.

Let S_i be functions of pose and bend, one for each phase i, with common gradients p and a,

.. math:: S_i = p \cdot (x, y) + a \phi + U_i(\phi, W),

U_i of period 2 pi in the heading, and bilinear between edges of heading and bend (of a rigid phase,
of the heading alone). If S_i grows by at most g_i per second whatever the robot does in phase i,
and U_{i+1} where phase i + 1 begins less U_i where phase i may end is at most e_i at every heading,
then summing over the phases of a plan

.. math:: \sum_i g_i\,(t_{end,i} - t_{start,i}) \;\ge\;
    p \cdot \Delta(x, y) + a \Delta\phi + U_n(\phi_{goal}, d_n) - U_0(0, 0) - \sum_i e_i,

a linear constraint on the event times, and the least cost of the temporal network with this
constraint is a lower bound. It holds for any p and U, however the robot moves: it may rest, turn
about, or bend too far and back. Where a bend d_i is known to within bounds, the worst in them
counts; of the goal poses the one counts that gains the least, so p has no part along a coordinate
that is free, and of a free heading the least U_n counts. Plans that turn left by some angle modulo
2 pi, or by more, gain at least a times that where a >= 0, and those that turn right where a <= 0:
each are bounded by a program of their own, and the worse bound is that of all.

Phases begin and end at rest. With G what S_i may grow by where only the full speed of units or
wheels limits it, which takes them a ramp R to reach, growth after t is at most G t / R too: so a
phase that lasts T counts as T - r with r = R g_i / G, or T^2 / (4 r) where it lasts less than 2 r.

In a rigid phase g_i is a maximum over the vertices of a polytope of twists; in a soft phase over
boxes of shapes on the line of its bends, out to the curvature limits, and the corners of the two
units' speeds that bend no segment too fast (growth is linear in both, and what limits the wheels
besides is left out). Along a box growth is linear, but for how motions change: its ends count.

On a panel of headings of half-width h about phi_m the arc R(phi) w lies in the triangle of its ends
and R(phi_m) w / cos h, so testing these three points proves a growth on the whole panel. Where on
the panel U is taken for them is off by half of h / sin h - 1 of it at most.

The S_i that give the highest bound solve a linear program together with the dual of the temporal
network (y are its multipliers, and g_i the price of time in phase i). Most of its rows are idle, so
it is solved with few of them and those that are violated are added. What is returned is always
proved by the true maxima, whether or not the program was solved to the end, or well.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.planning.bounds.linear_program import Program, Rows
from twosra_mpc.planning.bounds.pose_phases import Indices, PhaseMotions, PoseTask
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.timing import EventLayout

PANELS = 12  # of headings, and one edge more near the goal's
_GRID = 5  # decimals of a turn to which edges are rounded, so that no panel is tiny
_ROUNDS = 20  # of adding rows
_CUTS = 400  # rows added a phase and round
_VIOLATED = 1e-4  # s/s
_FIRST = 10  # motions of a phase of which there are rows at first
_AHEAD: Array = np.array([0.0, 1.0, 0.5])  # where on a panel the points are that are tested
_INSTANT_S = 1e-12  # ramps are longer
_ROUNDING = 1e-5  # relative allowance for rounding, and for shapes known to 1e-9 rad


class PoseConstraint(NamedTuple):
    """sum of rates[i] (duration of phase i, at full speed) >= need for every plan [s].

    Full speed takes ramps_s[i] to reach from rest, (phases,).
    """

    rates: Array
    need: float
    ramps_s: Array

    def at_speed_s(self, lasting_s: Array) -> Array:
        """Durations at full speed of phases that last so long, from rest to rest [s], (phases,)."""
        ramps_s = np.maximum(self.ramps_s, _INSTANT_S)
        return lasting_s - ramps_s * (1 - (1 - np.minimum(1.0, lasting_s / (2 * ramps_s))) ** 2)


class PoseProgram:
    """The linear program for p, U, g, y, the least U_n at the goal, the sizes of p, and a.

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
        n = len(phases)
        self.u = 2 + self.panels * np.cumsum([0, *(len(phase.edges) for phase in phases)])
        self.g = int(self.u[-1])
        self.y = self.g + n
        self.m = self.y + len(least)
        self.a = self.m + 3
        self.width = self.a + 1
        self.gain = self._gain(list(least.values()))
        self.program = Program(-self.gain, self._bounds(task).tolist())
        # Those that are not in the program yet: limited by costs, and by 0.
        self.rows = [self._balance(layout, least), self._switches(), self._least_gain()]
        self.limits = cost[: layout.origin]
        for i, phase in enumerate(phases):
            step = max(1, len(phase.motions) // _FIRST)
            motion, panel = np.meshgrid(
                np.arange(0, len(phase.motions), step), np.arange(0, self.panels, 3)
            )
            self._add(i, motion.ravel(), panel.ravel(), np.full(motion.size, 4))

    def _goal_headings(self, task: PoseTask) -> Array:
        """Headings of the goal at one of which U_n is least, as shares of edges, (n, panels)."""
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
        gain[self.u[0] + self.panels * np.arange(len(self.phases[0].edges))] = -self.phases[0].begin
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
        bounds[2 : self.g] = -2 * most, 2 * most
        bounds[self.g : self.y, 0] = bounds[self.y : self.m, 0] = 0.0
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
        """U of a phase is no larger where it begins than that before where it may end."""
        rows, at = list[Array](), np.arange(self.panels)
        for i, (before, after) in enumerate(itertools.pairwise(self.phases)):
            for end in before.ends:
                row = np.zeros((self.panels, self.width))
                for k, share in enumerate(end):
                    row[at, self.u[i] + self.panels * k + at] = -share
                for k, share in enumerate(after.begin):
                    row[at, self.u[i + 1] + self.panels * k + at] = share
                rows.append(row)
        return Rows.of(np.reshape(rows, (-1, self.width)))

    def _least_gain(self) -> Rows:
        """What is gained is no more than U at the goal; abs(p) are at least p."""
        ends = self.phases[-1].ends
        rows = np.zeros((len(self.goal) * len(ends) + 4, self.width))
        last = np.einsum("gp,en->genp", self.goal, ends).reshape(len(rows) - 4, -1)
        rows[:-4, self.u[-2] : self.g] = -last
        rows[:-4, self.m] = 1.0
        rows[-4:, :2] = np.vstack([np.eye(2), -np.eye(2)])
        rows[-4:, self.m + 1 : self.a] = -np.vstack([np.eye(2), np.eye(2)])
        return Rows.of(rows)

    def _add(self, i: int, motion: Indices, panel: Indices, point: Indices) -> None:
        """Rows: growth of S_i by some motions, at some points of some panels, is at most g_i."""
        phase, count = self.phases[i], len(motion)
        u, v, r, bending = phase.motions[motion].T
        c, s = self.cos[panel, point // 2], self.sin[panel, point // 2]
        steep, bent = r / self.widths[panel], bending / phase.widths[phase.piece[motion]]
        along, ahead = phase.at[motion, point % 2], _AHEAD[point // 2]
        low = phase.piece[motion]
        high = np.minimum(low + 1, len(phase.edges) - 1)
        turned = (panel + 1) % self.panels
        values = [c * u - s * v, s * u + c * v, -np.ones(count), r]
        values += [-steep * (1 - along) - bent * (1 - ahead), steep * (1 - along) - bent * ahead]
        values += [-steep * along + bent * (1 - ahead), steep * along + bent * ahead]
        columns = [
            np.zeros(count, dtype=np.intp),
            np.ones(count, dtype=np.intp),
            np.full(count, self.g + i),
            np.full(count, self.a),
            *(self.u[i] + self.panels * edge + p for edge in (low, high) for p in (panel, turned)),
        ]
        row, column = np.tile(np.arange(count), len(columns)), np.concatenate(columns)
        self.rows.append(Rows.summed(count, row, column, np.concatenate(values)))

    def best(self, value: Callable[[PoseConstraint], float], enough: float) -> Array | None:
        """The x of which a constraint of the highest value is proved, up to what is enough."""
        best, found = -math.inf, None
        for _ in range(_ROUNDS):
            if (x := self.solve()) is None:
                break
            constraint, violated = self.read(x)
            if (reached := value(constraint)) >= best:
                best, found = reached, x
            if best >= enough or not violated:
                break
        return found

    def solve(self) -> Array | None:
        """Optimum of the program with the rows it has; None if the solver gives up."""
        rows = Rows.stacked(self.rows)
        limits = np.pad(self.limits, (0, len(rows.starts) - 1 - len(self.limits)))
        self.rows, self.limits = [], limits[:0]
        try:
            optimum = self.program.optimum(rows, limits)
        except ArithmeticError:
            return None
        return None if optimum is None else optimum.x

    def read(self, x: Array) -> tuple[PoseConstraint, bool]:
        """What S in x is worth; adds the rows it violates, and tells whether there are any."""
        growths = [self.growth(phase, i, x) for i, phase in enumerate(self.phases)]
        violated = [self._cut(i, each - x[self.g + i]) for i, (each, _) in enumerate(growths)]
        rates = list(map(_largest, growths))
        return self._constraint(x, rates, np.zeros(len(rates))), any(violated)

    def prove(self, x: Array, phases: Sequence[PhaseMotions]) -> PoseConstraint:
        """What S in x is worth, by how these phases move and start."""
        rates = [_largest(self.growth(phase, i, x)) for i, phase in enumerate(phases)]
        ramps_s = np.zeros(len(phases))
        for i, (phase, rate) in enumerate(zip(phases, rates, strict=True)):
            if phase.starting and rate:
                fast = _largest(self.growth(phase.starting, i, x))
                ramps_s[i] = phase.ramp_s * rate / max(fast, rate)
        return self._constraint(x, rates, ramps_s)

    def _constraint(self, x: Array, rates: list[float], ramps_s: Array) -> PoseConstraint:
        p = x[:2] * self.given
        levels = [self._levels(i, x) for i in range(len(self.phases))]
        pairs = itertools.pairwise(zip(self.phases, levels, strict=True))
        steps = [
            float((after[0].begin @ after[1] - before[0].ends @ before[1]).max())
            for before, after in pairs
        ]
        last = self.phases[-1].ends @ levels[-1] @ self.goal.T
        first = self.phases[0].begin @ levels[0][:, 0]
        parts = [p * self.task.shift, last.min(), -first, -np.array(steps)]
        parts += [-np.where(self.given, self.task.reach, 0.0) * np.abs(p), x[self.a] * self.side[1]]
        gain, size = (sum(float(np.sum(f(part))) for part in parts) for f in (np.array, np.abs))
        allowed = np.array(rates) * (1 + _ROUNDING)
        return PoseConstraint(allowed, gain - _ROUNDING * size, ramps_s)

    def _levels(self, i: int, x: Array) -> Array:
        """U of a phase, at edges of pieces and of panels."""
        return x[self.u[i] : self.u[i + 1]].reshape(-1, self.panels)

    def growth(self, phase: PhaseMotions, i: int, x: Array) -> tuple[Array, Array]:
        """Growth of S_i by every motion at six points of every panel, and how much it may be off.

        Shapes (n, panels, 6) and (n, panels).
        """
        p, a, levels = x[:2] * self.given, x[self.a], self._levels(i, x)
        high = np.minimum(np.arange(len(levels)) + 1, len(levels) - 1)
        turning = a + (np.roll(levels, -1, axis=1) - levels) / self.widths
        bending = (levels[high] - levels) / phase.widths[:, None]
        u, v, r, w = phase.motions.T[:, :, None, None]
        low, along = phase.piece, phase.at[:, None, :]
        turn = turning[low][..., None] * (1 - along) + turning[high[low]][..., None] * along
        first, last = bending[low][..., None], np.roll(bending, -1, axis=1)[low][..., None]
        bend = first * (1 - _AHEAD) + last * _AHEAD
        forth, across = p[0] * self.cos + p[1] * self.sin, p[1] * self.cos - p[0] * self.sin
        growth = (u * forth + v * across + w * bend)[..., None] + (r * turn)[:, :, None, :]
        off, half = phase.slack.T[:, :, None], self.widths / 2
        twist = (half / np.sin(half) - 1) / 2 * np.abs(last - first)[..., 0]
        loose = np.hypot(*p) * np.hypot(*off[:2]) + twist * (np.abs(w[..., 0]) + off[3])
        loose += off[2] * np.abs(turn).max(axis=2) + off[3] * np.abs(bend).max(axis=2)
        return growth.reshape(*growth.shape[:2], -1), loose

    def _cut(self, i: int, excess: Array) -> bool:
        """Add the worst motion of every panel and piece, where it violates its row."""
        phase = self.phases[i]
        worst, point = excess.max(axis=2), excess.argmax(axis=2)
        panel, groups = np.arange(self.panels), range(int(phase.piece.max()) + 1)
        alike = [np.flatnonzero(phase.piece == each) for each in groups]
        chosen = [np.stack([each[worst[each].argmax(axis=0)], panel]) for each in alike]
        motion, where = np.concatenate(chosen, axis=1)
        order = np.argsort(-worst[motion, where])[:_CUTS]
        order = order[worst[motion[order], where[order]] > _VIOLATED]
        if len(order):
            motion, where = motion[order], where[order]
            self._add(i, motion, where, point[motion, where])
        return bool(len(order))


def _largest(growth: tuple[Array, Array]) -> float:
    """Largest growth; never negative, as the robot may rest."""
    here, loose = growth
    return max(0.0, float((here.max(axis=2) + loose).max()))
