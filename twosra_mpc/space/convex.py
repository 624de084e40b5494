"""Convex parts of polygons, and outlines of things that are touched and carried, in such parts."""

from __future__ import annotations

import math

import numpy as np

from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array

_ROUNDING = 1e-9  # rad


def convex_parts(corners: Array) -> list[Array]:
    """Counter-clockwise convex polygons whose union is a polygon, each (k, 2).

    The polygon itself where it is convex, else triangles.
    """
    ahead = np.roll(corners, -1, axis=0) - corners
    turn = ahead[:, 0] * np.roll(ahead[:, 1], -1) - ahead[:, 1] * np.roll(ahead[:, 0], -1)
    lengths = np.hypot(*ahead.T)
    turn /= lengths * np.roll(lengths, -1)  # its sine: sides may be as short as can be
    if (turn >= -_ROUNDING).all():
        return [corners[np.roll(turn, 1) > _ROUNDING]]
    import shapely  # a convex one needs none

    triangles = shapely.constrained_delaunay_triangles(shapely.Polygon(corners))
    pieces = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    (ax, ay), (bx, by) = ((pieces[:, k] - pieces[:, 0]).T for k in (1, 2))
    area = ax * by - ay * bx
    return [piece if a > 0 else piece[::-1] for piece, a in zip(pieces, area, strict=True)]


_SIDES = 48  # of polygons that stand for discs that are touched: 0.2 % larger


def eroded(thing: Obstacle, by_m: float) -> tuple[Obstacle, ...]:
    """Erosion of a thing by so much all around [m]: none, one or several pieces."""
    if (disc := thing.disc) is not None:
        if (left := disc.radius_m - by_m) <= 0:
            return ()
        angles = (np.arange(_SIDES) + 0.5) * math.tau / _SIDES
        corners = np.column_stack([np.cos(angles), np.sin(angles)]) * left / math.cos(angles[0])
        placed = corners + np.array([disc.x_m, disc.y_m])
        return (Obstacle(name=thing.name, polygon_m=tuple(map(tuple, placed.tolist()))),)
    import shapely  # a disc needs none

    rest = shapely.buffer(shapely.Polygon(thing.corners_m), -by_m, join_style="mitre")
    parts = [part for part in shapely.get_parts(rest) if not shapely.is_empty(part)]
    return tuple(
        Obstacle(
            name=thing.name if len(parts) == 1 else f"{thing.name} {i}",
            polygon_m=tuple(map(tuple, shapely.get_coordinates(part)[:-1].tolist())),
        )
        for i, part in enumerate(parts, start=1)
    )


def quadrangles(thing: Obstacle) -> Array:
    """Convex pieces of four corners, counter-clockwise, whose union holds a thing, (m, 4, 2)."""
    found = []
    for part in convex_parts(thing.corners_m):
        first, rest = part[0], part[1:]
        for i in range(0, len(rest) - 1, 2):
            corners = rest[i : i + 3]
            if len(corners) == 2:  # a triangle: the middle of a side is a corner, too
                corners = np.array([corners[0], corners.mean(axis=0), corners[1]])
            found.append(np.vstack([first, corners]))
    return np.array(found)
