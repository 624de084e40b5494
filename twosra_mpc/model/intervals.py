"""Interval evaluation of a CasADi SX function: enclosures of its values over boxes.

Each elementary operation maps intervals to an interval that contains every value it can take, so
the result contains the function's range over the box (natural interval extension); halving boxes
tightens it. Rounding is covered by a relative widening of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial, reduce
from typing import NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.cache import per_function
from twosra_mpc.model.rows import by_rows
from twosra_mpc.robot.coordinates import Array

_AT_ONCE = 1000  # operations that cost about as much as a call
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
    charge(Cost.ENCLOSURE, 1 + lower.size * function.n_instructions() // _AT_ONCE)
    (found,) = by_rows(_extension(function), np.vstack([lower, upper]).T)
    low, high = np.split(found.T, 2)
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
    return ca.Function("extension", [corners], [bounds])


def _binary(operation: int) -> Callable[[ca.SX | float, ca.SX | float], ca.SX]:
    """An operation by its code: an operator tries numbers first, which takes 25 times as long."""
    return partial(ca.SX.binary, operation)


def _unary(operation: int) -> Callable[[ca.SX | float], ca.SX]:
    return partial(ca.SX.unary, operation)


_plus, _minus, _times, _over = map(_binary, (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV))
_lesser, _greater, _less, _at_most = map(_binary, (ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE))
_both, _either, _zero_unless = map(_binary, (ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO))
_not, _inverse, _squared, _root = map(_unary, (ca.OP_NOT, ca.OP_INV, ca.OP_SQ, ca.OP_SQRT))
_floor, _ceiling, _cos = map(_unary, (ca.OP_FLOOR, ca.OP_CEIL, ca.OP_COS))


def _if_else(true: ca.SX, value: ca.SX | float, other: ca.SX | float) -> ca.SX:
    return _plus(_zero_unless(true, value), _zero_unless(_not(true), other))


def _add(a: Interval, b: Interval) -> Interval:
    never_negative = a.never_negative and b.never_negative
    return Interval(_plus(a.low, b.low), _plus(a.high, b.high), never_negative)


def _subtract(a: Interval, b: Interval) -> Interval:
    return Interval(_minus(a.low, b.high), _minus(a.high, b.low))


def _multiply(a: Interval, b: Interval) -> Interval:
    if not a.never_negative:
        a, b = b, a
    if a.never_negative:
        low = _lesser(_times(a.low, b.low), _times(a.high, b.low))
        high = _greater(_times(a.low, b.high), _times(a.high, b.high))
        return Interval(low, high, b.never_negative)
    products = [_times(one, other) for one in a[:2] for other in b[:2]]
    return Interval(reduce(_lesser, products), reduce(_greater, products))


def _invert(a: Interval) -> Interval:
    """1 / a; everything where a contains zero."""
    safe = _either(_less(0, a.low), _less(a.high, 0))
    low, high = _inverse(a.high), _inverse(a.low)
    return Interval(_if_else(safe, low, -math.inf), _if_else(safe, high, math.inf))


def _square(a: Interval) -> Interval:
    ends = _squared(a.low), _squared(a.high)
    around = _both(_at_most(a.low, 0), _at_most(0, a.high))
    return Interval(_if_else(around, 0.0, _lesser(*ends)), _greater(*ends), never_negative=True)


def _rising(operation: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """The rule of a function that rises."""
    return lambda a: Interval(operation(a.low), operation(a.high))


def _cosine(a: Interval) -> Interval:
    ends = _cos(a.low), _cos(a.high)
    low = _if_else(_holds(a, math.pi), -1.0, _lesser(*ends))
    return Interval(low, _if_else(_holds(a, 0.0), 1.0, _greater(*ends)))


def _holds(a: Interval, angle: float) -> ca.SX:
    """1 if it holds this angle, up to full turns, else 0."""
    first, last = (_over(_minus(end, angle), 2 * math.pi) for end in a[:2])
    return _at_most(_ceiling(first), _floor(last))


_ZERO = Interval(ca.SX(0), ca.SX(0))
_QUARTER_TURN = Interval(ca.SX(math.pi / 2), ca.SX(math.pi / 2))

_RULES: dict[int, Callable[..., Interval]] = {
    ca.OP_ADD: _add,
    ca.OP_SUB: _subtract,
    ca.OP_MUL: _multiply,
    ca.OP_DIV: lambda a, b: _multiply(a, _invert(b)),
    ca.OP_NEG: lambda a: _subtract(_ZERO, a),
    ca.OP_INV: _invert,
    ca.OP_SQ: _square,
    ca.OP_TWICE: _rising(_unary(ca.OP_TWICE)),
    ca.OP_SQRT: _rising(lambda x: _if_else(_less(x, 0), 0.0, _root(x))),  # where it is defined
    ca.OP_EXP: _rising(_unary(ca.OP_EXP)),
    ca.OP_COS: _cosine,
    ca.OP_SIN: lambda a: _cosine(_subtract(a, _QUARTER_TURN)),
}
