"""Task of the pose, and what the phases of a mode sequence can do to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.bounds.rigid_motion import rows_of_any, twist_vertices
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode

Indices = NDArray[np.intp]
Shape = tuple[float, ...]  # curvatures [1/m]
Bounds = tuple[tuple[float, float], ...]  # (low, high) of every segment

BOXES = 24  # of shapes in a piece of B
_STILL = 1e-300  # 1/m/s: added to rates that may be 0
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
        if (twists := twist_vertices(rows_of_any(*self.speed_rows(least, most)))) is None:
            return None
        motions, none = np.pad(twists, ((0, 0), (0, 1))), np.zeros((len(twists), 1), dtype=np.intp)
        return PhaseMotions(motions, np.zeros_like(motions), none, np.zeros(1), np.ones(1, bool))

    def soft_phase(
        self, mode: Mode, origin: Bounds, bend: tuple[float, float], room: tuple[float, float]
    ) -> PhaseMotions | None:
        """Motions of a soft phase that bends by something in ``bend`` and strays within ``room``.

        None if nothing limits it. Where there is no room, pieces have no length.
        """
        edges, bends, settled = pieces_of(bend, room)
        steps = np.linspace(0.0, 1.0, BOXES, endpoint=False)
        along = np.append((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel(), edges[-1])
        low, high = (
            np.array([w[end] + soft * ends for w, soft in zip(origin, mode, strict=True)])
            for end, ends in enumerate((along[:-1], along[1:]))
        )
        lower, upper = self.soft_motions(mode, low, high)
        if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
            return None
        middle, half = (upper + lower)[:, :4] / 2, (upper - lower)[:, :4] / 2
        turning = (side[:, 4 + np.flatnonzero(mode)] for side in (lower, upper))
        shares = self.shares(mode, *turning)
        motions = np.einsum("kum,ucm->kmc", [*shares, *-shares], middle).reshape(-1, 4)
        slack = np.tile((half[0] + half[1]).T, (2 * len(shares), 1))
        piece = np.tile(np.repeat(np.arange(len(bends)), BOXES), 2 * len(shares))[:, None]
        return PhaseMotions(motions, slack, piece, bends, settled)

    def shares(self, mode: Mode, least: Array, most: Array) -> Array:
        """Shares of full speed at corners of what the units may do in boxes, (k, 2, m).

        No soft segment bends faster than its limit, so both do not go on at full speed. Opposite
        corners are left out.

        Args:
            mode: A soft mode.
            least: Of the rates of the curvatures of its soft segments, by unit, (2, soft, m).
            most: The same.
        """
        quickest = self.bend_rates_per_m_s[np.flatnonzero(mode), None]
        least, most = (np.maximum(side, 0.0) + _STILL for side in (least, most))
        left = quickest - least[::-1]  # what the other one's least leaves to each
        one, other = np.clip(np.maximum(left / least, left / most).min(axis=1), -1.0, 1.0)
        full = np.ones_like(one)
        return np.array([[one, full], [full, other], [full, -full]])


def pieces_of(
    bend: tuple[float, float], room: tuple[float, float]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Edges of the pieces of B, the change of W each surely makes, and whether that is all."""
    least, most = bend
    surely = min(bend, key=abs) if least * most > 0 else 0.0
    low, high = min(surely, 0.0), max(surely, 0.0)
    under, over = [least] if least < low else [], [most] if most > high else []
    first, last = min(least, low), max(most, high)
    edges = np.concatenate(
        [
            np.linspace(min(room[0], first), first, _OUTSIDE, endpoint=False),
            under,
            np.linspace(low, high, _INSIDE, endpoint=False),
            [high] if over else [],
            np.linspace(last, max(room[1], last), _OUTSIDE + 1),
        ]
    )
    settled = (edges[:-1] >= low) & (edges[1:] <= high)
    settled |= (edges[:-1] >= last) | (edges[1:] <= first)
    return edges, math.copysign(1.0, surely) * np.diff(np.clip(edges, low, high)), settled


class PhaseMotions(NamedTuple):
    """Extreme motions of a phase.

    Attributes:
        motions: (u, v, r, dW/dt), (n, 4).
        slack: How far the true motions may lie from them, (n, 4).
        piece: Pieces of B in which they take place, (n, k).
        bends: Change of W in each piece that the phase must make, (pieces,).
        settled: Whether it is known how much of a piece the phase bends; elsewhere B is flat.
    """

    motions: Array
    slack: Array
    piece: Indices
    bends: Array
    settled: NDArray[np.bool_]
