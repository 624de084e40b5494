"""The lumped model solves its own differential equation, and the paper's waits follow from it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from twosra_mpc.robot.description import load_robot, segment_model
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.model import replayed

AMBIENT_C = 25.0


def paper_segment() -> Lumped:
    """A segment of the paper's robot in air of 25 C."""
    model = segment_model(load_robot("2sra-v1"), AMBIENT_C, 0)
    assert isinstance(model, Lumped)
    return model


PAPER = paper_segment()

MODELS = st.builds(
    Lumped,
    heat_solid_J_per_K=st.floats(2.0, 5.0),
    heat_liquid_J_per_K=st.floats(2.0, 5.0),
    latent_J=st.floats(50.0, 200.0),
    loss_W_per_K=st.floats(0.01, 0.03),
    resistance_ohm=st.floats(4.0, 11.0),
    temperature_coefficient_per_K=st.sampled_from([0.0, 3.93e-3]),
    melting_point_C=st.floats(58.0, 63.0),
    ambient_C=st.floats(10.0, 35.0),
)
CURRENTS_A = st.one_of(st.just(0.0), st.floats(0.05, 0.95))
SHARES = st.floats(-1.0, 2.0)  # below 0 solid, above 1 liquid
DURATIONS_S = st.floats(0.0, 400.0).map(lambda s: round(s, 9))  # a solver moves on in these


def state_at(model: Lumped, share: float) -> tuple[float]:
    """From 50 K below melting (-1) over the plateau (0 to 1) to 25 K above (2)."""
    if share < 0:
        return (50.0 * model.heat_solid_J_per_K * share,)
    if share > 1:
        return (model.latent_J + 25.0 * model.heat_liquid_J_per_K * (share - 1),)
    return (model.latent_J * share,)


# --- the differential equation, integrated numerically -------------------------------------------


def integrated(
    model: Lumped, enthalpy_J: float, current_A: float, duration_s: float
) -> tuple[float, float]:
    """(H, heat of the coil) [J] after a constant current: a regime at a time, event to event."""
    latent, melting = model.latent_J, model.melting_point_C

    def temperature(regime: str, h: float) -> float:
        if regime == "solid":
            return melting + h / model.heat_solid_J_per_K
        return (
            melting if regime == "plateau" else melting + (h - latent) / model.heat_liquid_J_per_K
        )

    def heater_W(at_C: float) -> float:
        warmer = 1 + model.temperature_coefficient_per_K * (at_C - 25.0)
        return current_A**2 * model.resistance_ohm * warmer

    def net_W(at_C: float) -> float:
        return heater_W(at_C) - model.loss_W_per_K * (at_C - model.ambient_C)

    h, heat, now = enthalpy_J, 0.0, 0.0
    while now < duration_s:
        rising = net_W(temperature("plateau", h)) > 0
        regime = "solid" if h < 0 or (h == 0 and not rising) else "liquid"
        if 0 < h < latent or (h == 0 and rising) or (h == latent and not rising):
            regime = "plateau"

        def rates(_: float, y: list[float], regime: str = regime) -> list[float]:
            at_C = temperature(regime, y[0])
            return [net_W(at_C), heater_W(at_C)]

        ends = {"solid": [(0.0, 1)], "plateau": [(0.0, -1), (latent, 1)], "liquid": [(latent, -1)]}
        events = []
        for edge, direction in ends[regime]:

            def passed(_: float, y: list[float], edge: float = edge) -> float:
                return y[0] - edge

            passed.terminal, passed.direction = True, direction  # type: ignore[attr-defined]
            events.append(passed)
        done = solve_ivp(
            rates, (now, duration_s), [h, heat], "DOP853", events=events, rtol=1e-11, atol=1e-10
        )
        now, (h, heat) = float(done.t[-1]), done.y[:, -1].tolist()
        for (edge, _), times in zip(ends[regime], done.t_events, strict=True):
            h = edge if len(times) else h
    return h, heat


@given(MODELS, SHARES, CURRENTS_A, DURATIONS_S)
def test_propagation_solves_the_equation_through_all_regimes(
    model: Lumped, share: float, current_A: float, duration_s: float
) -> None:
    state = state_at(model, share)
    expected, heat = integrated(model, state[0], current_A, duration_s)
    size = model.latent_J
    (reached,) = model.propagate(state, current_A, duration_s)
    assert reached == pytest.approx(expected, rel=1e-6, abs=1e-6 * size)
    spent = model.energy_J(state, current_A, duration_s)
    assert spent == pytest.approx(heat, rel=1e-6, abs=1e-6 * size)


def test_a_coil_that_exactly_makes_up_for_the_loss_heats_evenly() -> None:
    """b = 0, where the closed form divides by it."""
    slope = PAPER.temperature_coefficient_per_K * PAPER.resistance_ohm
    for nudge in (0.0, 1e-13, -1e-9, 1e-6):
        current_A = math.sqrt(PAPER.loss_W_per_K / slope) * (1 + nudge)
        for start_C in (30.0, 65.0):
            state = PAPER.initial(start_C)
            expected, heat = integrated(PAPER, state[0], current_A, 60.0)
            reached = PAPER.propagate(state, current_A, 60.0)[0]
            assert reached == pytest.approx(expected, rel=1e-6)
            assert PAPER.energy_J(state, current_A, 60.0) == pytest.approx(heat, rel=1e-6)


# --- energy --------------------------------------------------------------------------------------


@given(MODELS, SHARES, DURATIONS_S)
def test_the_holding_current_holds(model: Lumped, share: float, duration_s: float) -> None:
    state = state_at(model, share)
    assume(model.temperature_C(state) > model.ambient_C)
    current_A = model.holding_current_A(state)
    (after,) = model.propagate(state, current_A, duration_s)
    assert after == pytest.approx(state[0], rel=1e-6, abs=1e-6 * model.latent_J)
    heat = model.energy_J(state, current_A, duration_s)
    assert model.holding_energy_J(state, duration_s) == pytest.approx(heat, rel=1e-6, abs=1e-9)
    assert model.hold(state, duration_s) == state


def test_holding_a_hair_below_the_melting_point_is_no_division_by_zero() -> None:
    """There rounding decides whether the segment warms or cools."""
    for h in (-5e-324, -1e-300, -1e-17, 0.0, 1e-17, 5e-324):
        for ambient_C in range(10, 35):
            model = replace(PAPER, ambient_C=float(ambient_C), loss_W_per_K=0.011774365978744346)
            current_A = model.holding_current_A((h,))
            assert abs(model.propagate((h,), current_A, 100.0)[0]) < 1e-9
            assert model.time_until((h,), current_A, 10.0) > 1e6


# --- times to thresholds -------------------------------------------------------------------------


@given(MODELS, SHARES, SHARES, CURRENTS_A)
def test_the_time_until_a_level_is_when_it_is_first_reached(
    model: Lumped, share: float, target: float, current_A: float
) -> None:
    state, (level,) = state_at(model, share), state_at(model, target)
    size = model.latent_J
    assume(abs(state[0] - level) > 1e-6 * size)
    needed = model.time_until(state, current_A, level)
    if math.isfinite(needed):
        (reached,) = model.propagate(state, current_A, needed)
        assert reached == pytest.approx(level, rel=1e-6, abs=1e-6 * size)
        for part in (0.2, 0.6, 0.95):
            (before,) = model.propagate(state, current_A, part * needed)
            assert (before <= level + 1e-9 * size) == (state[0] <= level)
    else:
        (later,) = model.propagate(state, current_A, 2e4)
        assert (later < level) == (state[0] < level) or later == pytest.approx(level, rel=1e-6)


def test_a_level_that_is_here_takes_no_time() -> None:
    state = PAPER.initial(40.0)
    assert PAPER.time_until(state, 0.9, state[0]) == 0.0


def test_below_the_plateaus_holding_current_nothing_melts() -> None:
    """0.293 A makes up for the loss at the melting point."""
    cold = PAPER.initial(AMBIENT_C)
    assert PAPER.time_until(cold, 0.290, PAPER.liquid_level) == math.inf
    assert math.isfinite(PAPER.time_until(cold, 0.296, PAPER.liquid_level))


# --- temperature, melt fraction ------------------------------------------------------------------


@given(MODELS, st.floats(0.0, 100.0))
def test_level_and_temperature_are_inverse(model: Lumped, temperature_C: float) -> None:
    state = model.initial(temperature_C)
    assert model.temperature_C(state) == pytest.approx(temperature_C, abs=1e-9)
    assert model.level(state) == model.level_at(temperature_C)
    assert model.melt_fraction(state) == (temperature_C > model.melting_point_C)


@given(MODELS, st.floats(0.0, 1.0))
def test_on_the_plateau_the_temperature_stays(model: Lumped, share: float) -> None:
    state = state_at(model, share)
    assert model.temperature_C(state) == model.melting_point_C
    assert model.melt_fraction(state) == pytest.approx(share)
    assert model.solid_level <= model.level(state) <= model.liquid_level


# --- the paper's segment -------------------------------------------------------------------------


@pytest.mark.parametrize(("current_A", "melt_s"), [(0.7, 84.9), (0.8, 62.6), (0.9, 48.2)])
def test_melting_takes_as_long_as_first_principles_say(current_A: float, melt_s: float) -> None:
    cold = PAPER.initial(25.0)
    needed = PAPER.time_until(cold, current_A, PAPER.liquid_level)
    assert needed == pytest.approx(melt_s, rel=0.02)


@pytest.mark.parametrize(
    ("from_C", "to_C", "freeze_s"),
    [(65.0, None, 253.0), (65.0, 53.0, 296.0), (85.0, None, 325.0), (85.0, 40.0, 474.0)],
)
def test_freezing_takes_as_long_as_first_principles_say(
    from_C: float, to_C: float | None, freeze_s: float
) -> None:
    level = PAPER.solid_level if to_C is None else PAPER.level_at(to_C)
    needed = PAPER.time_until(PAPER.initial(from_C), 0.0, level)
    assert needed == pytest.approx(freeze_s, rel=0.02)


def test_derived_parameters_are_those_of_the_geometry() -> None:
    assert PAPER.heat_solid_J_per_K == pytest.approx(3.08, rel=0.01)
    assert PAPER.heat_liquid_J_per_K == pytest.approx(3.21, rel=0.01)
    assert PAPER.latent_J == pytest.approx(153.0, rel=0.01)
    assert PAPER.loss_W_per_K == pytest.approx(0.0181, rel=0.01)
    assert PAPER.resistance_ohm == pytest.approx(6.64, rel=0.01)


def test_full_current_has_no_stable_liquid_equilibrium() -> None:
    """At 0.9 A the coil's power grows faster with temperature than the loss: it runs away."""
    grows_W_per_K = PAPER.temperature_coefficient_per_K * 0.9**2 * PAPER.resistance_ohm
    assert PAPER.loss_W_per_K - grows_W_per_K < 0
    times = np.arange(0.0, 3000.0, 50.0)

    def rises(current_A: float) -> np.ndarray:
        start = PAPER.initial(65.0)
        states = [PAPER.propagate(start, current_A, t) for t in times.tolist()]
        return np.diff([PAPER.temperature_C(state) for state in states])

    assert (np.diff(rises(0.9)) > 0).all()  # faster and faster
    assert 65.0 + rises(0.9).sum() > 1000.0
    assert (np.diff(rises(0.5)) < 0).all()  # slower and slower
    near, far = (PAPER.propagate(PAPER.initial(t), 0.9, 600.0) for t in (65.0, 66.0))
    assert PAPER.temperature_C(far) - PAPER.temperature_C(near) > 1.0


@given(MODELS, SHARES, CURRENTS_A, st.lists(DURATIONS_S, min_size=1, max_size=8))
def test_many_times_at_once_are_each_time_by_itself(
    model: Lumped, share: float, current_A: float, durations_s: list[float]
) -> None:
    state, times = state_at(model, share), np.array(durations_s)
    for after in (lambda t: model.propagate(state, current_A, t), lambda t: model.hold(state, t)):
        each, many = [after(t) for t in durations_s], after(times)
        assert many[0] == pytest.approx([one[0] for one in each], rel=1e-12, abs=1e-9)
        warm = [model.temperature_C(one) for one in each]
        assert model.temperature_C(many) == pytest.approx(warm, rel=1e-12)
        molten = [model.melt_fraction(one) for one in each]
        assert model.melt_fraction(many) == pytest.approx(molten, rel=1e-12, abs=1e-12)


@given(MODELS, SHARES, st.lists(st.tuples(st.floats(0.0, 60.0), CURRENTS_A), min_size=1))
def test_currents_are_replayed_one_after_the_other(
    model: Lumped, share: float, steps: list[tuple[float, float]]
) -> None:
    states = [state_at(model, share)]
    steps = [step for step in steps for _ in range(2)]  # some last
    for duration_s, current_A in steps:
        states.append(model.propagate(states[-1], current_A, duration_s))
    durations_s, currents_A = np.array(steps).T
    t, current_A = np.append(0.0, np.cumsum(durations_s)), np.append(currents_A, math.nan)
    (enthalpy,) = replayed(model, states[0], t, current_A)
    np.testing.assert_allclose(enthalpy, np.array(states)[:, 0], rtol=1e-9, atol=1e-6)
