"""Cones of motions that an object follows."""

from __future__ import annotations

import numpy as np
import pytest
from grasps import cube, disc
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from twosra_mpc import load_robot
from twosra_mpc.contact.grip import Pulls, PushingCone, pushing_cone
from twosra_mpc.contact.touch import grasp_touches
from twosra_mpc.problem.speeds import drive_rows

V1, V2 = load_robot("2sra-v1"), load_robot("2sr-v2")
TOUCH = grasp_touches(V2, disc(0.06)).touches[-1]
AHEAD, BACK = [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]
seeds, frictions = st.integers(0, 1000), st.sampled_from([0.0, 0.1, 0.3, 0.6])


def pushed(side_m: float, friction: float, off_m: float = 0.0) -> PushingCone:
    """A cube on the middle link of the straight robot, its centroid off the middle."""
    pose = [off_m, V1.geometry.fibre_radius_m + side_m / 2, 0.0]
    return pushing_cone(V1.geometry, [0.0, 0.0], cube(side_m), pose, friction)


def some_twists(seed: int, count: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)) * [1.0, 1.0, 20.0]


@given(st.floats(0.02, 0.06), st.floats(-0.005, 0.005), frictions)
@settings(max_examples=10)
def test_a_flat_face_pushes_along_its_normal_and_never_pulls(
    side_m: float, off_m: float, friction: float
) -> None:
    cone = pushed(side_m, friction, off_m)
    assert cone.holds([AHEAD, BACK, [0.0, 0.0, 0.0]]).tolist() == [True, False, True]
    assert cone.holds([1.0, 0.0, 0.0]).tolist() is False


@given(st.floats(0.02, 0.06), st.floats(0.05, 0.45))
@settings(max_examples=10)
def test_it_may_slant_as_far_as_friction_goes(side_m: float, friction: float) -> None:
    cone = pushed(side_m, friction)  # forces still pass through the centroid from the link
    slants = np.array([[0.98 * friction, 1.0, 0.0], [-0.98 * friction, 1.0, 0.0]])
    assert cone.holds(slants).all()
    assert not cone.holds(slants * [1.05, 1.0, 1.0]).any()


def test_without_friction_a_flat_face_turns_about_points_on_its_normals() -> None:
    """A frictionless line contact: force through the face, so v_x = 0 and bounded turning."""
    side, half = 0.04, 0.015 * 0.9  # the middle link is 30 mm long
    cone, wide, high = pushed(side, 0.0), 0.6 * side / np.sqrt(np.pi), 0.024
    for w in (0.5, -0.5):
        most = abs(w) * wide**2 / half  # |c^2 w| <= half * v_y
        twists = [[w * high, 1.02 * most, w], [w * high, 0.5 * most, w]]
        assert cone.holds(twists).tolist() == [True, False]


def test_what_slides_has_room_until_its_centroid_is_beyond_the_last_contact() -> None:
    """Half its side on a flat front that is longer, to either side; none on a round one."""
    for side_m, off_m in ((0.03, 0.0), (0.06, 0.008), (0.06, -0.008)):
        assert pushed(side_m, 0.3, off_m).room_m == pytest.approx(side_m / 2, abs=5e-4)
    cone = pushing_cone(V2.geometry, TOUCH.kappa, disc(0.06), TOUCH.pose_in_b0, 0.5)
    assert cone.room_m == 0.0


@given(seeds, frictions)
@settings(max_examples=10)
def test_it_is_a_convex_cone_that_friction_widens(seed: int, friction: float) -> None:
    side, off = np.random.default_rng(seed).uniform([0.02, -0.01], [0.06, 0.01])
    cone, wider = pushed(side, friction, off), pushed(side, friction + 0.1, off)
    twists = np.concatenate([some_twists(seed), [AHEAD]])
    held = twists[cone.holds(twists)]
    assert cone.holds(3.7 * held).all()
    assert not cone.holds(-held[np.abs(held).sum(axis=1) > 0]).any()
    assert wider.holds(held).all()
    mixed = held + np.roll(held, 1, axis=0) * 0.6
    assert cone.holds(mixed).all()


@given(seeds, st.sampled_from([0.0, 0.3]))
@settings(max_examples=5)
def test_facets_agree_with_forces_found(seed: int, friction: float) -> None:
    """The same cone by non-negative least squares over contact forces."""
    pose = TOUCH.pose_in_b0
    cone = pushing_cone(V2.geometry, TOUCH.kappa, disc(0.06), pose, friction)
    into = pose[:2] - cone.contacts
    into /= np.linalg.norm(into, axis=1, keepdims=True)  # a disc: towards its centre
    across = np.column_stack([-into[:, 1], into[:, 0]])
    forces = np.concatenate([into + friction * across, into - friction * across])
    arms, wide = np.tile(cone.contacts - pose[:2], (2, 1)), 0.6 * 0.06
    torque = arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]
    wrenches = np.column_stack([forces, torque / wide]).T
    for s in some_twists(seed, 15):
        v = s[:2] + s[2] * np.array([-pose[1], pose[0]])
        load = np.array([*v, wide * s[2]])
        _, off = nnls(wrenches, load)
        missed = off / np.linalg.norm(load)
        if missed < 1e-9 or missed > 1e-3:
            assert bool(cone.holds(s)) == (missed < 1e-9)


def test_what_touches_nothing_follows_nothing() -> None:
    cone = pushing_cone(V1.geometry, [0.0, 0.0], cube(0.03), [0.0, 0.2, 0.0], 0.5)
    assert not len(cone.contacts)
    assert not cone.holds(some_twists(1)).any()


def test_embraced_from_all_sides_with_friction_it_follows_everything() -> None:
    touch = grasp_touches(V1, disc(0.03)).touches[0]
    cone = pushing_cone(V1.geometry, touch.kappa, disc(0.03), touch.pose_in_b0, 0.5)
    assert cone.holds(some_twists(2)).all()
    without = pushing_cone(V1.geometry, touch.kappa, disc(0.03), touch.pose_in_b0, 0.0)
    turning = [[-touch.pose_in_b0[1], touch.pose_in_b0[0], -1.0]]
    assert not without.holds(turning).any()
    assert without.holds([AHEAD, BACK]).tolist() == [True, True]


@given(seeds, st.lists(st.floats(-40.0, 40.0), min_size=2, max_size=2))
@settings(max_examples=10)
def test_wheels_pull_as_little_as_any_forces_along_their_rims(
    seed: int, kappa: list[float]
) -> None:
    pose = np.array([0.004, 0.035, 0.3])
    wheels = drive_rows(V1, kappa)[1] * V1.geometry.wheel_radius_m
    for twist in some_twists(seed, 3):
        found = Pulls.of(V1, np.array(kappa), disc(0.03), pose)(twist)
        u, v, r = twist
        wide_m, (x, y) = 0.6 * 0.03, pose[:2]  # c of a disc
        load = np.array([u - r * y, v + r * x, wide_m**2 * r])
        force = load / np.hypot(np.hypot(load[0], load[1]), wide_m * r)
        force[2] += x * force[1] - y * force[0]
        sizes = np.concatenate([np.zeros(4), [1.0]])  # least largest force that balances it
        most = np.vstack([np.c_[np.eye(4), -np.ones(4)], np.c_[-np.eye(4), -np.ones(4)]])
        balanced = np.c_[wheels.T, np.zeros(3)]
        best = linprog(sizes, most, np.zeros(8), balanced, force, bounds=(None, None))
        assert found == pytest.approx(best.fun, rel=1e-3)  # a disc's corners stand for it
