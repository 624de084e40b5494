"""Robots of one to four segments of any length: the geometry, written by hand a second time."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from twosra_mpc import InputError, Robot, load_robot
from twosra_mpc.model.bending import bending
from twosra_mpc.model.chain import fibre_end_pose
from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import kinematics, wheel_travel
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.solver.guess import bent
from twosra_mpc.robot.modes import Mode, all_modes, is_rigid, mode_name, rigid_mode, soft_segments

Array = NDArray[np.float64]

ARC = load_robot("2sra-v1")


def robot_of(lengths: tuple[float, ...], **path: str) -> Robot:
    """The arc robot with these segments."""
    document: dict[str, Any] = ARC.model_dump()
    document["geometry"] |= {"segments": len(lengths), "segment_length_m": lengths}
    document["path"] |= path
    document["limits"]["curvature_per_m"] = 60.0
    return Robot(**document)


ROBOTS = [
    robot_of(lengths, speed_reference=reference)
    for lengths in ((0.05,), (0.04, 0.04), (0.03, 0.05), (0.03, 0.04, 0.05), (0.04,) * 4)
    for reference in ("fibre_end", "side_wheel")
]
NAMES = [f"{r.geometry.lengths_m}-{r.path.model_dump()['speed_reference']}" for r in ROBOTS]


def frame(x: float, y: float, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])


def chain(robot: Robot, kappa: Array) -> tuple[Array, Array]:
    """Frames of the fibre ends (LU1's, LU2's) seen from b0, link by link and arc by arc."""
    geometry, inner = robot.geometry, robot.coordinates.segments // 2
    right = np.eye(3)
    for j in range(inner, len(kappa)):
        straight = geometry.middle_link_m * (1 if j > inner else 0.5 if inner else 0)
        right = right @ frame(straight, 0, 0) @ arc(kappa[j], geometry.lengths_m[j])
    return mirrored(robot, kappa), right


def mirrored(robot: Robot, kappa: Array) -> Array:
    """The left half is the mirror image of a right half bent the same way."""
    geometry, inner = robot.geometry, robot.coordinates.segments // 2
    pose = np.eye(3)
    for j in range(inner - 1, -1, -1):
        straight = geometry.middle_link_m if j < inner - 1 else geometry.middle_link_m / 2
        pose = pose @ frame(straight, 0, 0) @ arc(kappa[j], geometry.lengths_m[j])
    angle = np.arctan2(pose[1, 0], pose[0, 0])
    return frame(-pose[0, 2], pose[1, 2], -angle)


def arc(kappa: float, length: float) -> Array:
    if abs(kappa) < 1e-9:
        return frame(length, kappa * length**2 / 2, kappa * length)
    turn = kappa * length
    return frame(np.sin(turn) / kappa, (1 - np.cos(turn)) / kappa, turn)


def world(robot: Robot, q: Array) -> tuple[Array, Array]:
    here = frame(*q[:3])
    first, second = chain(robot, q[3:])
    return here @ first, here @ second


def shapes(robot: Robot, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    q: Array = rng.uniform(-1, 1, robot.coordinates.size) * robot.coordinates.each(1, 3, 55)
    return q


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_fibre_ends_are_where_the_chain_of_links_and_arcs_ends(robot: Robot, seed: int) -> None:
    q = shapes(robot, seed)
    symbol = ca.SX.sym("q", len(q))
    for unit, expected in enumerate(chain(robot, q[3:])):
        end = fibre_end_pose(robot.geometry, symbol, unit)
        x, y, angle = ca.Function("end", [symbol], [end])(q).full().ravel()
        assert frame(x, y, angle) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
@pytest.mark.parametrize("unit", [0, 1])
def test_a_moving_unit_bends_all_soft_segments_alike_and_the_other_unit_holds(
    robot: Robot, unit: int
) -> None:
    q, h = shapes(robot, 7), 1e-6
    for mode in robot.modes:
        if is_rigid(mode):
            continue
        rate = kinematics(robot).jacobian(q, mode).full()[:, unit]
        bent = rate[3:]
        assert bent == pytest.approx(np.array(mode) * bent.max(), rel=1e-12)
        assert bent.max() > 0
        before, after = world(robot, q - h * rate), world(robot, q + h * rate)
        held = (after[1 - unit] - before[1 - unit]) / (2 * h)
        assert np.abs(held).max() < 1e-7
        moved = (after[unit] - before[unit]) / (2 * h)
        here = world(robot, q)[unit]
        speed = reference_speed(robot, here, moved, unit)
        assert speed == pytest.approx(1.0, rel=1e-6)


def reference_speed(robot: Robot, here: Array, moved: Array, unit: int) -> float:
    """What v measures: speed of the fibre end, or how far the side wheel rolls."""
    if robot.path.model_dump()["speed_reference"] == "fibre_end":
        return float(np.hypot(*moved[:2, 2]))
    x, y, beta = robot.geometry.wheel_placement[2 * unit]
    velocity = np.linalg.inv(here) @ moved @ np.array([x, y, 1.0])
    rolled = float(velocity[0] * np.cos(beta) + velocity[1] * np.sin(beta))
    return rolled * (1, -1)[unit]


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
@pytest.mark.parametrize("seed", range(2))
def test_wheels_roll_as_far_as_their_points_travel(robot: Robot, seed: int) -> None:
    """V s against finite differences of where every wheel is, in every mode."""
    q, h, rng = shapes(robot, seed), 1e-6, np.random.default_rng(seed)
    for mode in robot.modes:
        s = rng.uniform(-0.01, 0.01, 5)
        s[2:] *= is_rigid(mode)
        s[:2] *= not is_rigid(mode)
        rate = kinematics(robot).jacobian(q, mode).full() @ s
        turned = wheel_travel(robot)(q, s, mode).full().ravel()
        before, after = world(robot, q - h * rate), world(robot, q + h * rate)
        for wheel, (x, y, beta) in enumerate(robot.geometry.wheel_placement):
            unit = wheel // 2
            velocity = (after[unit] - before[unit]) / (2 * h) @ np.array([x, y, 1.0])
            heading = world(robot, q)[unit][:2, :2] @ np.array([np.cos(beta), np.sin(beta)])
            rolled = velocity[:2] @ heading / robot.geometry.wheel_radius_m
            assert turned[wheel] == pytest.approx(rolled, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
def test_rigid_driving_changes_the_pose_alone(robot: Robot) -> None:
    q = shapes(robot, 3)
    jacobian = kinematics(robot).jacobian(q, robot.rigid).full()
    c, s = np.cos(q[2]), np.sin(q[2])
    expected = np.zeros((len(q), 5))
    expected[:3, 2:] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    assert jacobian == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
def test_bending_coordinates_of_soft_segments_change_alike(robot: Robot) -> None:
    facts, q, bend = bending(robot), shapes(robot, 5) / 3, 0.2
    for mode in robot.modes[1:]:
        nodes, travel = bent(robot, q, mode, bend, 1)
        before, after = (facts.coordinates(at[3:]) for at in nodes)
        assert np.subtract(after, before) == pytest.approx(bend * np.array(mode), abs=1e-8)
        end = interval_flow(robot, 64)(q, [*travel[0], 0, 0, 0], mode).full().ravel()
        assert end[3:] == pytest.approx(nodes[1, 3:], abs=2e-2)
        assert facts.curvatures(after) == pytest.approx(nodes[1, 3:], abs=1e-7)


@pytest.mark.parametrize("robot", ROBOTS[::2], ids=NAMES[::2])
@settings(max_examples=15)
@given(data=st.data())
def test_no_bend_is_faster_than_its_proved_rate(robot: Robot, data: st.DataObject) -> None:
    limit, n = robot.limits.curvature_per_m, robot.coordinates.segments
    kappa = np.array([data.draw(st.floats(-limit, limit)) for _ in range(n)])
    mode = data.draw(st.sampled_from(robot.modes[1:]))
    known = tuple(
        None if soft else (float(k), float(k)) for soft, k in zip(mode, kappa, strict=True)
    )
    soft = soft_segments(mode)[0]
    v = np.array([1.0, 1.0, 0, 0, 0]) * robot.limits.unit_speed_m_s
    q = np.concatenate([np.zeros(3), kappa])
    columns = kinematics(robot).jacobian(q, mode).full()[3 + soft] * v
    per_w = robot.geometry.lengths_m[0]
    assert np.abs(columns).sum() * per_w <= bending(robot).fastest(mode, known) * (1 + 1e-9)


def test_overridden_wheels_measure_the_speed_themselves() -> None:
    """A side wheel at half the distance rolls less for the same bend: v_j is what it rolls."""
    document: dict[str, Any] = ARC.model_dump()
    placed = [list(wheel) for wheel in ARC.geometry.wheel_placement]
    placed[0][0], placed[2][0] = -0.0325, 0.0325
    wheels = [dict(zip(("x_m", "y_m", "angle_rad"), wheel, strict=True)) for wheel in placed]
    document["geometry"]["wheels"] = wheels
    robot = Robot(**document)
    q = np.array([0, 0, 0, 12.0, -20.0])
    for mode in robot.modes[1:]:
        for unit, s in enumerate(np.eye(5)[:2]):
            rolled = wheel_travel(robot)(q, s, mode).full()[2 * unit, 0]
            expected = (1, -1)[unit] / robot.geometry.wheel_radius_m
            assert rolled == pytest.approx(expected, rel=1e-12)


def test_a_wheel_that_does_not_roll_cannot_measure_a_speed() -> None:
    document: dict[str, Any] = ARC.model_dump()
    placed = [list(wheel) for wheel in ARC.geometry.wheel_placement]
    placed[2][2] = 0.0  # along the fibre
    wheels = [dict(zip(("x_m", "y_m", "angle_rad"), wheel, strict=True)) for wheel in placed]
    document["geometry"]["wheels"] = wheels
    with pytest.raises(InputError, match=r"geometry\.wheels\.2 .*rolls when the unit bends"):
        kinematics(Robot(**document))


# Compiled functions are kept by what they depend on.


def test_robots_that_move_alike_share_compiled_functions() -> None:
    document = ARC.model_dump()
    heater = {**document["heater"], "melt_current_A": 0.7}
    other = Robot(**{**document, "name": "another", "description": "told apart", "heater": heater})
    assert kinematics(other) is kinematics(ARC)
    assert interval_flow(other, 8) is interval_flow(ARC, 8)
    longer = {**document["geometry"], "middle_link_m": 0.031}
    assert kinematics(Robot(**{**document, "geometry": longer})) is not kinematics(ARC)
    limits = {**document["limits"], "curvature_per_m": 50.0}
    narrower = Robot(**{**document, "limits": limits})
    assert bending(narrower).fastest((1, 1), (None, None)) <= bending(ARC).fastest(
        (1, 1), (None, None)
    )


# What a robot file may say of its segments.


def test_segments_may_be_counted_or_listed() -> None:
    document = ARC.model_dump()
    del document["geometry"]["segments"], document["segments"]
    three = Robot(**document, segments=3)
    assert three.geometry.lengths_m == (0.04, 0.04, 0.04)
    assert three.modes == all_modes(3)
    thermal = document.pop("segment")
    geometry = {k: v for k, v in document["geometry"].items() if k != "segment_length_m"}
    listed = [{"length_m": 0.03, **thermal}, {"length_m": 0.05, **thermal}]
    two = Robot(**{**document, "geometry": geometry, "segment": listed})
    assert two.geometry.lengths_m == (0.03, 0.05)
    assert two.thermal_segment(1) == ARC.segment
    bare = [{"length_m": 0.03}, {"length_m": 0.05}]
    timing = {"constant": document["timing"]["constant"]}
    plain = Robot(**{**document, "geometry": geometry, "segment": bare, "timing": timing})
    with pytest.raises(InputError, match="a thermal description in robot"):
        plain.thermal_segment(0)
    for robot in (three, two, plain):
        assert Robot(**robot.model_dump(mode="json")) == robot


@pytest.mark.parametrize(
    ("changes", "field", "allowed"),
    [
        ({"segments": 5}, "geometry.segments", "less than or equal to 4"),
        ({"segments": 0}, "geometry.segments", "greater than or equal to 1"),
        ({"segment": [{"length_m": 0.04}]}, "geometry.segment_length_m", "own length_m"),
        ({"segments": 3, "path": {"model": "log_spiral"}}, "path", "key is required"),
    ],
)
def test_wrong_segments_are_named(changes: dict[str, object], field: str, allowed: str) -> None:
    document = ARC.model_dump()
    del document["segments"]
    del document["geometry"]["segments"]
    with pytest.raises(InputError) as caught:
        Robot(**{**document, **changes})
    assert caught.value.field.startswith(field)
    assert allowed in caught.value.allowed


def test_fitted_curves_know_two_equal_segments_only() -> None:
    document = load_robot("2sra-v1-paper").model_dump()
    for geometry in ({"segments": 3}, {"segment_length_m": [0.03, 0.05]}):
        changed = {**document, "geometry": {**document["geometry"], **geometry}}
        with pytest.raises(InputError, match=r"path\.model = 'log_spiral'.*two of equal length"):
            Robot(**changed)


def test_modes_of_any_number_of_segments() -> None:
    assert all_modes(1) == ((0,), (1,))
    assert len(set(all_modes(4))) == 16
    assert rigid_mode(3) == (0, 0, 0)
    assert mode_name((1, 0, 1)) == "[1,0,1]"
    mode: Mode = (0, 1, 1)
    assert soft_segments(mode) == (1, 2)


def test_what_bending_together_keeps_is_a_difference_of_curvatures_whatever_the_lengths() -> None:
    robot = robot_of((0.03, 0.05))
    name, unit, factor = path_model(robot).conserved
    w1, w2 = bending(robot).coordinates((12.0, 5.0))
    assert (name.format(1, 2), unit) == ("kappa1 - kappa2", "1/m")
    assert factor * (w1 - w2) == pytest.approx(7.0)
