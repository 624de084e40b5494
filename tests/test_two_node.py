"""The two-node model solves its own differential equation and fits its robot's log."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.linalg import expm

from twosra_mpc.robot.description import load_robot, segment_model
from twosra_mpc.robot.segment import TwoNodeSegment
from twosra_mpc.thermal.two_node import TwoNode

AMBIENT_C = 22.6


# A segment of the follow-up robot as its heating logs of May 2024 have it, with a gain of 0.75.
LOGGED = TwoNode(1.429, 0.01730, 3.41, 0.00339, 0.95, 0.8, 53.0, 62.0, AMBIENT_C)
FULL_A = LOGGED.full_current_A

MODELS = st.builds(
    TwoNode,
    power_K_per_s=st.floats(1.0, 2.5),
    coupling_per_s=st.floats(0.005, 0.05),
    body_ratio=st.floats(0.5, 6.0),
    body_loss_per_s=st.floats(0.001, 0.01),
    core_heat_J_per_K=st.floats(0.5, 3.0),
    full_current_A=st.just(0.8),
    solid_level=st.just(53.0),
    liquid_level=st.just(62.0),
    ambient_C=st.floats(10.0, 35.0),
)
TEMPERATURES_C = st.floats(20.0, 90.0)
STATES = st.tuples(TEMPERATURES_C, TEMPERATURES_C)
CURRENTS_A = st.one_of(st.just(0.0), st.floats(0.05, 0.8))
DURATIONS_S = st.floats(0.0, 600.0)


def matrix(model: TwoNode) -> np.ndarray:
    """d/dt of (T_c, T_b, 1), without the heater."""
    a, leave, loss = (
        model.coupling_per_s,
        model.coupling_per_s / model.body_ratio,
        model.body_loss_per_s,
    )
    return np.array([[-a, a, 0.0], [leave, -leave - loss, loss * model.ambient_C], [0.0, 0.0, 0.0]])


def heating(model: TwoNode, current_A: float) -> float:
    """Rise of the core by its heater alone [K/s]."""
    return model.power_K_per_s * (current_A / model.full_current_A) ** 2


# --- the differential equation -------------------------------------------------------------------


@given(MODELS, STATES, CURRENTS_A, DURATIONS_S)
def test_propagation_is_the_matrix_exponential(
    model: TwoNode, state: tuple[float, float], current_A: float, duration_s: float
) -> None:
    rates = matrix(model)
    rates[0, 2] += heating(model, current_A)
    expected = (expm(rates * duration_s) @ [*state, 1.0])[:2]
    assert model.propagate(state, current_A, duration_s) == pytest.approx(expected, rel=1e-9)


@given(MODELS, STATES, CURRENTS_A)
def test_a_constant_current_leads_to_one_steady_state(
    model: TwoNode, state: tuple[float, float], current_A: float
) -> None:
    """There the heater makes up for what the body loses to the air."""
    core, body = model.propagate(state, current_A, 1e6)
    lost = model.body_ratio * model.body_loss_per_s * (body - model.ambient_C)
    assert lost == pytest.approx(heating(model, current_A), abs=1e-9)
    assert model.coupling_per_s * (core - body) == pytest.approx(lost, abs=1e-9)


# --- holding and energy --------------------------------------------------------------------------


@given(MODELS, STATES, st.floats(1.0, 600.0))
def test_holding_clamps_the_core_while_the_body_settles(
    model: TwoNode, state: tuple[float, float], duration_s: float
) -> None:
    core, body = state
    assume(core > body >= model.ambient_C)
    extended = np.zeros((4, 4))
    extended[:3, :3] = matrix(model)
    extended[0] = 0.0  # the core stays
    extended[3, :2] = model.coupling_per_s, -model.coupling_per_s  # what it gives the body [K]
    end = expm(extended * duration_s) @ [core, body, 1.0, 0.0]
    assert model.hold(state, duration_s) == pytest.approx(end[:2], rel=1e-9)
    given_J = model.core_heat_J_per_K * end[3]
    assert model.holding_energy_J(state, duration_s) == pytest.approx(given_J, rel=1e-6)


@given(MODELS, STATES)
def test_the_holding_current_stops_the_core(model: TwoNode, state: tuple[float, float]) -> None:
    core, body = state
    assume(model.ambient_C <= body <= core)
    current_A = model.holding_current_A(state)
    after, _ = model.propagate(state, current_A, 1e-3)
    assert after == pytest.approx(core, abs=1e-5)
    back, _ = model.propagate(state, model.holding_current_A(state, 1.0), 1.0)
    assert back == pytest.approx(core, abs=1e-9)
    steady_W = model.core_heat_J_per_K * model.coupling_per_s * (core - body)
    assert model.power_W(current_A, core) == pytest.approx(steady_W, abs=1e-9)
    assert model.energy_J(state, current_A, 7.0) == pytest.approx(7.0 * steady_W, abs=1e-9)


# --- times to thresholds -------------------------------------------------------------------------


@given(MODELS, STATES, CURRENTS_A, TEMPERATURES_C)
def test_the_time_until_a_level_is_when_it_is_first_reached(
    model: TwoNode, state: tuple[float, float], current_A: float, level: float
) -> None:
    assume(abs(state[0] - level) > 1e-6)
    needed = model.time_until(state, current_A, level)
    below = state[0] < level
    end = min(needed, 2e4)
    if math.isfinite(needed):
        assert model.propagate(state, current_A, needed)[0] == pytest.approx(level, abs=1e-6)
    for t in np.linspace(0.0, end, 200, endpoint=False).tolist():
        core = model.propagate(state, current_A, t)[0]
        assert core == pytest.approx(level, abs=1e-6) or (core < level) == below


@given(MODELS, TEMPERATURES_C, st.floats(1.0, 40.0))
def test_a_core_colder_than_its_body_warms_up_and_turns(
    model: TwoNode, core_C: float, colder_K: float
) -> None:
    """Without current it reaches every level up to its highest, and none above."""
    state = (core_C, core_C + colder_K)
    assume(core_C > model.ambient_C)
    times = np.linspace(0.0, 3000.0, 30001)
    low, high = np.linalg.eigvals(matrix(model)[:2, :2]).real  # complex from NumPy 2.5 on
    modes = np.linalg.solve([[1.0, 1.0], [low, high]], [*deviation(model, state)])
    cores = model.ambient_C + modes @ np.exp(np.outer([low, high], times))
    top = int(cores.argmax())
    assume(0 < top < 30000)
    assert model.time_until(state, 0.0, float(cores[top]) - 1e-3) < times[top] + 0.1
    assert model.time_until(state, 0.0, float(cores[top]) + 1e-3) == math.inf
    falls = model.time_until(state, 0.0, core_C - 0.5)
    if math.isfinite(falls):
        assert falls > times[top]


def deviation(model: TwoNode, state: tuple[float, float]) -> tuple[float, float]:
    """Core above the air [K], and its rate [K/s], without current."""
    core, body = state
    return core - model.ambient_C, -model.coupling_per_s * (core - body)


def test_a_core_hotter_than_its_steady_state_falls_through_it_and_returns() -> None:
    """A hot core over a cold body under current: the first of two passages counts."""
    current_A = 0.5 * FULL_A
    state = (80.0, 25.0)
    times = np.arange(0.0, 2000.0, 0.05)
    cores = np.array([LOGGED.propagate(state, current_A, t)[0] for t in times.tolist()])
    lowest = int(cores.argmin())
    assert 0 < lowest < len(times) - 1
    level = float(cores[lowest]) + 2.0
    passages = times[:-1][(cores[:-1] > level) != (cores[1:] > level)]
    assert len(passages) == 2
    assert LOGGED.time_until(state, current_A, level) == pytest.approx(passages[0], abs=0.06)
    bottom = (float(cores[lowest]), LOGGED.propagate(state, current_A, float(times[lowest]))[1])
    assert LOGGED.time_until(bottom, current_A, level) == pytest.approx(
        passages[1] - times[lowest], abs=0.2
    )


# --- temperature, melt fraction ------------------------------------------------------------------


@given(MODELS, TEMPERATURES_C)
def test_the_level_is_the_core_temperature(model: TwoNode, temperature_C: float) -> None:
    state = model.initial(temperature_C)
    assert model.level(state) == model.temperature_C(state) == temperature_C
    assert model.level_at(temperature_C) == temperature_C
    expected = np.interp(temperature_C, (53.0, 62.0), (0.0, 1.0))
    assert model.melt_fraction(state) == pytest.approx(expected)


# --- the follow-up robot's segment ---------------------------------------------------------------


def test_time_constants_are_those_of_its_logs() -> None:
    rates = np.linalg.eigvals(matrix(LOGGED)[:2, :2]).real
    fast, slow = sorted((-1 / rates).tolist())
    assert 43.0 <= fast <= 44.0
    assert 396.0 <= slow <= 418.0


def test_full_power_softens_it_in_37_s_and_would_destroy_it() -> None:
    cold = LOGGED.initial(AMBIENT_C)
    assert LOGGED.time_until(cold, FULL_A, 62.0) == pytest.approx(36.6, rel=0.02)
    assert LOGGED.propagate(cold, FULL_A, 1e5)[0] == pytest.approx(230.0, abs=5.0)


@pytest.mark.parametrize(("body_C", "freeze_s"), [(38.0, 41.0), (40.4, 46.0), (44.6, 57.0)])
def test_a_warm_body_delays_freezing(body_C: float, freeze_s: float) -> None:
    """From 64 C to 53 C by the sensor, whose two lags of 2.85 s add to the core's time."""
    needed = LOGGED.time_until((64.0, body_C), 0.0, 53.0) + 2 * 2.85
    assert needed == pytest.approx(freeze_s, rel=0.1)


def test_the_sensor_of_a_segment_shows_liquid_when_its_model_is() -> None:
    """Both lags integrated along a melt from cold: the reading is at the threshold, within 1 K."""
    robot = load_robot("2sr-v2")
    assert isinstance(robot.segment, TwoNodeSegment)
    model, lag_s = segment_model(robot, AMBIENT_C, 0), robot.segment.sensor_lag_s
    molten_s = model.time_until(model.initial(AMBIENT_C), 0.8, model.liquid_level)
    times = np.linspace(0.0, molten_s, 2001)
    step_s, one, two = times[1], AMBIENT_C, AMBIENT_C
    for time in times[1:].tolist():
        core = model.level(model.propagate(model.initial(AMBIENT_C), 0.8, time))
        one += step_s / lag_s * (core - one)
        two += step_s / lag_s * (one - two)
    assert two == pytest.approx(robot.segment.liquid_above_C, abs=1.0)
    weak = robot.heater.with_values(soft_setpoint_C=64.0)
    assert robot.segment.thermal_model(0.077, weak, AMBIENT_C).liquid_level == 63.5


@given(MODELS, STATES, CURRENTS_A, st.lists(DURATIONS_S, min_size=1, max_size=8))
def test_many_times_at_once_are_each_time_by_itself(
    model: TwoNode, state: tuple[float, float], current_A: float, durations_s: list[float]
) -> None:
    times = np.array(durations_s)
    for after in (lambda t: model.propagate(state, current_A, t), lambda t: model.hold(state, t)):
        each, many = [after(t) for t in durations_s], after(times)
        np.testing.assert_allclose(np.array(many).T, each, rtol=1e-12)
        molten = [model.melt_fraction(one) for one in each]
        assert model.melt_fraction(many) == pytest.approx(molten, rel=1e-12, abs=1e-12)
