"""Path models side by side: cardioid, corrected spiral, exact wheel map, and the bounds on them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import ROBOT, bold, random_problem

from twosra_mpc import Goal, InputError, Problem, Robot, Start, Status, load_robot, plan
from twosra_mpc.model.bending import bending
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.relaxation import bending_task
from twosra_mpc.problem.limits import UNIT_GAP, broken_by_shapes, most_gaps_m
from twosra_mpc.robot.description import PATH_MODELS, with_path_model
from twosra_mpc.robot.modes import SOFT_1, SOFT_2, SOFT_BOTH, Mode
from twosra_mpc.robot.paths import ArcPath

V2 = load_robot("2sr-v2")
FIBRE_END = ROBOT.with_values(path=ArcPath(model="arc", speed_reference="fibre_end"))
V2_FIBRE_END = V2.with_values(path=FIBRE_END.path)


def bend_rates(robot: Robot, alpha: float) -> tuple[float, float, float]:
    """K of cases I, II (other segment straight) and III (equal curvatures) at a bending angle."""
    kappa = alpha / robot.geometry.lengths_m[0]
    jacobian = kinematics(robot).jacobian
    single = jacobian([0, 0, 0, kappa, 0], SOFT_1).full()[3]
    both = jacobian([0, 0, 0, kappa, kappa], SOFT_BOTH).full()[3]
    return float(single[0]), float(single[1]), float(both[0])


# Ratios cardioid / exact (fibre end) of the follow-up robot at alpha = 0, 1, pi/2, shared notes.
CARDIOID_RATIOS = [(0.0, 0.993, 0.974, 1.018), (1.0, 1.018, 1.047, 1.12), (1.571, 1.06, 1.17, 1.33)]


@pytest.mark.parametrize(("alpha", "i", "ii", "iii"), CARDIOID_RATIOS)
def test_the_cardioid_bends_as_the_follow_up_robot_says(
    alpha: float, i: float, ii: float, iii: float
) -> None:
    ratios = np.array(bend_rates(V2, alpha)) / np.array(bend_rates(V2_FIBRE_END, alpha))
    np.testing.assert_allclose(ratios, (i, ii, iii), atol=0.006)


def test_row_three_in_phase_is_half_as_fast_and_near_the_exact_model() -> None:
    printed = bend_rates(ROBOT, 0.0)
    corrected = bend_rates(with_path_model(ROBOT, "log_spiral_corrected"), 0.0)
    exact = bend_rates(FIBRE_END, 0.0)
    assert printed[2] / corrected[2] == pytest.approx(math.exp(0.2229 * math.pi), rel=1e-9)
    assert printed[:2] == corrected[:2]
    assert corrected[2] / exact[2] == pytest.approx(0.843, abs=1e-3)


def test_every_model_says_what_its_speed_is_and_carries_its_wheel_map() -> None:
    maps = {name: path_model(with_path_model(ROBOT, name)).wheel_map for name in PATH_MODELS}
    assert maps == {
        "log_spiral": "paper",
        "log_spiral_corrected": "paper",
        "arc": "exact",
        "cardioid": "paper",
    }
    speeds = {path_model(with_path_model(ROBOT, name)).speed for name in PATH_MODELS}
    assert all("speed" in text or "end" in text for text in speeds)
    assert len(speeds) == 3


def test_straight_arcs_turn_the_other_wheel_of_the_moving_unit_too() -> None:
    """Erratum 14: .28 (I), .17 (II), .21 (III) of the side wheel's speed."""
    robot = with_path_model(ROBOT, "arc")
    wheels = kinematics(robot).wheel_matrix
    case_1 = wheels([0, 0, 0, 0, 0], SOFT_1).full()[:, 0]
    case_2 = wheels([0, 0, 0, 0, 0], SOFT_1).full()[:, 1]
    case_3 = wheels([0, 0, 0, 0, 0], SOFT_BOTH).full()[:, 0]
    assert case_1[1] / case_1[0] == pytest.approx(0.28, abs=0.005)
    assert case_2[3] / case_2[2] == pytest.approx(0.17, abs=0.005)
    assert case_3[1] / case_3[0] == pytest.approx(0.21, abs=0.005)
    assert np.abs(case_1[2:]).max() < 1e-9


@pytest.mark.parametrize("model", PATH_MODELS)
@given(
    kappa=st.tuples(st.floats(-75, 75), st.floats(-75, 75)),
    speeds=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    mode=st.sampled_from([SOFT_1, SOFT_2, SOFT_BOTH]),
)
def test_no_bend_is_faster_than_its_proved_rate(
    model: str, kappa: tuple[float, float], speeds: tuple[float, float], mode: Mode
) -> None:
    robot = with_path_model(ROBOT, model)
    facts, limit = bending(robot), robot.limits.unit_speed_m_s
    q = np.array([0, 0, 0, *kappa])
    v = np.array([*speeds, 0, 0, 0]) * limit
    rate = kinematics(robot).jacobian(q, mode).full() @ v
    segment, h = mode.index(1), 1e-3
    slope = (facts.coordinate(kappa[segment] + h) - facts.coordinate(kappa[segment] - h)) / (2 * h)
    anywhere = facts.fastest(mode, (None, None))
    known = [None if soft else (k, k) for soft, k in zip(mode, kappa, strict=True)]
    here = facts.fastest(mode, tuple(known))
    assert abs(rate[3 + segment]) * slope <= here * (1 + 1e-4)
    assert here <= anywhere * (1 + 1e-9)


@pytest.mark.parametrize("model", PATH_MODELS)
@pytest.mark.parametrize("mode", [SOFT_1, SOFT_BOTH])
def test_bending_with_both_units_at_full_speed_takes_the_proved_least_time(
    model: str, mode: Mode
) -> None:
    robot = with_path_model(ROBOT, model)
    facts, limit = bending(robot), robot.limits.unit_speed_m_s
    q = np.array([0, 0, 0, -20.0, 12.0])
    seconds = 0.4
    step = [limit * seconds, limit * seconds, 0, 0, 0]
    end = interval_flow(robot, 64)(q, step, mode).full()[:, 0]
    origin = (facts.coordinate(q[3]), facts.coordinate(q[4]))
    bend = facts.coordinate(float(end[3])) - origin[0]
    least = facts.least_time(mode, [(w, w) for w in origin], bend)
    assert least <= seconds + 1e-9
    assert least >= 0.98 * seconds


def test_a_bend_through_overlapping_units_is_forbidden() -> None:
    facts = bending(ROBOT)
    origin = (facts.coordinate(59.0), facts.coordinate(0.0))
    bend = facts.coordinate(59.0)
    shapes, off = facts.shapes_on_the_way(SOFT_2, [(w, w) for w in origin], bend)
    assert not off.any()
    assert most_gaps_m(ROBOT, shapes).min() < 0


def test_what_is_forbidden_though_a_shape_is_known_to_within_bounds_is_forbidden_anywhere() -> None:
    facts, rng = bending(ROBOT), np.random.default_rng(5)
    for width in rng.uniform(0, 4, 40).tolist():
        middle, bend = rng.uniform(-50, 50, 2), facts.coordinate(float(rng.uniform(-59, 59)))
        box = np.array([middle - width, middle + width])
        low, high = (facts.coordinates(k.tolist()) for k in box)
        shapes, off = facts.shapes_on_the_way(SOFT_2, list(zip(low, high, strict=True)), bend)
        if most_gaps_m(ROBOT, shapes, off).min() >= 0:
            continue
        for _ in range(5):
            exactly = facts.coordinates(rng.uniform(*box).tolist())
            some, none = facts.shapes_on_the_way(SOFT_2, [(w, w) for w in exactly], bend)
            assert not none.any()
            assert broken_by_shapes(ROBOT, some) is UNIT_GAP


@pytest.mark.parametrize("model", PATH_MODELS)
@pytest.mark.parametrize("seed", [60, 61])
def test_every_model_plans_to_a_proved_gap(model: str, seed: int) -> None:
    result = plan(random_problem(seed, robot=with_path_model(ROBOT, model)))
    assert result.status is Status.OPTIMAL
    assert result.gap is not None
    assert result.gap < 1e-3


@pytest.mark.parametrize(("model", "most"), [("log_spiral", 78.54), ("arc", 157.08)])
def test_curvatures_beyond_a_model_are_refused(model: str, most: float) -> None:
    data = with_path_model(ROBOT, model).model_dump()
    data["limits"]["curvature_per_m"] = 200.0
    with pytest.raises(InputError) as error:
        Robot(**data)
    assert error.value.field == "limits.curvature_per_m"
    assert f"at most {most:.2f} 1/m" in error.value.allowed


def test_a_cardioid_ends_before_its_cusp() -> None:
    data = V2.model_dump()
    data["limits"]["curvature_per_m"] = 60.0
    with pytest.raises(InputError, match="path model cardioid ends"):
        Robot(**data)


def test_the_follow_up_robot_is_planned_for() -> None:
    problem = random_problem(
        62,
        robot=V2,
        start={"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (5.0, -8.0)},
        goal={"x_m": 0.1, "y_m": 0.1, "phi_rad": 1.0, "kappa_per_m": (-10.0, 12.0)},
    )
    result = plan(problem)
    assert result.status is Status.OPTIMAL


def test_a_narrow_dip_of_the_gap_on_the_way_of_a_bend_is_found() -> None:
    """Wheels overlap the other unit for a moment, and 41 shapes on the way miss it."""
    robot = bold(load_robot("2sra-v1"))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(-31.0, 29.5))
    goal = Goal(kappa_per_m=(57.3, 29.5))
    task, facts = bending_task(Problem(robot=robot, start=start, goal=goal)), bending(robot)
    before, bend = tuple((w, w) for w in task.origin), (57.3 + 31.0) * 0.04
    pieces = np.linspace(0.0, bend, 40)
    ways = [
        facts.shapes_on_the_way(SOFT_1, before, float(end), float(begin))[0]
        for begin, end in itertools.pairwise(pieces)
    ]
    assert any(broken_by_shapes(robot, way) is not None for way in ways)
    assert most_gaps_m(robot, facts.shapes_on_the_way(SOFT_1, before, bend)[0]).min() >= 0
    assert task.forbidden(SOFT_1, before, bend, bend) is not None
    assert task.forbidden(SOFT_1, before, 0.8 * bend, bend) is None
