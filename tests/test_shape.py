"""Shapes: units apart, wheels independent, and the planner keeps to both."""

from __future__ import annotations

import math

import numpy as np
import pytest
from problems import ROBOT

from twosra_mpc import Goal, InputError, Problem, Robot, Start, load_problem, load_robot, plan
from twosra_mpc.lab.bench.singular_shapes import condition_number, singular_shapes
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.ends import check_shapes, may_drive
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.robot.geometry import Wheel
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_BOTH


def test_condition_numbers_of_the_papers_geometry() -> None:
    """Straight 1.40; at most 5.8 for abs(alpha) <= pi/2, turning measured at 0.1 m."""
    assert condition_number(ROBOT, (0.0, 0.0)) == pytest.approx(1.40, abs=0.005)
    grid = np.linspace(-1, 1, 61) * math.pi / 2 / 0.04
    conditions = np.array([condition_number(ROBOT, (a, b)) for a in grid for b in grid])
    assert conditions.max() == pytest.approx(5.8, abs=0.1)
    assert np.median(conditions) == pytest.approx(1.62, abs=0.03)


def test_the_papers_wheels_lose_control_only_where_the_units_overlap() -> None:
    squares = ROBOT.geometry.with_values(unit_frame_m=ROBOT.geometry.unit_side_m)
    found = singular_shapes(ROBOT.with_values(geometry=squares))
    assert [tuple(np.round(s.kappa_per_m, 1).tolist()) for s in found] == [
        (-58.8, -39.6),
        (39.6, 58.8),
    ]
    assert [round(1e3 * s.unit_gap_m) for s in found] == [-22, -22]
    for framed, square in zip(singular_shapes(ROBOT), found, strict=True):
        assert framed.kappa_per_m == square.kappa_per_m
        assert framed.unit_gap_m < square.unit_gap_m


@pytest.mark.parametrize("segments", [1, 3])
def test_singular_shapes_of_any_number_of_segments_are_the_nearest_ones(segments: int) -> None:
    """They lose rank to rounding, and thousands of shapes nearer the straight one keep theirs."""
    whole = load_robot("3sra")
    robot = whole.with_values(geometry=whole.geometry.with_values(segments=segments))
    wheels, rng = kinematics(robot).wheel_matrix, np.random.default_rng(segments)

    def smallest(kappa: np.ndarray) -> float:
        matrix = wheels([0, 0, 0, *kappa], [0] * segments).full()[:, 2:]
        scale = robot.geometry.wheel_radius_m * np.array([1, 1, 10.0])
        return float(np.linalg.svd(matrix * scale, compute_uv=False)[-1])

    found = singular_shapes(robot)
    assert bool(found) == (segments > 1)
    assert all(smallest(np.array(shape.kappa_per_m)) < 1e-6 for shape in found)
    limit = robot.limits.curvature_per_m
    least = min((np.linalg.norm(shape.kappa_per_m) for shape in found), default=limit)
    direction = rng.normal(size=(1000, segments))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    nearer = np.clip(0.97 * least * direction * rng.uniform(0.5, 1, (1000, 1)), -limit, limit)
    assert min(map(smallest, nearer)) > 1e-3


def robot_singular_when_straight() -> Robot:
    """All four wheels drive across the straight fibre: it can slide along itself unnoticed."""
    quarter = math.pi / 2
    wheels = tuple(
        Wheel(x_m=x, y_m=y, angle_rad=angle)
        for x, y, angle in (
            (-0.08, 0.0, quarter),
            (-0.05, 0.03, quarter),
            (0.08, 0.0, -quarter),
            (0.05, -0.03, -quarter),
        )
    )
    geometry = ROBOT.geometry.with_values(wheels=wheels)
    return ROBOT.with_values(geometry=geometry)


def test_a_singular_shape_inside_the_limits_is_found_and_not_driven_in() -> None:
    robot = robot_singular_when_straight()
    assert any(abs(sum(s.kappa_per_m)) < 0.1 for s in singular_shapes(robot))
    start = Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(0.0, 0.0))
    goal = Goal(x_m=0.05, y_m=0.02, phi_rad=0.2, kappa_per_m=(20.0, 30.0))
    problem = Problem(robot=robot, start=start, goal=goal)
    sequence = (RIGID, SOFT_1, SOFT_BOTH, RIGID)
    assert may_drive(problem, sequence) == (False, True, True, True)
    result = plan(problem)
    assert result.found
    assert result.plan.phases[0].mode != RIGID
    assert result.plan.phases[-1].mode == RIGID
    assert result.plan.verification.limits["wheel_independence"] >= 0


def test_overlapping_shapes_are_refused_by_name() -> None:
    shape = {"kappa_per_m": (45.0, 55.0)}
    base = load_problem("paper-1")
    for where in ("start", "goal"):
        changed = {**getattr(base, where).model_dump(), **shape}
        problem = load_problem("paper-1", **{where: changed})
        with pytest.raises(InputError, match=r"overlaps .* by .* mm|is .* mm short") as error:
            plan(problem)
        assert error.value.field == f"{where}.kappa_per_m"
        assert error.value.value == (45.0, 55.0)
    check_shapes(base)


def test_a_plan_goes_round_the_shapes_that_overlap() -> None:
    """From (60, -50) to (-40, 62): bending one segment first would bring the units together."""
    problem = Problem(
        robot=ROBOT,
        start=Start(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(55.0, -20.0)),
        goal=Goal(x_m=0.0, y_m=0.0, phi_rad=0.0, kappa_per_m=(-10.0, 55.0)),
    )
    result = plan(problem)
    assert result.found
    assert shape_margins(ROBOT, result.plan.samples.q[:, 3:])["unit_gap_m"].min() >= 0


def test_units_hang_where_their_wheels_are() -> None:
    geometry = load_robot("2sr-v2").geometry
    shape, beyond = robot_shape(geometry, np.zeros(5)), geometry.unit_frame_m - geometry.unit_side_m
    for unit, wheels in ((0, shape.wheels[:2]), (1, shape.wheels[2:])):
        low = shape.units[unit].min(axis=0) + beyond / 2
        high = shape.units[unit].max(axis=0) - beyond / 2
        assert high[1] == pytest.approx(
            0.0, abs=1e-12
        )  # the wheels' square is flush with the fibre
        for corners in wheels:  # beside that square, never in it
            inner = np.clip(corners.mean(axis=0), low, high)
            assert np.linalg.norm(corners.mean(axis=0) - inner) == pytest.approx(0.0065, abs=1e-9)
