"""What is refused of air, temperatures, heaters, windows and segments, and in which words."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

import pytest
from test_problem import ROBOT, SCENARIO, assert_refused, changed, problems_of, refusal, without

from twosra_mpc import Problem, Robot, load_problem, load_robot
from twosra_mpc.robot.timing import ThermalTiming

Document = dict[str, Any]

V2: Document = tomllib.loads(
    files("twosra_mpc").joinpath("robots", "2sr-v2.toml").read_text(encoding="utf-8")
)
SMALL = {"start.kappa_per_m": [5.0, -5.0], "goal.kappa_per_m": [10.0, -10.0]}


def scenario(robot: Document | str = "2sra-v1", **changes: object) -> Document:
    """A scenario for either robot with keys changed, dots written as two underscores."""
    document = {**SCENARIO, "robot": Robot(**robot) if isinstance(robot, dict) else robot}
    for key, value in SMALL.items():
        document = changed(document, key, value)
    for key, value in changes.items():
        document = changed(document, key.replace("__", "."), value)
    return document


SOLID, HALF, LIQUID = ({"start__melt_fraction": [share, 0.0]} for share in (0.0, 0.5, 1.0))
WARM = {"start__temperature_C": [57.0, 22.0]}

# Robot, field of the error, its value, what else the scenario says, what is allowed.
CONSTANT, PAPER = {"timing": "constant"}, {"timing": "paper"}
THERMAL_ONLY = "only with a thermal timing; {} has constant times"
SCENARIOS: list[tuple[str, str, object, Document, str]] = [
    ("2sra-v1", "ambient_C", 61.0, {}, "^from 0 to below 61 C, where the metal of 2sra-v1 melts$"),
    ("2sra-v1", "ambient_C", -0.1, {}, "from 0 to below 61 C"),
    ("2sr-v2", "ambient_C", 53.0, {}, "from 0 to below 53 C.*2sr-v2 melts"),
    ("2sra-v1", "ambient_C", "warm", {}, "number"),
    ("2sr-v2", "start.temperature_C.0", 53.1, SOLID, "^at most 53 C: melt_fraction says solid$"),
    ("2sr-v2", "start.temperature_C.0", 61.9, LIQUID, "^at least 68.3642 C: .* says liquid$"),
    ("2sr-v2", "start.temperature_C.0", 61.9, HALF, "^60.6821 C: .* that 50 % is molten$"),
    ("2sra-v1", "start.temperature_C.0", 50.0, HALF, "^61 C: .* that 50 % is molten$"),
    ("2sra-v1", "start.melt_fraction.0", 1.5, {}, r"^from 0 \(solid\) to 1 \(liquid\)$"),
    (
        "2sra-v1",
        "start.body_temperature_C.0",
        30.0,
        {},
        "^25 C, as its metal: it has no other node$",
    ),
    ("2sr-v2", "start.body_temperature_C.0", 58.0, WARM, "^from 0 to 57 C, its metal being so$"),
    ("2sra-v1", "start.temperature_C.0", 61.0, {}, "^with start.melt_fraction: at 61 C metal may"),
    ("2sra-v1", "start.temperature_C.0", 85.5, {}, r"from 0 to 85 C \(robot 2sra-v1\)"),
    ("2sra-v1", "heating", "slow", {}, "'fastest', 'least_energy' or 'keep_warm'"),
    ("2sra-v1", "heating", "keep_warm", CONSTANT, THERMAL_ONLY.format("constant")),
    ("2sra-v1", "heating", "keep_warm", PAPER, THERMAL_ONLY.format("paper")),
    ("2sra-v1", "transition_quantile", 0.9, CONSTANT, THERMAL_ONLY.format("constant")),
    ("2sra-v1", "transition_quantile", 0.4, {}, "or equal to 0.5"),
    ("2sra-v1", "transition_quantile", 1.0, {}, "less than 1"),
    ("2sra-v1", "transition_quantile", "0.9", {}, "number"),
    ("2sra-v1", "heaters_at_once", 0, {}, "greater than or equal to 1"),
    ("2sra-v1", "heaters_at_once", 3, {}, "1 or 2"),
]


@pytest.mark.parametrize(("robot", "field", "value", "more", "allowed"), SCENARIOS)
def test_a_mistake_in_a_thermal_scenario_is_named(
    robot: str, field: str, value: object, more: Document, allowed: str
) -> None:
    key = field.removesuffix(".0")
    cold = 0.0 if key == "start.melt_fraction" else 25.0 if robot == "2sra-v1" else 22.0
    given = {key.replace(".", "__"): value if key == field else [value, cold]}
    document = scenario(robot, **given, **more)
    assert_refused(lambda: Problem(**document), field, value, allowed, None)


@pytest.mark.parametrize("robot", ["2sra-v1", "2sr-v2"])
def test_the_limits_of_what_is_refused_are_accepted(robot: str) -> None:
    solid, liquid = {"2sra-v1": (60.99, 61.01), "2sr-v2": (53.0, 68.365)}[robot]
    problem = Problem(**scenario(robot, start__temperature_C=[solid, liquid], ambient_C=0.0))
    assert problem.start_mode == (0, 1)
    assert Problem(**scenario(robot, ambient_C=solid - 0.01)).ambient == solid - 0.01
    assert Problem(**scenario(robot, transition_quantile=0.5, heating="keep_warm"))
    assert Problem(**scenario(robot, heaters_at_once=1, start__temperature_C=[85.0, 0.0]))


def test_between_the_thresholds_of_the_follow_up_robot_metal_is_changing() -> None:
    warm = {"start__temperature_C": [57.0, 22.0]}
    assert Problem(**scenario("2sr-v2", **warm, timing="constant")).start_stiffness == (0, 0)
    problem = Problem(**scenario("2sr-v2", **warm))
    assert problem.start_stiffness == (None, 0)
    assert problem.start_mode == (0, 0)
    share = problem.melt_fractions[0]
    again = Problem(**scenario("2sr-v2", start__melt_fraction=[share, 0.0]))
    assert again.temperatures == pytest.approx((57.0, 22.6))


@pytest.mark.parametrize("timing", ["nominal", "constant", "paper"])
def test_at_the_melting_point_a_melt_fraction_tells_what_metal_is(timing: str) -> None:
    for share, stiffness in ((0.0, 0), (0.3, None), (1.0, 1)):
        given = {"start__temperature_C": [25.0, 61.0], "start__melt_fraction": [0.0, share]}
        problem = Problem(**scenario("2sra-v1", **given, timing=timing))
        assert problem.start_stiffness == (0, stiffness)


def weak(document: Document, current_A: float) -> Document:
    """A robot whose heaters give little."""
    document = changed(document, "heater.melt_current_A", current_A)
    return changed(document, "heater.hold_current_A", current_A)


@pytest.mark.parametrize("current_A", [0.1, 0.25, 0.29])
def test_a_heater_too_weak_to_melt_is_refused_with_the_air_it_is_too_weak_for(
    current_A: float,
) -> None:
    """0.293 A just holds the melting point in still air of 25 C."""
    document = scenario(weak(ROBOT, current_A))
    allowed = r"^a current that heats to the set-point 65 C in air of 25 C$"
    field = "robot.heater.melt_current_A"
    assert_refused(lambda: Problem(**document), field, current_A, allowed, None)
    assert Problem(**{**document, "timing": "constant"})


def test_a_heater_may_be_strong_enough_in_warm_air_only() -> None:
    document = weak(ROBOT, 0.3)
    assert Problem(**scenario(document, ambient_C=45.0))
    (error,) = problems_of(refusal(lambda: Problem(**scenario(document, ambient_C=5.0))))
    assert "in air of 5 C" in error.allowed
    cold = {"start__temperature_C": [0.0, 0.0]}  # it only takes longer
    assert Problem(**scenario(document, ambient_C=45.0, **cold))


ROBOTS: list[tuple[Document, str, object, str]] = [
    (ROBOT, "segment.ranges.turns", [1.0, 2.0], "^one of heat"),
    (ROBOT, "segment.ranges.power_K_per_s", [1.4, 1.5], "one of heat_solid_J_.*melting_point_C"),
    (V2, "segment.ranges.latent_J", [1.0, 2.0], "power_K"),  # each of the other model
    (ROBOT, "segment.ranges.latent_J", [165.0, 131.0], "^two positive numbers, low then high$"),
    (V2, "segment.ranges.coupling_per_s", [0.0, 0.018], "^two positive numbers, low then high$"),
    (ROBOT, "segment.tube_inner_diameter_m", 0.0052, r"^more than core and coil, 0\.0052 m$"),
    (ROBOT, "segment.tube_outer_diameter_m", 0.007, r"^more than tube_inner.* \(0\.007 m\)$"),
    (V2, "segment.liquid_above_C", 53.0, r"^more than solid_below_C \(53 C\)$"),
    (ROBOT, "segment.metal.fill", 1.01, "less than or equal to 1"),
    (ROBOT, "segment.metal.fill", 0.0, "greater than 0"),
    (ROBOT, "segment.coil.turns", -1.0, "greater than 0"),
    (ROBOT, "segment.metal.colour", 1.0, "known keys here"),
    (ROBOT, "segment.convection_W_per_m2_K", 0.0, "than 0"),
    (V2, "segment.sensor_lag_s", -1.0, "or equal to 0"),
    (V2, "segment.body_ratio", "large", "number"),
    (ROBOT, "segment", 3, "a table of keys"),
]


@pytest.mark.parametrize(("document", "key", "value", "allowed"), ROBOTS)
def test_a_mistake_in_a_segment_is_named(
    document: Document, key: str, value: object, allowed: str
) -> None:
    spoilt = changed(document, key, value)
    assert_refused(lambda: Robot(**spoilt), key, value, allowed, None)


@pytest.mark.parametrize("key", ["segment.core_diameter_m", "segment.metal.latent_heat_J_per_kg"])
def test_a_key_missing_from_a_segment_is_named(key: str) -> None:
    assert_refused(lambda: Robot(**without(ROBOT, key)), key, "missing", "required", None)


@pytest.mark.parametrize("model", ["three_node", None])
def test_a_segment_of_no_known_model_is_named(model: str | None) -> None:
    key = "segment.model"
    document = without(ROBOT, key) if model is None else changed(ROBOT, key, model)
    (error,) = problems_of(refusal(lambda: Robot(**document)))
    assert error.field == key
    assert error.value == (model or "missing")


def test_a_thermal_timing_needs_a_segment() -> None:
    document = without(ROBOT, "segment")
    allowed = "^a table of keys: timing nominal takes its times from it$"
    assert_refused(lambda: Robot(**document), "segment", "missing", allowed, None)
    constant = changed(document, "timing.nominal", ROBOT["timing"]["constant"])
    assert Robot(**constant).segment is None


@pytest.mark.parametrize("name", ["2sra-v1", "2sr-v2"])
def test_the_built_in_robots_take_their_times_from_their_segments(name: str) -> None:
    robot = load_robot(name)
    assert isinstance(robot.timing["nominal"], ThermalTiming)
    assert robot.segment is not None
    assert set(robot.segment.ranges)
    assert load_problem("paper-1").scenario()["transition_quantile"] is None
