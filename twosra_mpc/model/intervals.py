"""Interval evaluation of a CasADi SX function: enclosures of its values over boxes.

Each elementary operation maps intervals to an interval that contains every value it can take, so
the result contains the function's range over the box (natural interval extension); halving boxes
tightens it. Rounding is covered by a relative widening of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.deadline import check_time
from twosra_mpc.model.cache import per_function
from twosra_mpc.robot.coordinates import Array

_ROUNDING = 1e-12  # relative; a few thousand operations stay far below it


class Interval(NamedTuple):
    """All values between two, in symbols.

    Attributes:
        low: Lower bound.
        high: Upper bound.
        never_negative: Whether the values are not, whatever the box.
    """

    low: ca.SX
    high: ca.SX
    never_negative: bool = False


def enclose(function: ca.Function, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Enclose the values of an SX function of one vector over many boxes.

    Args:
        function: x (n,) -> y (m,), an expanded SX function.
        lower: Lower corners of the boxes, (n, boxes).
        upper: Upper corners of the boxes, (n, boxes).

    Returns:
        Lower and upper bounds of y, each (m, boxes).

    Raises:
        NotImplementedError: If the function uses an operation without an interval rule.
    """
    check_time()
    low, high = np.split(_extension(function)(np.vstack([lower, upper])).full(), 2)
    size = _ROUNDING * np.maximum(np.abs(low), np.abs(high))
    return low - size, high + size


@per_function()
def _extension(function: ca.Function) -> ca.Function:
    """Lower and upper corner of a box, stacked -> bounds of y, likewise: compiled."""
    n, m = function.numel_in(0), function.numel_out(0)
    corners, bounds = ca.SX.sym("corners", 2 * n), ca.SX.zeros(2 * m)
    work: dict[int, Interval] = {}
    for k in range(function.n_instructions()):
        operation, operands = function.instruction_id(k), function.instruction_input(k)
        results = function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            bounds[results[1]], bounds[m + results[1]], _ = work[operands[0]]
        elif operation == ca.OP_INPUT:
            work[results[0]] = Interval(corners[operands[1]], corners[n + operands[1]])
        elif operation == ca.OP_CONST:
            value = function.instruction_constant(k)
            work[results[0]] = Interval(ca.SX(value), ca.SX(value), value >= 0)
        else:
            rule = _RULES.get(operation)
            if rule is None:
                raise NotImplementedError(f"no interval rule for CasADi operation {operation}")
            work[results[0]] = rule(*(work[operand] for operand in operands))
    return ca.Function("extension", [corners], [bounds], {"cse": True})


def _add(a: Interval, b: Interval) -> Interval:
    return Interval(a.low + b.low, a.high + b.high, a.never_negative and b.never_negative)


def _subtract(a: Interval, b: Interval) -> Interval:
    return Interval(a.low - b.high, a.high - b.low)


def _multiply(a: Interval, b: Interval) -> Interval:
    if not a.never_negative:
        a, b = b, a
    if a.never_negative:
        low = ca.fmin(a.low * b.low, a.high * b.low)
        return Interval(low, ca.fmax(a.low * b.high, a.high * b.high), b.never_negative)
    products = [a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high]
    return Interval(reduce(ca.fmin, products), reduce(ca.fmax, products))


def _negate(a: Interval) -> Interval:
    return Interval(-a.high, -a.low)


def _invert(a: Interval) -> Interval:
    """1 / a; everything where a contains zero."""
    safe = ca.logic_or(a.low > 0, a.high < 0)
    low, high = ca.if_else(safe, 1 / a.high, -math.inf), ca.if_else(safe, 1 / a.low, math.inf)
    return Interval(low, high)


def _square(a: Interval) -> Interval:
    ends = a.low**2, a.high**2
    around = ca.logic_and(a.low <= 0, a.high >= 0)
    return Interval(ca.if_else(around, 0.0, ca.fmin(*ends)), ca.fmax(*ends), never_negative=True)


def _rising(operation: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """The rule of a function that rises."""
    return lambda a: Interval(operation(a.low), operation(a.high))


def _cosine(a: Interval) -> Interval:
    ends = ca.cos(a.low), ca.cos(a.high)
    top = ca.floor(a.high / (2 * math.pi)) >= ca.ceil(a.low / (2 * math.pi))
    bottom = ca.floor((a.high / math.pi - 1) / 2) >= ca.ceil((a.low / math.pi - 1) / 2)
    low, high = ca.if_else(bottom, -1.0, ca.fmin(*ends)), ca.if_else(top, 1.0, ca.fmax(*ends))
    return Interval(low, high)


_QUARTER_TURN = Interval(ca.SX(math.pi / 2), ca.SX(math.pi / 2))

_RULES: dict[int, Callable[..., Interval]] = {
    ca.OP_ADD: _add,
    ca.OP_SUB: _subtract,
    ca.OP_MUL: _multiply,
    ca.OP_DIV: lambda a, b: _multiply(a, _invert(b)),
    ca.OP_NEG: _negate,
    ca.OP_INV: _invert,
    ca.OP_SQ: _square,
    ca.OP_TWICE: _rising(lambda x: 2 * x),
    ca.OP_SQRT: _rising(lambda x: ca.if_else(x < 0, 0.0, ca.sqrt(x))),  # where it is defined
    ca.OP_EXP: _rising(ca.exp),
    ca.OP_COS: _cosine,
    ca.OP_SIN: lambda a: _cosine(_subtract(a, _QUARTER_TURN)),
}
