"""Interval enclosures contain every value, and shrink with the box."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import ROBOT

from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.robot.description import PATH_MODELS, with_path_model


def every_operation() -> ca.Function:
    x = ca.SX.sym("x", 2)
    a, b = x[0], x[1]
    parts = [
        a + b,
        a - b,
        a * b,
        a / (2 + b**2),
        -a,
        1 / (3 + a),
        a**2,
        2 * b,
        ca.sqrt(1 + a**2),
        ca.exp(-a * b / 4),
        ca.cos(a),
        ca.sin(b),
        ca.cos(a * b) * ca.sin(a + b),
    ]
    return ca.Function("f", [x], [ca.vertcat(*parts)])


BOX = st.tuples(st.floats(-2.9, 6.0), st.floats(0.0, 3.0))


@given(first=BOX, second=BOX, seed=st.integers(0, 2**32 - 1))
def test_every_value_lies_in_the_enclosure(
    first: tuple[float, float], second: tuple[float, float], seed: int
) -> None:
    function = every_operation()
    lower = np.array([[first[0]], [second[0]]])
    width = np.array([[first[1]], [second[1]]])
    low, high = enclose(function, lower, lower + width)
    shares = np.random.default_rng(seed).uniform(0, 1, (2, 200))
    shares[:, :4] = [[0, 0, 1, 1], [0, 1, 0, 1]]
    values = function.map(200)(lower + shares * width).full()
    assert (values >= low - 1e-12).all()
    assert (values <= high + 1e-12).all()


def test_a_point_is_enclosed_tightly() -> None:
    function = every_operation()
    point = np.array([[0.7], [-1.3]])
    low, high = enclose(function, point, point)
    assert np.abs(high - low).max() < 1e-11
    np.testing.assert_allclose((low + high)[:, 0] / 2, function(point).full()[:, 0], atol=1e-11)


def test_division_by_an_interval_that_contains_zero_is_unbounded() -> None:
    x = ca.SX.sym("x", 1)
    low, high = enclose(ca.Function("f", [x], [1 / x]), np.array([[-1.0]]), np.array([[2.0]]))
    assert low[0, 0] == -np.inf
    assert high[0, 0] == np.inf


def test_an_unknown_operation_is_refused() -> None:
    x = ca.SX.sym("x", 1)
    with pytest.raises(NotImplementedError, match="no interval rule"):
        enclose(ca.Function("f", [x], [ca.atan(x)]), np.zeros((1, 1)), np.ones((1, 1)))


@pytest.mark.parametrize("model", PATH_MODELS)
def test_jacobians_of_all_path_models_can_be_enclosed(model: str) -> None:
    jacobian = kinematics(with_path_model(ROBOT, model)).jacobian
    x = ca.SX.sym("x", 7)
    function = ca.Function("f", [x], [ca.vec(jacobian(x[:5], x[5:]))])
    rng = np.random.default_rng(1)
    modes = rng.integers(0, 2, (2, 40)).astype(float)
    q = rng.uniform([-1, -1, -3, -60, -60], [1, 1, 3, 60, 60], (40, 5)).T
    half = np.array([[0.1], [0.1], [0.05], [0.5], [0.5]])
    low, high = enclose(function, np.vstack([q - half, modes]), np.vstack([q + half, modes]))
    values = function.map(40)(np.vstack([q, modes])).full()
    assert (values >= low).all()
    assert (values <= high).all()
