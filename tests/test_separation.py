"""Separating axes: exact where pieces overlap, a lower bound where they do not, at any pose."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import random_world

from twosra_mpc import load_robot
from twosra_mpc.problem.tolerances import ROUNDING_M
from twosra_mpc.problem.world import Workspace, World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import Footprint, footprint
from twosra_mpc.space.separation import FAR_M, Separation, Surroundings, placed

SAME_M = 1e-9
ROBOTS = [load_robot(name) for name in ("2sra-v1", "2sr-v2", "3sra")]
seeds = st.integers(0, 10_000)


def shaped(seed: int) -> Footprint:
    rng = np.random.default_rng(seed)
    robot = ROBOTS[seed % len(ROBOTS)]
    return footprint(robot.geometry, rng.uniform(-30, 30, robot.coordinates.segments))


def poses(seed: int, count: int, reach_m: float = 0.8) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform([-reach_m, -reach_m, -np.pi], [reach_m, reach_m, np.pi], (count, 3))


def true_m(world: World, corners: Array) -> Array:
    """GEOS distance of sets of pieces (m, p, 4, 2) to the obstacles, 0 where they overlap."""
    solid = shapely.union_all([shapely.Polygon(one.corners_m) for one in world.obstacles])
    bodies = [shapely.union_all(shapely.polygons(pieces)) for pieces in corners]
    return shapely.distance(np.array(bodies), solid)


@given(seeds)
@settings(max_examples=15)
def test_a_lower_bound_of_the_distance_with_its_sign(seed: int) -> None:
    world, shape, at = random_world(seed, workspace=None), shaped(seed), poses(seed, 60)
    found = Separation(shape, world, 0.002).distances(at)
    true = true_m(world, placed(shape.outer, at))
    apart = true > 0
    assert (found <= np.where(apart, np.minimum(true, FAR_M), 0.0) + SAME_M).all()
    assert (found[true > 1e-6] > 0).all()  # convex pieces apart have an axis between them


@given(seeds)
@settings(max_examples=20)
def test_the_depth_is_the_shortest_way_out(seed: int) -> None:
    """Of one convex piece in one part: moved by less it overlaps, by a bit more it need not."""
    rng = np.random.default_rng(seed)
    hull = shapely.MultiPoint(0.1 * rng.normal(size=(6, 2))).convex_hull
    middle = np.array([hull.centroid.x, hull.centroid.y])
    box = middle + np.array([(-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03)])
    world = World(**{"obstacles": [{"polygon_m": shapely.get_coordinates(hull)[:-1].tolist()}]})
    depth = -float(Surroundings(world, 0.0).distances(box[None, None])[0])
    assert depth > 0
    angles = np.linspace(0, 2 * np.pi, 1440, endpoint=False)
    away = np.column_stack([np.cos(angles), np.sin(angles)])
    for share, parts in ((0.999, False), (1.001, True)):
        moved = shapely.polygons(box + share * depth * away[:, None])
        shared = shapely.area(shapely.intersection(moved, hull))
        assert bool((shared < 1e-9).any()) == parts


@given(seeds)
@settings(max_examples=15)
def test_what_is_proved_at_a_pose_holds_nearby(seed: int) -> None:
    """A distance less what points move is a bound of the true one; a depth changes no faster."""
    world, shape, rng = (
        random_world(seed, workspace=None),
        shaped(seed),
        np.random.default_rng(seed),
    )
    at = poses(seed, 60)
    by = rng.normal(size=at.shape) * np.array([0.01, 0.01, 0.05]) * rng.random((60, 1))
    distances = Separation(shape, world, 0.004).distances
    moved = np.hypot(by[:, 0], by[:, 1]) + shape.radius_m * np.abs(by[:, 2])
    before, after = distances(at), distances(at + by)
    assert (true_m(world, placed(shape.outer, at + by)) >= before - moved - SAME_M).all()
    deep = (before <= 0) & (after <= 0)
    assert (np.abs(after - before)[deep] <= moved[deep] + SAME_M).all()


@given(seeds, st.sampled_from([0.0, 0.004, 0.02, 0.06]), st.floats(-9, -6))
@settings(max_examples=10)
def test_moved_by_rounding_distances_change_as_little(
    seed: int, kept_m: float, power: float
) -> None:
    """Turned, too, and wherever one way to tell a distance becomes another."""
    world, shape, at = random_world(seed), shaped(seed), poses(seed, 80)
    by = 10.0**power * np.random.default_rng(seed).normal(size=at.shape)
    distances = Separation(shape, world, kept_m).distances
    before, after = distances(at), distances(at + by)
    moved = np.hypot(by[:, 0], by[:, 1]) + shape.radius_m * np.abs(by[:, 2])
    assert (np.abs(after - before) <= 3 * moved + SAME_M).all()


def test_batches_agree_with_one_by_one() -> None:
    world, shape, at = random_world(3), shaped(3), poses(3, 600)
    separation = Separation(shape, world, 0.002)
    one_by_one = np.concatenate([separation.distances(pose[None]) for pose in at])
    assert np.array_equal(separation.distances(at), one_by_one)
    parts = separation.surroundings.to_parts(placed(shape.outer, at))
    assert parts.shape == (600, separation.surroundings.columns[-1].start)
    assert (separation.distances(at) <= parts.min(axis=1)).all()
    assert separation.distances(np.zeros((0, 3))).shape == (0,)


def test_a_part_far_away_does_not_count() -> None:
    shape, at = shaped(0), np.zeros((1, 3))
    far = World(**{"obstacles": [{"disc": {"x_m": 3.0, "y_m": 0.0, "radius_m": 0.1}}]})
    assert Separation(shape, far, 0.0).distances(at)[0] == FAR_M
    assert Separation(shape, World(), 0.0).distances(at)[0] == FAR_M


@pytest.mark.parametrize("kept_m", [0.0, 0.01])
def test_the_edge_of_the_workspace_may_be_touched(kept_m: float) -> None:
    shape = footprint(ROBOTS[0].geometry, [0.0, 0.0])
    right = float(shape.outer[..., 0].max())
    edge = World(workspace=Workspace(x_m=(-1.0, right), y_m=(-1.0, 1.0)))
    distances = Separation(shape, edge, kept_m).distances
    at = np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [-2e-3, 0.0, 0.0]])
    touched = kept_m + ROUNDING_M
    assert distances(at) == pytest.approx([touched, touched - 1e-3, touched + 2e-3])


@given(seeds)
def test_convex_parts_are_the_polygon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 12)))
    star = rng.uniform(0.02, 0.1, len(angles))[:, None] * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )
    whole = shapely.Polygon(star)
    if not whole.is_valid or whole.area < 1e-8 or not whole.exterior.is_ccw:
        return
    parts = convex_parts(star)
    polygons = [shapely.Polygon(part) for part in parts]
    for part, polygon in zip(parts, polygons, strict=True):
        assert polygon.exterior.is_ccw
        assert polygon.convex_hull.area == pytest.approx(polygon.area)
        assert len(part) >= 3
    assert sum(polygon.area for polygon in polygons) == pytest.approx(whole.area)
    assert shapely.union_all(polygons).symmetric_difference(whole).area < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_no_piece_is_said_to_be_farther_away_than_it_is(seed: int) -> None:
    """Whatever its corners are: discs around pieces hold the farthest of them."""
    rng, world = np.random.default_rng(seed), random_world(seed, workspace=None)
    long, short, turn = (
        rng.uniform(0.05, 0.1, 200),
        rng.uniform(0.01, 0.02, 200),
        7 * rng.random(200),
    )
    kites = np.stack([long, 1j * short, -short, -1j * short], axis=1) * np.exp(1j * turn)[:, None]
    kites += (rng.uniform(-0.6, 0.6, (200, 2)) @ np.array([1, 1j]))[:, None]
    pieces = np.stack([kites.real, kites.imag], axis=-1)
    corners = shapely.polygons(pieces).tolist()
    solid = [
        shapely.Polygon(part) for item in world.obstacles for part in convex_parts(item.corners_m)
    ]
    true = np.array([[each.distance(other) for other in solid] for each in corners])
    found = Surroundings(world, 0.0).to_parts(pieces[:, None])
    assert (found <= true + 1e-9).all()
