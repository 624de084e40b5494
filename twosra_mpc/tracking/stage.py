r"""One sampling period of motion, seen from the outputs.

By the midpoint rule, the input that takes the outputs from y_k to y_{k+1} in one period h is

.. math:: u_k = M(\bar q_k)^{-1} (y_{k+1} - y_k) / h,

with the configuration half way. What is limited, each divided by its limit, is g = (v / v_max,
V u / omega_max), the locomotion units' speeds in soft modes and all wheel speeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.modes import Mode
from twosra_mpc.robot import Robot
from twosra_mpc.tracking.outputs import OUTPUTS, Outputs
from twosra_mpc.tracking.settings import TrackerLimits, TrackerWeights

Array = NDArray[np.float64]

CURVATURE_MARGIN = 1.05  # measured curvatures are taken as at most this many times the limit


@dataclass(frozen=True)
class Setup:
    """Everything the quadratic program of one mode is made from."""

    robot: Robot
    mode: Mode
    horizon: int
    period_s: float
    weights: TrackerWeights
    limits: TrackerLimits

    @property
    def outputs(self) -> Outputs:
        """What the mode tracks."""
        return OUTPUTS[self.mode]

    @property
    def scale(self) -> Array:
        """Deviation of each output that costs one, (m,) [m, m, rad or rad, 1/m]."""
        weights = self.weights
        of = np.array(
            [weights.position_m] * 2 + [weights.heading_rad] + [weights.curvature_per_m] * 2
        )
        scale: Array = self.outputs.selection @ of
        return scale


@dataclass(frozen=True)
class Stage:
    """Compiled model of one period in one mode; m outputs, q half way, d = y_{k+1} - y_k.

    Attributes:
        speeds: (q, d) -> (input u [m/s, rad/s], four wheel speeds [rad/s]).
        limited: (q, d) -> (g, dg/dd, dg/dy): what is limited, (rows,), and its derivatives by the
            step, (rows, m), and by the last output half way, (rows,). The other outputs do not
            matter: rigid motion is the same everywhere, bending also in every direction.
        bending: q -> d(curvatures of ``Outputs.bending``) / dy, (bending, m).
        wheels: Which wheels turn in this mode; the last rows of g.
    """

    speeds: ca.Function
    limited: ca.Function
    bending: ca.Function
    wheels: tuple[int, ...]


def stage_model(setup: Setup) -> Stage:
    """Write down the model of one period."""
    outputs, compiled = setup.outputs, kinematics(setup.robot)
    q, d = ca.SX.sym("q", 5), ca.SX.sym("d", outputs.count)
    inputs = list(outputs.inputs)
    sigma = ca.DM(setup.mode)
    motion = ca.sparsify(compiled.jacobian(q, sigma)[:, inputs])
    inverse = ca.inv_minor(ca.sparsify(ca.DM(outputs.selection)) @ motion)
    u = inverse @ d / setup.period_s
    wheels = ca.sparsify(compiled.wheel_matrix(q, sigma)[:, inputs]) @ u
    turning = tuple(i for i in range(4) if not wheels[i].is_zero())

    limits = setup.robot.limits
    g = wheels[list(turning)] / limits.wheel_speed_rad_s
    if outputs.bending:
        g = ca.vertcat(u / limits.unit_speed_m_s, g)
    bending = motion[list(outputs.bending), :] @ inverse
    along = ca.SX(outputs.selection[-1])
    for row, coordinate in enumerate(outputs.bending):
        along[coordinate] = bending[row, -1]
    return Stage(
        speeds=ca.Function("speeds", [q, d], [u, wheels]),
        limited=ca.Function("limited", [q, d], [g, ca.jacobian(g, d), ca.jtimes(g, q, along)]),
        bending=ca.Function("bending", [q], [bending]),
        wheels=turning,
    )
