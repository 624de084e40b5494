"""Estimates are near the true metal; no sensor makes it too hot, no healthy robot is stopped."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from benchmarks.lying import LIES, Metal, Segment, watched
from twosra_mpc import load_robot
from twosra_mpc.execution.healthy_segments import Heat
from twosra_mpc.execution.heat_belief import HeatBelief, heat_belief
from twosra_mpc.thermal.uncertainty import drawn, healthy, healthy_ranges

ROBOT = load_robot("2sra-v1")
AIR_C, FULL_A, SET_C = 25.0, ROBOT.heater.melt_current_A, ROBOT.heater.soft_setpoint_C
HIGHEST_C = ROBOT.heater.temperature_max_C
FULL, OFF = Heat(1.0, 1.0), Heat(1.0, 0.0)
LATEST_S = 60.0
NEAR_K = 1.5  # thermistors of 1 % parts are as far off


def begun() -> HeatBelief:
    return heat_belief(ROBOT, AIR_C, 0, AIR_C)


def heated(belief: HeatBelief, metal: Metal, lag_s: float, until_C: float = SET_C) -> HeatBelief:
    """Full current until the sensor is at a temperature, or the heater must be off."""
    behind_C = shown_C = metal.temperature_C
    while shown_C < until_C and not belief.cut:
        for _ in range(10):
            metal.advance(FULL_A)
            behind_C += (metal.temperature_C - behind_C) * -math.expm1(-0.2 / lag_s)
            shown_C += (behind_C - shown_C) * -math.expm1(-0.2 / lag_s)  # half the lag each
        belief = belief.take(FULL, shown_C)
    return belief


@pytest.mark.parametrize("seed", range(12))
def test_the_metal_of_a_healthy_robot_is_within_the_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    metal = Metal(ROBOT, AIR_C, rng, False)
    belief = heated(begun(), metal, float(rng.uniform(2.0, 8.0)))
    coldest_C, hottest_C = belief.metal_C
    assert coldest_C - NEAR_K <= metal.temperature_C <= hottest_C + NEAR_K
    assert belief.misfit < 0.5
    assert belief.may_be_liquid


def test_what_a_robot_has_shown_is_known_from_melt_to_melt() -> None:
    """A coil's power is known once it has warmed metal, also after a rest."""
    metal = Metal(ROBOT, AIR_C, np.random.default_rng(1), False)
    hot = heated(begun(), metal, 4.0)
    cold = hot
    while len(cold.since) != 0:
        for _ in range(10):
            metal.advance(0.0)
        cold = cold.take(OFF, metal.temperature_C)
    at = cold.kinds.names.index("resistance_ohm")
    ohm = cold.kinds.middle + cold.kinds.half * cold.prior.mean
    assert ohm[at] == pytest.approx(metal.ohm, rel=0.1)
    variance = np.linalg.inv(cold.prior.precision)[at, at]
    assert variance < 0.3 * np.linalg.inv(begun().prior.precision)[at, at]


def test_a_belief_that_was_saved_goes_on_as_the_one_that_was_not() -> None:
    belief = heated(begun(), Metal(ROBOT, AIR_C, np.random.default_rng(2), False), 4.0, 50.0)
    saved = pickle.loads(pickle.dumps(belief))
    assert saved == belief
    assert saved.take(FULL, 51.0) == belief.take(FULL, 51.0)
    assert saved.take(FULL, 51.0) != belief.take(FULL, 51.1)


def test_readings_that_come_more_often_tell_the_same() -> None:
    rarely = often = begun()
    for k in range(1, 300):
        shown_C, heat = AIR_C + 0.1 * max(0, k - 20), 1.0 if k < 200 else 0.0
        often = often.take(Heat(0.1, heat), shown_C)
        if k % 10 == 0:
            rarely = rarely.take(Heat(1.0, heat if k > 200 or k < 200 else 1.0), shown_C)
    assert len(often.since) <= len(rarely.since)
    assert often.metal_C == pytest.approx(rarely.metal_C, abs=1.0)


@pytest.mark.parametrize("seed", [0, 1, 2, 40200])
def test_no_healthy_robot_is_stopped(seed: int) -> None:
    found = watched(ROBOT, seed, lasts_s=500.0)
    assert found.cause == "", found.words
    assert found.melts
    assert found.hottest_C < 80.0


@pytest.mark.parametrize("melts_at", [-1.0, 1.0])
@pytest.mark.parametrize("warms", [-1.0, 1.0])
def test_metal_that_freezes_as_quickly_as_any_is_healthy(melts_at: float, warms: float) -> None:
    """Nothing is seen of it on the plateau, and then it is solid sooner than was believed."""
    belief = begun()
    kinds, quick = belief.kinds, np.zeros((1, belief.kinds.size))
    ends = {"latent_J": -1.0, "loss_W_per_K": 1.0, "resistance_ohm": -1.0, "ambient_C": -1.0}
    ends |= {"heat_solid_J_per_K": warms, "melting_point_C": melts_at}
    quick[0, : len(kinds.names)] = [ends.get(name, 0.0) for name in kinds.names]
    quick[0, kinds.either] = 1.0
    metal, misfits = kinds.begun(quick, kinds.start(AIR_C, AIR_C)), []
    molten = False
    while metal.shown_C[0] > 50.0 or not molten:
        molten |= bool(metal.level[0] >= 1.02 * kinds.nominal.liquid_level)
        heat = OFF if molten or belief.cut else FULL
        metal = metal.warmed(heat)
        belief = belief.take(heat, float(metal.shown_C[0]))
        misfits.append(belief.misfit)
    assert max(misfits) < 0.5


# Of the last ones few healthy segments show the readings: the heater rests, goes on, and rests.
@pytest.mark.parametrize(
    ("lie", "seed"),
    [
        *((lie, 5) for lie in LIES),
        *(("stuck, melting", seed) for seed in (5006, 7031, 30049)),
        *(("creeps", 5026), ("scaled", 7002)),
    ],
)
def test_no_sensor_makes_metal_too_hot_or_is_in_doubt_for_long(lie: str, seed: int) -> None:
    found = watched(ROBOT, seed, lie, lasts_s=700.0)
    assert found.hottest_C <= HIGHEST_C
    assert not found.mattered_s > LATEST_S


def test_no_reading_of_metal_that_melts_is_one_of_liquid_metal() -> None:
    kinds = begun().kinds
    most = kinds.middle + kinds.half
    melting_C, gain = most[kinds.names.index("melting_point_C")], most[len(kinds.names)]
    assert not kinds.is_liquid(AIR_C + gain * (melting_C - AIR_C))
    assert kinds.is_liquid(ROBOT.heater.soft_setpoint_C)


def test_no_healthy_metal_cools_more_slowly_than_the_slowest() -> None:
    rng = np.random.default_rng(0)
    for begins_C in (58.0, 62.5, 70.0):
        metal = Metal(ROBOT, AIR_C, rng, False)
        while metal.temperature_C < begins_C:
            metal.advance(FULL_A)
        slowest = metal.slowest()
        for _ in range(6000):
            assert slowest.temperature_C >= metal.temperature_C - 1e-9
            metal.advance(0.0)
            slowest.advance(0.0)


@pytest.mark.parametrize("stays_C", [25.0, 45.0, 59.5, 61.7, 63.3, 64.9])
def test_metal_is_not_too_hot_under_a_sensor_that_sticks(stays_C: float) -> None:
    """Whenever it begins to in the first melt, of a fast segment and of a slow one."""
    for seed in range(4):
        metal = Metal(ROBOT, AIR_C, np.random.default_rng(seed), False)
        belief = heated(begun(), metal, 3.0, stays_C)
        while belief.misfit < 1.0 and len(belief.since) < 200:
            for _ in range(10):
                metal.advance(FULL_A * (not belief.cut))
            belief = belief.take(OFF if belief.cut else FULL, stays_C)
        assert metal.hottest_C <= HIGHEST_C


def test_samples_told_as_currents_are_no_danger(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a fast switch; a root mean square is to be told."""
    monkeypatch.setattr(Segment, "told_A", lambda segment: segment.current_A)
    assert watched(ROBOT, 0, lasts_s=300.0).hottest_C <= HIGHEST_C


def test_a_reading_at_the_set_point_makes_no_liquid_of_metal_without_the_heat_for_it() -> None:
    belief = begun()
    for _ in range(10):
        belief = belief.take(Heat(1.0, 0.02), SET_C)
    assert not belief.may_be_liquid
    assert belief.cut
    assert belief.misfit > 1.0


def test_heat_of_two_times_is_that_of_both() -> None:
    both = Heat(1.0, 1.0).then(Heat(3.0, 0.2, 0.4))
    assert (both.passed_s, both.share, both.unknown) == pytest.approx((4.0, 0.4, 0.3))
    assert Heat(0.0, 0.0).then(FULL) == FULL


def test_simulated_segments_are_drawn_within_what_is_watched_as_healthy() -> None:
    kinds, ranges = begun().kinds, ROBOT.thermal_segment(0).ranges
    within, rng = healthy_ranges(kinds.nominal, ranges), np.random.default_rng(0)
    low, high = kinds.middle - kinds.half, kinds.middle + kinds.half
    ends = dict(zip(kinds.names, zip(low, high, strict=True), strict=False))
    for _ in range(2000):
        one = healthy(drawn(kinds.nominal, ranges, rng), within)
        assert all(ends[n][0] - 1e-9 <= getattr(one, n) <= ends[n][1] + 1e-9 for n in within)
