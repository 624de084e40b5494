"""The interior point method of gentle motion, against closed forms and against SciPy's SLSQP."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, minimize

from twosra_mpc.planning.single_goal.interior_point import minimum


@pytest.mark.parametrize("seed", range(4))
def test_time_is_shared_out_by_square_roots(seed: int) -> None:
    """With d_1 + ... + d_m <= C alone, the least sum of e_i / d_i has d_i ~ sqrt(e_i)."""
    e = np.random.default_rng(seed).uniform(0.01, 1.0, 4)
    eye = np.eye(4)
    rows, least = np.vstack([eye, -np.ones((1, 4))]), np.append(np.full(4, 1e-3), -2.0)
    found = minimum(e, eye, np.zeros(4), rows, least, np.full(4, 0.4))
    assert found == pytest.approx(2.0 * np.sqrt(e) / np.sqrt(e).sum(), abs=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_it_finds_what_slsqp_finds(seed: int) -> None:
    """Three phases one after the other, with waits between, limits and a price of the end."""
    rng = np.random.default_rng(seed)
    e, price = rng.uniform(0.0, 1.0, 3), np.append(np.zeros(5), rng.choice([0.0, 0.7]))
    steps = np.eye(6) - np.eye(6, k=-1)  # of the events start, end, start, end, start, end
    lasting = steps[1::2]
    rows = np.vstack([steps, -lasting, -np.eye(6)[5:]])
    least = np.concatenate([rng.uniform(0.05, 0.2, 6), rng.uniform(-0.9, -0.5, 3), [-2.0]])
    begin = np.cumsum(np.maximum(least[:6], 0.2))

    def objective(t: np.ndarray) -> float:
        return float((e / (lasting @ t)).sum() + price @ t)

    found = minimum(e, lasting, price, rows, least, begin)
    bounds = [LinearConstraint(rows, least, np.inf)]
    options = {"ftol": 1e-14, "maxiter": 500}
    expected = minimize(objective, begin, method="SLSQP", constraints=bounds, options=options)
    assert (rows @ found >= least - 1e-8).all()
    assert objective(found) <= expected.fun + 1e-7
    assert lasting[e > 0.1] @ found == pytest.approx(lasting[e > 0.1] @ expected.x, abs=1e-3)


def test_rows_may_leave_no_choice() -> None:
    found = minimum(
        np.ones(1),
        np.eye(1),
        np.zeros(1),
        np.array([[1.0], [-1.0]]),
        np.array([0.3, -0.3]),
        np.array([0.3]),
    )
    assert found == pytest.approx([0.3], abs=1e-8)
