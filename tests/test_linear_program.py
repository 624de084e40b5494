"""What is proved of linear programs, however wrong the solver is."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from twosra_mpc.planning.bounds import linear_program
from twosra_mpc.planning.bounds.linear_program import Optimum, Rows, minimise, proved_minimum


def random_program(seed: int) -> tuple[Any, ...]:
    """Differences of times that are at least so much, the last one the cost; and a bounded one."""
    rng, n = np.random.default_rng(seed), 6
    rows, limits = [], []
    for u in range(n):
        for v in range(u + 1, n):
            row = np.zeros(n + 1)
            row[[u, v]], row[n] = [1.0, -1.0], rng.normal()
            rows.append(row)
            limits.append(-rng.uniform())
    objective = np.zeros(n + 1)
    objective[n - 1] = 1.0
    bounds = [*[(0.0, None)] * n, (-2.0, 3.0)]
    return objective, np.array(rows), np.array(limits), bounds, np.array([1.0] * n + [math.inf])


@pytest.mark.parametrize("seed", range(10))
def test_the_proved_minimum_is_the_minimum(seed: int) -> None:
    program = random_program(seed)
    optimum = minimise(*program[:4])
    assert optimum is not None
    proved, x = proved_minimum(*program)
    assert optimum[0] * (1 - 1e-9) - 1e-9 <= proved <= optimum[0] + 1e-12
    assert x == pytest.approx(optimum[1])


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("size", [1e-7, 0.1, 10.0])
def test_wrong_multipliers_prove_less_and_never_more(
    seed: int, size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = random_program(seed)
    optimum = minimise(*program[:4])
    assert optimum is not None
    noise = size * np.random.default_rng(seed).normal(size=len(program[1]))

    def wrong(*args: Any) -> Optimum:
        found = minimise(*args)
        assert found is not None
        return Optimum(found.cost + 1.0, found.x, found.marginals + noise)

    monkeypatch.setattr(linear_program, "minimise", wrong)
    proved, _ = proved_minimum(*program)
    assert 0.0 <= proved <= optimum[0] + 1e-12
    if size < 1e-3:
        assert proved >= optimum[0] - 1e-4


def test_contradictions_are_proved_by_a_ray() -> None:
    # x + 1 <= y and y + 1 <= x, whatever they are; and b is at least 1 and at most 0.5.
    rows, limits = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-1.0, -1.0])
    free = [(0.0, None)] * 2
    assert proved_minimum(np.ones(2), rows, limits, free, np.ones(2))[0] == math.inf
    row, limit = np.array([[-1.0]]), np.array([-1.0])
    least, x = proved_minimum(np.ones(1), row, limit, [(0.0, 0.5)], np.zeros(1))
    assert least == math.inf
    assert x == pytest.approx([0.5])


def test_what_the_solver_wrongly_calls_infeasible_is_not_proved_to_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    program = random_program(0)
    calls = []

    def wrong(*args: Any) -> Optimum | None:
        calls.append(args)
        return None if len(calls) == 1 else minimise(*args)

    monkeypatch.setattr(linear_program, "minimise", wrong)
    proved, x = proved_minimum(*program)
    assert proved == 0.0
    assert (program[1] @ x <= program[2] + 1e-6).all()


def test_variables_that_nothing_limits_prove_nothing_by_rounding() -> None:
    # x - y / 3 >= 1 and y free: the multipliers of y cancel to rounding only.
    rows, limits = np.array([[-1.0, 0.1], [0.0, -0.1 / 3], [0.0, 0.1 / 3]]), np.array([-1.0, 0, 0])
    bounds = [(0.0, None), (None, None)]
    unknown = proved_minimum(np.array([1.0, 0.0]), rows, limits, bounds, np.array([1.0, math.inf]))
    known = proved_minimum(np.array([1.0, 0.0]), rows, limits, bounds, np.array([1.0, 5.0]))
    assert unknown[0] == 0.0
    assert known[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_the_solver_finds_what_scipy_finds(seed: int) -> None:
    objective, rows, limits, bounds, _ = random_program(seed)
    found = minimise(objective, rows, limits, bounds)
    assert found is not None
    theirs = linprog(objective, A_ub=rows, b_ub=limits, bounds=bounds)
    assert found.cost == pytest.approx(theirs.fun, rel=1e-9)
    assert found.marginals @ limits == pytest.approx(theirs.ineqlin.marginals @ limits, rel=1e-9)


def test_programs_without_optimum_are_errors_and_contradictions_are_none() -> None:
    row, free = np.array([[1.0]]), [(None, None)]
    with pytest.raises(ArithmeticError, match="without optimum"):
        minimise(np.ones(1), row, np.zeros(1), free)
    assert minimise(np.ones(1), np.array([[1.0], [-1.0]]), np.array([0.0, -1.0]), free) is None


def test_sparse_rows_are_those_of_the_matrix() -> None:
    row, column = np.array([2, 0, 2, 0, 2]), np.array([1, 3, 1, 0, 0])
    value = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    matrix = np.zeros((4, 5))
    np.add.at(matrix, (row, column), value)
    parts = [Rows.summed(4, row, column, value), Rows.of(np.eye(5)[:2])]
    stacked, whole = Rows.stacked(parts), Rows.of(np.vstack([matrix, np.eye(5)[:2]]))
    for mine, theirs in zip(stacked, whole, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_proved_is_below_the_exact_sum(seed: int) -> None:
    """Sums of doubles err either way; what weak duality proves is rounded down all the same."""
    rng, count = np.random.default_rng(seed), 40
    rows, limits = rng.normal(size=(count, 3)), -rng.uniform(size=count)
    y = rng.uniform(size=count)
    objective = -(y @ rows)  # so that nothing but the rows' limits is left
    made = Optimum(0.0, np.zeros(3), -y)
    bounds: Any = [(0.0, None)] * 3
    proved, _ = linear_program._weak_duality(
        objective, rows, limits, bounds, np.full(3, math.inf), made
    )
    exact = -sum(
        Fraction(a) * Fraction(b) for a, b in zip(y.tolist(), limits.tolist(), strict=True)
    )
    assert Fraction(proved) <= exact
    assert proved == pytest.approx(float(exact), rel=1e-12)
