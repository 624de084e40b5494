"""The kinematics is the geometry of the robot, or the paper's spirals, whichever is asked for.

The geometry here is written a second time, in complex numbers and without the package: an arc of
length l that turns by alpha ends at the chord l sinc(alpha / 2) exp(i alpha / 2).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import DOP853, quad, solve_ivp

from twosra_mpc.lab.reproduction.published_model import published_jacobian
from twosra_mpc.model.chain import sagitta_ratio, sinc, versine_ratio, versine_ratio_squared
from twosra_mpc.model.flow import FINE_STEPS, interval_flow, roll_out
from twosra_mpc.model.kinematics import hybrid_jacobian, kinematics, wheel_travel
from twosra_mpc.model.path_models import path_model
from twosra_mpc.problem.tolerances import DEFECT_TOLERANCE
from twosra_mpc.robot.description import Robot, load_robot
from twosra_mpc.robot.modes import MODES, RIGID, SOFT_1, SOFT_2, SOFT_BOTH, Mode, mode_name
from twosra_mpc.robot.paths import ArcPath, LogSpiralPath

Array = NDArray[np.float64]

# --- the robot ------------------------------------------------------------------------------

L, LINK, H1, H2, H3, WHEEL = 0.04, 0.03, 0.0825, 0.054, 0.0285, 0.01  # m, of the paper's robot
CURVATURE = 78.5  # 1/m, limit of the robot: a half circle
SCALE = np.array([1 / L, 1 / L, 1.0, L, L])  # brings the rows of q to rad

SPIRAL = load_robot("2sra-v1-paper")
assert isinstance(SPIRAL.path, LogSpiralPath)
TABLE_1 = SPIRAL.path
KINKED = SPIRAL.with_values(path=TABLE_1.with_values(smoothing_rad=1e-9))
FIBRE_END = SPIRAL.with_values(path=ArcPath(model="arc", speed_reference="fibre_end"))
SIDE_WHEEL = SPIRAL.with_values(path=ArcPath(model="arc", speed_reference="side_wheel"))
ARCS = {"fibre_end": FIBRE_END, "side_wheel": SIDE_WHEEL}
ROBOTS = {"spiral": SPIRAL, **ARCS}

each_robot = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS.keys())
each_arc = pytest.mark.parametrize("robot", ARCS.values(), ids=ARCS.keys())
each_mode = pytest.mark.parametrize("mode", MODES, ids=mode_name)
each_soft_mode = pytest.mark.parametrize("mode", [SOFT_2, SOFT_1, SOFT_BOTH], ids=mode_name)
each_unit = pytest.mark.parametrize("unit", [0, 1], ids=["LU1", "LU2"])

for_some = settings(max_examples=12)


def between(bound: float) -> st.SearchStrategy[float]:
    """Draw numbers within +-bound."""
    return st.floats(-bound, bound, allow_subnormal=False)


def vectors(*bounds: float) -> st.SearchStrategy[Array]:
    """Draw vectors whose entries lie within +-bounds."""
    return st.tuples(*map(between, bounds)).map(np.array)


configurations = vectors(1.0, 1.0, math.pi, CURVATURE, CURVATURE)
bent_to_a_quarter = vectors(1.0, 1.0, math.pi, CURVATURE / 2, CURVATURE / 2)
velocities = vectors(0.03, 0.03, 0.1, 0.1, 1.0)  # m/s, rad/s; of an interval of 1 s: m, rad
speeds = between(0.03)  # m/s


def jacobian(robot: Robot, q: Array, mode: Mode) -> Array:
    """J(q, mode) of the package."""
    return np.asarray(kinematics(robot).jacobian(q, mode).full())


def followed(robot: Robot, q: Array, travel: Array, mode: Mode) -> Array:
    """Q after the input displacement ``travel``, by the package's flow."""
    return np.asarray(interval_flow(robot, FINE_STEPS)(q, travel, mode).full().ravel())


def unit_input(unit: int, amount: float) -> Array:
    """Input displacement or velocity of one locomotion unit alone."""
    return np.asarray(amount * np.eye(5)[unit])


# --- an independent geometry ----------------------------------------------------------------


@dataclass(frozen=True)
class Pose:
    """A frame in the plane: complex position [m] and angle [rad]."""

    position: complex
    angle: float

    def __matmul__(self, other: Pose) -> Pose:
        turned = np.exp(1j * self.angle) * other.position
        return Pose(complex(self.position + turned), self.angle + other.angle)

    def inverse(self) -> Pose:
        """Return the pose of the reference in this frame."""
        return Pose(complex(-np.exp(-1j * self.angle) * self.position), -self.angle)


def link_pose(q: Array) -> Pose:
    """Frame b0."""
    return Pose(complex(q[0], q[1]), float(q[2]))


def end_in_link(q: Array, unit: int) -> Pose:
    """Frame b1 (unit 0) or b2 (unit 1) in b0."""
    alpha = float(q[3 + unit] * L)
    chord = complex(L * np.sinc(alpha / 2 / np.pi) * np.exp(0.5j * alpha))
    if unit == 1:
        return Pose(LINK / 2 + chord, alpha)
    return Pose(-(LINK / 2 + chord).conjugate(), -alpha)


def unit_pose(q: Array, unit: int) -> Pose:
    """Frame b1 or b2 in the world."""
    return link_pose(q) @ end_in_link(q, unit)


def wheels_in_link(q: Array) -> list[Pose]:
    """Wheels in b0; the angle is the rolling direction (paper eqs. q_bC and psi)."""
    mounted = [
        Pose(-H1 + 0j, np.pi / 2),
        Pose(complex(-H2, H3), 0.0),
        Pose(H1 + 0j, -np.pi / 2),
        Pose(complex(H2, -H3), np.pi),
    ]
    return [end_in_link(q, wheel // 2) @ pose for wheel, pose in enumerate(mounted)]


def bent(q: Array, mode: Mode, moving: int, alpha: float) -> Array:
    """Bend every soft segment by ``alpha``; the unit that does not move is held in the world."""
    shape = np.array([0.0, 0.0, 0.0, *(q[3:] + alpha / L * np.array(mode))])
    link = unit_pose(q, 1 - moving) @ end_in_link(shape, 1 - moving).inverse()
    return np.array([link.position.real, link.position.imag, link.angle, *shape[3:]])


def reference_point(robot: Robot, unit: int) -> complex:
    """Point of a unit whose speed v is, in its end frame."""
    if robot is FIBRE_END:
        return 0j
    return complex((-1, 1)[unit] * H1)


def derivative(function: Callable[[float], Array], step: float = 1e-3) -> Array:
    """Derivative at 0 by central differences of fourth order."""
    near = function(step) - function(-step)
    far = function(2 * step) - function(-2 * step)
    return np.asarray((8 * near - far) / (12 * step))


# --- series functions -----------------------------------------------------------------------

CLOSED_FORMS: dict[str, tuple[Callable[[ca.SX], ca.SX], Callable[[Array], Array]]] = {
    "S": (sinc, lambda a: np.sin(a) / a),
    "C": (versine_ratio, lambda a: (1 - np.cos(a)) / a),
    "A": (sagitta_ratio, lambda a: (a - np.sin(a)) / a**2),
    "B": (versine_ratio_squared, lambda a: (1 - np.cos(a)) / a**2),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_series_are_their_closed_forms_up_to_a_full_turn(name: str) -> None:
    series, closed = CLOSED_FORMS[name]
    alpha = ca.SX.sym("alpha")
    angles = np.concatenate(
        [np.linspace(-2 * np.pi, -0.01, 400), np.linspace(0.01, 2 * np.pi, 400)]
    )
    values = ca.Function("f", [alpha], [series(alpha)])(angles.reshape(1, -1)).full().ravel()
    np.testing.assert_allclose(values, closed(angles), rtol=0.0, atol=2e-12)


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("S", (1.0, 0.0, -1 / 3)),
        ("C", (0.0, 1 / 2, 0.0)),
        ("A", (0.0, 1 / 6, 0.0)),
        ("B", (1 / 2, 0.0, -1 / 12)),
    ],
)
def test_series_have_the_exact_value_and_derivatives_at_zero(
    name: str, limits: tuple[float, float, float]
) -> None:
    alpha = ca.SX.sym("alpha")
    value = CLOSED_FORMS[name][0](alpha)
    slope = ca.gradient(value, alpha)
    bend = ca.gradient(slope, alpha)
    at_zero = [float(x) for x in ca.Function("f", [alpha], [value, slope, bend])(0.0)]
    np.testing.assert_allclose(at_zero, limits, rtol=0.0, atol=1e-16)


@pytest.mark.parametrize("angle", [-6.0, -2.0, -1e-3, -1e-9, 0.0, 1e-9, 1e-3, 2.0, 6.0])
def test_series_satisfy_their_identities_also_at_zero(angle: float) -> None:
    """(a S)' = cos a, (a C)' = sin a, a A = 1 - S and a B = C."""
    a = ca.SX.sym("a")
    defects = ca.vertcat(
        ca.gradient(a * sinc(a), a) - ca.cos(a),
        ca.gradient(a * versine_ratio(a), a) - ca.sin(a),
        a * sagitta_ratio(a) - (1 - sinc(a)),
        a * versine_ratio_squared(a) - versine_ratio(a),
    )
    values = ca.Function("defects", [a], [defects])(angle).full()
    np.testing.assert_allclose(values, 0.0, rtol=0.0, atol=2e-11)


# --- arc: the Jacobian is the geometry ------------------------------------------------------


def geometric_column(robot: Robot, q: Array, mode: Mode, unit: int) -> Array:
    """Rate of q per speed of one locomotion unit, from the geometry alone."""

    def state(alpha: float) -> Array:
        return bent(q, mode, unit, alpha)

    def place(alpha: float) -> Array:
        """Position of the unit's reference point in the unit's present end frame."""
        pose = unit_pose(state(alpha), unit) @ Pose(reference_point(robot, unit), 0.0)
        seen = (unit_pose(q, unit).inverse() @ pose).position
        return np.array([seen.real, seen.imag])

    along, across = derivative(place)
    speed = math.hypot(along, across) if robot is FIBRE_END else float(across)
    return derivative(state) / speed


@each_unit
@each_soft_mode
@each_arc
@given(q=configurations)
def test_arc_columns_are_the_finite_differences_of_the_geometry(
    robot: Robot, mode: Mode, unit: int, q: Array
) -> None:
    expected = SCALE * geometric_column(robot, q, mode, unit)
    column = SCALE * jacobian(robot, q, mode)[:, unit]
    assert np.linalg.norm(column - expected) <= 1e-6 * np.linalg.norm(expected)


@each_robot
@given(q=configurations)
def test_rigid_columns_move_the_link_along_its_own_axes(robot: Robot, q: Array) -> None:
    def moved(twist: complex, turn: float, share: float) -> Array:
        pose = link_pose(q) @ Pose(share * twist, share * turn)
        return np.array([pose.position.real, pose.position.imag, pose.angle, q[3], q[4]])

    columns = jacobian(robot, q, RIGID)[:, 2:]
    motions = [(1 + 0j, 0.0), (1j, 0.0), (0j, 1.0)]
    for column, (twist, turn) in zip(columns.T, motions, strict=True):
        expected = derivative(partial(moved, twist, turn))
        np.testing.assert_allclose(column, expected, rtol=0.0, atol=1e-9)


# --- arc: along the flow --------------------------------------------------------------------


@each_unit
@each_soft_mode
@each_arc
@given(q=bent_to_a_quarter, travel=speeds)
@for_some
def test_the_unit_that_is_not_driven_stays_where_it_is(
    robot: Robot, mode: Mode, unit: int, q: Array, travel: float
) -> None:
    end = followed(robot, q, unit_input(unit, travel), mode)
    before, after = unit_pose(q, 1 - unit), unit_pose(end, 1 - unit)
    assert abs(after.position - before.position) <= 1e-9
    assert abs(after.angle - before.angle) <= 1e-9


# --- every path model -----------------------------------------------------------------------


@each_robot
@given(q=configurations)
def test_the_link_turns_by_the_bend_of_the_segment_whose_end_is_held(
    robot: Robot, q: Array
) -> None:
    for mode in (SOFT_2, SOFT_1, SOFT_BOTH):
        matrix = jacobian(robot, q, mode)
        turn_by_1 = -L * matrix[4, 0] if mode[1] else 0.0  # LU1 moves, b2 is held
        turn_by_2 = L * matrix[3, 1] if mode[0] else 0.0
        np.testing.assert_allclose(matrix[2, :2], [turn_by_1, turn_by_2], rtol=1e-14)


@each_robot
@given(q=configurations)
def test_a_unit_next_to_the_only_soft_segment_does_not_move_the_link(
    robot: Robot, q: Array
) -> None:
    assert not np.any(jacobian(robot, q, SOFT_2)[:4, 1])
    assert not np.any(jacobian(robot, q, SOFT_1)[[0, 1, 2, 4], 0])


@each_robot
@given(q=configurations)
def test_positive_speeds_raise_the_curvatures_of_soft_segments_only(robot: Robot, q: Array) -> None:
    for mode in MODES:
        bend = jacobian(robot, q, mode)[3:, :2]
        assert np.all(np.sign(bend) == np.array(mode)[:, None])


@each_robot
@given(q=configurations, travel=velocities)
@for_some
def test_rigid_segments_keep_their_curvature_to_the_last_bit(
    robot: Robot, q: Array, travel: Array
) -> None:
    for mode in MODES:
        end = followed(robot, q, travel, mode)
        for segment in (0, 1):
            if not mode[segment]:
                assert end[3 + segment] == q[3 + segment]


@each_robot
@given(q=configurations, travel=velocities)
@for_some
def test_the_rigid_mode_is_a_motion_of_the_plane(robot: Robot, q: Array, travel: Array) -> None:
    """With constant u, v, r it is the screw about one point: p = (e^{ir} - 1) / (ir) (u + iv)."""
    _, _, u, v, r = travel
    screw = Pose(complex(u, v) * np.sinc(r / 2 / np.pi) * np.exp(0.5j * r), r)
    expected = link_pose(q) @ screw
    end = link_pose(followed(robot, q, travel, RIGID))
    assert abs(end.position - expected.position) <= 1e-8
    assert abs(end.angle - expected.angle) <= 1e-12


@each_robot
@given(q=bent_to_a_quarter, travel=velocities)
@for_some
def test_the_kinematics_is_the_same_from_every_pose(robot: Robot, q: Array, travel: Array) -> None:
    origin = np.array([0.0, 0.0, 0.0, q[3], q[4]])
    for mode in MODES:
        moved = link_pose(q) @ link_pose(followed(robot, origin, travel, mode))
        end = followed(robot, q, travel, mode)
        assert abs(link_pose(end).position - moved.position) <= 1e-12
        assert abs(end[2] - moved.angle) <= 1e-12


@each_robot
@given(q=configurations)
def test_mirroring_the_robot_exchanges_its_segments(robot: Robot, q: Array) -> None:
    """Reflect in the world's y axis: x, phi and the two sides change, y and kappa do not."""
    reflect = np.array([-1.0, 1.0, -1.0, 1.0, 1.0])
    swap, swap_inputs = [0, 1, 2, 4, 3], [1, 0, 2, 3, 4]
    input_sign = np.array([1.0, 1.0, -1.0, 1.0, -1.0])
    for s1, s2 in MODES:
        mirrored = jacobian(robot, (reflect * q)[swap], (s2, s1))
        expected = reflect[:, None] * jacobian(robot, q, (s1, s2)) * input_sign
        np.testing.assert_allclose(
            SCALE[:, None] * mirrored,
            SCALE[:, None] * expected[swap][:, swap_inputs],
            rtol=0.0,
            atol=1e-11,
        )


# --- the mode as an argument ----------------------------------------------------------------


@lru_cache(maxsize=16)
def jacobian_of_one_mode(robot: Robot, mode: Mode) -> ca.Function:
    """Kappa -> J at phi = 0, written down for this mode alone."""
    kappa, sigma = ca.SX.sym("kappa", 2), ca.SX(np.array(mode, dtype=float))
    found = hybrid_jacobian(robot.geometry, path_model(robot), kappa, sigma)
    return ca.Function("J", [kappa], [found])


@each_mode
@each_robot
@given(q=configurations)
@for_some
def test_one_matrix_for_all_modes_is_the_matrix_of_each_mode(
    robot: Robot, mode: Mode, q: Array
) -> None:
    alone, q = jacobian_of_one_mode(robot, mode)(q[3:]).full(), np.append([0.0, 0.0, 0.0], q[3:])
    np.testing.assert_allclose(jacobian(robot, q, mode), alone, rtol=1e-12)


@each_mode
@each_robot
@given(q=configurations)
@for_some
def test_a_mode_ignores_the_inputs_it_does_not_have(robot: Robot, mode: Mode, q: Array) -> None:
    matrix = jacobian(robot, q, mode)
    wheels = kinematics(robot).wheel_matrix(q, mode).full()
    own, other = (slice(2, 5), slice(0, 2)) if mode == RIGID else (slice(0, 2), slice(2, 5))
    assert not np.any(matrix[:, other])
    assert not np.any(wheels[:, other])
    assert np.linalg.matrix_rank(SCALE[:, None] * matrix[:, own]) == (3 if mode == RIGID else 2)


# --- spiral ---------------------------------------------------------------------------------


def bend_rates(robot: Robot, alpha: float) -> Array:
    """K of the paths I, II (rigid segment straight) and III (equal curvatures) [1/m^2]."""
    straight = np.array([0.0, 0.0, 0.0, 0.0, alpha / L])
    equal = np.array([0.0, 0.0, 0.0, alpha / L, alpha / L])
    one, both = jacobian(robot, straight, SOFT_2), jacobian(robot, equal, SOFT_BOTH)
    return np.array([one[4, 1], one[4, 0], both[4, 0]])


def test_bend_rates_of_the_straight_robot() -> None:
    exact = [2 / L**2, 1 / (L * (1.5 * L + LINK)), 1 / (L * (2 * L + LINK))]
    np.testing.assert_allclose(exact, [1250.0, 277.8, 227.3], rtol=2e-4)
    np.testing.assert_allclose(bend_rates(FIBRE_END, 0.0), exact, rtol=1e-14)
    ratios = np.array([0.872, 0.884, 1.698])
    np.testing.assert_allclose(bend_rates(SPIRAL, 0.0) / exact, ratios, rtol=0.0, atol=5e-4)
    np.testing.assert_allclose(bend_rates(SIDE_WHEEL, 0.0), [244.0, 145.0, 91.0], atol=0.5)


@pytest.mark.parametrize(
    ("alpha", "ratios"),
    [
        (0.5, (0.962, 0.918, 1.925)),
        (1.0, (1.047, 0.946, 2.083)),
        (np.pi / 2, (1.134, 0.970, 2.146)),
    ],
)
def test_bend_rates_of_the_spirals_against_the_exact_ones(
    alpha: float, ratios: tuple[float, float, float]
) -> None:
    found = bend_rates(KINKED, alpha) / bend_rates(FIBRE_END, alpha)
    np.testing.assert_allclose(found, ratios, rtol=0.0, atol=5.1e-4)


@given(q=configurations)
def test_spiral_bend_rates_are_even_in_curvature(q: Array) -> None:
    opposite = np.array([q[0], q[1], q[2], -q[3], -q[4]])
    for mode in MODES:
        here, there = jacobian(SPIRAL, q, mode), jacobian(SPIRAL, opposite, mode)
        np.testing.assert_array_equal(here[2:], there[2:])


@lru_cache(maxsize=2)
def spiral_rates(robot: Robot) -> Callable[[float], Array]:
    """K_I, K_II, K_III and d(x, y)/d kappa at equal bends, with first and second derivatives.

    The derivatives, by AD, are with respect to the bending angle; shape (3, 5).
    """
    alpha = ca.SX.sym("alpha")
    q = ca.vertcat(0, 0, 0, alpha / L, alpha / L)
    one, both = kinematics(robot).jacobian(q, SOFT_2), kinematics(robot).jacobian(q, SOFT_BOTH)
    values = ca.vertcat(one[4, 1], one[4, 0], both[4, 0], one[:2, 0] / one[4, 0])
    slopes = ca.jacobian(values, alpha)
    bends = ca.jacobian(slopes, alpha)
    function = ca.Function("rates", [alpha], [ca.horzcat(values, slopes, bends)])

    def evaluate(at: float) -> Array:
        return np.asarray(function(at).full().T)

    return evaluate


@given(alpha=between(0.1))
def test_spiral_derivatives_are_finite_differences_near_zero(alpha: float) -> None:
    rates = spiral_rates(SPIRAL)
    step = 1e-4  # smoothing is over 1e-2 rad
    found = rates(alpha)
    assert np.all(np.isfinite(found))
    differences = derivative(lambda h: rates(alpha + h), step)
    for order in (1, 2):
        size = np.abs(found[order]).max()
        np.testing.assert_allclose(
            found[order], differences[order - 1], rtol=1e-5, atol=1e-7 * size
        )


def test_the_smoothed_spiral_has_no_kink_at_zero() -> None:
    rates = spiral_rates(SPIRAL)
    at_zero = rates(0.0)
    assert np.all(np.isfinite(at_zero))
    np.testing.assert_array_equal(at_zero[1, :3], 0.0)
    for near in (1e-5, 1e-6, 1e-7):
        for side in (-near, near):  # third derivatives are of order 1 / eps^2 or less
            jump = rates(side) - at_zero
            assert np.all(np.abs(jump) <= near * 1e4 * np.abs(at_zero).max(axis=0))


def test_the_unsmoothed_spiral_would_have_a_kink_of_a_fifth_per_radian() -> None:
    rates = spiral_rates(KINKED)
    right, left = rates(1e-6), rates(-1e-6)
    np.testing.assert_allclose(
        (right[1] / right[0] - left[1] / left[0])[:3] / 2,
        np.array(TABLE_1.growth) / np.array(TABLE_1.angle_ratio),
        rtol=1e-3,
    )


@given(alpha=between(math.pi))
def test_smoothing_changes_rates_by_less_than_a_third_of_a_percent(alpha: float) -> None:
    """The angle is at most eps short, so that spiral k is off by at most exp(b eps / m) - 1."""
    smooth, kinked = spiral_rates(SPIRAL)(alpha)[0], spiral_rates(KINKED)(alpha)[0]
    growth, ratio = np.array(TABLE_1.growth), np.array(TABLE_1.angle_ratio)
    short = kinked[:3] / smooth[:3] - 1
    assert np.all(short >= -1e-12)
    assert np.all(short <= np.expm1(growth / ratio * TABLE_1.smoothing_rad) + 1e-9)
    assert np.all(np.abs(short) <= [0.0022, 0.0009, 0.0030])


@each_soft_mode
@given(q=configurations)
def test_the_spiral_jacobian_is_the_published_one_started_here(mode: Mode, q: Array) -> None:
    published = SCALE[:, None] * published_jacobian(q, q, mode)
    found = SCALE[:, None] * jacobian(KINKED, q, mode)
    for column, expected in zip(found.T, published.T, strict=True):
        assert np.linalg.norm(column - expected) <= 0.005 * np.linalg.norm(expected)


# --- wheels ---------------------------------------------------------------------------------


@given(q=configurations)
def test_wheels_are_where_the_geometry_puts_them(q: Array) -> None:
    poses = kinematics(SPIRAL).wheel_poses(q).full()
    expected = wheels_in_link(q)
    np.testing.assert_allclose(poses[0], [w.position.real for w in expected], atol=1e-13)
    np.testing.assert_allclose(poses[1], [w.position.imag for w in expected], atol=1e-13)
    np.testing.assert_allclose(poses[2], [w.angle for w in expected], atol=1e-13)


def rolling_speeds(q: Array, rate: Array) -> Array:
    """How fast each wheel must roll when q changes at ``rate`` and no wheel slips along its way."""

    def contacts(t: float) -> Array:
        at = q + t * rate
        points = [(link_pose(at) @ wheel).position for wheel in wheels_in_link(at)]
        return np.array([[p.real, p.imag] for p in points])

    directions = np.array([q[2] + wheel.angle for wheel in wheels_in_link(q)])
    rolling = np.column_stack([np.cos(directions), np.sin(directions)])
    return np.asarray(np.sum(derivative(contacts) * rolling, axis=1) / WHEEL)


@pytest.mark.parametrize(
    ("robot", "mode"), [*itertools.product(ARCS.values(), MODES), (SPIRAL, RIGID)]
)
@given(q=configurations, velocity=velocities)
@for_some
def test_no_wheel_slips_in_rigid_motion_and_in_any_mode_of_exact_arcs(
    robot: Robot, mode: Mode, q: Array, velocity: Array
) -> None:
    found = kinematics(robot).wheel_matrix(q, mode).full() @ velocity
    expected = rolling_speeds(q, jacobian(robot, q, mode) @ velocity)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)


@each_soft_mode
@given(q=configurations, velocity=velocities)
@for_some
def test_soft_spiral_modes_drive_only_the_side_wheels(
    mode: Mode, q: Array, velocity: Array
) -> None:
    """Paper eq. wheel_drive."""
    found = kinematics(SPIRAL).wheel_matrix(q, mode).full() @ velocity
    expected = np.array([velocity[0], 0.0, -velocity[1], 0.0]) / WHEEL
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@each_robot
@given(q=configurations, velocity=velocities)
@for_some
def test_wheel_travel_is_the_wheel_matrix_times_the_displacement(
    robot: Robot, q: Array, velocity: Array
) -> None:
    for mode in MODES:
        expected = kinematics(robot).wheel_matrix(q, mode).full() @ velocity
        found = wheel_travel(robot)(q, velocity, mode).full().ravel()
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


# --- roll-out -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "end", "tolerance"),
    [
        (-27.0, 30.0, 1e-8),  # published simulation 2
        (-77.5, 77.5, DEFECT_TOLERANCE / 10),  # from limit to limit
    ],
)
@pytest.mark.parametrize(
    ("mode", "unit"), [(SOFT_2, 1), (SOFT_2, 0), (SOFT_BOTH, 0)], ids=["I", "II", "III"]
)
@each_robot
def test_ten_fine_intervals_bend_far_more_exactly_than_plans_are_verified(
    robot: Robot, mode: Mode, unit: int, start: float, end: float, tolerance: float
) -> None:
    def shape(kappa: float) -> Array:
        return np.array([0.0, 0.0, 0.0, kappa if mode[0] else start, kappa])

    def path_per_curvature(kappa: float) -> float:
        return float(1 / jacobian(robot, shape(kappa), mode)[4, unit])

    path, _ = quad(path_per_curvature, start, end, points=[0.0], epsabs=1e-9)
    inputs = np.tile(unit_input(unit, path / 10), (1, 10, 1))

    def rate(_: float, q: Array) -> Array:
        return np.asarray(jacobian(robot, q, mode) @ inputs[0, 0])

    q, nodes = shape(start), [shape(start)]
    for _ in range(10):
        piece = solve_ivp(rate, (0.0, 1.0), q, method=DOP853, rtol=1e-12, atol=1e-13, max_step=0.2)
        q = piece.y[:, -1]
        nodes.append(q)
    assert q[4] == pytest.approx(end, abs=1e-6)
    states = roll_out(robot, shape(start), (mode,), inputs).states[0]
    np.testing.assert_allclose(states, nodes, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("mode", MODES)
def test_wheel_speeds_give_the_inputs_back(mode: Mode) -> None:
    """By a least-squares solver of its own; inputs that the mode has not are 0."""
    rng, known = np.random.default_rng(3), kinematics(load_robot("2sra-v1"))
    q = np.array([0.1, 0.2, 0.3, 20.0, -35.0])
    v = np.zeros(5)
    used = slice(2, 5) if mode == (0, 0) else slice(0, 2)
    v[used] = rng.normal(size=v[used].shape)
    matrix = known.wheel_matrix(q, mode).full()
    np.testing.assert_allclose(known.inputs(q, mode, matrix @ v), v, atol=1e-9)
    slipping = rng.normal(size=4)
    best = np.linalg.lstsq(matrix, slipping, rcond=None)[0]
    np.testing.assert_allclose(known.inputs(q, mode, slipping), best, atol=1e-9)
