"""Task of the pose, and what the phases of a mode sequence can do to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.bounds.rigid_motion import rows_of_any, twist_vertices
from twosra_mpc.robot.coordinates import WHEELS, Array
from twosra_mpc.robot.modes import Mode

Indices = NDArray[np.intp]
Shape = tuple[float, ...]  # curvatures [1/m]
Bounds = tuple[tuple[float, float], ...]  # (low, high) of every segment

_STILL = 1e-300  # 1/m/s: added to rates that may be 0
_MARGIN, _SHORT = 1e-4, 2e-5  # of W: beyond its room, and what all pieces are longer than
_INSIDE, _OUTSIDE = 4, 2  # pieces of B within the bend, on each side


@dataclass(frozen=True)
class PoseTask:
    """The change of pose a plan must bring about, and how fast its phases can.

    Attributes:
        heading: At the start, from the world's x axis [rad].
        shift: Change of (x, y) in the world, to the middle of what the goal allows [m], (2,).
        reach: Half-sides of that, infinite where free; ``shift`` is 0 there [m], (2,).
        turn: Change of heading to the middle of what the goal allows, modulo full turns [rad].
        turn_reach: Half of what it allows; pi where the heading is free [rad].
        known_s: Duration of a rigid motion in the start shape that makes the change [s].
        speed_rows: (least, largest kappa (n,)) -> rows M with abs(M xi) <= 1 for every rigid twist
            in a shape between, and how far off they may be, each (m, 3).
        ramp_s: In which a locomotion unit gets from rest to full speed at least [s].
        wheel_ramp_s: The same of a wheel.
        soft_motions: (mode, least W (n, m), largest W (n, m)) -> lower and upper bounds, each
            (2, 4 + n, m), of twist (u, v, r), dW/dt and the rates of all curvatures by LU1 and by
            LU2 at full speed, in these boxes.
        changes: (mode, middles (n, m), half-widths (n,) of boxes of curvatures [1/m]) -> dW/dt by
            LU1 and LU2 at full speed, and twist and change of all curvatures per dW, in the
            middles, (2, 4 + n, m); and bounds of their slopes in the boxes, (2, n, 2, 4 + n, m).
        bend_rates_per_m_s: Largest rate of each curvature, (n,).
        overlaps: (middles (m, n), half-widths (n,) of boxes of curvatures) -> whether parts overlap
            in all of a box, (m,).
    """

    heading: float
    shift: Array
    reach: Array
    turn: float
    turn_reach: float
    known_s: float
    speed_rows: Callable[[Shape, Shape], tuple[Array, Array]]
    ramp_s: float
    wheel_ramp_s: float
    soft_motions: Callable[[Mode, Array, Array], tuple[Array, Array]]
    changes: Callable[[Mode, Array, Array], tuple[Array, Array]]
    bend_rates_per_m_s: Array
    overlaps: Callable[[Array, Array], NDArray[np.bool_]]

    @property
    def sides(self) -> tuple[tuple[float, float], ...]:
        """1 and the least turn of some plans, -1 and the largest of all others; (0, 0): of all."""
        if self.turn_reach >= math.pi:
            return ((0.0, 0.0),)
        left = self.turn % math.tau
        return (1.0, left - self.turn_reach), (-1.0, left - math.tau + self.turn_reach)

    def rigid_phase(self, least: Shape, most: Shape) -> PhaseMotions | None:
        """Motions of a rigid phase in a shape between these; None if nothing limits it."""
        rows, off = self.speed_rows(least, most)
        if (moving := self._driving(twist_vertices(rows_of_any(rows, off)))) is None:
            return None
        starting = self._driving(twist_vertices(rows_of_any(rows[:WHEELS], off[:WHEELS])))
        return moving._replace(starting=starting, ramp_s=self.wheel_ramp_s)

    @staticmethod
    def _driving(twists: Array | None) -> PhaseMotions | None:
        if twists is None:
            return None
        motions, one = np.pad(twists, ((0, 0), (0, 1))), np.ones((1, 1))
        piece, at = np.zeros(len(twists), dtype=np.intp), np.zeros((len(twists), 2))
        return PhaseMotions(motions, np.zeros_like(motions), piece, at, np.zeros(1), one[0], one)

    def soft_phase(
        self,
        mode: Mode,
        origin: Bounds,
        bend: tuple[float, float],
        room: tuple[float, float],
        boxes: int,
    ) -> PhaseMotions | None:
        """Motions of a soft phase that bends by something in ``bend`` and strays within ``room``.

        In about so many boxes of shapes; None if nothing limits it.
        """
        edges = pieces_of(bend, room)
        counts = np.ceil(boxes * np.diff(edges) / np.ptp(edges)).astype(int)
        of_piece = np.repeat(np.arange(len(counts)), counts)
        parts = [np.arange(count + 1) / count for count in counts]
        at = np.concatenate([np.stack([part[:-1], part[1:]], axis=1) for part in parts])
        along = np.append(edges[of_piece] + np.diff(edges)[of_piece] * at[:, 0], edges[-1])
        low, high = (
            np.array([w[end] + soft * ends for w, soft in zip(origin, mode, strict=True)])
            for end, ends in enumerate((along[:-1], along[1:]))
        )
        lower, upper = self.soft_motions(mode, low, high)
        if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
            return None
        middle, half = (upper + lower)[:, :4] / 2, (upper - lower)[:, :4] / 2
        soft = np.flatnonzero(mode)
        turning = lower[:, 4 + soft], upper[:, 4 + soft]
        quickest = self.bend_rates_per_m_s[soft]
        inside = edges[(edges > bend[0]) & (edges < bend[1])]
        ends = np.array([between(edges, w) for w in (*bend, *inside)])

        def moving(shares: Array) -> PhaseMotions:
            motions = np.einsum("kum,ucm->kmc", [*shares, *-shares], middle).reshape(-1, 4)
            of_boxes = (half[0] + half[1]).T, of_piece[:, None], at
            slack, piece, place = (np.tile(each, (2 * len(shares), 1)) for each in of_boxes)
            begin = between(edges, 0.0)
            return PhaseMotions(motions, slack, piece[:, 0], place, edges, begin, ends)

        starting = moving(corners(math.inf * quickest, *turning))
        return moving(corners(quickest, *turning))._replace(starting=starting, ramp_s=self.ramp_s)


def corners(quickest: Array, least: Array, most: Array) -> Array:
    """Shares of full speed at corners of what the units may do in boxes, (k, 2, m).

    No soft segment bends faster than its limit, so both do not go on at full speed. Opposite
    corners are left out.

    Args:
        quickest: Largest rates of the curvatures of soft segments [1/m/s], (soft,).
        least: Of these rates in the boxes, by unit at full speed, (2, soft, m).
        most: The same.
    """
    least, most = (np.maximum(side, 0.0) + _STILL for side in (least, most))
    left = quickest[:, None] - least[::-1]  # what the other one's least leaves to each
    one, other = np.clip(np.maximum(left / least, left / most).min(axis=1), -1.0, 1.0)
    full = np.ones_like(one)
    return np.array([[one, full], [full, other], [full, -full]])


def pieces_of(bend: tuple[float, float], room: tuple[float, float]) -> Array:
    """Edges of the pieces of a change of W: on the way from 0 to the bend, and on each side."""
    low, high = min(0.0, bend[0]), max(0.0, bend[1])
    edges = np.concatenate(
        [
            np.linspace(min(room[0], low) - _MARGIN, low, _OUTSIDE, endpoint=False),
            np.linspace(low, high, _INSIDE, endpoint=False),
            np.linspace(high, max(room[1], high) + _MARGIN, _OUTSIDE + 1),
        ]
    )
    return edges[np.append(True, np.diff(edges) > _SHORT)]


def between(edges: Array, w: float) -> Array:
    """Shares of edges in what is linear between them, at w, (n,)."""
    return np.array([np.interp(w, edges, each) for each in np.eye(len(edges))])


class PhaseMotions(NamedTuple):
    """Extreme motions of a phase.

    Attributes:
        motions: (u, v, r, dW/dt), (n, 4).
        slack: How far the true motions may lie from them, (n, 4).
        piece: Pieces of the change of W in which they take place, (n,).
        at: From where to where in it, as shares, (n, 2).
        edges: Of the pieces, (m,).
        begin: Where the phase begins, as shares of the edges, (m,).
        ends: Where it may end: what is linear between edges is least at one of these, (k, m).
        starting: Motions at full speed of units or wheels, whatever else limits them.
        ramp_s: In which these get there from rest [s]; 0 if that is not known.
    """

    motions: Array
    slack: Array
    piece: Indices
    at: Array
    edges: Array
    begin: Array
    ends: Array
    starting: PhaseMotions | None = None
    ramp_s: float = 0.0

    @property
    def widths(self) -> Array:
        """Of the pieces; 1 beyond the last, (m,)."""
        return np.append(np.diff(self.edges), 1.0)
