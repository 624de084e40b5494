r"""What the change of pose costs any plan, whatever its mode sequence.

As in ``rigid_motion``, let S(x, y, phi) = p . (x, y) + C(phi) grow by at most 1 per second while
the robot drives rigidly in its start shape, here at every heading, with C of period 2 pi. In any
other phase i S grows by at most some rate g_i: in a rigid phase of known shape the maximum over the
vertices of its polytope of twists and all headings; in a soft mode

.. math:: g = \max\; |p|\,|(u, v)| + |r|\,\max |C'|

over the shapes it can take, with both locomotion units at up to full speed. Summing over a plan,

.. math:: \sum_i g_i\,(t_{end,i} - t_{start,i}) \ge S(goal) - S(start).

Where a soft phase must bend by a known amount, which takes T at least, it is outside of the shapes
of that bend for no longer than it lasts beyond T; so S grows by at most g t - (g - g') T in time t,
with g' the rate in those shapes.

The linear program of the sequence bound takes this as one more constraint. p and C are those that
make the right hand side largest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.modes import Mode
from twosra_mpc.search.linear_program import minimise
from twosra_mpc.search.rigid_motion import twist_vertices

Array = NDArray[np.float64]

_PANELS = 96
_ROUNDING = 1e-5  # relative allowance for rounding, and for shapes known to 1e-6 rad


@dataclass(frozen=True)
class PoseTask:
    """The change of pose a plan must bring about, and how fast its phases can.

    Attributes:
        shift: Change of (x, y) in the start frame of heading [m], (2,).
        turn: Change of heading, modulo full turns [rad].
        known_s: Duration of a rigid motion in the start shape that makes the change [s].
        wheel_matrix: (kappa1, kappa2) -> V of the rigid mode, (4, 3) [1/m, 1/m, 1].
        wheel_speed_rad_s: Wheel speed limit.
        start: Curvatures at the start [1/m].
        soft_speeds: mode -> upper bounds of |(u, v)| [m/s] and |r| [rad/s] in boxes that cover
            all shapes, (n,) each.
        soft_speeds_between: (mode, (W_1, W_2), change of W) -> the same for the shapes of a bend.
    """

    shift: Array
    turn: float
    known_s: float
    wheel_matrix: Callable[[tuple[float, float]], Array]
    wheel_speed_rad_s: float
    start: tuple[float, float]
    soft_speeds: Callable[[Mode], tuple[Array, Array]]
    soft_speeds_between: Callable[[Mode, tuple[float, float], float], tuple[Array, Array]]

    @cached_property
    def _subsolution(self) -> Subsolution | None:
        vertices = twist_vertices(self.wheel_matrix(self.start), self.wheel_speed_rad_s)
        return None if vertices is None else best_subsolution(vertices, self.shift, self.turn)

    @property
    def need_s(self) -> float:
        """S(goal) - S(start): the time it takes at rate 1."""
        found = self._subsolution
        return min(found.gain, self.known_s) * (1 - _ROUNDING) if found else 0.0

    def rigid_rate(self, shape: tuple[float, float] | None) -> float:
        """Largest growth of S per second in a rigid phase; inf if its shape is not known."""
        found = self._subsolution
        if found is None or shape is None:
            return math.inf
        vertices = twist_vertices(self.wheel_matrix(shape), self.wheel_speed_rad_s)
        return math.inf if vertices is None else found.growth(vertices) * (1 + _ROUNDING)

    def soft_rate(self, mode: Mode) -> float:
        """Largest growth of S per second in a soft phase, in any shape."""
        return self._largest(*self.soft_speeds(mode))

    def bending_rate(self, mode: Mode, origin: tuple[float, float], bend: float) -> float:
        """Largest growth of S per second in the shapes of a bend."""
        return self._largest(*self.soft_speeds_between(mode, origin, bend))

    def _largest(self, speed: Array, turning: Array) -> float:
        found = self._subsolution
        if found is None:
            return math.inf
        return float((np.linalg.norm(found.p) * speed + found.steepest * turning).max())


@dataclass(frozen=True, eq=False)
class Subsolution:
    """S on panels of headings; see the module.

    Attributes:
        p: Gradient along x and y [s/m], (2,).
        edges: Edges of the panels of headings, over one turn [rad], (n + 1,).
        slopes: C' on each panel [s/rad], (n,).
        gain: S(goal) - S(start) [s].
    """

    p: Array
    edges: Array
    slopes: Array
    gain: float

    @property
    def steepest(self) -> float:
        """Largest abs(C')."""
        return float(np.abs(self.slopes).max())

    def growth(self, vertices: Array) -> float:
        """Largest growth per second of twists (u, v, r) in the hull of ``vertices``, (n, 3)."""
        rows = _growth_rows(self.edges, vertices)
        return float((rows @ np.concatenate([self.p, self.slopes])).max())


def best_subsolution(vertices: Array, shift: Array, turn: float) -> Subsolution:
    """Find the S that grows most from start to goal (a linear program)."""
    turn = math.remainder(turn, math.tau)
    edges = np.unique([*np.linspace(-math.pi, math.pi, _PANELS + 1), 0.0, turn])
    middle, widths = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    between = (middle > min(0.0, turn)) & (middle < max(0.0, turn))
    gain = np.concatenate([shift, math.copysign(1.0, turn) * widths * between])
    rows = _growth_rows(edges, vertices)
    closed = np.concatenate([np.zeros(2), widths])  # C has period 2 pi
    rows = np.vstack([rows, closed, -closed])
    limits = np.concatenate([np.ones(len(rows) - 2), np.zeros(2)])
    optimum = minimise(-gain, rows, limits, [(None, None)] * len(gain))
    assert optimum is not None, "S = 0 is feasible"
    value, x = optimum
    return Subsolution(x[:2], edges, x[2:], -value)


def _growth_rows(edges: Array, vertices: Array) -> Array:
    """Rows a with a . (p, slopes) = growth, for every vertex at three points of every panel.

    On a panel of half-width h the arc R(phi) w lies in the triangle of its ends and of
    R(middle) w / cos h.
    """
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    count = len(middle)
    blocks = []
    for angle, size in (
        (middle - half, np.ones(count)),
        (middle + half, np.ones(count)),
        (middle, 1 / np.cos(half)),
    ):
        c, s = np.cos(angle) * size, np.sin(angle) * size
        for u, v, r in vertices:
            turned = np.column_stack([c * u - s * v, s * u + c * v])
            blocks.append(np.hstack([turned, np.eye(count) * r]))
    return np.vstack(blocks)
