"""The published model: the unified Jacobian on logarithmic spirals, exactly as published.

Source: Labazanova et al., "Self-Reconfigurable Soft-Rigid Mobile Agent with Variable Stiffness
and Adaptive Morphology", IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749, section "Unified Jacobian
Matrix" (eqs. log_spiral, kappa_fit1 to kappa_fit3, kappa, jacobain_angle, F_derivative). This
module exists for parity with the published simulations (``greedy.published``). Every deviation
from good kinematics is the paper's; none is repaired here.

Configuration q = [x, y, phi, kappa_1, kappa_2] (m, m, rad, 1/m, 1/m), input
v = [v_1, v_2, u_0, v_0, r_0] (m/s, m/s, m/s, m/s, rad/s), mode sigma = (s_1, s_2) with 1 = soft.
With alpha = kappa l, spiral k in {I, II, III} and m = (3/2, 1, 3/4), for kappa <= 0::

    rho_k(kappa) = a_k exp(b_k (alpha / m_k - pi))         even in kappa
    K_k          = m_k / (l rho_k)                         curvature rate per unit LU speed
    Phi_k        = m_k / rho_k                             turning rate per unit LU speed
    dF_j/dkappa  = R(phi(q_0) +- alpha_j(q_0)) [ +- (c_0 sin alpha + c_1 rho_I sin(c_1 kappa)) ]
                                               [     c_0 cos alpha + c_1 rho_I cos(c_1 kappa)  ]
    Delta_k,j    = dF_j/dkappa K_k(kappa_j)

with c_0 = l l_0 / 2, c_1 = l / m_1 (rounded as below), the upper sign for segment j = 2 and the
lower one for j = 1. The columns of J^s are::

    sigma    v_1                                             v_2
    (0, 1)   Delta_II,2   -Phi_II,2   0        K_II,2    0            0           0        K_I,2
    (1, 0)   0            0           K_I,1    0         Delta_II,1   +Phi_II,1   K_II,1   0
    (1, 1)   Delta_III,2  -Phi_III,2  K_III,1  K_III,2   Delta_III,1  +Phi_III,1  K_III,1  K_III,2

and J^r = [R_z(phi); 0] takes u_0, v_0, r_0 in mode (0, 0); J^s is zero there, J^r in soft modes.

Everything runs on Python floats: on vectors of five they are several times faster than arrays. And
the last bits, on which the published loop depends, are then the same with every BLAS; only the C
library's exp, sin and cos are left to vary.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.errors import InputError
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import MODES, RIGID, Mode

Vector: TypeAlias = list[float]  # five entries, as q or v

SEGMENT_M = 0.04  # length of one segment
_SPIRAL_A = (2.3250 * SEGMENT_M, 3.3041 * SEGMENT_M, 2.4471 * SEGMENT_M)  # m, Table I
_SPIRAL_B = (0.3165, 0.083, 0.2229)  # 1/rad, Table I
_SPIRAL_M = (1.5, 1.0, 0.75)  # eqs. kappa_fit1 to kappa_fit3
_ADJACENT, _OPPOSITE, _BOTH = 0, 1, 2  # spirals I, II, III
_SEGMENT_1, _SEGMENT_2 = -1.0, 1.0  # sides of the link

# l l_0 / 2 and l / m_1. The second is 0.026667 rounded down by 0.25 %: it is what was simulated.
_HALF_LINK = 0.0006  # m^2
_L_OVER_M1 = 0.0266  # m

CURVATURE_RANGE = 2.0 * math.pi / SEGMENT_M  # 1/m, the range the spirals are defined on


class HeldFrame(NamedTuple):
    """Heading of the end frame of one segment."""

    cos: float
    sin: float


HeldFrames: TypeAlias = tuple[HeldFrame, HeldFrame]  # of segments 1 and 2


def published_jacobian(q: ArrayLike, q_start: ArrayLike, mode: Mode) -> Array:
    """Return the unified Jacobian J(q_0, q, sigma) of the paper.

    Args:
        q: (5,) current configuration in m, rad, 1/m.
        q_start: (5,) configuration q_0 at the start of the whole plan.
        mode: stiffness (s_1, s_2), 1 = soft.

    Returns:
        (5, 5) array with columns v_1, v_2 (zero when rigid), u_0, v_0, r_0 (zero when soft).

    Raises:
        InputError: On a malformed configuration or an unknown mode.
    """
    if mode not in MODES:
        raise InputError("mode", mode, f"one of {MODES}")
    current = checked_configuration("q", q)
    jacobian = np.zeros((5, 5))
    if mode == RIGID:
        cos, sin = math.cos(current[2]), math.sin(current[2])
        jacobian[:3, 2:] = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
    else:
        held = held_frames(checked_configuration("q_start", q_start))
        jacobian[:, :2] = np.transpose(_soft_columns(current, mode, held))
    return jacobian


def inverse_kinematics(
    q: Vector, mode: Mode, demand: Vector, held: HeldFrames
) -> tuple[Vector, Vector]:
    """Return v = J^+ demand and q_dot = J v."""
    if mode == RIGID:
        cos, sin = math.cos(q[2]), math.sin(q[2])
        u0 = cos * demand[0] + sin * demand[1]
        v0 = cos * demand[1] - sin * demand[0]
        rate = [cos * u0 - sin * v0, sin * u0 + cos * v0, demand[2], 0.0, 0.0]
        return [0.0, 0.0, u0, v0, demand[2]], rate
    column1, column2 = _soft_columns(q, mode, held)
    v1, v2 = _least_squares(column1, column2, demand)
    return [v1, v2, 0.0, 0.0, 0.0], combination(v1, column1, v2, column2)


def _least_squares(column1: Vector, column2: Vector, demand: Vector) -> tuple[float, float]:
    """Return [column1 column2]^+ demand by Gram-Schmidt.

    The columns are independent in every soft mode, because Phi > 0: no rank decision is needed.
    """
    r11 = math.sqrt(_dot(column1, column1))
    unit1 = [a / r11 for a in column1]
    r12 = _dot(unit1, column2)
    rest = combination(1.0, column2, -r12, unit1)
    v2 = _dot(rest, demand) / _dot(rest, rest)
    v1 = (_dot(unit1, demand) - r12 * v2) / r11
    return v1, v2


def _soft_columns(q: Vector, mode: Mode, held: HeldFrames) -> tuple[Vector, Vector]:
    """Return the columns of J^s for v_1 and v_2."""
    kappa1, kappa2 = q[3], q[4]
    if mode == (0, 1):
        x, y, phi, bend = _link_rates(_SEGMENT_2, _OPPOSITE, kappa2, held[1])
        return [x, y, phi, 0.0, bend], [0.0, 0.0, 0.0, 0.0, _bend_rate(_ADJACENT, kappa2)]
    if mode == (1, 0):
        x, y, phi, bend = _link_rates(_SEGMENT_1, _OPPOSITE, kappa1, held[0])
        return [0.0, 0.0, 0.0, _bend_rate(_ADJACENT, kappa1), 0.0], [x, y, phi, bend, 0.0]
    # Each segment bends at the spiral III rate of its own curvature, although the paper says that
    # the two curvatures change equally.
    x2, y2, phi2, bend2 = _link_rates(_SEGMENT_2, _BOTH, kappa2, held[1])
    x1, y1, phi1, bend1 = _link_rates(_SEGMENT_1, _BOTH, kappa1, held[0])
    return [x2, y2, phi2, bend1, bend2], [x1, y1, phi1, bend1, bend2]


def _link_rates(
    side: float, spiral: int, kappa: float, held: HeldFrame
) -> tuple[float, float, float, float]:
    """Return Delta_x, Delta_y, -+Phi and K: the link moves, the end of its soft segment is held.

    Args:
        side: +1 when segment 2 bends and LU 1 moves, -1 when segment 1 bends and LU 2 moves.
        spiral: index of the spiral the moving LU follows.
        kappa: current curvature of the bending segment in 1/m.
        held: end frame of the bending segment, at the start of the whole plan.
    """
    alpha = kappa * SEGMENT_M
    # Spiral I shapes the displacement in every mode, and its d rho / d kappa is left out. The
    # angle is 0.0266 kappa, not alpha / m_1: the rounded constant is used throughout.
    arm = _L_OVER_M1 * _spiral_radius(_ADJACENT, kappa)
    angle = _L_OVER_M1 * kappa
    along = side * (_HALF_LINK * math.sin(alpha) + arm * math.sin(angle))
    across = _HALF_LINK * math.cos(alpha) + arm * math.cos(angle)
    x = held.cos * along - held.sin * across
    y = held.sin * along + held.cos * across
    radius = _spiral_radius(spiral, kappa)
    bend = _SPIRAL_M[spiral] / (SEGMENT_M * radius)
    return x * bend, y * bend, -side * _SPIRAL_M[spiral] / radius, bend


def _bend_rate(spiral: int, kappa: float) -> float:
    """Return K_k(kappa) in 1/m^2: curvature rate per unit speed of the moving LU."""
    return _SPIRAL_M[spiral] / (SEGMENT_M * _spiral_radius(spiral, kappa))


def _spiral_radius(spiral: int, kappa: float) -> float:
    """Return rho_k(kappa) in m, even in kappa (the paper's formula jumps at 0)."""
    growth = _SPIRAL_B[spiral]
    angle = kappa * SEGMENT_M / _SPIRAL_M[spiral] - math.pi
    if kappa > 0.0:
        growth = -growth
        angle += 2.0 * math.pi
    return _SPIRAL_A[spiral] * math.exp(growth * angle)


def held_frames(start: Vector) -> HeldFrames:
    """Orient the end frames of both segments as they are at the start of the whole plan.

    This is the paper's q_0. It is wrong as soon as the "held" LU has turned, by 3 to 22 mm in the
    published simulations, and is kept because they were made with it.
    """
    headings = (start[2] - start[3] * SEGMENT_M, start[2] + start[4] * SEGMENT_M)
    first, second = (HeldFrame(math.cos(heading), math.sin(heading)) for heading in headings)
    return first, second


def checked_configuration(name: str, values: ArrayLike) -> Vector:
    """Check a configuration given by the caller and turn it into Python floats."""
    array = np.asarray(values, dtype=np.float64)
    given = array.tolist()
    if array.shape != (5,):
        raise InputError(name, given, "five numbers: x, y [m], phi [rad], kappa_1, kappa_2 [1/m]")
    if not np.all(np.isfinite(array)):
        raise InputError(name, given, "finite numbers")
    if np.max(np.abs(array[3:])) > CURVATURE_RANGE:
        allowed = f"curvatures within +-2 pi / l = +-{CURVATURE_RANGE:z.1f} 1/m, as of spirals"
        raise InputError(name, given, allowed)
    return given


def distance(a: Vector, b: Vector) -> float:
    """Return the published norm of a - b, which adds m, rad and 1/m without weights."""
    gap = difference(a, b)
    return math.sqrt(_dot(gap, gap))


# Written out: sum() rounds differently from Python 3.12 on, and loops over five take twice as long.
def difference(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4]]


def combination(s: float, a: Vector, t: float, b: Vector) -> Vector:
    """Return s a + t b."""
    return [
        s * a[0] + t * b[0],
        s * a[1] + t * b[1],
        s * a[2] + t * b[2],
        s * a[3] + t * b[3],
        s * a[4] + t * b[4],
    ]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]
