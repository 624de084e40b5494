"""Legs: constant body twists between two poses, how long they take, and which are proved clear.

A leg is proved by distances at few poses, and by how far any point travels between them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.problem.tolerances import ROUNDING_M, UNSEEN_M
from twosra_mpc.robot.coordinates import Array, wrapped


def twists(start: Array, end: Array, turns_rad: Array | None = None) -> Array:
    """Displacement (s_u, s_v, s_r) of b0 in its own frame by a constant twist, (..., 3) [m, rad].

    Args:
        start: Poses, (..., 3) [m, m, rad].
        end: Poses, (..., 3).
        turns_rad: By how much it turns; left out, by the least of what ends at that heading.
    """
    turn = wrapped(end[..., 2] - start[..., 2]) if turns_rad is None else turns_rad
    shift = end[..., :2] - start[..., :2]
    heading = start[..., 2] + turn / 2  # the chord is at half the turn
    c, s = np.cos(heading), np.sin(heading)
    stretched = 1 / np.sinc(turn / (2 * np.pi))
    along = stretched * (c * shift[..., 0] + s * shift[..., 1])
    across = stretched * (c * shift[..., 1] - s * shift[..., 0])
    return np.stack([along, across, turn], axis=-1)


def moved(start: Array, twist: Array, share: Array) -> Array:
    """Poses after a share of displacements by constant twists, (..., 3)."""
    turn = twist[..., 2] * share
    chord = share * np.sinc(turn / (2 * np.pi))
    heading = start[..., 2] + turn / 2
    c, s = np.cos(heading), np.sin(heading)
    x = start[..., 0] + chord * (c * twist[..., 0] - s * twist[..., 1])
    y = start[..., 1] + chord * (s * twist[..., 0] + c * twist[..., 1])
    return np.stack([x, y, start[..., 2] + turn], axis=-1)


def times_at_speed_s(rows: Array, twist: Array) -> Array:
    """Least times of displacements (..., 3) at full speed, (...,) [s], by `drive_rows` (m, 3)."""
    found: Array = np.abs(twist @ rows.T).max(axis=-1)
    return found


def times_from_rest_s(at_speed_s: Array, gained_s2: Array) -> Array:
    """The same from rest to rest, zero for what does not move, (...,) [s].

    ``gained_s2`` is what they travel divided by the largest acceleration, in any unit of length.
    """
    ramp_s = gained_s2 / np.maximum(at_speed_s, 1e-300)
    found: Array = np.where(at_speed_s >= ramp_s, at_speed_s + ramp_s, 2 * np.sqrt(gained_s2))
    return found


def continued(poses: Array) -> Array:
    """Poses with headings that go on over full turns; one that is as before is left out."""
    poses = poses.copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    moving = np.abs(np.diff(poses, axis=0)).max(axis=1) > 1e-12
    kept: Array = poses[np.append(True, moving)]
    return kept


Clear = Callable[[Array], Array]  # poses (m, 3) -> lower bounds of what they keep, (m,) [m]

_LOOKED_AT_M = UNSEEN_M / 4  # of travel to the next pose that is looked at


def clear_legs(
    clear: Clear, start: Array, twist: Array, radius_m: float, needed_m: Array | float
) -> NDArray[np.bool_]:
    """True for legs that are proved to keep a distance all the way, (m,).

    On a share w of a leg no point of the robot travels more than (|(s_u, s_v)| + radius |s_r|) w.
    So a pose that keeps d proves what is within (d - needed) / travel of it; one that just keeps
    what is needed, what is so near that nothing else can be seen there.

    Args:
        clear: Lower bounds of what poses keep.
        start: Where legs start, (m, 3).
        twist: Their displacements, (m, 3).
        radius_m: Farthest point of the robot from b0.
        needed_m: What legs must keep, (m,) or one number.
    """
    travel = np.hypot(twist[:, 0], twist[:, 1]) + radius_m * np.abs(twist[:, 2]) + 1e-12
    needed = np.broadcast_to(needed_m, travel.shape)
    good = np.ones(len(travel), dtype=bool)
    leg, low, high = np.arange(len(travel)), np.zeros(len(travel)), np.ones(len(travel))
    while len(leg):
        middle = (low + high) / 2
        kept = clear(moved(start[leg], twist[leg], middle)) - needed[leg]
        proved = np.maximum(kept, _LOOKED_AT_M) / travel[leg]
        rest = low + proved < middle
        good[leg[kept < -ROUNDING_M]] = False
        open_ = rest & good[leg]
        leg, low, high = (
            np.tile(leg[open_], 2),
            np.concatenate([low[open_], (middle + proved)[open_]]),
            np.concatenate([(middle - proved)[open_], high[open_]]),
        )
    return good
