r"""The unified hybrid Jacobian, the wheel poses and the wheel configuration matrix.

.. math:: \dot q = J(q, \sigma)\,v, \qquad \omega = V(q, \sigma)\,v

q = [x, y, phi, kappa1, kappa2] (m, m, rad, 1/m, 1/m), v = [v1, v2, u0, v0, r0] (m/s, m/s, m/s, m/s,
rad/s), omega = four wheel speeds (rad/s), sigma = (s1, s2), 1 = soft. Frames as in the paper: b0 at
the middle of the middle link, x from LU1 to LU2; kappa_j > 0 bends segment j to +y; v_j > 0 moves
LU j to its own +y and raises kappa_j. This is the only place where the kinematics is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.path_models import PathModel, path_model
from twosra_mpc.model.series import sinc, versine_ratio
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry

Array = NDArray[np.float64]

TURNING_RADIUS_M = 0.1  # at which turning is compared with shifting in singular values


@dataclass(frozen=True)
class Kinematics:
    """Compiled kinematics of one robot.

    Attributes:
        robot: The robot described.
        jacobian: (q, sigma) -> J, 5x5.
        wheel_matrix: (q, sigma) -> V, 4x5, paper eq. config_matrix.
        wheel_poses: q -> 3x4, columns (x, y, psi) of the wheels in b0 (m, m, rad).
        shape_margins: (kappa1, kappa2) -> (gap between the locomotion units [m], bound from below
            on the wheel independence of ``MotionLimits``).
    """

    robot: Robot
    jacobian: ca.Function
    wheel_matrix: ca.Function
    wheel_poses: ca.Function
    shape_margins: ca.Function


class JacobianInPlace:
    """J for loops that need it often: fill ``q`` and ``sigma``, ``evaluate()``, read ``columns``.

    Saves converting arrays on every call. Row i of ``columns`` (5, 5) is column i of J.
    """

    def __init__(self, robot: Robot) -> None:
        self.q, self.sigma = np.zeros(5), np.zeros(2)
        self.columns = np.zeros((5, 5))
        self._function = kinematics(robot).jacobian
        buffer: Any = self._function.buffer()  # its type stub describes the C++ call, not this one
        self._memory, self.evaluate = buffer  # the memory must live as long as evaluate is used
        self._memory.set_arg(0, memoryview(self.q.data))
        self._memory.set_arg(1, memoryview(self.sigma.data))
        self._memory.set_res(0, memoryview(self.columns.data))


@lru_cache(maxsize=32)
def kinematics(robot: Robot) -> Kinematics:
    """Write down the kinematics of ``robot`` and compile it."""
    q, sigma = ca.SX.sym("q", 5), ca.SX.sym("sigma", 2)
    path = path_model(robot)
    jacobian = hybrid_jacobian(robot.geometry, path, q, sigma)
    wheels = wheel_configuration(robot.geometry, q, sigma)
    if path.wheel_map == "exact":
        wheels = exact_wheel_map(robot.geometry, q) @ _body_rates(q, jacobian)
    kappa = ca.SX.sym("kappa", 2)
    poses = wheel_pose_matrix(robot.geometry, q)
    return Kinematics(
        robot=robot,
        jacobian=ca.Function("J", [q, sigma], [ca.densify(jacobian)]),
        wheel_matrix=ca.Function("V", [q, sigma], [ca.densify(wheels)]),
        wheel_poses=ca.Function("wheel_poses", [q], [poses]),
        shape_margins=ca.Function("margins", [kappa], [shape_margins(robot.geometry, kappa)]),
    )


@lru_cache(maxsize=32)
def wheel_travel(robot: Robot) -> ca.Function:
    """(q, s, sigma) -> V(q, sigma) s: angle each wheel rolls over an interval [rad], shape (4,)."""
    q, s, sigma = ca.SX.sym("q", 5), ca.SX.sym("s", 5), ca.SX.sym("sigma", 2)
    matrix = kinematics(robot).wheel_matrix(q, sigma)
    return ca.Function("wheel_travel", [q, s, sigma], [matrix @ s])


@lru_cache(maxsize=256)
def wheel_travels(robot: Robot, count: int) -> ca.Function:
    """``wheel_travel`` of ``count`` intervals at once, one per column."""
    return wheel_travel(robot).map(count)


@lru_cache(maxsize=256)
def shape_margins_of(robot: Robot, count: int) -> ca.Function:
    """``Kinematics.shape_margins`` of ``count`` shapes at once, one per column."""
    return kinematics(robot).shape_margins.map(count)


def hybrid_jacobian(geometry: Geometry, path: PathModel, q: ca.SX, sigma: ca.SX) -> ca.SX:
    """J(q, sigma), 5x5, columns (v1, v2, u0, v0, r0); sigma may be a symbol.

    Paper section III-D with errata 3 (sign of the phi row) and 9 (autonomous form).
    """
    only_1, only_2 = sigma[0] * (1 - sigma[1]), (1 - sigma[0]) * sigma[1]
    both = sigma[0] * sigma[1]
    rigid = (1 - sigma[0]) * (1 - sigma[1])
    alpha = q[3:5] * geometry.lengths_m[0]
    share_1, share_2 = path.share(alpha[0]), path.share(alpha[1])
    by_1 = both * path.both(alpha[0], alpha[1])
    by_2 = both * path.both(alpha[1], alpha[0])

    # Bending rate of each segment per speed of each LU; b0 turns with the one whose end is held.
    turn_by_1 = only_2 * path.opposite(alpha[1], alpha[0]) + by_1 * share_2
    turn_by_2 = only_1 * path.opposite(alpha[0], alpha[1]) + by_2 * share_1
    bend = ca.blockcat(
        [
            [only_1 * path.adjacent(alpha[0]) + by_1 * share_1, turn_by_2],
            [turn_by_1, only_2 * path.adjacent(alpha[1]) + by_2 * share_2],
        ]
    )
    rotation = ca.blockcat([[ca.cos(q[2]), -ca.sin(q[2])], [ca.sin(q[2]), ca.cos(q[2])]])
    x1, y1 = path.displacement(alpha[0])
    x2, y2 = path.displacement(alpha[1])
    half_link = geometry.middle_link_m / 2
    shift = ca.horzcat(
        rotation @ ca.vertcat(-x2, half_link + y2) * turn_by_1,
        rotation @ ca.vertcat(x1, half_link + y1) * turn_by_2,
    )
    soft = ca.vertcat(shift, ca.horzcat(-turn_by_1, turn_by_2), bend / geometry.lengths_m[0])
    drive = ca.vertcat(ca.diagcat(rotation, 1), ca.SX.zeros(2, 3)) * rigid
    return ca.horzcat(soft, drive)


def fibre_end_pose(geometry: Geometry, q: ca.SX, segment: int) -> ca.SX:
    """Pose (x, y, angle) of fibre end b1 (segment 0) or b2 (1) in b0, eq. transform-matrix."""
    length, side = geometry.lengths_m[0], (-1, 1)[segment]
    alpha = q[3 + segment] * length
    reach = geometry.middle_link_m / 2 + length * sinc(alpha)
    return ca.vertcat(side * reach, length * versine_ratio(alpha), side * alpha)


def wheel_pose_matrix(geometry: Geometry, q: ca.SX) -> ca.SX:
    """Poses of the four wheels in b0, 3x4: rows x, y [m], psi [rad] (eqs. q_bC, psi)."""
    columns = []
    for wheel, (x, y, beta) in enumerate(geometry.wheel_placement):
        end = fibre_end_pose(geometry, q, wheel // 2)
        c, s = ca.cos(end[2]), ca.sin(end[2])
        columns.append(ca.vertcat(end[0] + c * x - s * y, end[1] + s * x + c * y, end[2] + beta))
    return ca.horzcat(*columns)


def wheel_configuration(geometry: Geometry, q: ca.SX, sigma: ca.SX) -> ca.SX:
    """V(q, sigma), 4x5, eq. config_matrix, with psi in the body frame (erratum 12)."""
    rigid = (1 - sigma[0]) * (1 - sigma[1])
    poses = wheel_pose_matrix(geometry, q)
    rows = []
    for wheel, (from_v1, from_v2) in enumerate(((1, 0), (0, 0), (0, -1), (0, 0))):
        x, y, psi = poses[0, wheel], poses[1, wheel], poses[2, wheel]
        c, s = ca.cos(psi), ca.sin(psi)
        soft = (1 - rigid) * ca.horzcat(from_v1, from_v2)
        rows.append(ca.horzcat(soft, rigid * ca.horzcat(c, s, x * s - y * c)))
    return ca.vertcat(*rows) / geometry.wheel_radius_m


def exact_wheel_map(geometry: Geometry, q: ca.SX) -> ca.SX:
    """W(kappa1, kappa2), 4x5: wheel speeds per body twist (u, v, r) and curvature rates.

    Wheels that do not slip while the fibre bends: the rigid columns as in the paper, and for each
    wheel how far its own fibre end moves along its drive direction when its segment bends.
    """
    poses = wheel_pose_matrix(geometry, q)
    rows = []
    for wheel in range(4):
        segment = wheel // 2
        x, y, psi = poses[0, wheel], poses[1, wheel], poses[2, wheel]
        c, s = ca.cos(psi), ca.sin(psi)
        moved = ca.jacobian(poses[:2, wheel], q[3 + segment])
        bend = [ca.SX(0), ca.SX(0)]
        bend[segment] = c * moved[0] + s * moved[1]
        rows.append(ca.horzcat(c, s, x * s - y * c, *bend))
    return ca.vertcat(*rows) / geometry.wheel_radius_m


def _body_rates(q: ca.SX, jacobian: ca.SX) -> ca.SX:
    """J with its first two rows turned into b0: (u, v, r, kappa1', kappa2') per input."""
    c, s = ca.cos(q[2]), ca.sin(q[2])
    to_body = ca.blockcat([[c, s], [-s, c]])
    return ca.vertcat(to_body @ jacobian[:2, :], jacobian[2:, :])


def shape_margins(geometry: Geometry, kappa: ca.SX) -> ca.SX:
    """(gap between the units [m], lower bound of the wheel independence) of a shape, 2x1.

    The gap is the largest separation along any side direction of the two squares (separating axis
    theorem): positive when they are apart, minus the overlap otherwise. With G = V^T V, scaled, the
    smallest singular value is at least 2 sqrt(det G) / tr G, because the other two eigenvalues have
    a product of at most (tr G / 2)^2.
    """
    q = ca.vertcat(0, 0, 0, kappa)
    wheels = wheel_configuration(geometry, q, ca.SX.zeros(2))[:, 2:] * geometry.wheel_radius_m
    scaled = ca.horzcat(wheels[:, :2], wheels[:, 2] / TURNING_RADIUS_M)
    gram = scaled.T @ scaled
    independence = 2 * ca.sqrt(ca.fmax(ca.det(gram), 0)) / ca.trace(gram)
    return ca.vertcat(_unit_gap(geometry, q), independence)


def _unit_gap(geometry: Geometry, q: ca.SX) -> ca.SX:
    half = geometry.unit_side_m / 2
    outward = geometry.end_link_m + half
    centres, axes = [], []
    for segment, side in ((0, -1), (1, 1)):
        end = fibre_end_pose(geometry, q, segment)
        c, s = ca.cos(end[2]), ca.sin(end[2])
        centres.append(ca.vertcat(end[0] + side * outward * c, end[1] + side * outward * s))
        axes += [ca.vertcat(c, s), ca.vertcat(-s, c)]
    between = centres[1] - centres[0]
    gaps = []
    for n, axis in enumerate(axes):
        other = axes[2:] if n < 2 else axes[:2]
        extent = half * (1 + sum(ca.fabs(ca.dot(axis, side)) for side in other))
        gaps.append(ca.fabs(ca.dot(axis, between)) - extent)
    return ca.fmax(ca.fmax(gaps[0], gaps[1]), ca.fmax(gaps[2], gaps[3]))
