r"""The fibre as a chain of straight links and arcs: where its points and the wheels are in b0.

b0 sits in the middle of a link, ``geometry.inner_link_of_b0``, its x axis towards LU2. Poses are
(x, y, angle) [m, m, rad], a column each; a frame on the fibre has its x axis along it, towards LU2.

Of the bending angle a of an arc come four entire functions,

.. math:: S = \sin a / a, \quad C = (1 - \cos a) / a, \quad
          A = (a - \sin a) / a^2, \quad B = (1 - \cos a) / a^2.

Each is a Taylor polynomial in a^2: no division, no branch, exact derivatives at a = 0, absolute
error below 2e-12 for abs(a) <= 2 pi.

What is written again and again is a function: calling it writes its operations into an expression
20 times faster than Python does.
"""

from __future__ import annotations

import functools
import math
from functools import lru_cache

import casadi as ca

from twosra_mpc.model.cache import BODIES
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.geometry import Geometry

_TERMS = 17  # the next one is below 2e-12 at 2 pi


@functools.cache
def _series(offset: int) -> ca.Function:
    """Function of a: sum over k of (-1)^k a^(2k) / (2k + offset)!, by Horner's rule."""
    alpha = ca.SX.sym("alpha")
    factors = [(-1) ** k / math.factorial(2 * k + offset) for k in reversed(range(_TERMS))]
    total = ca.polyval(ca.DM(factors), alpha * alpha)
    return ca.Function("series", [alpha], [total])


def sinc(alpha: ca.SX) -> ca.SX:
    """S(a) = sin(a) / a."""
    return _series(1)(alpha)


def versine_ratio(alpha: ca.SX) -> ca.SX:
    """C(a) = (1 - cos a) / a."""
    return alpha * _series(2)(alpha)


def sagitta_ratio(alpha: ca.SX) -> ca.SX:
    """A(a) = (a - sin a) / a^2."""
    return alpha * _series(3)(alpha)


def versine_ratio_squared(alpha: ca.SX) -> ca.SX:
    """B(a) = (1 - cos a) / a^2."""
    return _series(2)(alpha)


def placed(pose: ca.SX, points: ca.SX | ca.DM) -> ca.SX:
    """Points, 2xk, given in the frame at ``pose``, where that frame is given, 2xk [m]."""
    c, s = ca.cos(pose[2]), ca.sin(pose[2])
    turned = ca.blockcat([[c, -s], [s, c]]) @ points
    return turned + ca.repmat(pose[:2], 1, points.shape[1])


def composed(pose: ca.SX, poses: ca.SX | ca.DM) -> ca.SX:
    """Poses, 3xk, given in the frame at ``pose``, where that frame is given, 3xk."""
    return _composed(poses.shape[1])(pose, poses)


@functools.cache
def _composed(count: int) -> ca.Function:
    pose, poses = ca.SX.sym("pose", 3), ca.SX.sym("poses", 3, count)
    found = ca.vertcat(placed(pose, poses[:2, :]), pose[2] + poses[2, :])
    return ca.Function("composed", [pose, poses], [found])


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
    q = ca.SX.sym("q", POSE + geometry.segments)
    pairs = ca.horzsplit(ca.DM(geometry.wheel_placement).T, 2)
    units = [composed(fibre_end_pose(geometry, q, i), pair) for i, pair in enumerate(pairs)]
    return ca.Function("wheel_poses", [q], [ca.horzcat(*units)], ["q"], ["poses"])
