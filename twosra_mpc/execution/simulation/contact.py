"""Whether a simulated robot has touched anything, and how near it came."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

_STEP_M = 1e-3  # the outline moves no farther between two looks


class Approach(NamedTuple):
    """The closest approach to an obstacle in a run, or the first touch.

    Attributes:
        clearance_m: Least distance, at least: that of pieces that hold the robot; negative by the
            depth where they overlap.
        name: The obstacle.
        time_s: When.
        touched: Whether it was touched.
    """

    clearance_m: float
    name: str
    time_s: float
    touched: bool


def closest_approach(world: World, geometry: Geometry, truth: Truth) -> Approach | None:
    """How near to obstacles a robot of this geometry really came; None where there are none."""
    if not world.obstacles:
        return None
    from twosra_mpc.space.proximity import Proximity, arms_m

    time_s, q = _finely(arms_m(geometry), truth)
    distances_m = Proximity(world, geometry).distances(q)[:, :-1]
    least_m = distances_m.min(axis=1)
    at = int((least_m <= 0).argmax() if (least_m <= 0).any() else least_m.argmin())
    return Approach(
        clearance_m=float(least_m.min()),
        name=world.names[int(distances_m[at].argmin())],
        time_s=float(time_s[at]),
        touched=bool(least_m[at] <= 0),
    )


def _finely(arms_m: Array, truth: Truth) -> tuple[Array, Array]:
    """Times and configurations between which no point of the robot moves far; no place twice."""
    moved_m = np.abs(np.diff(truth.q, axis=0)) @ arms_m
    steps = np.ceil(moved_m / _STEP_M).astype(int)
    places = [truth.q[:1]]
    times = [truth.time_s[:1]]
    for k in np.flatnonzero(steps):
        shares = np.arange(1, steps[k] + 1) / steps[k]
        places.append(truth.q[k] + shares[:, None] * (truth.q[k + 1] - truth.q[k]))
        times.append(truth.time_s[k] + shares * (truth.time_s[k + 1] - truth.time_s[k]))
    return np.concatenate(times), np.concatenate(places)
