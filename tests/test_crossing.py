"""Crossings of zero are found to rounding, however the function bends."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from twosra_mpc.thermal.model import crossing

SHAPES: dict[str, Callable[[float], float]] = {
    "line": lambda t: t,
    "saturating": lambda t: 1 - math.exp(-t / 5.0),
    "steep at first and last": lambda t: t + t**3,
    "growing": lambda t: math.expm1(t / 9.0),
}


@pytest.mark.parametrize("shape", SHAPES)
@given(root=st.floats(0.01, 99.0), side=st.sampled_from([-1.0, 1.0]))
def test_crossings_are_those_that_brent_finds(shape: str, root: float, side: float) -> None:
    def function(t: float) -> float:
        return side * SHAPES[shape](t - root)

    found = crossing(function, (0.0, function(0.0)), (100.0, function(100.0)))
    assert found == pytest.approx(root, abs=1e-11)
    assert abs(function(found)) <= abs(function(brentq(function, 0.0, 100.0, xtol=1e-12))) + 1e-12


def test_a_bracket_that_ends_at_zero_is_its_end() -> None:
    assert crossing(lambda t: min(t - 3.0, 0.0), (0.0, -3.0), (3.0, 0.0)) == 3.0


def test_it_takes_no_more_than_a_secant_where_the_function_is_a_line() -> None:
    asked = []

    def function(t: float) -> float:
        asked.append(t)
        return t - 3.0

    for first in (None, 3.0):
        asked.clear()
        assert crossing(function, (0.0, -3.0), (8.0, 5.0), first) == pytest.approx(3.0, abs=1e-12)
        assert len(asked) <= 3
