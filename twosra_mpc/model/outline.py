"""The robot's outline in the plane, by its kinematics, for whatever draws it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.model.cache import BODIES
from twosra_mpc.model.chain import composed, fibre_end_pose, fibre_poses, placed, wheel_pose_matrix
from twosra_mpc.model.rows import by_rows
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array, Coordinates
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.validation import ArrayValue, TwoOrMore

FEW_POINTS = 7  # along a segment

_CORNERS = ca.DM([(-1, -1), (1, -1), (1, 1), (-1, 1)]).T


@public
@dataclass(frozen=True, eq=False, repr=False)
class RobotShape(ArrayValue):
    """The robot in the plane [m, rad]; leading axes are those of the configurations.

    Attributes:
        origin: b0, (..., 2).
        segments: Points along each segment from LU1 towards LU2, (..., n, points, 2).
        links: Ends of the end link of LU1, the links between segments and that of LU2, in this
            order, (..., n + 1, 2, 2).
        units: Corners of the frames of the locomotion units, (..., 2, 4, 2).
        wheels: Corners of wheels 1 to 4, (..., 4, 4, 2); from the first to the second they roll.
        ends: Poses of the fibre ends, x axis towards LU2, (..., 2, 3).
    """

    origin: Array
    segments: Array
    links: Array
    units: Array
    wheels: Array
    ends: Array

    @property
    def centres(self) -> Array:
        """Centres of the locomotion units, (..., 2, 2)."""
        return self.units.mean(axis=-2)


@public
def robot_shape(geometry: Geometry, q: ArrayLike, points: TwoOrMore = 40) -> RobotShape:
    """Place the robot at q = (x, y, phi, kappa1 ... kappan) [m, m, rad, 1/m], shape (..., 3 + n).

    ``points`` are drawn along each segment.

    Raises:
        InputError: If q has another number of coordinates.
    """
    at, size = np.asarray(q, dtype=float), Coordinates(geometry.segments).size
    if at.shape[-1:] != (size,):
        raise InputError("q", at.shape, f"an array of shape (..., {size})")
    n, rows = geometry.segments, at.reshape(-1, size)
    shapes = ((n, points, 2), (n + 1, 2, 2), (2, 4, 2), (4, 4, 2), (2, 3))
    columns = by_rows(_outline(geometry, points), rows)
    placed_in = zip(columns, shapes, strict=True)
    parts = (values.reshape(*at.shape[:-1], *shape) for values, shape in placed_in)
    return RobotShape(at[..., :2], *parts)


@lru_cache(maxsize=BODIES)
def outline_points(geometry: Geometry) -> ca.Function:
    """Q -> points whose hull holds the robot but for the arcs between them, (2, m).

    Corners of units, wheels and end links that stick out, and a few points of each segment, with
    discs of radii ``outline_radii_m`` about them; these come last.
    """
    q = ca.SX.sym("q", Coordinates(geometry.segments).size)
    segments, _, units, wheels, _ = _outline(geometry, FEW_POINTS)(q)
    half, beside, corners = geometry.unit_frame_m / 2, ca.DM([[0, 0], [-1, 1]]), []
    if geometry.fibre_radius_m + abs(geometry.unit_offset_m) > half:  # else units hide link ends
        for unit, side in ((0, -1), (1, 1)):
            ends = ca.DM([[side * geometry.end_link_m] * 2, [0, 0]])
            ends += geometry.fibre_radius_m * beside
            corners.append(placed(q[:POSE], placed(fibre_end_pose(geometry, q, unit), ends)))
    points = ca.horzcat(units, wheels, *corners, segments)
    return ca.Function("outline_points", [q], [points], {"cse": True})


def outline_radii_m(geometry: Geometry) -> Array:
    """Radii of discs about the ``outline_points``, (m,) [m]: that of the fibre, for its points."""
    fibre = FEW_POINTS * geometry.segments
    radii = np.zeros(outline_points(geometry).size2_out(0))
    radii[-fibre:] = geometry.fibre_radius_m
    return radii


@lru_cache(maxsize=16)
def _outline(geometry: Geometry, points: int) -> ca.Function:
    """Q -> the parts of ``RobotShape`` but the first, their points as columns."""
    q = ca.SX.sym("q", Coordinates(geometry.segments).size)
    shares = ca.DM(np.linspace(0.0, 1.0, points)).T
    segments = [fibre_poses(geometry, q, j, shares)[:2, :] for j in range(geometry.segments)]
    joints = [segment[:, [0, -1]] for segment in segments]  # a link from each end to the next one
    ends, poses = [fibre_end_pose(geometry, q, i) for i in (0, 1)], wheel_pose_matrix(geometry, q)
    half_m, link_m = geometry.unit_frame_m / 2, geometry.end_link_m
    out_m, aside_m = geometry.unit_middle_m
    tips, units = [], []
    for side, end in zip((-1, 1), ends, strict=True):
        tips.append(placed(end, ca.DM([side * link_m, 0.0])))
        units.append(placed(end, ca.DM([side * out_m, aside_m]) + half_m * _CORNERS))
    tread = ca.DM([geometry.wheel_radius_m, geometry.wheel_thickness_m / 2])
    wheels = [placed(poses[:, i], tread * _CORNERS) for i in range(WHEELS)]
    parts = (segments, [tips[0], *joints, tips[1]], units, wheels)
    world = [placed(q[:POSE], ca.horzcat(*part)) for part in parts]
    return ca.Function("outline", [q], [*world, composed(q[:POSE], ca.horzcat(*ends))])
