"""Legs proved clear: distances at few poses, and how far any point travels between them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.problem.tolerances import ROUNDING_M, UNSEEN_M
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.screws import moved

Clear = Callable[[Array], Array]  # poses (m, 3) -> lower bounds of what they keep, (m,) [m]

_LOOKED_AT_M = UNSEEN_M / 4  # of travel to the next pose that is looked at


def clear_legs(
    clear: Clear, start: Array, twist: Array, radius_m: float, needed_m: Array | float
) -> NDArray[np.bool_]:
    """Which legs are proved to keep a distance all the way, (m,).

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
