"""Limits: each written once; here every one of them a second time, by hand."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from once import planned
from problems import at_once
from test_segments import ROBOTS, world

from twosra_mpc import Robot, load_problem, load_robot, plan
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.solver.multiple_shooting import transcribe
from twosra_mpc.problem import ends, limits
from twosra_mpc.problem.limits import (
    SHAPE_LIMITS,
    SPEED_LIMITS,
    ShapeLimit,
    broken_by_shapes,
    may_drive_in,
    most_gaps_m,
    shape_margins,
)
from twosra_mpc.problem.speeds import (
    driven,
    interval_durations,
    least_times_and_turns,
    margins,
    rigid_rows,
    shapes_allowed,
    speed_limits,
)

LIMITED = load_robot("2sra-v1")
ARC = at_once(LIMITED)


@pytest.mark.parametrize("robot", ROBOTS[1::2], ids=lambda r: str(r.coordinates.segments))
@given(seed=st.integers(0, 10_000))
def test_margins_of_shapes_by_hand(robot: Robot, seed: int) -> None:
    limit = 1.2 * robot.limits.curvature_per_m
    kappa = np.random.default_rng(seed).uniform(-limit, limit, robot.coordinates.segments)
    margins = {name: float(found[0]) for name, found in shape_margins(robot, kappa).items()}
    expected = robot.limits.curvature_per_m - np.abs(kappa).max()
    assert margins["curvature_per_m"] == pytest.approx(expected, abs=1e-5)
    assert margins["unit_gap_m"] == pytest.approx(gap(robot, kappa), abs=1e-9)
    matrix = kinematics(robot).wheel_matrix([0, 0, 0, *kappa], robot.rigid).full()[:, 2:]
    scaled = matrix * robot.geometry.wheel_radius_m * np.array([1, 1, 10.0])
    smallest = np.linalg.svd(scaled, compute_uv=False)[-1]
    bound = margins["wheel_independence"] + robot.limits.wheel_independence
    assert 0 <= bound <= smallest + 1e-6


def gap(robot: Robot, kappa: np.ndarray) -> float:
    """Gap between the squares by projecting their corners, less what is asked for."""
    g, squares = robot.geometry, []
    for side, end in zip((-1, 1), world(robot, np.array([0, 0, 0, *kappa])), strict=True):
        centre, half = side * (g.end_link_m + g.unit_side_m / 2), g.unit_frame_m / 2
        corners = [(centre + a * half, b * half, 1) for a in (-1, 1) for b in (-1, 1)]
        squares.append((end @ np.array(corners).T)[:2].T)
    best = -math.inf
    for points in squares:
        for corner in (1, 2):
            axis = (points[corner] - points[0]) / np.linalg.norm(points[corner] - points[0])
            one, other = squares[0] @ axis, squares[1] @ axis
            best = max(best, other.min() - one.max(), one.min() - other.max())
    return best - robot.limits.unit_gap_m


@pytest.mark.parametrize("seed", range(4))
def test_least_times_of_motions_by_hand(seed: int) -> None:
    """Each wheel and each unit within its speed, at the start, in the middle and at the end."""
    rng, sequence = np.random.default_rng(seed), ((1, 0), (0, 0), (1, 1))
    inputs = np.zeros((3, 2, 5))
    inputs[[0, 2], :, :2] = rng.uniform(-0.01, 0.01, (2, 2, 2))
    inputs[1, :, 2:] = rng.uniform(-0.1, 0.1, (2, 3))
    motion = roll_out(ARC, np.array([0, 0, 0.3, 10, -20.0]), sequence, inputs)
    found = interval_durations(motion)
    for i, mode in enumerate(sequence):
        for k in range(2):
            s, least = inputs[i, k], np.abs(inputs[i, k, :2]).max() / 0.03
            before, after = motion.states[i, k], motion.states[i, k + 1]
            for q in (before, (before + after) / 2, after):
                rolled = np.abs(kinematics(ARC).wheel_matrix(q, mode).full() @ s).max()
                least = max(least, rolled / 10.0)
            assert found[i, k] == pytest.approx(least, rel=1e-12)


def test_rigid_rows_are_the_wheel_matrix_over_the_wheel_speed() -> None:
    matrix = kinematics(ARC).wheel_matrix([0, 0, 0, 12.0, -7.0], (0, 0)).full()[:, 2:]
    assert rigid_rows(ARC, (12.0, -7.0)) == pytest.approx(matrix / 10.0)


@given(
    direction=st.floats(-math.pi, math.pi),
    turn=st.floats(-0.3, 0.3),
    kappa=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
)
def test_rigid_rows_forbid_no_twist_within_the_limits(
    direction: float, turn: float, kappa: tuple[float, float]
) -> None:
    """Bounds rest on them; what is verified may use a little less than the circle of speeds."""
    twist = np.array([math.cos(direction), math.sin(direction), turn])
    drives = LIMITED.with_values(limits=LIMITED.limits.with_values(wheel_speed_rad_s=1e3))
    at_most = np.array([0.05, 0.05, 1.0]) * twist
    assert np.abs(rigid_rows(drives, kappa) @ at_most).max() <= 1 + 1e-12
    motion = np.array([[0.0, 0.0, *at_most]])
    stated, _ = least_times_and_turns(
        drives, np.array([[0.0, 0.0, 0.0, *kappa]]), motion, np.array([[0, 0]])
    )
    assert 1 - 1e-12 <= stated[0] <= 1 / math.cos(math.pi / 16) + 1e-12


def test_every_limit_is_checked_in_every_plan() -> None:
    made = planned("move-and-shape")
    samples = made.samples
    dt_s = np.append(np.diff(samples.t_s), 0.0)

    def left(times_faster: float) -> dict[str, float]:
        v, a = times_faster * samples.v, samples.a
        found = driven(made.robot, samples.q, v, a, dt_s, samples.mode)
        return dict(margins(made.robot, samples.q, v, a, found))

    names = {limit.name for limit in (*SHAPE_LIMITS, *SPEED_LIMITS)}
    assert set(left(1.0)) == names | {"wheel_acceleration_rad_s2"}
    for name, margin in left(1.0).items():
        assert made.verification.limits[name] == pytest.approx(margin, abs=1e-12)
    assert made.verification.limits["wheel_acceleration_rad_s2"] >= 0
    assert all(margin >= 0 for margin in left(1.0).values())
    assert all(left(500.0)[limit.name] < 0 for limit in SPEED_LIMITS)


def test_a_limit_that_a_robot_does_not_have_is_not_checked() -> None:
    made = planned("move-and-shape", robot=ARC)
    assert [limit.name for limit in speed_limits(ARC)] == ["wheel_speed_rad_s", "unit_speed_m_s"]
    assert not {"bend_rate_rad_s", "wheel_acceleration_rad_s2"} & set(made.verification.limits)
    assert made.verification.limits["wheel_speed_rad_s"] == 0.0  # nothing else holds it back


@pytest.mark.parametrize("seed", range(3))
def test_bending_driving_and_turning_rates_by_hand(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kappa, phi = rng.uniform(-30, 30, 2), rng.uniform(-3, 3)
    q = np.array([[0, 0, phi, *kappa]])
    angle, turn = rng.uniform(-np.pi, np.pi), rng.uniform(-0.05, 0.05)
    s = np.array([0, 0, 0.02 * math.cos(angle), 0.02 * math.sin(angle), turn])
    rows = kinematics(LIMITED).wheel_matrix(q[0], (0, 0)).full()[:, 2:] @ s[2:]
    least = max(0.02 / 0.05, abs(turn) / 0.3, np.abs(rows).max() / 10.0)
    found = least_times_and_turns(LIMITED, q, s[None], np.array([[0, 0]]))[0][0]
    assert least * (1 - 1e-12) <= found <= max(least, 0.02 / 0.05 / math.cos(math.pi / 16)) + 1e-12
    bend = np.array([0.001, 0.001, 0, 0, 0])
    rates = kinematics(LIMITED).jacobian(q[0], (1, 0)).full()[3:] @ bend * 0.04
    least = max(np.abs(rates).max() / 0.5, 0.001 / 0.03)
    assert least_times_and_turns(LIMITED, q, bend[None], np.array([[1, 0]]))[0][0] == pytest.approx(
        least
    )


@pytest.mark.parametrize(
    ("kappa", "name"),
    [((0.0, 0.0), None), ((90.0, 0.0), "curvature_per_m"), ((45.0, 55.0), "unit_gap_m")],
)
def test_a_broken_limit_is_named(kappa: tuple[float, float], name: str | None) -> None:
    found = broken_by_shapes(ARC, [kappa])
    assert (found.name if found else None) == name
    if found is not None:
        assert found.name in found.words(ARC.limits) or "overlap" in found.words(ARC.limits)


def test_a_motion_that_comes_too_close_between_nodes_is_refused() -> None:
    """Bending both segments by 110 1/m passes shapes in which the units overlap."""
    inputs = np.zeros((1, 12, 5))
    inputs[0, :, :2] = 0.018
    motion = roll_out(ARC, np.array([0, 0, 0, -20.0, -20.0]), ((1, 1),), inputs)
    apart = shape_margins(ARC, motion.states[0, :, 3:])["unit_gap_m"] >= 0
    assert shapes_allowed(motion, 1e-9) == bool(apart.all())
    assert most_gaps_m(ARC, motion.states[0, :1, 3:]).min() >= 0


# A limit of one's own: one value, and everything that plans and checks follows it.


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> ShapeLimit:
    """The difference of the curvatures stays within 30 1/m."""
    toy = ShapeLimit(
        name="difference_per_m",
        margin=lambda body, kappa: 30.0 - ca.fabs(kappa[0] - kappa[1]),
        words=lambda numbers: "curvatures differ by over 30 1/m",
        rounding=1e-9,
        scale=30.0,
    )
    monkeypatch.setattr(limits, "SHAPE_LIMITS", (*SHAPE_LIMITS, toy))
    for module, name in ((limits, "shape_function"), (ends, "_steepness")):
        kept = getattr(module, name)  # that of the limits there were
        monkeypatch.setattr(module, name, per_body(32)(kept.__wrapped__))
    return toy


def test_a_further_limit_is_kept_by_plans_and_named_by_messages(narrow: ShapeLimit) -> None:
    problem = load_problem("paper-1", robot="2sra-v1")  # from a difference of 14 1/m to 10
    margins = shape_margins(problem.robot, (20.0, -20.0))
    assert margins[narrow.name][0] == pytest.approx(-10.0)
    found = plan(problem).require()
    assert found.verification.limits[narrow.name] >= 0
    rows = transcribe(ARC.body, None, 2, 3, 1).rows["shape"]
    assert rows.stop - rows.start == 2 * (2 * 4)  # it and the gap, at every node
    apart = load_problem("paper-4", robot="2sra-v1")  # starts at a difference of 44 1/m
    with pytest.raises(ValueError, match=r"start\.kappa_per_m .* curvatures differ by over 30"):
        plan(apart)


def test_driving_limits_forbid_driving_only() -> None:
    singular = next(limit for limit in SHAPE_LIMITS if limit.driving)
    shape = (39.6, 58.8)  # where the paper's wheels lose control, and the units overlap
    assert shape_margins(ARC, shape)[singular.name][0] < 0
    assert not may_drive_in(ARC, [shape])[0]
