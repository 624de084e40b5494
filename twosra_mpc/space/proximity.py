"""How near configurations are to what is around the robot, obstacle by obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.footprint import footprints, reach_per_curvature_m2
from twosra_mpc.space.separation import Surroundings, placed

EDGE = "the edge of the workspace"
_BATCH = 256  # configurations


class Nearest(NamedTuple):
    """Distance to an obstacle, or to the edge of the workspace, and its name."""

    distance_m: float
    name: str


class Proximity:
    """Lower bounds of distances to obstacles and edges, for configurations of any shapes."""

    def __init__(self, world: World, geometry: Geometry, carried: Sequence[Array] = ()) -> None:
        """Look at a world with the footprints of a robot, and of what it carries.

        Args:
            world: What is around it.
            geometry: The robot's.
            carried: Convex pieces that move with b0, in its frame, each (k, 2).
        """
        self.names, self._geometry = (*world.names, EDGE), geometry
        self._carried = [piece[None] for piece in carried]
        self._obstacles = Surroundings(world.with_values(workspace=None), 0.0)
        self._edges = Surroundings(World(workspace=world.workspace), 0.0)

    def distances(self, q: Array) -> Array:
        """Distance of each configuration (m, 3 + n) to each obstacle and the edges, (m, k + 1) [m].

        At most `FAR_M`; negative by the depth where they overlap.
        """
        batches = (q[i : i + _BATCH] for i in range(0, len(q), _BATCH))
        return np.concatenate([np.zeros((0, len(self.names))), *map(self._distances, batches)])

    def nearest(self, q: Array) -> Nearest:
        """What a configuration (3 + n,) is nearest to."""
        distances = self.distances(q[None])[0]
        k = int(distances.argmin())
        return Nearest(float(distances[k]), self.names[k])

    def _distances(self, q: Array) -> Array:
        outer, _ = footprints(self._geometry, q[:, POSE:])
        found = self._of(placed(outer, q[:, :POSE]))
        for piece in self._carried:
            found = np.minimum(found, self._of(placed(piece, q[:, :POSE])))
        return found

    def _of(self, corners: Array) -> Array:
        parts, owner = self._obstacles.to_parts(corners), self._obstacles.obstacle_of_part
        owned = [parts[:, owner == i].min(axis=1) for i in range(len(self.names) - 1)]
        return np.column_stack([*owned, self._edges.distances(corners)])


def arms_m(geometry: Geometry) -> Array:
    """How far points of the outline move at most per unit of each coordinate of q, (3 + n,)."""
    straight, _ = footprints(geometry, np.zeros((1, geometry.segments)))
    radius_m = float(np.linalg.norm(straight, axis=-1).max())
    return np.array([1.0, 1.0, radius_m, *reach_per_curvature_m2(geometry)])
