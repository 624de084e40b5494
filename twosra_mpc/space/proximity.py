"""How near configurations are to what is around the robot, whatever their shapes."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.footprint import footprint, reach_per_curvature_m2
from twosra_mpc.space.separation import FAR_M, Separation

EDGE = "the edge of the workspace"
_STEP_PER_M = 0.5  # between the shapes that footprints are kept of


class Nearest(NamedTuple):
    """Distance to an obstacle, or to the edge of the workspace, and its name."""

    distance_m: float
    name: str


class Proximity:
    """Lower bounds of distances to obstacles and edges, for configurations of any shapes.

    Footprints are kept for curvatures on a grid; a configuration off it is taken nearer by as much
    as its points may be away from those of its neighbour on the grid: 1 mm for ``2sra-v1``.
    """

    def __init__(self, world: World, geometry: Geometry) -> None:
        """Look at a world with the footprints of a robot."""
        self.world, self.geometry = world, geometry
        self._within = World(workspace=world.workspace)
        self._separations = lru_cache(maxsize=64)(self._of_shape)

    def distances(self, q: Array, *, exactly: bool = False) -> Array:
        """Distance of each configuration (m, 3 + n) to each obstacle and the edges, (m, k + 1) [m].

        At most `FAR_M`; negative by the depth where they overlap. ``exactly`` asks for footprints
        of these very shapes.
        """
        kappa = q[:, POSE:] if exactly else np.round(q[:, POSE:] / _STEP_PER_M) * _STEP_PER_M
        shapes, which = np.unique(kappa, axis=0, return_inverse=True)
        found = np.full((len(q), len(self.world.obstacles) + 1), FAR_M)
        for k, shape in enumerate(shapes):
            rows = np.flatnonzero(which.ravel() == k)
            found[rows] = self._by_obstacle(tuple(shape.tolist()), q[rows, :POSE])
        return found - self._moved_m(q[:, POSE:] - kappa)[:, None]

    def nearest(self, q: Array) -> Nearest:
        """What a configuration (3 + n,) is nearest to."""
        distances = self.distances(q[None], exactly=True)[0]
        k = int(distances.argmin())
        return Nearest(float(distances[k]), (*self.world.names, EDGE)[k])

    def _of_shape(self, kappa: tuple[float, ...]) -> tuple[Separation, Separation]:
        """Separation of one shape from the obstacles, and from the edges."""
        outline = footprint(self.geometry, kappa)
        return Separation(outline, self.world, 0.0), Separation(outline, self._within, 0.0)

    def _by_obstacle(self, kappa: tuple[float, ...], poses: Array) -> Array:
        around, within = self._separations(kappa)
        parts, owner = around.to_obstacles(poses), around.obstacle_of_part
        owned = [parts[:, owner == i].min(axis=1) for i in range(len(self.world.obstacles))]
        return np.column_stack([*owned, within.distances(poses)])

    def _moved_m(self, kappa: Array) -> Array:
        """How far points move at most as curvatures change by these (m, n), (m,) [m]."""
        left = self.geometry.inner_link_of_b0
        reach = np.abs(kappa) * reach_per_curvature_m2(self.geometry)
        most: Array = np.maximum(reach[:, :left].sum(axis=1), reach[:, left:].sum(axis=1))
        return most
