"""The bending coordinate W is what its definition says, is conserved, and its rate is bounded."""

from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp

from twosra_mpc.model.bending import bending
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.rows import by_rows
from twosra_mpc.robot.description import Robot, load_robot
from twosra_mpc.robot.modes import SOFT_1, SOFT_2, SOFT_BOTH, Mode
from twosra_mpc.robot.paths import ArcPath, LogSpiralPath

Array = NDArray[np.float64]

L = 0.04  # m, length of a segment of the paper's robot
CURVATURE = 78.5  # 1/m, limit of the robot

SPIRAL = load_robot("2sra-v1-paper")
SLOW_WHEELS = SPIRAL.with_values(limits=SPIRAL.limits.with_values(wheel_speed_rad_s=1.0))
ARCS = {
    "fibre_end": SPIRAL.with_values(path=ArcPath(model="arc", speed_reference="fibre_end")),
    "side_wheel": SPIRAL.with_values(path=ArcPath(model="arc", speed_reference="side_wheel")),
}
SPIRALS = {"spiral": SPIRAL, "slow_wheels": SLOW_WHEELS}
ROBOTS = {**SPIRALS, **ARCS}

each_robot = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS.keys())
each_spiral = pytest.mark.parametrize("robot", SPIRALS.values(), ids=SPIRALS.keys())
for_some = settings(max_examples=12)


def between(bound: float) -> st.SearchStrategy[float]:
    """Draw numbers within +-bound."""
    return st.floats(-bound, bound, allow_subnormal=False)


curvatures = between(CURVATURE)
soft_modes = st.sampled_from((SOFT_2, SOFT_1, SOFT_BOTH))


def unit_speed(robot: Robot) -> float:
    """Speed that no locomotion unit can exceed, because of itself or of its side wheel [m/s]."""
    limits = robot.limits
    return min(limits.unit_speed_m_s, limits.wheel_speed_rad_s * robot.geometry.wheel_radius_m)


def density(robot: Robot, alpha: float) -> float:
    """1 / g, written a second time: rho_III / m_III of the smoothed spiral [m], 1 for arcs."""
    if not isinstance(robot.path, LogSpiralPath):
        return 1.0
    eps, m = robot.path.smoothing_rad, robot.path.angle_ratio[2]
    spiral_angle = (math.hypot(alpha, eps) - eps) / m + math.pi
    radius = robot.path.scale[2] * L * math.exp(-robot.path.growth[2] * spiral_angle)
    return radius / m


def coordinate_rates(robot: Robot, kappas: tuple[float, float], mode: Mode, v: Array) -> Array:
    """dW/dt of both segments, with dW/dkappa = l / g."""
    q = np.array([0.0, 0.0, 0.0, *kappas])
    bend = kinematics(robot).jacobian(q, mode).full()[3:, :2] @ v
    densities = np.array([density(robot, kappa * L) for kappa in kappas])
    return np.asarray(L * densities * bend)


# --- the coordinate -------------------------------------------------------------------------


@each_robot
@given(kappa=curvatures)
def test_the_coordinate_is_odd(robot: Robot, kappa: float) -> None:
    coordinate = bending(robot).coordinate
    assert coordinate(0.0) == 0.0
    assert coordinate(-kappa) == -coordinate(kappa)


@each_robot
@pytest.mark.parametrize("kappa", [1e-3, 0.2, 1.0, 7.0, 30.0, -40.0, 78.5, 157.0, 250.0])
def test_the_coordinate_is_the_integral_of_its_definition(robot: Robot, kappa: float) -> None:
    breaks = sorted({x for x in (0.01, 0.05, 0.3) if x < abs(kappa) * L})
    integral, _ = quad(
        partial(density, robot),
        0.0,
        abs(kappa) * L,
        points=breaks or None,
        epsabs=1e-15,
        epsrel=1e-12,
        limit=200,
    )
    found = bending(robot).coordinate(kappa)
    assert found == pytest.approx(math.copysign(integral, kappa), rel=1e-11)


@pytest.mark.parametrize("smoothing_rad", [1e-2, 1e-3, 3e-4, 1e-4])
def test_the_error_of_the_coordinate_is_less_than_bounds_leave_room_for(
    smoothing_rad: float,
) -> None:
    assert isinstance(SPIRAL.path, LogSpiralPath)
    robot = SPIRAL.with_values(path=SPIRAL.path.with_values(smoothing_rad=smoothing_rad))
    facts, largest = bending(robot), bending(robot).coordinate(CURVATURE)
    for kappa in (0.3, 1.0, 8.0, CURVATURE):
        points = [size for size in np.geomspace(1e-5, 1.0, 16) if size < kappa * L]
        integral, _ = quad(
            partial(density, robot), 0.0, kappa * L, points=points, epsabs=1e-16, limit=400
        )
        assert abs(facts.coordinate(kappa) - integral) < 3e-12 * largest
    error = 4e-12 * largest  # of a change of W that follows from up to four of them
    assert facts.least_time(SOFT_1, [(0.0, 0.0)] * 2, error) == 0.0
    assert facts.least_effort_s2(SOFT_1, [(0.0, 0.0)] * 2, error) == 0.0


@each_robot
@given(kappa=between(CURVATURE - 1), step=st.floats(1e-3, 1.0))
@for_some
def test_the_coordinate_grows_by_its_density(robot: Robot, kappa: float, step: float) -> None:
    """Mean value theorem: W grows by l / g, taken somewhere on the way, per curvature."""
    coordinate = bending(robot).coordinate
    grown = (coordinate(kappa + step) - coordinate(kappa)) / (step * L)
    on_the_way = [density(robot, x * L) for x in (kappa, kappa + step)]
    if kappa < 0 < kappa + step:
        on_the_way.append(density(robot, 0.0))
    slack = 1e-9 * max(on_the_way)
    assert min(on_the_way) - slack <= grown <= max(on_the_way) + slack


# --- what is conserved ----------------------------------------------------------------------


@each_robot
@given(
    kappas=st.tuples(curvatures, curvatures),
    v=st.tuples(between(0.03), between(0.03)).map(np.array),
)
def test_with_both_soft_both_coordinates_change_at_one_rate(
    robot: Robot, kappas: tuple[float, float], v: Array
) -> None:
    rates = coordinate_rates(robot, kappas, SOFT_BOTH, v)
    assert rates[0] == pytest.approx(rates[1], rel=1e-12, abs=1e-15)


@each_spiral
@given(kappas=st.tuples(curvatures, curvatures), v=st.tuples(between(0.03), between(0.03)))
def test_on_the_spiral_that_rate_is_the_sum_of_the_speeds(
    robot: Robot, kappas: tuple[float, float], v: tuple[float, float]
) -> None:
    rates = coordinate_rates(robot, kappas, SOFT_BOTH, np.array(v))
    np.testing.assert_allclose(rates, v[0] + v[1], rtol=0.0, atol=1e-15)


# --- how fast -------------------------------------------------------------------------------

shapes = st.tuples(curvatures, curvatures)
fixed = st.sampled_from([(False, False), (True, False), (False, True)])


def rate_at_full_speed(robot: Robot, kappas: tuple[float, float], mode: Mode) -> float:
    """Rate of a soft segment's coordinate with both locomotion units at full speed."""
    full = np.full(2, unit_speed(robot))
    return float(coordinate_rates(robot, kappas, mode, full)[mode.index(1)])


@each_robot
@given(
    kappas=shapes,
    mode=soft_modes,
    shares=st.tuples(between(1.0), between(1.0)).map(np.array),
    is_fixed=fixed,
)
@example((0.0, 0.0), SOFT_1, np.array([1.0, 1.0]), (False, False))
@example((CURVATURE, CURVATURE), SOFT_1, np.array([1.0, 1.0]), (False, True))
@example((-CURVATURE, 0.0), SOFT_2, np.array([-1.0, -1.0]), (True, False))
@example((CURVATURE, -CURVATURE), SOFT_BOTH, np.array([1.0, 1.0]), (False, False))
@for_some
def test_no_coordinate_changes_faster_than_its_bound(
    robot: Robot,
    kappas: tuple[float, float],
    mode: Mode,
    shares: Array,
    is_fixed: tuple[bool, bool],
) -> None:
    rates = coordinate_rates(robot, kappas, mode, unit_speed(robot) * shares)
    known = tuple((k, k) if fixed else None for k, fixed in zip(kappas, is_fixed, strict=True))
    assert np.max(np.abs(rates)) <= bending(robot).fastest(mode, known)
    twist = kinematics(robot).jacobian([0, 0, 0, *kappas], mode).full()[:, :2] @ shares
    far_m_s = unit_speed(robot) * float(np.hypot(*twist[:2]))
    assert far_m_s <= bending(robot).largest_speed_m_s(mode)


@each_robot
@pytest.mark.parametrize("mode", [SOFT_1, SOFT_2, SOFT_BOTH])
def test_the_largest_speed_of_the_middle_link_is_not_loose(robot: Robot, mode: Mode) -> None:
    grid = np.linspace(-CURVATURE, CURVATURE, 41)
    q = np.array([(0, 0, 0, *kappas) for kappas in itertools.product(grid, grid)])
    (columns,) = by_rows(kinematics(robot).jacobian, q, np.tile(mode, (len(q), 1)))
    along, across = columns.reshape(len(q), 5, 5)[:, :2, :2].transpose(2, 0, 1)
    most = unit_speed(robot) * float(np.hypot(along, across).sum(axis=1).max())
    assert most <= bending(robot).largest_speed_m_s(mode) <= 1.35 * most


@each_spiral
@pytest.mark.parametrize("mode", [SOFT_1, SOFT_2])
def test_with_one_soft_spirals_bend_fastest_when_straight(robot: Robot, mode: Mode) -> None:
    straight = rate_at_full_speed(robot, (0.0, 0.0), mode)
    for kappa in np.linspace(-CURVATURE, CURVATURE, 41):
        assert rate_at_full_speed(robot, (float(kappa), float(kappa)), mode) <= straight
    assert straight <= bending(robot).fastest(mode, (None, None)) <= 1.05 * straight


@each_robot
@pytest.mark.parametrize("mode", [SOFT_1, SOFT_2, SOFT_BOTH])
@pytest.mark.parametrize(("known", "slack"), [(None, 1.3), (0.0, 1.05), (-60.0, 1.05)])
def test_bounds_are_not_loose(robot: Robot, mode: Mode, known: float | None, slack: float) -> None:
    grid = [float(kappa) for kappa in np.linspace(-CURVATURE, CURVATURE, 21)]
    shapes_met = itertools.product(grid, grid if known is None else [known])
    fastest = max(rate_at_full_speed(robot, shape, mode) for shape in shapes_met)
    around = None if known is None else (known - 1e-6, known + 1e-6)
    assert bending(robot).fastest(mode, (None, around)) <= slack * fastest


@each_robot
@given(kappas=shapes, mode=soft_modes, share=st.floats(0.0, 1.0))
@example((-CURVATURE, -CURVATURE), SOFT_BOTH, 1.0)
@example((-CURVATURE, CURVATURE), SOFT_1, 1.0)
@example((CURVATURE, -CURVATURE), SOFT_1, 0.0)
@for_some
def test_at_full_speed_a_bend_takes_its_least_time_and_little_more(
    robot: Robot, kappas: tuple[float, float], mode: Mode, share: float
) -> None:
    facts = bending(robot)
    origin = (facts.coordinate(kappas[0]), facts.coordinate(kappas[1]))
    room = facts.coordinate(CURVATURE)
    down = max(-room - w for w, soft in zip(origin, mode, strict=True) if soft)
    up = min(room - w for w, soft in zip(origin, mode, strict=True) if soft)
    bend = down + share * (up - down)
    least_s = facts.least_time(mode, [(w, w) for w in origin], bend)
    assume(abs(bend) > 1e-3 * room and math.isfinite(least_s))
    full = np.full(2, math.copysign(unit_speed(robot), bend))

    def rate(_: float, shape: Array) -> Array:
        """Change of both curvatures, which stops at their limits."""
        q = np.array([0.0, 0.0, 0.0, *np.clip(shape, -CURVATURE, CURVATURE)])
        return np.asarray(kinematics(robot).jacobian(q, mode).full()[3:, :2] @ full)

    times = [0.0, least_s, 1.3 * least_s]
    path = solve_ivp(rate, (0.0, times[-1]), kappas, t_eval=times, rtol=1e-9, atol=1e-9).y
    soft = mode.index(1)
    bent = [abs(facts.coordinate(kappa) - origin[soft]) for kappa in path[soft, 1:]]
    assert bent[0] <= abs(bend) * (1 + 1e-7)
    assert bent[1] >= abs(bend)


@pytest.mark.parametrize("mode", [SOFT_1, SOFT_2, SOFT_BOTH])
def test_bounds_are_in_proportion_to_the_speed_that_wheels_and_units_allow(mode: Mode) -> None:
    assert unit_speed(SPIRAL) == 0.03
    assert unit_speed(SLOW_WHEELS) == pytest.approx(0.01)
    fast = bending(SPIRAL).fastest(mode, (None, None))
    assert bending(SLOW_WHEELS).fastest(mode, (None, None)) == pytest.approx(fast / 3)
