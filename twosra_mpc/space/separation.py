r"""Distances to obstacles: separating axes of convex pieces, many poses at once.

For convex P and O and the outward normals n of the sides of either one,

.. math:: d(P, O) \ge \max_n \min_{p \in P} n \cdot p - \max_{o \in O} n \cdot o,

with n turned for the sides of P. Where P and O overlap this is minus the depth, which changes by at
most as much as P is moved, as the distance itself does. So does the distance of a disc around P to
a box around O, which is less where it is positive: pieces far away are known by that alone, those
nearer by the larger one, and in between the one becomes the other as steadily.

`Proximity` has them for configurations of any shapes, obstacle by obstacle.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.problem.tolerances import ROUNDING_M, kept_from_m
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import POSE, Array, rotation
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import Footprint, footprints, reach_per_curvature_m2

FAR_M = 0.25  # distances beyond this are not told apart
_NEAR_M = 0.03  # beyond what is kept: pieces whose disc is nearer to a box are looked at closely
_LOOKS = 4  # at the box of a part in the time of one at its sides
_BATCH = 64  # poses: of a robot of 50 pieces, some MiB on the way


class Surroundings:
    """The obstacles and edges of a world, and how far convex pieces are from them.

    Args:
        world: What is around the robot.
        kept_m: What is to be kept from obstacles, as `footprint.kept_m` says.
    """

    def __init__(self, world: World, kept_m: float) -> None:
        self.kept_m = kept_m
        each = [convex_parts(obstacle.corners_m) for obstacle in world.obstacles]
        firsts = np.cumsum([0, *map(len, each)]).tolist()
        charge(Cost.PART, firsts[-1])
        self._parts = [(part, *_normals(part)) for part in itertools.chain(*each)]
        self.columns = [slice(*ends) for ends in itertools.pairwise([*firsts, None])]
        corners = (item.corners_m[..., None] for item in world.obstacles)
        self._boxes = [(own.min(axis=0), own.max(axis=0)) for own in corners]
        self._workspace = None if world.workspace is None else world.workspace.corners_m

    def distances(self, corners: Array, lent_m: Array | float = 0.0) -> Array:
        """Least distance of sets of pieces (m, p, k, 2) to obstacles and edges, (m,) [m].

        At most `FAR_M`. At least ``kept_m`` is allowed: the edge of the workspace may be touched,
        to rounding, and counts as farther away; so does each part and edge by what is lent to it.
        """
        batches = (corners[i : i + _BATCH] for i in range(0, len(corners), _BATCH))
        least = ((self.to_each(one) + lent_m).min(axis=1, initial=FAR_M) for one in batches)
        return np.concatenate([np.zeros(0), *least])

    def to_parts(self, corners: Array) -> Array:
        """Distance of sets of pieces (m, p, k, 2) to each convex part of obstacles, (m, parts)."""
        # Minima and maxima over leading axes, which are short, are three times as fast.
        points = np.ascontiguousarray(corners.transpose(2, 3, 0, 1))
        points = points.reshape(*points.shape[:2], -1)
        middle = points.mean(axis=0)
        radius = np.sqrt(((points - middle) ** 2).sum(axis=1).max(axis=0))
        found, near_m = np.empty((len(corners), len(self._parts))), self.kept_m + _NEAR_M
        charge(Cost.DISTANCE, len(corners) * len(self._boxes))
        for box, of in zip(self._boxes, self.columns, strict=False):
            apart = _from_box(middle, *box) - radius
            near = np.flatnonzero(apart < near_m)
            bounded = apart[near]
            apart[near] = FAR_M
            found[:, of] = apart.reshape(len(corners), -1).min(axis=1)[:, None]
            charge(Cost.DISTANCE, len(near) * (of.stop - of.start - 1) // _LOOKS)
            for k in range(of.start, of.stop) if len(near) else ():
                part, outward, ends = self._parts[k]
                if of.stop - of.start > 1:  # what is far from this part is not asked closely
                    box = part.min(axis=0)[:, None], part.max(axis=0)[:, None]
                    apart = np.maximum(bounded, _from_box(middle[:, near], *box) - radius[near])
                    far = apart >= near_m
                    np.minimum.at(found[:, k], near[far] // corners.shape[1], apart[far])
                    close, lower = near[~far], apart[~far]
                else:
                    close, lower = near, bounded
                if not len(close):
                    continue
                charge(Cost.DISTANCE, len(close))
                own = points[..., close]
                normals, reach = _normals(own)
                by_part = ((outward @ own).min(axis=0) - ends[:, None]).max(axis=0)
                by_piece = ((part @ normals).min(axis=1) - reach).max(axis=0)
                exact = np.maximum(by_part, by_piece)
                least, most = np.where(lower > 0, lower, -np.inf), 2 * near_m - lower
                np.minimum.at(found[:, k], close // corners.shape[1], np.clip(exact, least, most))
        return np.minimum(found, FAR_M)

    def to_each(self, corners: Array) -> Array:
        """The same, then to each edge, as `distances` counts them, (m, parts and edges)."""
        parts = self.to_parts(corners)
        if self._workspace is None:
            return parts
        low, high = self._workspace
        ends = np.ascontiguousarray(corners.reshape(len(corners), -1, 2).transpose(1, 2, 0))
        inside = np.vstack([ends.min(axis=0) - low[:, None], high[:, None] - ends.max(axis=0)])
        return np.column_stack([parts, inside.T + self.kept_m + ROUNDING_M])


class Separation:
    """Lower bounds of the distance of one footprint to what is around it, at many poses.

    Args:
        footprint: The robot in one shape.
        world: What is around it.
        kept_m: What is to be kept from obstacles, as `footprint.kept_m` says.
    """

    def __init__(self, footprint: Footprint, world: World, kept_m: float) -> None:
        self.kept_m, self.radius_m = kept_m, footprint.radius_m
        self.surroundings = Surroundings(world, kept_m)
        self._pieces = np.array(footprint.outer)

    def distances(self, poses: Array, lent_m: Array | float = 0.0) -> Array:
        """Least distance at each pose (m, 3), (m,) [m]; see `Surroundings.distances`."""
        batches = (
            placed(self._pieces, poses[i : i + _BATCH]) for i in range(0, len(poses), _BATCH)
        )
        found = (self.surroundings.distances(each, lent_m) for each in batches)
        return np.concatenate([np.zeros(0), *found])

    def to_things(self, pose: Array) -> Array:
        """As `to_each` of a pose (3,), but to the nearest of an obstacle's parts, or edge [m]."""
        apart: Array = self.surroundings.to_each(placed(self._pieces, pose[None]))[0]
        for of in self.surroundings.columns:
            apart[of] = apart[of].min(initial=FAR_M)
        return apart

    def kept_from_m(self, poses: Array, off_m: float = 0.0) -> float:
        """Clearance of drives that start at one of these poses (m, 3), or ``off_m`` from it."""
        own_m = self.surroundings.to_parts(placed(self._pieces, poses)) - off_m
        return float(kept_from_m(own_m, self.kept_m).min(initial=self.kept_m))


def placed(pieces: Array, poses: Array) -> Array:
    """Corners of pieces (p, k, 2), or (m, p, k, 2), at poses (m, 3), (m, p, k, 2)."""
    return pieces @ rotation(poses[:, 2])[:, None] + poses[:, None, None, :2]


def _normals(corners: Array) -> tuple[Array, Array]:
    """Outward unit normals of polygons (k, 2, ...), and n . corner on each side, (k, ...)."""
    sides = np.concatenate([corners[1:], corners[:1]]) - corners
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1)
    normals /= np.sqrt((normals**2).sum(axis=1, keepdims=True))
    reach: Array = (normals * corners).sum(axis=1)
    return normals, reach


def _from_box(points: Array, low: Array, high: Array) -> Array:
    """Distance of points (2, ...) to a box, (...,) [m]."""
    off = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.asarray(np.hypot(off[0], off[1]))


EDGE = "the edge of the workspace"
_TOGETHER = 256  # configurations looked at at once


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
        self._around = Surroundings(world, -ROUNDING_M)

    def distances(self, q: Array) -> Array:
        """Distance of each configuration (m, 3 + n) to each obstacle and the edges, (m, k + 1) [m].

        At most `FAR_M`; negative by the depth where they overlap.
        """
        batches = (q[i : i + _TOGETHER] for i in range(0, len(q), _TOGETHER))
        return np.concatenate([np.zeros((0, len(self.names))), *map(self._distances, batches)])

    def nearest(self, q: Array) -> Nearest:
        """Nearest obstacle or edge of a configuration (3 + n,)."""
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
        apart, things = self._around.to_each(corners), self._around.columns
        return np.column_stack([apart[:, of].min(axis=1, initial=FAR_M) for of in things])


def arms_m(geometry: Geometry) -> Array:
    """Largest motion of the outline's points per unit of each coordinate of q, (3 + n,)."""
    straight, _ = footprints(geometry, np.zeros((1, geometry.segments)))
    radius_m = float(np.linalg.norm(straight, axis=-1).max())
    return np.array([1.0, 1.0, radius_m, *reach_per_curvature_m2(geometry)])
