"""Points of the robot's outline in the plane, for whatever draws it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.robot.geometry import Geometry

Array = NDArray[np.float64]


class RobotShape(NamedTuple):
    """Points of the robot in the plane [m].

    Attributes:
        origin: b0, (2,).
        segments: Arcs from the middle link to the fibre ends, (2, n, 2).
        links: Middle link and the two end links, (3, 2, 2).
        units: Corners of the locomotion units, (2, 4, 2).
        wheels: Corners of wheels 1 to 4, (4, 4, 2).
    """

    origin: Array
    segments: Array
    links: Array
    units: Array
    wheels: Array


def robot_shape(geometry: Geometry, q: ArrayLike, points: int = 40) -> RobotShape:
    """Place the robot at q = (x, y, phi, kappa1, kappa2) [m, m, rad, 1/m, 1/m], shape (5,)."""
    x, y, phi, *kappa = np.asarray(q, dtype=float)
    half_link, half_side = geometry.middle_link_m / 2, geometry.unit_side_m / 2
    rolling, across = geometry.wheel_radius_m, geometry.wheel_thickness_m / 2
    (h2, h3), h1 = geometry.front_wheel_m, geometry.side_wheel_m
    segments, units, wheels = [], [], []
    links = [np.array([(-half_link, 0.0), (half_link, 0.0)])]
    for side, curvature in zip((-1, 1), kappa, strict=True):
        arc = segment_arc(geometry, curvature, side, points)
        end, turn = arc[-1], side * curvature * geometry.lengths_m[0]
        segments.append(arc)
        links.append(_moved([(0.0, 0.0), (side * geometry.end_link_m, 0.0)], end, turn))
        units.append(_moved(_box(side * h2, 0.0, half_side, half_side), end, turn))
        wheels.append(_moved(_box(side * h1, 0.0, across, rolling), end, turn))
        wheels.append(_moved(_box(side * h2, -side * h3, rolling, across), end, turn))
    origin = np.array([x, y])
    placed = (_moved(part, origin, phi) for part in (segments, links, units, wheels))
    return RobotShape(origin, *placed)


def segment_arc(geometry: Geometry, kappa: float, side: int, points: int = 40) -> Array:
    """Arc of the segment on one side (-1 or 1) of b0, from the middle link out [m], (points, 2)."""
    run = np.linspace(0.0, geometry.lengths_m[0], points)
    half = kappa * run / 2
    along, across = np.sinc(2 * half / np.pi), np.sin(half) * np.sinc(half / np.pi)
    return np.stack([side * (geometry.middle_link_m / 2 + run * along), run * across], axis=1)


def _box(x: float, y: float, half_x: float, half_y: float) -> Array:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.array([x, y]) + corners * (half_x, half_y)


def _moved(points: ArrayLike, origin: Array, turn: float) -> Array:
    """Points (..., 2) turned by ``turn`` [rad], then shifted by ``origin``."""
    c, s = np.cos(turn), np.sin(turn)
    moved: Array = np.asarray(points, dtype=float) @ np.array([(c, s), (-s, c)]) + origin
    return moved
