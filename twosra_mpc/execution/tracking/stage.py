r"""One sampling period of motion, seen from the outputs.

By the midpoint rule, the input that takes the outputs from y_k to y_{k+1} in one period h is

.. math:: u_k = M(\bar q_k)^{-1} (y_{k+1} - y_k) / h,

with the configuration half way. Speeds g = (v / v_max in soft modes, omega / omega_max), each
divided by its limit, follow from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from twosra_mpc.execution.tracking.setup import Setup
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.coordinates import WHEELS


@dataclass(frozen=True)
class Stage:
    """Compiled model of one period in one mode; m outputs, q half way, d = y_{k+1} - y_k.

    Attributes:
        motion: (q, d) -> (input u [m/s, rad/s], four wheel speeds [rad/s]).
        speeds: (q, d) -> (g, dg/dd, dg/dy): speeds, and their derivatives by the step, (rows, m),
            and by the last output half way, (rows,). The other outputs do not matter: rigid motion
            is the same everywhere, bending also in every direction.
        bending: q -> derivative of the moving curvatures by the outputs, (bending, m).
        limits: Rows of g to keep within one; those left out are then within one by themselves.
        wheels: Wheels that turn in this mode; they are the last rows of g.
    """

    motion: ca.Function
    speeds: ca.Function
    bending: ca.Function
    limits: tuple[int, ...]
    wheels: tuple[int, ...]

    @property
    def wheel_rows(self) -> slice:
        """The rows of g that are wheel speeds."""
        return slice(-len(self.wheels), None)


def stage_model(setup: Setup) -> Stage:
    """Write down the model of one period."""
    outputs, compiled = setup.outputs, kinematics(setup.robot)
    limits, bending = setup.robot.limits, list(outputs.bending)
    q, d = ca.SX.sym("q", setup.robot.coordinates.size), ca.SX.sym("d", outputs.count)
    inputs, sigma = list(outputs.inputs), ca.DM(setup.mode)
    jacobian = ca.sparsify(compiled.jacobian(q, sigma)[:, inputs])
    inverse = ca.inv_minor(ca.sparsify(ca.DM(outputs.selection)) @ jacobian)
    u = inverse @ d / setup.period_s
    drive = ca.sparsify(compiled.wheel_matrix(q, sigma)[:, inputs])
    wheels = tuple(i for i in range(WHEELS) if not drive[i, :].is_zero())

    by_wheel = drive[list(wheels), :] / limits.wheel_speed_rad_s
    g, rows = by_wheel @ u, list(range(len(wheels)))
    if bending:
        g = ca.vertcat(u / limits.unit_speed_m_s, g)
        rows = [0, 1] + [
            2 + i for i in rows if not _within_one(by_wheel[i, :], limits.unit_speed_m_s)
        ]
    bends = jacobian[bending, :] @ inverse
    along = ca.SX(outputs.selection[-1])
    for row, coordinate in enumerate(bending):
        along[coordinate] = bends[row, -1]
    return Stage(
        motion=ca.Function("motion", [q, d], [u, drive @ u]),
        speeds=ca.Function("speeds", [q, d], [g, ca.jacobian(g, d), ca.jtimes(g, q, along)]),
        bending=ca.Function("bending", [q], [bends]),
        limits=tuple(rows),
        wheels=wheels,
    )


def _within_one(row: ca.SX, most: float) -> bool:
    """Whether inputs of at most ``most`` keep a constant combination of them within one."""
    return row.is_constant() and float(ca.norm_1(ca.DM(row).T)) * most <= 1.0
