"""The temperature sensor: thermistor and divider, converter, decoding, lag, faults."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from heater_loop import LinearMap
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from twosra_mpc.control.thermistor import (
    NtcDivider,
    TemperatureSensor,
    follow,
    temperature_sensor,
)
from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import load_robot

FALLING = NtcDivider()
RISING = NtcDivider(fixed_ohm=15.18e3, supply_V=3.536, ntc_to_ground=False)
LINE = LinearMap()
CIRCUITS = pytest.mark.parametrize(
    "circuit", [FALLING, RISING, LINE], ids=["pull-up", "to", "line"]
)

TEMPERATURES_C = st.floats(0.5, 84.5)
LAGS_S = st.one_of(st.just(0.0), st.floats(0.1, 20.0))


def quiet(circuit: NtcDivider = FALLING) -> TemperatureSensor:
    """A sensor that the firmware knows exactly."""
    return TemperatureSensor(25.0, part=circuit, assumed=circuit)


# --- thermistor and divider ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("temperature_C", "resistance_ohm"),
    [(0, 33.62e3), (25, 10e3), (53, 3.207e3), (62, 2.316e3), (65, 2.086e3), (85, 1.087e3)],
)
def test_the_thermistor_has_its_tables_resistance(
    temperature_C: float, resistance_ohm: float
) -> None:
    assert FALLING.resistance_ohm(temperature_C) == pytest.approx(resistance_ohm, rel=1e-3)


def test_dividers_have_the_papers_voltages() -> None:
    """1.1 to 3.3 V over 0 to 85 C: nearly, with standard parts; exactly, with 15.18 k."""
    assert FALLING.voltage_V(0.0) == pytest.approx(3.10, abs=0.005)
    assert FALLING.voltage_V(85.0) == pytest.approx(1.09, abs=0.005)
    assert RISING.voltage_V(0.0) == pytest.approx(1.1, abs=0.005)
    assert RISING.voltage_V(85.0) == pytest.approx(3.3, abs=0.005)
    assert (LINE.voltage_V(0.0), LINE.voltage_V(85.0)) == (1.1, pytest.approx(3.3))


def test_the_default_divider_resolves_three_hundredths_of_a_degree() -> None:
    per_K = FALLING.voltage_V(64.5) - FALLING.voltage_V(65.5)
    assert per_K == pytest.approx(28.5e-3, rel=0.01)
    assert 3.3 / 4095 / per_K == pytest.approx(0.028, abs=0.001)


@CIRCUITS
@given(temperature_C=TEMPERATURES_C)
def test_decoding_undoes_the_circuit(circuit: NtcDivider, temperature_C: float) -> None:
    voltage = circuit.voltage_V(temperature_C)
    assert circuit.temperature_C(voltage) == pytest.approx(temperature_C, abs=1e-9)


@CIRCUITS
@given(temperature_C=TEMPERATURES_C)
def test_a_reading_is_off_by_half_a_code_at_most(circuit: NtcDivider, temperature_C: float) -> None:
    sensor = quiet(circuit)
    step_V = circuit.supply_V / 4095
    voltage = circuit.voltage_V(temperature_C)
    ends = [circuit.temperature_C(voltage + side * 0.51 * step_V) for side in (-1, 1)]
    assert min(ends) <= sensor.read_C(sensor.settled(temperature_C)) <= max(ends)


def test_readings_are_quantised() -> None:
    sensor = quiet()
    readings = {sensor.read_C(sensor.settled(t)) for t in np.linspace(64.0, 66.0, 2000).tolist()}
    assert len(readings) == pytest.approx(2.0 / 0.028, abs=3)


# --- tolerance -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("errors", "off_K"),
    [
        ({"resistance": 0.05}, -1.4),
        ({"resistance": 0.01}, -0.29),
        ({"beta": 0.01}, 0.45),
        ({"beta": 0.01, "resistance": 0.01}, 0.17),
        ({"fixed": 0.01}, 0.29),
    ],
)
def test_parts_off_by_their_tolerance_shift_the_reading(
    errors: dict[str, float], off_K: float
) -> None:
    sensor = replace(quiet(), part=FALLING.off_by(**errors))
    assert sensor.read_C(sensor.settled(65.0)) - 65.0 == pytest.approx(off_K, abs=0.05)


@pytest.mark.parametrize(
    ("temperature_C", "off_K"), [(25, -7.6), (53, -3.5), (62, -1.5), (65, -0.9)]
)
def test_the_papers_line_misreads_a_divider(temperature_C: float, off_K: float) -> None:
    """As a straight line through the ends of a divider that falls from 3.3 to 1.1 V."""
    divider = NtcDivider(fixed_ohm=2.407e3, supply_V=3.536)
    line = LinearMap(range_V=(3.3, 1.1))
    read_C = line.temperature_C(divider.voltage_V(temperature_C))
    assert read_C - temperature_C == pytest.approx(off_K, abs=0.15)


# --- faults --------------------------------------------------------------------------------------


@CIRCUITS
@pytest.mark.parametrize("resistance_ohm", [1e12, 0.0], ids=["open", "short"])
def test_a_broken_wire_reads_as_a_fault(circuit: NtcDivider, resistance_ohm: float) -> None:
    sensor = quiet(circuit)
    broken = replace(FALLING, resistance_25_ohm=resistance_ohm, supply_V=circuit.supply_V)
    assert math.isnan(replace(sensor, part=broken).read_C(sensor.settled(40.0)))
    assert math.isfinite(sensor.read_C(sensor.settled(40.0)))


@CIRCUITS
def test_temperatures_outside_the_circuits_range_read_as_a_fault(circuit: NtcDivider) -> None:
    sensor = quiet(circuit)
    coldest, hottest = circuit.range_C
    for outside in (coldest - 2.0, hottest + 2.0):
        assert math.isnan(sensor.read_C(sensor.settled(outside)))
    for inside in (coldest + 1.0, hottest - 1.0):
        assert sensor.read_C(sensor.settled(inside)) == pytest.approx(inside, abs=0.5)


def test_every_temperature_of_a_heater_is_told_from_a_broken_wire() -> None:
    sensor = quiet()
    for temperature_C in np.linspace(-20.0, 120.0, 300).tolist():
        assert math.isfinite(sensor.read_C(sensor.settled(temperature_C)))


# --- lag, gain -----------------------------------------------------------------------------------


@given(
    LAGS_S.filter(bool),
    LAGS_S.filter(bool),
    st.tuples(*[TEMPERATURES_C] * 4),
    st.floats(0.01, 60.0),
)
def test_two_lags_follow_a_ramp_exactly(
    tau_1: float, tau_2: float, values: tuple[float, ...], duration_s: float
) -> None:
    one, two, before, after = values
    slope = (after - before) / duration_s

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [(before + slope * t - y[0]) / tau_1, (y[0] - y[1]) / tau_2]

    done = solve_ivp(rates, (0.0, duration_s), [one, two], "DOP853", rtol=1e-10, atol=1e-9)
    reached = follow((one, two), (tau_1, tau_2), before, after, duration_s)
    assert reached == pytest.approx(done.y[:, -1], abs=1e-6)


@given(st.floats(0.1, 20.0), st.floats(-1e-3, 1e-3), st.floats(0.01, 60.0))
def test_nearly_equal_lags_are_no_special_case(tau: float, apart: float, duration_s: float) -> None:
    equal = follow((30.0, 20.0), (tau, tau), 40.0, 50.0, duration_s)
    nearly = follow((30.0, 20.0), (tau, tau * (1 + 1e-9 * apart)), 40.0, 50.0, duration_s)
    assert nearly == pytest.approx(equal, abs=1e-9)


@given(LAGS_S, LAGS_S, st.floats(0.01, 5.0))
def test_a_lag_of_nothing_is_the_limit_of_a_short_one(
    tau_1: float, tau_2: float, duration_s: float
) -> None:
    exact = follow((30.0, 30.0), (tau_1, tau_2), 30.0, 50.0, duration_s)
    short = follow((30.0, 30.0), (tau_1 or 1e-9, tau_2 or 1e-9), 30.0, 50.0, duration_s)
    assert exact == pytest.approx(short, abs=1e-5)


def test_a_sensor_touches_its_share_of_the_excess_over_the_air() -> None:
    sensor = replace(quiet(), gain=0.75)
    assert sensor.settled(65.0) == (55.0, 55.0)
    assert sensor.follow((25.0, 25.0), 65.0, 65.0, 1e4) == pytest.approx((55.0, 55.0))


# --- of a robot ----------------------------------------------------------------------------------


def test_a_robots_file_says_how_its_sensor_lags() -> None:
    logged = temperature_sensor(load_robot("2sr-v2"), 22.6, 0)
    assert (logged.gain, logged.lags_s) == (1.0, (2.85, 2.85))
    paper = temperature_sensor(load_robot("2sra-v1"), 25.0, 0)
    assert (paper.gain, paper.lags_s) == (1.0, (4.0, 4.0))
    line = temperature_sensor(load_robot("2sra-v1"), 25.0, 0, LINE)
    assert line.part is line.assumed is LINE


def test_a_sensor_is_refused_in_air_that_it_cannot_read() -> None:
    with pytest.raises(InputError, match=r"ambient_C = -5\.0 .* from 0 to 85 C"):
        temperature_sensor(load_robot("2sra-v1"), -5.0, 0, LINE)
