"""Interval evaluation of a CasADi SX function: enclosures of its values over boxes.

Each elementary operation maps intervals to an interval that contains every value it can take, so
the result contains the function's range over the box (natural interval extension); halving boxes
tightens it. Rounding is covered by a relative widening of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import casadi as ca
import numpy as np

from twosra_mpc.deadline import check_time
from twosra_mpc.robot.coordinates import Array

Interval = tuple[Array, Array]

_ROUNDING = 1e-12  # relative; a few thousand operations stay far below it


def enclose(function: ca.Function, lower: Array, upper: Array) -> Interval:
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
    shape = (function.numel_out(0), lower.shape[1])
    low, high = np.zeros(shape), np.zeros(shape)
    work: dict[int, Interval] = {}
    for operation, operands, results, constant in _tape(function):
        if operation == ca.OP_OUTPUT:
            low[results[1]], high[results[1]] = work[operands[0]]
        elif operation == ca.OP_INPUT:
            work[results[0]] = (lower[operands[1]], upper[operands[1]])
        elif operation == ca.OP_CONST:
            value = np.full(shape[1], constant)
            work[results[0]] = (value, value)
        else:
            rule = _RULES.get(operation)
            if rule is None:
                raise NotImplementedError(f"no interval rule for CasADi operation {operation}")
            work[results[0]] = rule(*(work[operand] for operand in operands))
    size = _ROUNDING * np.maximum(np.abs(low), np.abs(high))
    return low - size, high + size


@lru_cache(maxsize=64)
def _tape(function: ca.Function) -> list[tuple[int, list[int], list[int], float]]:
    """(operation, operands, results, constant) of every instruction."""
    tape = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        constant = function.instruction_constant(k) if operation == ca.OP_CONST else math.nan
        operands, results = function.instruction_input(k), function.instruction_output(k)
        tape.append((operation, operands, results, constant))
    return tape


def _add(a: Interval, b: Interval) -> Interval:
    return a[0] + b[0], a[1] + b[1]


def _subtract(a: Interval, b: Interval) -> Interval:
    return a[0] - b[1], a[1] - b[0]


def _multiply(a: Interval, b: Interval) -> Interval:
    products = np.array([a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]])
    return products.min(axis=0), products.max(axis=0)


def _invert(a: Interval) -> Interval:
    """1 / a; everything where a contains zero."""
    safe = (a[0] > 0) | (a[1] < 0)
    with np.errstate(divide="ignore"):
        return np.where(safe, 1 / a[1], -np.inf), np.where(safe, 1 / a[0], np.inf)


def _square(a: Interval) -> Interval:
    ends = np.array([a[0] ** 2, a[1] ** 2])
    return np.where((a[0] <= 0) & (a[1] >= 0), 0.0, ends.min(axis=0)), ends.max(axis=0)


def _cosine(a: Interval) -> Interval:
    ends = np.array([np.cos(a[0]), np.cos(a[1])])
    top = np.floor(a[1] / (2 * np.pi)) >= np.ceil(a[0] / (2 * np.pi))
    bottom = np.floor((a[1] / np.pi - 1) / 2) >= np.ceil((a[0] / np.pi - 1) / 2)
    return np.where(bottom, -1.0, ends.min(axis=0)), np.where(top, 1.0, ends.max(axis=0))


_QUARTER_TURN = (np.array(np.pi / 2), np.array(np.pi / 2))

_RULES: dict[int, Callable[..., Interval]] = {
    ca.OP_ADD: _add,
    ca.OP_SUB: _subtract,
    ca.OP_MUL: _multiply,
    ca.OP_DIV: lambda a, b: _multiply(a, _invert(b)),
    ca.OP_NEG: lambda a: (-a[1], -a[0]),
    ca.OP_INV: _invert,
    ca.OP_SQ: _square,
    ca.OP_TWICE: lambda a: (2 * a[0], 2 * a[1]),
    ca.OP_SQRT: lambda a: (np.sqrt(a[0]), np.sqrt(a[1])),
    ca.OP_EXP: lambda a: (np.exp(a[0]), np.exp(a[1])),
    ca.OP_COS: _cosine,
    ca.OP_SIN: lambda a: _cosine(_subtract(a, _QUARTER_TURN)),
}
