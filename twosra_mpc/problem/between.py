"""How fast what limits bound can vary from one sample of a soft motion to the next, proved."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.problem.limits import speed_function
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.description import Body, Robot

Bounds = tuple[Array, Array]  # lower and upper


def share_rates(
    robot: Robot, kappa: Bounds, v: Bounds, a: Array, mode: NDArray[np.int64]
) -> Bounds:
    """Enclose d/dt of the shares of the speed limits that are used, (shares, m) [1/s].

    Interval arithmetic on the derivative along q' = J(q, sigma) v, v' = a. Shares are signed, in
    the order of ``speed_function``.

    Args:
        robot: The robot.
        kappa: Least and largest curvatures, each (m, n) [1/m].
        v: Least and largest inputs, each (m, 5).
        a: Their rate of change, (m, 5).
        mode: Stiffness, (m, n).
    """
    lower, upper = (np.hstack([k, s, a, mode]).T for k, s in zip(kappa, v, strict=True))
    return enclose(_share_rates(robot), lower, upper)


@per_body()
def _share_rates(body: Body) -> ca.Function:
    """(kappa, v, a, sigma) as one vector -> rates of the shares."""
    segments = body.geometry.segments
    parts = (segments, INPUTS, INPUTS, segments)
    x, q = ca.SX.sym("x", sum(parts)), ca.SX.sym("q", POSE + segments)
    kappa, v, a, sigma = ca.vertsplit(x, np.cumsum([0, *parts]).tolist())
    speeds, growth = (ca.vertcat(*speed_function(body)(q, s, sigma)) for s in (v, a))
    rates = growth + ca.jtimes(speeds, q, kinematics(body).jacobian(q, sigma) @ v)
    (rates,) = ca.substitute([rates], [q], [ca.vertcat(ca.SX.zeros(POSE), kappa)])
    return ca.Function("share_rates", [x], [ca.densify(rates)], {"cse": True})
