"""Convex parts of polygons."""

from __future__ import annotations

import numpy as np

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
