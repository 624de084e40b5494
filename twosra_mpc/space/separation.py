r"""How far a footprint is from obstacles: separating axes of convex pieces, many poses at once.

For convex P and O and the outward normals n of the sides of either one,

.. math:: d(P, O) \ge \max_n \min_{p \in P} n \cdot p - \max_{o \in O} n \cdot o,

with n turned for the sides of P. Where P and O overlap this is minus the depth; both change by at
most as much as P is moved.
"""

from __future__ import annotations

import numpy as np

from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import Footprint

FAR_M = 0.25  # distances beyond this are not told apart
_BATCH = 256  # poses


class Separation:
    """Lower bounds of the distance of a footprint to the obstacles of a world.

    Args:
        footprint: The robot in one shape, and what it carries.
        world: What is around it.
        kept_m: What is to be kept from obstacles, as `footprint.kept_m` says.
    """

    def __init__(self, footprint: Footprint, world: World, kept_m: float) -> None:
        self.kept_m, self.radius_m = kept_m, footprint.radius_m
        self._pieces = np.array(footprint.outer)  # (p, 4, 2)
        sides = np.roll(self._pieces, -1, axis=1) - self._pieces
        self._normals, self._reach = _normals(self._pieces, sides)
        self._parts = [
            (i, part)
            for i, obstacle in enumerate(world.obstacles)
            for part in convex_parts(obstacle.corners_m)
        ]
        self.obstacle_of_part = np.array([i for i, _ in self._parts], dtype=int)
        self._of = [_Part(part) for _, part in self._parts]
        self._workspace = None if world.workspace is None else world.workspace.corners_m

    def distances(self, poses: Array) -> Array:
        """Least distance of each pose (m, 3) to obstacles and edges, (m,) [m]; at most `FAR_M`.

        At least ``kept_m`` is allowed. The edge of the workspace may be touched: it counts as
        farther away by ``kept_m``.
        """
        return np.concatenate(
            [
                np.zeros(0),
                *(self._least(poses[i : i + _BATCH]) for i in range(0, len(poses), _BATCH)),
            ]
        )

    def to_obstacles(self, poses: Array) -> Array:
        """Distance of each pose (m, 3) to each convex part of an obstacle, (m, parts) [m]."""
        corners, turned = self._placed(poses)
        found = np.full((len(poses), len(self._of)), FAR_M)
        for k, part in enumerate(self._of):
            away = np.linalg.norm(poses[:, :2] - part.middle, axis=1) - part.radius_m
            near = np.flatnonzero(away - self.radius_m < FAR_M)
            if len(near):
                found[near, k] = self._apart(corners[near], turned[near], poses[near], part)
        return found

    def _least(self, poses: Array) -> Array:
        least = self.to_obstacles(poses).min(axis=1, initial=FAR_M)
        if self._workspace is not None:
            corners, _ = self._placed(poses)
            low, high = self._workspace
            inside = np.minimum(corners - low, high - corners).min(axis=(1, 2, 3))
            least = np.minimum(least, inside + self.kept_m)
        return least

    def _placed(self, poses: Array) -> tuple[Array, Array]:
        """Corners of the pieces at poses, (m, p, 4, 2), and the poses' rotations, (m, 2, 2)."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        turned = np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)  # row vectors
        return self._pieces @ turned[:, None] + poses[:, None, None, :2], turned

    def _apart(self, corners: Array, turned: Array, poses: Array, part: _Part) -> Array:
        """Least distance of the pieces to one part, (m,)."""
        along = corners @ part.normals.T  # (m, p, 4, sides)
        by_part = (along.min(axis=2) - part.reach).max(axis=-1)
        normals = self._normals @ turned[:, None]  # (m, p, 4, 2)
        least = (normals @ part.corners.T).min(axis=-1)  # (m, p, 4)
        origin = (normals * poses[:, None, None, :2]).sum(axis=-1)
        by_piece = (least - origin - self._reach).max(axis=-1)
        return np.maximum(by_part, by_piece).min(axis=1)  # type: ignore[no-any-return]


class _Part:
    """A convex part of an obstacle: corners, outward normals, and how far it reaches on them."""

    def __init__(self, corners: Array) -> None:
        self.corners = corners
        sides = np.roll(corners, -1, axis=0) - corners
        normals, reach = _normals(corners[None], sides[None])
        self.normals, self.reach = normals[0], reach[0]
        self.middle = corners.mean(axis=0)
        self.radius_m = float(np.linalg.norm(corners - self.middle, axis=1).max())


def _normals(corners: Array, sides: Array) -> tuple[Array, Array]:
    """Outward unit normals of polygons (p, k, 2), and n . corner on each side, (p, k)."""
    normals = np.stack([sides[..., 1], -sides[..., 0]], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    reach: Array = (normals * corners).sum(axis=-1)
    return normals, reach
