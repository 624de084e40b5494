r"""Motion of a robot whose wheels are told to turn: the one with which they slip least.

Four wheel speeds are more than a mode has inputs, so they need not agree. With A the columns of the
wheel matrix V of the mode's inputs, the robot moves with

.. math:: v = \arg\min_v |A(q)\,v - \omega|^2, \qquad
    \dot q = J(q, \sigma)\,v + N(q)\,z(\omega - A v) + d.

Where the wheels determine more motions N z than the mode has inputs (`driven`), the robot makes
those, too, that let the wheels slip less: z minimises the slip |D z - (omega - A v)|^2 that is left
and a little of itself, for there are shapes in which wheels lose control of a motion. d is what the
model does not know (`Drift`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import runge_kutta
from twosra_mpc.model.kinematics import driven, kinematics, wheel_travel
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

_ALMOST_SINGULAR = 1e-12  # relative; keeps the normal equations solvable in singular shapes
_DAMPING = 0.03  # singular value of D, columns of length one, below which a motion is lost


class Drift(NamedTuple):
    """Drift besides the model while the fibre bends.

    Attributes:
        pivot_rad_per_rad: Turn of the robot about b0, per angle by which all soft segments bend.
        slide_m_per_rad: Its shift along y of b0, per bending angle.
        split: With several segments soft, share by which the first of them bends more, the second
            less, the third more again.
    """

    pivot_rad_per_rad: float = 0.0
    slide_m_per_rad: float = 0.0
    split: float = 0.0


NO_DRIFT = Drift()


@per_body(8)
def rolling(body: Body, mode: Mode) -> ca.Function:
    """(q, turned, drift) -> q after the wheels have turned evenly by ``turned`` (4,) [rad].

    One Runge-Kutta 4 step; ``drift`` are the values of a `Drift`, (3,).
    """
    q, turned = ca.SX.sym("q", POSE + body.geometry.segments), ca.SX.sym("turned", WHEELS)
    drift = ca.SX.sym("drift", 3)
    after = runge_kutta(lambda at: _rate(body, mode, at, turned, drift), q)
    return ca.Function("rolling", [q, turned, drift], [ca.densify(after)])


def held(body: Body, mode: Mode, q: Array) -> float:
    """Share of its motions that wheels hold in a shape: 0 where one of them turns no wheel."""
    turns = driven(body, mode)(q)[1].full()
    least = np.linalg.svd(turns / np.linalg.norm(turns, axis=0), compute_uv=False)[-1]
    return float(least**2 / (least**2 + _DAMPING**2))


def rolled(body: Body, mode: Mode, start: Array, turned: Array) -> Array:
    """Configurations (m + 1, 3 + n) from ``start`` on, as the wheels turn by ``turned`` (m, 4)."""
    chain = rolling(body, mode).mapaccum(len(turned))
    still = np.zeros((3, len(turned)))
    return np.vstack([start, chain(start, turned.T, still).full().T])


def travelled(robot: Robot, mode: Mode, q: Array, displacement: Array) -> Array:
    """Angles that the wheels roll, (4,) [rad], for inputs times their duration, (5,)."""
    turned: Array = wheel_travel(robot.body)(q, displacement, mode).full().ravel()
    return turned


def dragged(robot: Robot, q: Array, bent: Array, turned: Array) -> Array:
    """Pose of b0, (3,), once the wheels have turned by ``turned`` (4,) [rad].

    It moves so that they slip least while the curvatures change by ``bent`` (n,) [1/m], whatever
    bends the fibre.
    """
    wheels = kinematics(robot).wheel_map(q[POSE:] + bent / 2).full()
    told = turned - wheels[:, POSE:] @ bent
    u, v, turn = np.linalg.lstsq(wheels[:, :POSE], told)[0]
    c, s = math.cos(q[2] + turn / 2), math.sin(q[2] + turn / 2)
    pose: Array = q[:POSE] + np.array([c * u - s * v, s * u + c * v, turn])
    return pose


def _rate(body: Body, mode: Mode, q: ca.SX, turned: ca.SX, drift: ca.SX) -> ca.SX:
    """Rate of q per unit of time, in which the wheels turn by ``turned``."""
    compiled = kinematics(body)
    inputs = [2, 3, 4] if is_rigid(mode) else [0, 1]
    sigma = ca.DM(mode)
    drive = ca.sparsify(compiled.wheel_matrix(q, sigma)[:, inputs])
    gram = drive.T @ drive
    gram += _ALMOST_SINGULAR * ca.trace(gram) * ca.DM.eye(len(inputs))
    v = ca.inv_minor(gram) @ (drive.T @ turned)
    jacobian = ca.sparsify(compiled.jacobian(q, sigma)[:, inputs])
    moved = jacobian @ v
    motions, turns, _ = driven(body, mode)(q)
    if motions.size2() > len(inputs):
        unit = ca.diag(1 / ca.sqrt(ca.sum1(turns**2)).T)
        slip, turns = turned - drive @ v, turns @ unit
        damped = turns.T @ turns + _DAMPING**2 * ca.DM.eye(turns.size2())
        moved += motions @ unit @ ca.inv_minor(damped) @ (turns.T @ slip)
    if not is_rigid(mode):
        soft = soft_segments(mode)
        if len(soft) > 1:
            for number, segment in enumerate(soft):
                moved[POSE + segment] *= 1 + drift[2] * (-1.0) ** number
        bend = ca.dot(ca.DM(body.geometry.lengths_m), moved[POSE:])
        slide = drift[1] * bend
        moved[:POSE] += ca.vertcat(-ca.sin(q[2]) * slide, ca.cos(q[2]) * slide, drift[0] * bend)
    return moved
