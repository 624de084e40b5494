"""Bounds of a segment's heat hold for every healthy robot; no sensor makes its metal too hot."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.lying import LIES, Metal, watched
from twosra_mpc import load_robot
from twosra_mpc.execution.heat_belief import SENSOR_OFF_K, HeatBelief, heat_belief
from twosra_mpc.thermal.model import thresholds_C
from twosra_mpc.thermal.uncertainty import drawn, healthy, healthy_ranges

ROBOT = load_robot("2sra-v1")
AIR_C, FULL_A, SET_C = 25.0, ROBOT.heater.melt_current_A, ROBOT.heater.soft_setpoint_C
STEP_S, MODEL_K = 1.0, 3.0  # of the belief; as far off may the bounds be, as sensors are


def begun() -> HeatBelief:
    return heat_belief(ROBOT, AIR_C, 0, AIR_C)


def heated(belief: HeatBelief, metal: Metal, lag_s: float, until_C: float = SET_C) -> HeatBelief:
    """Full current until the sensor, or what there is instead of one, is at a temperature."""
    behind_C = shown_C = metal.temperature_C
    while shown_C < until_C and not belief.cut:
        for _ in range(10):
            metal.advance(FULL_A)
            behind_C += (metal.temperature_C - behind_C) * -math.expm1(-0.2 / lag_s)
            shown_C += (behind_C - shown_C) * -math.expm1(-0.2 / lag_s)  # half the lag each
        belief = belief.advance((FULL_A, FULL_A), STEP_S).take(shown_C)
        assert belief.at_least_C <= metal.temperature_C + MODEL_K or belief.melted
        assert metal.temperature_C <= belief.at_most_C + MODEL_K
    return belief


@pytest.mark.parametrize("seed", range(12))
def test_the_metal_of_a_healthy_robot_is_between_the_corners(seed: int) -> None:
    rng = np.random.default_rng(seed)
    belief = heated(begun(), Metal(ROBOT, AIR_C, rng, False), float(rng.uniform(2.0, 8.0)))
    assert belief.may_be_liquid
    least, most = belief.power
    assert most / least < 1.35  # a melt from cold tells the power, whatever the lag


def test_a_power_is_remembered_from_melt_to_melt() -> None:
    metal = Metal(ROBOT, AIR_C, np.random.default_rng(1), False)
    hot = heated(begun(), metal, 4.0)
    off = hot.advance((0.0, 0.0), STEP_S)
    assert off.power == pytest.approx(hot.power)
    assert off.rise is None


@pytest.mark.parametrize("seed", range(4))
def test_no_healthy_robot_is_stopped(seed: int) -> None:
    found = watched(ROBOT, seed, lasts_s=500.0)
    assert found.cause == "", found.words
    assert found.melts
    assert found.hottest_C < 80.0


@pytest.mark.parametrize("lie", LIES)
def test_no_sensor_makes_metal_too_hot(lie: str) -> None:
    """One that sticks where metal melts may stand for the healthy robot that melts last."""
    last_K = 25.0 if lie == "stuck, melting" else 0.0
    hottest_C = watched(ROBOT, 5, lie, lasts_s=700.0).hottest_C
    assert hottest_C <= ROBOT.heater.temperature_max_C + last_K


def test_the_heater_goes_off_by_the_hot_corner_whatever_a_sensor_shows() -> None:
    belief, highest_C, shown_C = begun(), ROBOT.heater.temperature_max_C, AIR_C
    while not belief.cut:
        belief = belief.advance((FULL_A, FULL_A), STEP_S).take(shown_C)
        assert belief.at_most_C < highest_C + 5.0
    assert belief.at_most_C >= highest_C
    assert belief.advance((0.0, 0.0), STEP_S).take(shown_C).cut


def test_a_cold_reading_lowers_what_metal_has_only_with_the_heater_off_for_long() -> None:
    belief = heated(begun(), Metal(ROBOT, AIR_C, np.random.default_rng(2), False), 4.0, 60.0)
    hot_C = belief.at_most_C
    for _ in range(10):
        belief = belief.advance((0.0, 0.0), STEP_S).take(30.0)
    assert belief.at_most_C > hot_C - 10.0
    for _ in range(40):
        belief = belief.advance((0.0, 0.0), STEP_S).take(30.0)
    assert belief.at_most_C <= 30.0 + SENSOR_OFF_K + 1e-9
    assert belief.at_least_C >= 30.0 - SENSOR_OFF_K - 1e-9


def test_a_reading_at_the_set_point_makes_no_liquid_of_metal_without_the_heat_for_it() -> None:
    belief = begun()
    for _ in range(10):
        belief = belief.advance((0.1, 0.1), STEP_S).take(SET_C)
    assert not belief.may_be_liquid
    assert belief.at_least_C < AIR_C + 5.0


def test_a_sensor_that_rises_as_no_metal_does_is_unlike_all() -> None:
    """One that lags by half a minute, one that stands still, and one that is scaled."""
    for lag_s, scale in ((30.0, 1.0), (1e4, 1.0), (4.0, 0.6)):
        metal, belief = Metal(ROBOT, AIR_C, np.random.default_rng(3), False), begun()
        shown_C = AIR_C
        while not (belief.unlike or belief.cut):
            for _ in range(10):
                metal.advance(FULL_A)
                aim_C = AIR_C + scale * (metal.temperature_C - AIR_C)
                shown_C += (aim_C - shown_C) * -math.expm1(-0.1 / lag_s)
            belief = belief.advance((FULL_A, FULL_A), STEP_S).take(shown_C)
            assert metal.temperature_C < ROBOT.heater.temperature_max_C


def test_simulated_segments_are_drawn_within_what_is_watched_as_healthy() -> None:
    corners = begun().corners
    model = replace(corners.cold)
    ranges = ROBOT.thermal_segment(0).ranges
    within, rng = healthy_ranges(model, ranges), np.random.default_rng(0)
    for _ in range(2000):
        one = healthy(drawn(model, ranges, rng), within)
        assert all(low <= getattr(one, n) <= high for n, (low, high) in within.items())
    assert thresholds_C(corners.hot)[0] <= thresholds_C(corners.cold)[0]
