"""Configurations that touch: by distances of the robot drawn by hand."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from grasps import apart_m, cube, disc, drawn, overlap_m2, pebble
from hypothesis import given, settings
from hypothesis import strategies as st

from twosra_mpc import InputError, load_robot
from twosra_mpc.contact.touch import (
    BEYOND,
    IN_THE_WAY,
    LEAVES,
    NOTHING,
    OVERLAPS,
    Touch,
    conform_touches,
    grasp_touches,
)
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.limits import broken_by_shapes, may_drive_in
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry

NAMES = ("2sra-v1", "2sra-v1-paper", "2sr-v2", "3sra")
ROBOTS = {name: load_robot(name) for name in NAMES}
V1 = ROBOTS["2sra-v1"]
UNITS, PARTS = "the units would meet", "other parts of the robot would meet"
REASONS = {UNITS, PARTS, OVERLAPS, NOTHING, IN_THE_WAY, LEAVES, BEYOND, "wheel_independence"}
ROUNDING_M = 1.5e-5

robots = st.sampled_from(list(ROBOTS.values()))


def check_touch(robot: Robot, thing: Object, touch: Touch) -> None:
    geometry, inner = robot.geometry, robot.geometry.inner_link_of_b0
    body = drawn(geometry, touch.configuration)
    assert abs(apart_m(body, thing)) < ROUNDING_M
    assert broken_by_shapes(robot, touch.kappa[None]) is None
    assert may_drive_in(robot, touch.kappa).all()
    sides = [np.arange(geometry.segments) < inner, np.arange(geometry.segments) >= inner]
    for moving in sides:
        if moving.any():
            tighter = touch.configuration.copy()
            tighter[POSE:][moving] += 0.5 * touch.side
            assert overlap_m2(drawn(geometry, tighter), thing) > overlap_m2(body, thing)


@given(robots, st.floats(0.015, 0.09))
@settings(max_examples=7)
def test_a_disc_is_touched_once_from_each_side_or_named_why_not(
    robot: Robot, radius_m: float
) -> None:
    found = grasp_touches(robot, disc(radius_m))
    assert len(found.touches) + sum(found.refused.values()) == 2
    assert set(found.refused) <= REASONS
    for touch in found.touches:
        check_touch(robot, disc(radius_m), touch)
        assert apart_m(drawn(robot.geometry, touch.configuration), disc(radius_m)) > -ROUNDING_M


@pytest.mark.parametrize(("name", "seed"), list(zip(NAMES, (3, 4, 5, 6), strict=True)))
def test_polygons_are_touched_and_not_overlapped(name: str, seed: int) -> None:
    robot = ROBOTS[name]
    thing = pebble(seed)
    found = grasp_touches(robot, thing)
    assert len(found.touches) + sum(found.refused.values()) == 2 * 72
    assert set(found.refused) <= REASONS
    wraps = [touch.wrap_rad for touch in found.touches]
    assert wraps == sorted(wraps, reverse=True) or np.allclose(wraps, sorted(wraps)[::-1])
    for touch in found.touches[::12]:
        check_touch(robot, thing, touch)


def roundest_m(geometry: Geometry) -> float:
    """Largest radius of a disc that a segment lies along: a unit's corner touches it, too."""
    half = geometry.unit_frame_m / 2
    near, beside = geometry.unit_middle_m[0] - half, half - geometry.fibre_radius_m
    return (near**2 + beside**2) / (2 * beside)


@given(st.floats(0.0, 0.004), st.floats(0.0, 0.002))
@settings(max_examples=5)
def test_without_a_middle_link_a_disc_is_touched_all_along(smaller_m: float, gap_m: float) -> None:
    radius_m = roundest_m(V1.geometry) - gap_m - smaller_m
    bare = V1.with_values(geometry=V1.geometry.with_values(middle_link_m=0.0))
    touches = grasp_touches(bare, disc(radius_m), gap_m).touches
    each = 1 / (radius_m + bare.geometry.fibre_radius_m + gap_m)
    for touch in touches:
        assert touch.kappa == pytest.approx(touch.side * each * np.ones(2), abs=0.02)
        gap = apart_m(drawn(bare.geometry, touch.configuration), disc(radius_m))
        assert gap == pytest.approx(gap_m, abs=ROUNDING_M)
    assert len(touches) == 2


def test_a_middle_link_asks_for_more() -> None:
    squares = V1.geometry.with_values(unit_frame_m=V1.geometry.unit_side_m)
    for robot in (V1, V1.with_values(geometry=squares)):
        touch = grasp_touches(robot, disc(0.03)).touches[0]
        check_touch(robot, disc(0.03), touch)
        assert touch.kappa.min() > 1.2 / (0.03 + V1.geometry.fibre_radius_m)
        assert np.degrees(touch.wrap_rad) > 180.0
    assert touch.kappa == pytest.approx([39.9, 39.9], abs=0.3)  # by hand, of units of 42 mm


def test_a_robot_that_looks_the_same_half_turned_touches_alike_from_both_sides() -> None:
    for thing in (disc(0.055), cube(0.05)):
        found = grasp_touches(V1, thing)
        one = [touch.kappa for touch in found.touches if touch.side > 0]
        other = [-touch.kappa[::-1] for touch in found.touches if touch.side < 0]
        assert np.sort(one, axis=0) == pytest.approx(np.sort(other, axis=0), abs=1e-3)


def test_a_mirrored_robot_touches_in_mirrored_shapes() -> None:
    wheels = [
        {"x_m": -x, "y_m": y, "angle_rad": np.pi - angle}
        for x, y, angle in V1.geometry.wheel_placement
    ]
    swapped = (*wheels[2:], *wheels[:2])
    mirrored = V1.with_values(geometry=V1.geometry.with_values(wheels=swapped))
    one, other = (grasp_touches(robot, disc(0.08)).touches for robot in (V1, mirrored))
    by_side = {touch.side: touch.kappa for touch in other}
    for touch in one:
        assert by_side[touch.side] == pytest.approx(touch.kappa[::-1], abs=1e-3)
        assert abs(touch.kappa[0] - touch.kappa[1]) > 0.5


def test_what_cannot_be_grasped_is_said() -> None:
    assert grasp_touches(V1, disc(0.025)).refused == {UNITS: 2}
    assert grasp_touches(ROBOTS["2sr-v2"], disc(0.02)).refused == {BEYOND: 2}
    none = grasp_touches(V1, disc(0.025))
    assert none.best_wrap_rad == 0.0
    assert not none.touches


def test_units_on_one_side_of_the_fibre_make_sides_differ() -> None:
    found = {touch.side: touch for touch in grasp_touches(ROBOTS["2sr-v2"], disc(0.05)).touches}
    fibre, units = found[1], found[-1]
    assert fibre.kappa == pytest.approx([18.52, 18.52], abs=0.02)
    assert units.wrap_rad > fibre.wrap_rad + 1.0


def test_shapes_that_repeat_are_few() -> None:
    found = grasp_touches(V1, cube(0.04))
    shapes = np.unique(np.round([touch.kappa for touch in found.touches], 2), axis=0)
    assert len(shapes) * 3 < len(found.touches)


@given(
    st.sampled_from(["2sra-v1", "2sra-v1-paper", "2sr-v2"]),
    st.floats(0.02, 0.08),
    st.sampled_from([(1,), (2,), (1, 2)]),
    st.floats(2e-4, 4e-3),
)
@settings(max_examples=20)
def test_segments_lie_along_a_cylinder_or_it_is_said_why_not(
    name: str, radius_m: float, segments: tuple[int, ...], gap_m: float
) -> None:
    robot, thing = ROBOTS[name], disc(radius_m)
    found = conform_touches(robot, thing.own, segments, gap_m)
    assert len(found.touches) + sum(found.refused.values()) == 2
    assert set(found.refused) <= REASONS
    asked = [j - 1 for j in segments]
    for touch in found.touches:
        assert list(np.flatnonzero(np.isfinite(touch.kappa))) == asked
        open_, lengths = touch.kappa - touch.side * touch.slack_per_m, robot.geometry.lengths_m
        for kappa in (touch.kappa, open_):
            q = np.nan_to_num(np.concatenate([touch.configuration[:POSE], kappa]))
            lines = robot_shape(robot.geometry, q, 200).segments[asked]
            off = np.linalg.norm(lines, axis=-1) - radius_m - robot.geometry.fibre_radius_m
            assert off.min() > -ROUNDING_M
            assert off.max() < gap_m * 1.05 + ROUNDING_M
        assert (touch.slack_per_m[asked] <= 2 * gap_m / np.array(lengths)[asked] ** 2 + 1e-9).all()


def test_a_segment_that_is_free_to_is_concentric() -> None:
    for radius_m in (0.02, 0.03, roundest_m(V1.geometry) - 0.001):
        touches = conform_touches(V1, disc(radius_m).own, (1,), 0.001).touches
        each = 1 / (radius_m + 0.004)
        assert [abs(touch.kappa[0]) for touch in touches] == pytest.approx([each] * 2, abs=0.02)
        assert touches[0].slack_per_m[0] == pytest.approx(2 * 0.001 / 0.04**2, rel=0.02)


def test_segments_begin_next_to_b0() -> None:
    with pytest.raises(InputError, match="segments"):
        conform_touches(ROBOTS["3sra"], disc(0.05).own, (3,), 0.001)


def test_an_arc_along_a_flat_side_is_straight() -> None:
    touches = conform_touches(ROBOTS["2sr-v2"], cube(0.3).own, (1, 2), 0.002).touches
    assert touches
    straight = [t for t in touches if np.abs(t.kappa).max() < 0.2]
    assert len(straight) > 10
    body = drawn(ROBOTS["2sr-v2"].geometry, straight[0].configuration)
    assert shapely.distance(body, shapely.Polygon(cube(0.3).own.corners_m)) < ROUNDING_M
