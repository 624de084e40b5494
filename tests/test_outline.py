"""The outline is the robot of the kinematics, whatever its segments and wherever its wheels."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import ROBOT
from test_segments import arc, frame

from twosra_mpc import InputError, Robot
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.robot.geometry import Geometry, Wheel

PLACES = st.floats(-0.1, 0.1)
WHEELS = st.tuples(*[st.builds(Wheel, x_m=PLACES, y_m=PLACES, angle_rad=st.floats(-4, 4))] * 4)


def geometry(lengths_m: tuple[float, ...], wheels: tuple[Wheel, ...] | None) -> Geometry:
    given = ROBOT.geometry.model_dump()
    changed = {"segments": len(lengths_m), "segment_length_m": lengths_m, "wheels": wheels}
    return Geometry(**given | changed)


def distinct(wheels: tuple[Wheel, ...] | None) -> bool:
    pairs = ((0, 1), (2, 3)) if wheels else ()
    places = [(wheel.x_m, wheel.y_m) for wheel in wheels or ()]
    return all(math.dist(places[i], places[j]) > ROBOT.geometry.wheel_radius_m for i, j in pairs)


GEOMETRIES = st.builds(
    geometry,
    st.lists(st.floats(0.02, 0.08), min_size=1, max_size=4).map(tuple),
    st.none() | WHEELS.filter(distinct),
)


@st.composite
def placed_robots(draw: st.DrawFn) -> tuple[Geometry, np.ndarray]:
    chosen = draw(GEOMETRIES)
    pose = [draw(st.floats(-1, 1)), draw(st.floats(-1, 1)), draw(st.floats(-4, 4))]
    bends = [draw(st.floats(-3, 3)) for _ in chosen.lengths_m]
    return chosen, np.array([*pose, *np.divide(bends, chosen.lengths_m)])


def walked(g: Geometry, q: np.ndarray) -> list[np.ndarray]:
    """Frames of the ends of every segment, walking from LU1 to LU2 without any b0 in between."""
    frames, at = [], np.eye(3)
    for length_m, kappa in zip(g.lengths_m, q[3:], strict=True):
        frames += [at, at := at @ arc(kappa, length_m)]
        at = at @ frame(g.middle_link_m, 0, 0)
    half_link = g.middle_link_m / 2 if g.segments > 1 else 0.0
    b0 = frames[2 * (g.segments // 2)] @ frame(-half_link, 0, 0)
    return [frame(*q[:3]) @ np.linalg.inv(b0) @ one for one in frames]


@given(placed_robots())
def test_every_part_is_where_a_walk_along_the_fibre_comes_to(
    robot: tuple[Geometry, np.ndarray],
) -> None:
    g, q = robot
    shape, frames = robot_shape(g, q, 7), walked(g, q)
    exact: dict[str, Any] = {"rtol": 0, "atol": 1e-10}
    places = np.array([one[:2, 2] for one in frames]).reshape(-1, 2, 2)
    np.testing.assert_allclose(shape.segments[:, [0, -1]], places, **exact)
    np.testing.assert_allclose(shape.links[:-1, 1], places[:, 0], **exact)
    np.testing.assert_allclose(shape.links[1:, 0], places[:, 1], **exact)
    for unit, (side, end) in enumerate(((-1, frames[0]), (1, frames[-1]))):
        x, y, angle = shape.ends[unit]
        np.testing.assert_allclose(frame(x, y, angle), end, **exact)
        tip = end @ [side * g.end_link_m, 0, 1]
        np.testing.assert_allclose(shape.links[-unit, -unit], tip[:2], **exact)
        centre = end @ [side * (g.end_link_m + g.unit_side_m / 2), 0, 1]
        np.testing.assert_allclose(shape.centres[unit], centre[:2], **exact)
        sides = np.roll(shape.units[unit], -1, axis=0) - shape.units[unit]
        np.testing.assert_allclose(np.linalg.norm(sides, axis=1), g.unit_frame_m, **exact)
        np.testing.assert_allclose(sides[0], g.unit_frame_m * end[:2, 0], **exact)
        for wheel in (2 * unit, 2 * unit + 1):
            x, y, beta = g.wheel_placement[wheel]
            at = end @ frame(x, y, beta)
            corners = shape.wheels[wheel]
            np.testing.assert_allclose(corners.mean(axis=0), at[:2, 2], **exact)
            rolling = corners[1] - corners[0]
            np.testing.assert_allclose(rolling, 2 * g.wheel_radius_m * at[:2, 0], **exact)
            assert math.dist(corners[2], corners[1]) == pytest.approx(g.wheel_thickness_m)


@settings(max_examples=20)
@given(placed_robots())
def test_segments_are_arcs_of_the_right_length_and_curvature(
    robot: tuple[Geometry, np.ndarray],
) -> None:
    g, q = robot
    for line, kappa, length_m in zip(
        robot_shape(g, q, 400).segments, q[3:], g.lengths_m, strict=True
    ):
        steps = np.diff(line, axis=0)
        length = np.linalg.norm(steps, axis=1)
        assert length.sum() == pytest.approx(length_m, rel=1e-4)
        turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
        np.testing.assert_allclose(turns / length[1:], kappa, rtol=1e-3, atol=1e-5)


@given(WHEELS.filter(distinct), st.lists(st.floats(-60, 60), min_size=2, max_size=2))
def test_overridden_wheels_are_drawn_where_they_drive(
    wheels: tuple[Wheel, ...], kappa: list[float]
) -> None:
    moved = Robot(**dict(ROBOT) | {"geometry": geometry(ROBOT.geometry.lengths_m, wheels)})
    poses = kinematics(moved).wheel_poses([0, 0, 0, *kappa]).full()
    drawn = robot_shape(moved.geometry, [0, 0, 0, *kappa]).wheels
    np.testing.assert_allclose(drawn.mean(axis=1), poses[:2].T, rtol=0, atol=1e-12)
    along = (drawn[:, 1] - drawn[:, 0]) / (2 * ROBOT.geometry.wheel_radius_m)
    directions = np.column_stack([np.cos(poses[2]), np.sin(poses[2])])
    np.testing.assert_allclose(along, directions, rtol=0, atol=1e-12)


def test_many_configurations_are_placed_at_once() -> None:
    q = np.random.default_rng(1).normal(size=(3, 4, 5))
    together = robot_shape(ROBOT.geometry, q)
    for place in np.ndindex(3, 4):
        alone: RobotShape = robot_shape(ROBOT.geometry, q[place])
        for part in fields(RobotShape):
            one, of_all = getattr(alone, part.name), getattr(together, part.name)[place]
            np.testing.assert_allclose(of_all, one, rtol=0, atol=1e-14)


def test_no_configuration_has_no_place() -> None:
    nowhere = robot_shape(ROBOT.geometry, np.zeros((0, 5)))
    assert all(len(getattr(nowhere, part.name)) == 0 for part in fields(RobotShape))


def test_a_configuration_of_another_robot_is_refused() -> None:
    with pytest.raises(InputError, match=r"an array of shape \(\.\.\., 5\)"):
        robot_shape(ROBOT.geometry, [0.0, 0.0, 0.0, 1.0])
