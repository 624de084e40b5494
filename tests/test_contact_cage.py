"""Cages: what is proved cannot be undone by a walk, and what is not caged does get out."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest
import shapely
from grasps import ORIGIN, apart_m, cube, disc, drawn, pebble
from hypothesis import given, settings
from hypothesis import strategies as st

from twosra_mpc import InputError, load_robot
from twosra_mpc.checking.clearance import leaves_straight
from twosra_mpc.checking.holds import Boxes, _discs, _free
from twosra_mpc.contact.grip import caged
from twosra_mpc.contact.touch import Touch, grasp_touches
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.description import Robot

ROBOTS = {name: load_robot(name) for name in ("2sra-v1", "2sr-v2", "3sra")}
V1, V2 = ROBOTS["2sra-v1"], ROBOTS["2sr-v2"]


def body_of(robot: Robot, touch: Touch) -> shapely.Geometry:
    body = drawn(robot.geometry, np.concatenate([np.zeros(3), touch.kappa]))
    shapely.prepare(body)
    return body


def walk(
    body: shapely.Geometry, thing: Object, pose: np.ndarray, seed: int, steps: int
) -> np.ndarray:
    """Poses of a random walk that never overlaps the robot by more than rounding, (m, 3)."""
    rng, poses = np.random.default_rng(seed), [pose]
    drift = rng.normal(size=3)
    for k in range(steps):
        if k % 25 == 0:
            drift = rng.normal(size=3)
        size = 10 ** rng.uniform(-4.5, -2.5)
        step = (drift + rng.normal(size=3)) * np.array([size, size, 20 * size])
        if apart_m(body, thing, poses[-1] + step) > -1.5e-5:
            poses.append(poses[-1] + step)
    return np.array(poses)


@pytest.mark.parametrize(
    ("radius_m", "proved"), [(0.03, True), (0.04, True), (0.05, True), (0.06, False)]
)
def test_the_robot_cages_discs_up_to_50_mm(radius_m: float, proved: bool) -> None:
    for touch in grasp_touches(V1, disc(radius_m)).touches:
        cage = caged(V1.geometry, touch.kappa, disc(radius_m), touch.pose_in_b0)
        assert cage.proved == proved
        assert np.isfinite(cage.room_m) == proved


@given(st.sampled_from(list(ROBOTS.values())), st.floats(0.02, 0.07), st.integers(0, 100))
@settings(max_examples=5)
def test_a_disc_on_a_walk_stays_within_its_room(robot: Robot, radius_m: float, seed: int) -> None:
    thing = disc(radius_m)
    for touch in grasp_touches(robot, thing).touches[:1]:
        cage = caged(robot.geometry, touch.kappa, thing, touch.pose_in_b0)
        poses = walk(body_of(robot, touch), thing, touch.pose_in_b0, seed, 200)
        away = np.linalg.norm(poses[:, :2] - touch.pose_in_b0[:2], axis=1)
        assert away.max() <= cage.room_m


@pytest.mark.parametrize(("name", "thing"), [("2sra-v1", cube(0.05)), ("3sra", pebble(2))])
def test_a_polygon_on_a_walk_stays_within_its_room(name: str, thing: Object) -> None:
    robot, known = ROBOTS[name], 0
    middle = shapely.get_coordinates(shapely.Polygon(thing.own.corners_m).centroid)[0]
    for touch in grasp_touches(robot, thing).touches[:2]:
        cage = caged(robot.geometry, touch.kappa, thing, touch.pose_in_b0)
        poses = walk(body_of(robot, touch), thing, touch.pose_in_b0, known, 200)
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        at = np.column_stack([c * middle[0] - s * middle[1], s * middle[0] + c * middle[1]])
        at += poses[:, :2]
        assert np.linalg.norm(at - at[0], axis=1).max() <= cage.room_m
        known += cage.proved
    assert known


def test_what_is_not_caged_is_pulled_out() -> None:
    for robot, thing in ((V1, disc(0.06)), (V1, disc(0.08)), (V2, disc(0.05))):
        touch = grasp_touches(robot, thing).touches[-1]
        cage = caged(robot.geometry, touch.kappa, thing, touch.pose_in_b0)
        assert not cage.proved
        body, away = body_of(robot, touch), np.linspace(0.0, 0.2, 101)
        kept = []
        for slant in np.linspace(-0.5, 0.5, 11):
            ahead = np.array([np.sin(slant), touch.side * np.cos(slant), 0.0])
            out = touch.pose_in_b0 + away[:, None] * ahead
            kept.append(min(apart_m(body, thing, pose) for pose in out))
        assert max(kept) > -2e-5


@given(st.floats(0.03, 0.055), st.floats(0.0, 0.004))
@settings(max_examples=7)
def test_what_holds_a_caged_disc_is_caged(radius_m: float, less_m: float) -> None:
    touch = grasp_touches(V1, disc(radius_m)).touches[0]
    each = [
        caged(V1.geometry, touch.kappa, disc(radius_m - off), touch.pose_in_b0)
        for off in (0.0, less_m)
    ]
    assert each[0].proved or not each[1].proved
    assert each[0].room_m <= each[1].room_m + 1e-4


def test_a_cube_is_caged_from_its_corner() -> None:
    found = grasp_touches(V1, cube(0.05)).touches
    held = caged(V1.geometry, found[0].kappa, cube(0.05), found[0].pose_in_b0)
    assert held.proved
    assert held.room_m < 0.02
    assert np.cos(4 * found[0].configuration[2]) < -0.9  # at about 45 degrees
    flat = next(touch for touch in found if np.abs(touch.kappa).max() < 5.0)
    assert not caged(V1.geometry, flat.kappa, cube(0.05), flat.pose_in_b0).proved


@given(st.integers(0, 200))
@settings(max_examples=5)
def test_where_nothing_overlaps_is_among_what_may_be_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kappa, thing = rng.uniform(-40, 40, 2), (disc(0.02), cube(0.03), pebble(seed))[seed % 3]
    body = drawn(V1.geometry, np.concatenate([np.zeros(3), kappa]))
    poses = rng.uniform([-0.15, -0.15, -3], [0.15, 0.15, 3], (10, 3))
    free = [pose for pose in poses if apart_m(body, thing, pose) > 0]
    for pose in free:
        caged(V1.geometry, kappa, thing, pose)  # refuses none


@pytest.mark.parametrize("thing", [disc(0.02), cube(0.03)])
def test_what_is_far_away_is_free(thing: Object) -> None:
    found = caged(V1.geometry, [-18.4, -36.9], thing, [0.5, 0.5, 2.5])
    assert not found.proved
    assert found.room_m == np.inf


def test_an_object_in_the_robot_is_refused() -> None:
    for thing in (disc(0.03), cube(0.03)):
        with pytest.raises(InputError, match="pose_in_b0"):
            caged(V1.geometry, [0.0, 0.0], thing, [0.0, 0.0, 0.0])


@pytest.mark.parametrize("headings", [24, 48])
def test_a_box_that_verification_calls_blocked_holds_no_free_pose(headings: int) -> None:
    """A rod turns far within a box of headings: what it moves by there must be allowed for."""
    rod = Object(name="rod", pose=ORIGIN, box={"x_m": (-0.04, 0.04), "y_m": (-0.004, 0.004)})
    q, rng = np.concatenate([np.zeros(3), [20.0, 20.0]]), np.random.default_rng(0)
    boxes, middle = Boxes(1e-3, 50, headings), np.array([0.0, 0.04, 0.0])
    free = np.array([*map(_free(V1.geometry, q, middle, _discs(rod), boxes), range(headings))])
    assert 0.02 < 1 - free.mean() < 0.98
    body, height = drawn(V1.geometry, q), 2 * np.pi / headings
    shapely.prepare(body)
    blocked = np.argwhere(~free)
    for k, i, j in blocked[rng.integers(len(blocked), size=600)].tolist():
        offsets = rng.uniform(-0.5, 0.5, 3)
        offsets[2] = np.sign(offsets[2]) / 2  # where it is turned the farthest
        x, y = middle[:2] + (np.array([i, j]) - boxes.each_way + offsets[:2]) * boxes.step
        assert apart_m(body, rod, np.array([x, y, (k + offsets[2]) * height])) <= 5e-5


UNSURE_M = 3e-4  # of the deepest overlap on a way


def least(gaps_m: Iterable[float]) -> float:
    """The least gap on a way, or the first that is an overlap for sure."""
    found = math.inf
    for gap_m in gaps_m:
        found = min(found, gap_m)
        if found < -UNSURE_M:
            break
    return found


def test_what_leaves_straight_overlaps_nothing_on_one_way() -> None:
    rng, seen = np.random.default_rng(0), set()
    angles, far = np.arange(24) * np.pi / 12, np.linspace(0.0, 0.17, 60)
    ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(24)], axis=-1)
    for k in range(9):
        kappa, thing = (
            rng.uniform(-45, 45) * np.ones(2),
            (disc(0.015), cube(0.03), pebble(k))[k % 3],
        )
        q = np.concatenate([np.zeros(3), kappa])
        pose = np.array([0.0, np.sign(kappa[0]) * rng.uniform(0.03, 0.07), rng.uniform(-3, 3)])
        body = drawn(V1.geometry, q)
        shapely.prepare(body)
        apart = max(least(apart_m(body, thing, pose + m * way) for m in far) for way in ways)
        leaves = leaves_straight(V1.geometry, thing, pose, q, 0.17)
        assert leaves == (apart > 0) or abs(apart) < UNSURE_M
        seen.add(leaves)
    assert seen == {False, True}
