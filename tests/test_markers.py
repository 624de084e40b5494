"""Markers: the configuration that explains them, how sure it is, and where a drive shows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twosra_mpc import InputError, load_robot
from twosra_mpc.lab.serial.markers import (
    Marker,
    Markers,
    calibrated_markers,
    configuration_by_markers,
    load_markers,
    marker_poses,
)
from twosra_mpc.lab.serial.pose_lines import PoseLines
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.model.rolling import rolled
from twosra_mpc.robot.coordinates import Array, wrapped

ROBOT, OF_THREE = load_robot("2sra-v1"), load_robot("3sra")
ON_UNITS = (
    Marker(link="unit 1", x_m=-0.03, y_m=0.01, phi_rad=1.0),
    Marker(link="unit 2", x_m=0.02, y_m=-0.005, phi_rad=-2.5),
)
FRAME = (0.4, -0.2, 2.0)
PAIR = Markers(marker=ON_UNITS, frame=FRAME)
THREE = Markers(marker=(*ON_UNITS, Marker(link="middle link", y_m=0.01)), frame=FRAME)
NOISE = np.array([PAIR.noise_m, PAIR.noise_m, PAIR.noise_rad])


def shape(seed: int, segments: int) -> Array:
    """A configuration of a robot, anywhere, bent by up to its limit."""
    random = np.random.default_rng(seed)
    most = ROBOT.limits.curvature_per_m
    place = [*random.uniform(-1, 1, 2), random.uniform(-3, 3)]
    return np.append(place, random.uniform(-most, most, segments))


def apart(found: Array, q: Array) -> Array:
    off = found - q
    off[..., 2] = wrapped(off[..., 2])
    return off


@given(seed=st.integers(0, 2**32 - 1), robot_of_three=st.booleans())
def test_the_configuration_behind_the_poses_is_found_from_nothing(
    seed: int, robot_of_three: bool
) -> None:
    robot, markers = (OF_THREE, THREE) if robot_of_three else (ROBOT, PAIR)
    q = shape(seed, robot.coordinates.segments)
    seen = configuration_by_markers(robot, markers, marker_poses(robot, markers, q))
    np.testing.assert_allclose(apart(seen.q, q), 0.0, atol=1e-4)
    assert seen.residual_m < 1e-6
    assert seen.residual_rad < 1e-6


def test_errors_are_as_large_as_their_covariance_says() -> None:
    random, squares = np.random.default_rng(1), []
    for seed in range(200):
        q = shape(seed, 2)
        told = marker_poses(ROBOT, PAIR, q) + NOISE * random.normal(size=(2, 3))
        seen = configuration_by_markers(ROBOT, PAIR, told, near=q)
        off = apart(seen.q, q)
        squares.append(off @ np.linalg.solve(seen.covariance, off))
    assert np.mean(squares) == pytest.approx(5.0, abs=4 * np.sqrt(2 * 5 / 200))  # of chi-square


def test_a_marker_in_the_middle_of_a_unit_is_between_its_wheels() -> None:
    out_m, aside_m = ROBOT.geometry.unit_middle_m
    middles = Markers(
        marker=(
            Marker(link="unit 1", x_m=-out_m, y_m=aside_m),
            Marker(link="unit 2", x_m=out_m, y_m=aside_m),
        )
    )
    q = np.array([0.0, 0.0, 0.0, 30.0, -12.0])
    seen = marker_poses(ROBOT, middles, q)
    shape = robot_shape(ROBOT.geometry, q)
    np.testing.assert_allclose(seen[:, :2], shape.centres, atol=1e-12)


def test_one_marker_or_both_on_one_unit_do_not_tell_the_shape() -> None:
    poses = marker_poses(ROBOT, PAIR, shape(3, 2))
    with pytest.raises(InputError, match=r"seen on: unit 2.*markers on links enough to tell 5"):
        configuration_by_markers(ROBOT, PAIR, np.where([[True], [False]], np.nan, poses))
    same = Markers(marker=(ON_UNITS[0], ON_UNITS[0]))
    with pytest.raises(InputError, match="markers on links enough"):
        configuration_by_markers(ROBOT, same, marker_poses(ROBOT, same, shape(3, 2)))


def test_the_third_marker_may_be_hidden_but_none_of_a_unit() -> None:
    q = shape(4, 2)
    poses = marker_poses(ROBOT, THREE, q)
    poses[2] = np.nan
    seen = configuration_by_markers(ROBOT, THREE, poses, near=q)
    np.testing.assert_allclose(apart(seen.q, q), 0.0, atol=1e-6)
    poses = marker_poses(ROBOT, THREE, q)
    poses[0] = np.nan
    with pytest.raises(InputError, match="seen on: unit 2, middle link"):
        configuration_by_markers(ROBOT, THREE, poses, near=q)


def drive() -> Array:
    """A turn and a way along of the straight robot, (61, 5)."""
    straight, matrix = np.zeros(5), kinematics(ROBOT).wheel_matrix(np.zeros(5), (0, 0)).full()
    turn, along = matrix @ (0, 0, 0.02, 0, 1.0), matrix @ (0, 0, 0.03, 0.02, 0)
    return rolled(ROBOT.body, (0, 0), straight, 0.1 * np.repeat([turn, along], 30, axis=0))


def test_a_short_drive_shows_where_the_markers_are() -> None:
    q, random = drive(), np.random.default_rng(2)
    poses = np.array([marker_poses(ROBOT, PAIR, each) for each in q])
    poses += NOISE * random.normal(size=poses.shape)
    guess = Markers(marker=(Marker(link="unit 1"), Marker(link="unit 2")))
    found = calibrated_markers(ROBOT, guess, q, poses)
    offsets = [[(m.x_m, m.y_m, m.phi_rad) for m in each.marker] for each in (found.markers, PAIR)]
    off = np.subtract(*offsets)
    assert (np.abs(off) < 4 * found.deviation).all()
    assert (found.deviation < [5e-4, 5e-4, 5e-3]).all()
    assert found.residual == pytest.approx(1.0, abs=0.15)
    np.testing.assert_allclose(found.markers.frame, FRAME, atol=6e-3)


def test_wheels_that_slip_are_betrayed_by_the_residual() -> None:
    q, straight = drive(), np.zeros(5)
    turned = np.diff(q[:, 2])
    slipped = [straight]
    for step, turn in zip(np.diff(q[:, :2], axis=0), turned, strict=True):
        slipped.append(slipped[-1] + 0.95 * np.array([*step, turn, 0.0, 0.0]))
    poses = np.array([marker_poses(ROBOT, PAIR, each) for each in slipped])
    found = calibrated_markers(ROBOT, PAIR, q, poses)
    assert found.residual > 2.0  # without noise


def test_a_drive_that_does_not_turn_shows_nothing() -> None:
    q = drive()[31:]
    poses = np.array([marker_poses(ROBOT, PAIR, each) for each in q])
    with pytest.raises(InputError, match="a drive that turns"):
        calibrated_markers(ROBOT, PAIR, q, poses)


def lines_of(text: str, markers: Markers = PAIR) -> PoseLines:
    left = [text.encode()]
    return PoseLines(lambda: left.pop() if left else b"", ROBOT, 15.0, lambda: 100.0, markers)


def test_lines_may_tell_poses_of_markers() -> None:
    q = np.array([0.1, -0.05, 0.8, 12.5, -8.0])
    poses = marker_poses(ROBOT, PAIR, q)
    told = " ".join(map(str, poses.ravel()))
    lines = lines_of(
        f"99.8 {told}\n99.9 {told} 1.0\n99.95 {told.replace(told.split()[0], 'nan')}\n"
    )
    times, found = lines.frames(7.0)
    np.testing.assert_allclose(times, [6.8])
    np.testing.assert_allclose(found, [q], atol=1e-5)
    assert (lines.taken, lines.refused) == (1, 2)
    assert "seen on: unit 2" in lines.trouble


def test_markers_that_no_shape_explains_are_refused() -> None:
    poses = marker_poses(ROBOT, THREE, np.array([0.1, -0.05, 0.8, 12.5, -8.0]))
    poses[2, :2] += 0.03
    lines = lines_of("99.8 " + " ".join(map(str, poses.ravel())) + "\n", THREE)
    assert not len(lines.frames(7.0)[0])
    assert "no shape of the robot explains" in lines.trouble


def test_noise_of_the_camera_is_what_markers_leave() -> None:
    place_m, heading_rad, curvature_per_m = lines_of("").camera.noise
    assert 0.5e-3 < place_m < 1e-3
    assert heading_rad < 0.04
    assert curvature_per_m < 1.5


def test_a_file_of_markers(tmp_path: Path) -> None:
    file = tmp_path / "markers.toml"
    text = "frame = [0.4, -0.2, 2.0]\n"
    for each in ON_UNITS:
        text += f'[[marker]]\nlink = "{each.link}"\nx_m = {each.x_m}\n'
        text += f"y_m = {each.y_m}\nphi_rad = {each.phi_rad}\n"
    file.write_text(text)
    assert load_markers(file) == PAIR
    file.write_text('[[marker]]\nlink = "unit 3"\n[[marker]]\nlink = "unit 2"\n')
    with pytest.raises(InputError, match=r"marker\.0\.link"):
        load_markers(file)
