"""When a function of time passes zero."""

from __future__ import annotations

import math
from collections.abc import Callable

_EXACT_S, _UNIT = 1e-12, 2.0**-52


Point = tuple[float, float]  # time [s] and value


def crossing(
    function: Callable[[float], float], low: Point, high: Point, first: float | None = None
) -> float:
    """Time at which ``function`` is zero, between two points that it is known at.

    Chandrupatla's method (Advances in Engineering Software 28, 1997): inverse quadratic
    interpolation where that is safe, else bisection. Exact to 1e-12 s and rounding.

    Args:
        function: Of time; its signs differ at the two points.
        low: The earlier one.
        high: The later one.
        first: Where to look first; without, where the secant is zero.
    """
    (a, at_a), (b, at_b) = low, high
    x = a + at_a / (at_a - at_b) * (b - a) if first is None else first
    while True:
        if (at_x := function(x)) == 0:
            return x
        if (at_x < 0) == (at_a < 0):
            c, at_c = a, at_a
        else:
            c, at_c, b, at_b = b, at_b, a, at_a
        a, at_a = x, at_x
        best = a if abs(at_a) < abs(at_b) else b
        least = (_EXACT_S + 4 * _UNIT * abs(best)) / abs(b - a)
        if least > 0.5:
            return best
        part, rise = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        share = 0.5
        if 1 - math.sqrt(1 - part) < rise < math.sqrt(part):
            share = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            share += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
        x = a + min(1 - least, max(least, share)) * (b - a)
