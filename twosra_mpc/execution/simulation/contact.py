"""Whether a simulated robot has touched anything, and how near it came."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

_STEP_M = 1e-3  # the outline moves no farther between two looks
_GRID_M = 3e-3  # more than two distances of one place by kept footprints differ


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
    from twosra_mpc.space.proximity import Proximity

    time_s, q = _finely(geometry, truth)
    around = Proximity(World(obstacles=world.obstacles), geometry)
    roughly = around.distances(q)[:, :-1].min(axis=1)
    rows = np.flatnonzero(roughly <= max(float(roughly.min()), 0.0) + _GRID_M)
    distances_m = around.distances(q[rows], exactly=True)[:, :-1]
    least_m = distances_m.min(axis=1)
    at = int((least_m <= 0).argmax() if (least_m <= 0).any() else least_m.argmin())
    return Approach(
        clearance_m=float(least_m.min()),
        name=world.names[int(distances_m[at].argmin())],
        time_s=float(time_s[rows[at]]),
        touched=bool(least_m[at] <= 0),
    )


def _finely(geometry: Geometry, truth: Truth) -> tuple[Array, Array]:
    """Times and configurations between which no point of the robot moves far; no place twice."""
    from twosra_mpc.space.footprint import footprint, reach_per_curvature_m2

    radius_m = footprint(geometry, np.zeros(geometry.segments)).radius_m
    arms_m = np.array([1.0, 1.0, radius_m, *reach_per_curvature_m2(geometry)])
    moved_m = np.abs(np.diff(truth.q, axis=0)) @ arms_m
    steps = np.ceil(moved_m / _STEP_M).astype(int)
    places = [truth.q[:1]]
    times = [truth.time_s[:1]]
    for k in np.flatnonzero(steps):
        shares = np.arange(1, steps[k] + 1) / steps[k]
        places.append(truth.q[k] + shares[:, None] * (truth.q[k + 1] - truth.q[k]))
        times.append(truth.time_s[k] + shares * (truth.time_s[k + 1] - truth.time_s[k]))
    return np.concatenate(times), np.concatenate(places)
