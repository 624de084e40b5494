r"""Motion of a robot whose wheels are told to turn: the one with which they slip least.

Four wheel speeds are more than a mode has inputs, so they need not agree. With A the columns of the
wheel matrix V of the mode's inputs, the robot moves with

.. math:: v = \arg\min_v |A(q)\,v - \omega|^2, \qquad \dot q = J(q, \sigma)\,v + d(q, v).

d is what the model does not know (`Drift`): a unit that is meant to hold is dragged round by the
one that bends the fibre, and slides, and two soft segments do not bend equally.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.chain import fibre_end_pose, placed
from twosra_mpc.model.flow import runge_kutta
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.description import Body
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

_ALMOST_SINGULAR = 1e-12  # relative; keeps the normal equations solvable in singular shapes


class Drift(NamedTuple):
    """Drift besides the model while the fibre bends.

    Attributes:
        pivot_rad_per_rad: Turn of a unit about its centre per angle by which the other one bends
            the fibre, in the sense in which that one turns.
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


def rolled(body: Body, mode: Mode, start: Array, turned: Array) -> Array:
    """Configurations (m + 1, 3 + n) from ``start`` on, as the wheels turn by ``turned`` (m, 4)."""
    chain = rolling(body, mode).mapaccum(len(turned))
    still = np.zeros((3, len(turned)))
    reached: Array = np.vstack([start, chain(start, turned.T, still).full().T])
    return reached


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
    if not is_rigid(mode):
        soft = soft_segments(mode)
        if len(soft) > 1:
            for number, segment in enumerate(soft):
                moved[POSE + segment] *= 1 + drift[2] * (-1.0) ** number
        moved[:POSE] += _slipped(body.geometry, q, jacobian @ ca.diag(v), drift)
    return moved


def _slipped(geometry: Geometry, q: ca.SX, moved: ca.SX, drift: ca.SX) -> ca.SX:
    """Rate of the pose (3,) by which the whole robot follows units that do not hold still.

    ``moved`` are the rates of q by either unit, (3 + n) x 2.
    """
    c, s = ca.cos(q[2]), ca.sin(q[2])
    slipped = ca.SX.zeros(POSE)
    for unit, sense in ((0, -1), (1, 1)):
        bend = ca.dot(ca.DM(geometry.lengths_m), moved[POSE:, unit])
        turn, centre = sense * drift[0] * bend, _unit_middle(geometry, q, 1 - unit)
        in_body = ca.vertcat(turn * centre[1], -turn * centre[0] + drift[1] * bend)
        slipped += ca.vertcat(ca.blockcat([[c, -s], [s, c]]) @ in_body, turn)
    return slipped


def _unit_middle(geometry: Geometry, q: ca.SX, unit: int) -> ca.SX:
    """Middle of a locomotion unit (0 or 1) in b0, (2,) [m]."""
    out_m, aside_m = geometry.unit_middle_m
    middle_m = ca.DM([(-1, 1)[unit] * out_m, aside_m])
    return placed(fibre_end_pose(geometry, q, unit), middle_m)


def rigid_wheel_speeds(body: Body, q: Array, twist: Array) -> Array:
    """Wheel speeds (4,) [rad/s] of a robot of shape q (3 + n,), all solid, that moves so.

    Args:
        body: The robot.
        q: Its configuration.
        twist: Speed along x and y of b0 and turning rate, (3,) [m/s, m/s, rad/s].
    """
    matrix = kinematics(body).wheel_matrix(q, np.zeros(body.geometry.segments)).full()
    speeds: Array = matrix[:, 2:] @ twist
    return speeds
