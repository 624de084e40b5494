"""Gaps between what is around the robot: which ones a path goes through, and what closes one."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import shapely

from twosra_mpc.problem.tolerances import DRAWN_M
from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import Array

_EDGE = "the edge of the workspace"
_THICK_M = 1e-3  # of what closes a gap
_FAR_M = 1e3  # edges of a workspace farther away are none


class Gap(NamedTuple):
    """The shortest way between two obstacles, or one and an edge of the workspace.

    Attributes:
        width_m: Its length.
        between: Names of the two.
        ends_m: The nearest points of the two, (2, 2).
    """

    width_m: float
    between: tuple[str, str]
    ends_m: Array

    def __str__(self) -> str:
        return f"the {1e3 * self.width_m:z.0f} mm between {self.between[0]} and {self.between[1]}"

    @property
    def closed(self) -> Obstacle:
        """A thin obstacle that fills it."""
        a, b = self.ends_m
        across = _THICK_M / 2 / self.width_m * np.array([-(b - a)[1], (b - a)[0]])
        corners = [a - across, b - across, b + across, a + across]
        return Obstacle(polygon_m=tuple((float(x), float(y)) for x, y in corners))


def gaps_through(world: World, path_m: Array) -> list[Gap]:
    """The gaps that a path (m, 2) goes through, narrowest first."""
    solid = [shapely.Polygon(item.corners_m) for item in world.obstacles]
    sides = [] if world.workspace is None else _sides(world.workspace.corners_m)
    pairs = itertools.chain(
        itertools.combinations(zip(world.names, solid, strict=True), 2),
        itertools.product(zip(world.names, solid, strict=True), ((_EDGE, side) for side in sides)),
    )
    path, found = shapely.LineString(path_m), []
    for (name, shape), (other, far) in pairs:
        line = shapely.shortest_line(shape, far)
        if line.length > DRAWN_M and shapely.intersects(line, path):
            ends = shapely.get_coordinates(line)
            found.append(Gap(float(line.length), (name, other), ends))
    return sorted(found, key=lambda gap: gap.width_m)


def _sides(corners: Array) -> list[shapely.LineString]:
    """The sides of the box from the lowest to the highest corner (2, 2) that are not far away."""
    ring = shapely.get_coordinates(shapely.box(*np.clip(corners, -_FAR_M, _FAR_M).ravel()))
    sides = [(a, b) for a, b in itertools.pairwise(ring) if (abs((a + b) / 2) < _FAR_M / 2).all()]
    return [shapely.LineString(side) for side in sides]
