"""The interior point method of gentle motion, against closed forms and against SciPy's SLSQP."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, minimize

from twosra_mpc.planning.solver.gentle import minimum


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


def degenerate(seed: int) -> tuple[np.ndarray, ...]:
    """Phases of which some cost no effort and some have no choice; rows repeat, and touch."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 5))
    steps, last = np.eye(2 * m) - np.eye(2 * m, k=-1), np.zeros(2 * m)
    e = rng.uniform(0.0, 1.0, m) * (rng.random(m) < 0.7) * 10.0 ** rng.uniform(-9.0, 0.0, m)
    quickest = rng.uniform(1e-3, 0.3, m)
    e = e / max((e / quickest).sum(), 1e-300)
    apart = np.stack([rng.uniform(0.0, 0.3, m) * (rng.random(m) < 0.5), quickest], 1).ravel()
    begin, longer = np.cumsum(apart), rng.uniform(0.0, 0.5, m) * (rng.random(m) < 0.4)
    last[-1] = 1.0
    rows = np.vstack([steps, -steps[1::2], np.eye(2 * m), -last])
    room = rng.choice([0.0, 1e-9, 1e-3, 0.3, 9.0])
    least = np.concatenate([apart, -quickest - longer, np.zeros(2 * m), [-begin[-1] - room]])
    again = rng.integers(0, len(rows), 5)
    both = np.vstack([rows, rows[again]]), np.append(least, least[again])
    return e, steps[1::2], np.zeros(2 * m), *both, begin


def test_degenerate_programs_are_solved_too() -> None:
    """No vertex that a plan begins at may end in an error; SLSQP finds nothing better."""
    compared = 0
    for seed in range(300):
        program = degenerate(seed)
        e, lasting, _, rows, least, begin = program
        found = minimum(*program)
        assert (rows @ found >= least - 2e-9).all(), seed
        if seed % 5:
            continue
        bounds = [LinearConstraint(rows, least - 1e-9, np.inf)]
        other = minimize(
            lambda t, e=e, lasting=lasting: (e / (lasting @ t)).sum(),
            begin,
            jac=lambda t, e=e, lasting=lasting: -(e / (lasting @ t) ** 2) @ lasting,
            method="SLSQP",
            constraints=bounds,
            options={"ftol": 1e-15},
        )
        if other.success and (rows @ other.x >= least - 2e-9).all():
            compared += 1
            assert (e / (lasting @ found)).sum() <= other.fun * (1 + 1e-6) + 1e-7, seed
    assert compared > 30


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", range(8))
def test_rows_that_contradict_each_other_end_it_with_numbers(seed: int) -> None:
    rng, eye = np.random.default_rng(seed), np.eye(3)
    rows = np.vstack([eye, -eye, -np.ones((1, 3))])
    least = np.concatenate([np.full(3, 0.2), np.full(3, -1.0), [-0.6 + 10 ** rng.uniform(-6, -1)]])
    found = minimum(rng.uniform(0.0, 1.0, 3), eye, np.zeros(3), rows, least, np.full(3, 0.2))
    assert np.isfinite(found).all()
