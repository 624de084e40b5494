"""The fibre as a chain of straight links and arcs: where its points and the wheels are in b0.

b0 sits in the middle of a link, ``geometry.inner_link_of_b0``, its x axis towards LU2. Poses are
(x, y, angle) [m, m, rad], a column each; a frame on the fibre has its x axis along it, towards LU2.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from twosra_mpc.model.cache import BODIES
from twosra_mpc.model.series import sinc, versine_ratio
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.geometry import Geometry


def placed(pose: ca.SX, points: ca.SX | ca.DM) -> ca.SX:
    """Points, 2xk, given in the frame at ``pose``, where that frame is given, 2xk [m]."""
    c, s = ca.cos(pose[2]), ca.sin(pose[2])
    turned = ca.blockcat([[c, -s], [s, c]]) @ points
    return turned + ca.repmat(pose[:2], 1, points.shape[1])


def composed(pose: ca.SX, poses: ca.SX | ca.DM) -> ca.SX:
    """Poses, 3xk, given in the frame at ``pose``, where that frame is given, 3xk."""
    return ca.vertcat(placed(pose, poses[:2, :]), pose[2] + poses[2, :])


def fibre_poses(geometry: Geometry, q: ca.SX, segment: int, shares: ca.SX | ca.DM) -> ca.SX:
    """Poses in b0 of points of a segment, 3xk.

    Args:
        geometry: Lengths of the fibre.
        q: Configuration, 3+n.
        segment: Which segment, from 0.
        shares: Where on it, 1xk: 0 at its end towards LU1, 1 at its end towards LU2.
    """
    first = geometry.inner_link_of_b0
    side = 1 if segment >= first else -1  # of b0; runs along the fibre are negative before it
    base = ca.SX([side * geometry.half_link_m, 0.0, 0.0])
    for inner in range(first if side > 0 else first - 1, segment, side):
        base = composed(base, arc(q[POSE + inner], ca.DM(side * geometry.lengths_m[inner])))
        base = composed(base, ca.DM([side * geometry.middle_link_m, 0.0, 0.0]))
    outward = shares if side > 0 else shares - 1
    return composed(base, arc(q[POSE + segment], geometry.lengths_m[segment] * outward))


def arc(kappa: ca.SX, runs_m: ca.SX | ca.DM) -> ca.SX:
    """Poses of points of an arc that starts at the origin along x, 3xk; ``runs_m`` has a sign."""
    alpha = kappa * runs_m
    return ca.vertcat(runs_m * sinc(alpha), runs_m * versine_ratio(alpha), alpha)


def fibre_end_pose(geometry: Geometry, q: ca.SX, unit: int) -> ca.SX:
    """Pose in b0 of the fibre end of LU1 (unit 0) or LU2 (1), 3x1, eq. transform-matrix."""
    return fibre_poses(geometry, q, unit * (geometry.segments - 1), ca.DM(unit))


def wheel_pose_matrix(geometry: Geometry, q: ca.SX) -> ca.SX:
    """Poses in b0 of the four wheels, their angle that of the drive direction, 3x4, eq. q_bC."""
    return wheel_poses(geometry)(q)


@lru_cache(maxsize=BODIES)
def wheel_poses(geometry: Geometry) -> ca.Function:
    """Q -> ``wheel_pose_matrix``, written down once and called from then on."""
    q, placement = ca.SX.sym("q", POSE + geometry.segments), ca.DM(geometry.wheel_placement).T
    units = [
        composed(fibre_end_pose(geometry, q, i), placement[:, 2 * i : 2 * i + 2]) for i in (0, 1)
    ]
    return ca.Function("wheel_poses", [q], [ca.horzcat(*units)], ["q"], ["poses"])
