r"""The four entire functions of the bending angle that exact constant-curvature kinematics needs.

.. math:: S = \sin a / a, \quad C = (1 - \cos a) / a, \quad
          A = (a - \sin a) / a^2, \quad B = (1 - \cos a) / a^2

Each is coded as a Taylor polynomial in a^2: no division, no branch, exact derivatives at a = 0,
absolute error below 2e-12 for abs(a) <= 2 pi.
"""

from __future__ import annotations

import math

import casadi as ca

_TERMS = 17


def _series(alpha: ca.SX, offset: int) -> ca.SX:
    """Return sum over k of (-1)^k a^(2k) / (2k + offset)!, by Horner's rule."""
    square = alpha * alpha
    total = ca.SX(0)
    for k in reversed(range(_TERMS)):
        total = (-1) ** k / math.factorial(2 * k + offset) + square * total
    return total


def sinc(alpha: ca.SX) -> ca.SX:
    """S(a) = sin(a) / a."""
    return _series(alpha, 1)


def versine_ratio(alpha: ca.SX) -> ca.SX:
    """C(a) = (1 - cos a) / a."""
    return alpha * _series(alpha, 2)


def sagitta_ratio(alpha: ca.SX) -> ca.SX:
    """A(a) = (a - sin a) / a^2."""
    return alpha * _series(alpha, 3)


def versine_ratio_squared(alpha: ca.SX) -> ca.SX:
    """B(a) = (1 - cos a) / a^2."""
    return _series(alpha, 2)
