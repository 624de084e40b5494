r"""The unified hybrid Jacobian, the wheel poses and the wheel configuration matrix.

.. math:: \dot q = J(q, \sigma)\,v, \qquad \omega = V(q, \sigma)\,v

q = [x, y, phi, kappa1 ... kappan] (m, m, rad, 1/m), v = [v1, v2, u0, v0, r0] (m/s, m/s, m/s, m/s,
rad/s), omega = four wheel speeds (rad/s), sigma = (s1 ... sn), 1 = soft. Frames as in the paper: b0
at the middle of the (middle) link, x from LU1 to LU2; kappa_j > 0 bends segment j to +y; v_1, v_2
> 0 move LU1, LU2 to their own +y and raise the curvatures. This is the only place where the
kinematics is written, for any number of segments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.arguments import check_size, public
from twosra_mpc.errors import InputError
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.chain import wheel_pose_matrix, wheel_poses
from twosra_mpc.model.path_models import PathModel, path_model
from twosra_mpc.robot.coordinates import INPUTS, POSE, WHEELS, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

TURNING_RADIUS_M = 0.1  # at which turning is compared with shifting in singular values
_PARALLEL = 1e-3  # rad between lines that meet nowhere


class ModelFunction(ca.Function):
    """A compiled function that says which of its arguments q, sigma and kappa does not fit."""

    if not TYPE_CHECKING:  # the types are CasADi's

        def __call__(self, *args: Any, **named: Any) -> Any:
            """Values of the function, of numbers or of symbols.

            Raises:
                InputError: If an argument is missing, has another size, or is no mode.
            """
            names = self.name_in()
            if len(args) != len(names) or named:
                allowed = f"the arguments {' and '.join(names)}, in this order"
                raise InputError(self.name(), args or named, allowed)
            for place, (name, given) in enumerate(zip(names, args, strict=True)):
                size = self.size1_in(place)
                if not isinstance(given, ca.SX | ca.MX) or given.shape != (size, 1):
                    check_size(name, given, size, "mode" if name == "sigma" else "")
            return super().__call__(*args)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ModelFunction) and self.serialize() == other.serialize()

    def __hash__(self) -> int:
        return hash(self.serialize())


@public
@dataclass(frozen=True)
class Kinematics:
    """Kinematics of a robot of n segments, as CasADi functions of numbers or of symbols.

    The configuration q = [x, y, phi, kappa1 ... kappan] (m, m, rad, 1/m ...) is the pose of frame
    b0 in the plane and the curvatures of the segments. The mode sigma = (s1 ... sn) is their
    stiffness, 1 = soft. The input v = [v1, v2, u0, v0, r0] (m/s, m/s, m/s, m/s, rad/s) holds the
    speeds of the two units, and the velocity of the rigid robot along and about the axes of b0.
    Then q' = J(q, sigma) v, and the four wheels turn at omega = V(q, sigma) v (rad/s).

    Called with numbers, a function returns a CasADi matrix: ``.full()`` makes it an array. Called
    with CasADi symbols, it returns an expression, which can be differentiated. An argument that
    does not fit is an ``InputError``.

    Attributes:
        jacobian: (q, sigma) -> J, the hybrid Jacobian, (3 + n) x 5.
        wheel_matrix: (q, sigma) -> V, 4 x 5, in rad/m (last column: in 1): by the exact map where
            the robot bends in exact arcs, else the paper's configuration matrix, with which only
            side wheels turn while a segment is soft.
        wheel_map: kappa -> W, the exact map, 4 x (3 + n): speeds of wheels that do not slip, per
            velocity of b0 in its own axes [m/s, m/s, rad/s] and curvature rates [1/(m s)].
        shared: (q, sigma) -> (J, V); cheaper than one after the other.
        wheel_poses: q -> poses of the wheels in b0, 3 x 4, columns (x, y, psi) [m, m, rad].
    """

    jacobian: ModelFunction
    wheel_matrix: ModelFunction
    wheel_map: ModelFunction
    shared: ModelFunction
    wheel_poses: ModelFunction

    def inputs(self, q: ArrayLike, sigma: ArrayLike, wheel_rad_s: ArrayLike) -> Array:
        """Inputs v = V+ omega of wheel speeds, by the Moore-Penrose inverse.

        Exact for speeds V v of inputs that the mode has; else the nearest by least squares. Inputs
        that a mode has not are 0. Paper, section Unified Jacobian Matrix.

        Args:
            q: Configuration, (3 + n,) [m, m, rad, 1/m ...].
            sigma: Mode, (n,), 1 = soft.
            wheel_rad_s: Speeds of the four wheels [rad/s].

        Returns:
            v = (v1, v2, u0, v0, r0) in m/s, m/s, m/s, m/s, rad/s; (5,).

        Raises:
            InputError: If an argument has another size, or is no mode.
        """
        check_size("wheel_rad_s", wheel_rad_s, WHEELS)
        given: Any = (q, sigma)  # checked by what is called
        matrix = self.wheel_matrix(*given).full()
        return np.linalg.pinv(matrix) @ np.asarray(wheel_rad_s, float)


class InPlace:
    """A function that reads from and writes to fixed arrays, for loops: ``evaluate()`` it.

    Saves converting arrays on every call. A matrix is written with a row for each of its columns.
    """

    def __init__(
        self, function: ca.Function, reads: Sequence[Array], writes: Sequence[Array]
    ) -> None:
        buffer: Any = function.buffer()  # its type stub describes the C++ call, not this one
        self._memory, self.evaluate = buffer  # the memory must live as long as evaluate is used
        self._kept = (function, *reads, *writes)
        for place, array in enumerate(reads):
            self._memory.set_arg(place, memoryview(array.data))
        for place, array in enumerate(writes):
            self._memory.set_res(place, memoryview(array.data))


@public
@per_body()
def kinematics(robot: Robot | Body) -> Kinematics:
    """Write down the kinematics of a robot and compile it; kept, so that asking again is free.

    Args:
        robot: A robot, or what its motion depends on (``robot.body``).

    Raises:
        InputError: If it is something else.
    """
    segments = robot.geometry.segments
    q, sigma = ca.SX.sym("q", POSE + segments), ca.SX.sym("sigma", segments)
    path = path_model(robot)
    in_body = hybrid_jacobian(robot.geometry, path, q[POSE:], sigma)
    jacobian = ca.vertcat(_turned(q[2]) @ in_body[:2, :], in_body[2:, :])
    wheel_map = exact_wheel_map(robot.geometry)
    if path.wheel_map == "exact":
        wheels = wheel_map(q[POSE:]) @ in_body
    else:
        wheels = wheel_configuration(robot.geometry, q, sigma)
    both = [ca.densify(jacobian), ca.densify(wheels)]
    names = ["q", "sigma"], ["J", "V"]
    shared = ca.Function("kinematics", [q, sigma], both, *names, {"cse": True})
    jacobian, wheels = shared(q, sigma)
    return Kinematics(
        jacobian=ModelFunction(ca.Function("J", [q, sigma], [jacobian], ["q", "sigma"], ["J"])),
        wheel_matrix=ModelFunction(ca.Function("V", [q, sigma], [wheels], ["q", "sigma"], ["V"])),
        wheel_map=ModelFunction(wheel_map),
        shared=ModelFunction(shared),
        wheel_poses=ModelFunction(wheel_poses(robot.geometry)),
    )


@per_body(8)
def driven(body: Body, mode: Mode) -> ca.Function:
    r"""Motions z (m,) that the wheels determine in a mode: q -> (N, D, U).

    q' = N z, the wheels turn at omega = D z, and the inputs v = U z belong to it. Rigid: z is the
    twist (u, v, r) of b0. Soft, with the exact wheel map: that twist and the mean rate of the soft
    segments' curvatures, four numbers for four wheels. Soft, with the paper's map: z = (v1, v2).
    """
    q, sigma = ca.SX.sym("q", POSE + body.geometry.segments), ca.DM(mode)
    compiled, path = kinematics(body), path_model(body)
    jacobian, wheels = compiled.jacobian(q, sigma), compiled.wheel_matrix(q, sigma)
    parts: list[Any]
    if is_rigid(mode) or path.wheel_map == "paper":
        columns = slice(2, INPUTS) if is_rigid(mode) else slice(0, 2)
        parts = [jacobian[:, columns], wheels[:, columns], ca.DM.eye(INPUTS)[:, columns]]
    else:
        rates = ca.SX.zeros(body.geometry.segments)
        lengths = body.geometry.lengths_m
        for j in soft_segments(mode):
            rates[j] = path.share(j, q[POSE + j] * lengths[j]) / lengths[j]
        rates *= sum(mode) / ca.sum1(rates)
        motion = ca.diagcat(_turned(q[2]), 1, rates)
        bends = ca.SX(ca.DM([[0, 0, 1, *[0] * len(mode)], [0, 0, 0, *np.divide(mode, sum(mode))]]))
        inputs = ca.SX.zeros(INPUTS, POSE + 1)
        inputs[:2, 2:] = ca.inv_minor(bends @ jacobian[:, :2])
        parts = [motion, compiled.wheel_map(q[POSE:]) @ ca.diagcat(ca.SX.eye(POSE), rates), inputs]
    names = ["N", "D", "U"]
    return ca.Function("driven", [q], [ca.sparsify(part) for part in parts], ["q"], names)


@per_body()
def wheel_travel(body: Body) -> ca.Function:
    """(q, s, sigma) -> V(q, sigma) s: angle each wheel rolls over an interval [rad], shape (4,)."""
    segments = body.geometry.segments
    q, s = ca.SX.sym("q", POSE + segments), ca.SX.sym("s", INPUTS)
    sigma = ca.SX.sym("sigma", segments)
    matrix = kinematics(body).wheel_matrix(q, sigma)
    return ca.Function("wheel_travel", [q, s, sigma], [matrix @ s])


def hybrid_jacobian(geometry: Geometry, path: PathModel, kappa: ca.SX, sigma: ca.SX) -> ca.SX:
    """J as seen from b0, (3 + n) x 5, columns (v1, v2, u0, v0, r0); sigma may be a symbol.

    Its rows are b0's twist (u, v, r) and the curvatures' rates: at phi = 0 those of q. Paper
    section III-D with errata 3 (sign of the phi row) and 9 (autonomous form).
    """
    lengths = ca.DM(geometry.lengths_m)
    stiffness = [sigma[j] for j in range(geometry.segments)]
    rigid = math.prod((1 - s for s in stiffness), start=ca.SX(1))
    soft = [
        ca.vertcat(*bend.twist, ca.vertcat(*bend.bending) / lengths)
        for bend in path.bends(kappa * lengths, stiffness)
    ]
    drive = ca.vertcat(ca.SX.eye(POSE), ca.SX(geometry.segments, POSE)) * rigid
    return ca.horzcat(*soft, drive)


def _turned(angle: ca.SX) -> ca.SX:
    """Matrix that turns vectors by an angle."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[c, -s], [s, c]])


def wheel_configuration(geometry: Geometry, q: ca.SX, sigma: ca.SX) -> ca.SX:
    """V(q, sigma), 4x5, eq. config_matrix, with psi in the body frame (erratum 12)."""
    rigid = math.prod((1 - sigma[j] for j in range(geometry.segments)), start=ca.SX(1))
    rolled = rigid * _rolled_rigidly(wheel_pose_matrix(geometry, q))
    soft = (1 - rigid) * ca.DM([(1, 0), (0, 0), (0, -1), (0, 0)])
    return ca.horzcat(soft, rolled) / geometry.wheel_radius_m


def _rolled_rigidly(poses: ca.SX) -> ca.SX:
    """Rolling of wheels at these poses in b0 per body twist (u, v, r), 4x3."""
    x, y, psi = ca.vertsplit(poses)
    c, s = ca.cos(psi), ca.sin(psi)
    return ca.vertcat(c, s, x * s - y * c).T


def exact_wheel_map(geometry: Geometry) -> ca.Function:
    """W as a function of kappa, 4 x (3 + n): wheel speeds per (u, v, r) and curvature rates.

    Wheels that do not slip while the fibre bends: the rigid columns as in the paper, and for each
    wheel how far it moves along its drive direction, seen from b0, when a segment bends.
    """
    kappa = ca.SX.sym("kappa", geometry.segments)
    poses = wheel_pose_matrix(geometry, ca.vertcat(0, 0, 0, kappa))
    rigid = _rolled_rigidly(poses)
    bent = [rigid[wheel, :2] @ ca.jacobian(poses[:2, wheel], kappa) for wheel in range(WHEELS)]
    rows = ca.horzcat(rigid, ca.vertcat(*bent)) / geometry.wheel_radius_m
    return ca.Function("W", [kappa], [rows], ["kappa"], ["W"])


@per_body()
def bend_levers(body: Body) -> ca.Function:
    """Kappa (n,) -> lever of the wheels on each segment if it alone is soft, (n,), in its lengths.

    Wheels that stand leave each unit a turn about the point where their drive directions meet. The
    lever is how far a bend brings these two points together, per angle: by it their force bends the
    segment. Where it is zero, its column of W depends on the rigid ones. Where it has the sign of
    the bend, the spring of the segment pushes the points apart, and buckles if that takes much.

    Raises:
        InputError: If there is no such point.
    """
    geometry, kappa = body.geometry, ca.SX.sym("kappa", body.geometry.segments)
    poses, points = wheel_pose_matrix(geometry, ca.vertcat(0, 0, 0, kappa)), []
    for i in (0, 2):
        (x, y, psi), (x2, y2, psi2) = geometry.wheel_placement[i : i + 2]
        if abs(math.sin(psi2 - psi)) < _PARALLEL:
            allowed = "left out: wheels of a unit drive along parallel lines"
            raise InputError("limits.bend_lever", body.limits.bend_lever, allowed)
        across = (x2 - x) * math.sin(psi2) - (y2 - y) * math.cos(psi2)
        along = ca.vertcat(ca.cos(poses[2, i]), ca.sin(poses[2, i]))
        points.append(poses[:2, i] + across / math.sin(psi2 - psi) * along)
    closer = -ca.gradient(ca.norm_2(points[1] - points[0]), kappa)
    levers = closer / ca.DM(geometry.lengths_m) ** 2
    return ca.Function("levers", [kappa], [ca.densify(levers)], {"cse": True})


def wheel_independence(geometry: Geometry, kappa: ca.SX) -> ca.SX:
    """Lower bound of the smallest singular value of the rigid wheel matrix of a shape, scaled.

    Wheel radius is divided out, and turning measured at 0.1 m. With G = V^T V the smallest singular
    value is at least 2 sqrt(det G) / tr G, because the other two eigenvalues have a product of at
    most (tr G / 2)^2.
    """
    q, rigid = ca.vertcat(0, 0, 0, kappa), ca.SX.zeros(geometry.segments)
    wheels = wheel_configuration(geometry, q, rigid)[:, 2:] * geometry.wheel_radius_m
    scaled = ca.horzcat(wheels[:, :2], wheels[:, 2] / TURNING_RADIUS_M)
    gram = scaled.T @ scaled
    return 2 * ca.sqrt(ca.fmax(ca.det(gram), 0)) / ca.trace(gram)
