"""The robot as convex pieces: outer ones hold it, it holds inner ones, and how bending moves it."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from twosra_mpc import load_robot
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.problem.tolerances import ROUNDING_M
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.space.footprint import (
    footprint,
    footprints,
    kept_m,
    moved_by_bending_m,
    reach_per_curvature_m2,
)

ROBOTS = [load_robot(name) for name in ("2sra-v1", "2sr-v2", "3sra")]
SAME_M = 1e-7
MOST_PER_M = 45.0

robots = st.sampled_from(ROBOTS)
seeds = st.integers(0, 10_000)


def shape_of(robot: Robot, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    kappa = rng.uniform(-MOST_PER_M, MOST_PER_M, robot.coordinates.segments)
    return np.where(rng.random(len(kappa)) < 0.2, 0.0, kappa)


def drawn(robot: Robot, kappa: Array, round_ends: bool = True) -> shapely.Geometry:
    """The robot with b0 at the origin: units, wheels and the fibre with its radius."""
    geometry, cap = robot.geometry, "round" if round_ends else "flat"
    shape = robot_shape(geometry, [0.0, 0.0, 0.0, *kappa], 60)
    radius = geometry.fibre_radius_m
    parts = [shapely.Polygon(corners) for corners in (*shape.units, *shape.wheels)]
    parts += [shapely.LineString(line).buffer(radius, cap_style=cap) for line in shape.segments]
    links = [line for line in shape.links if np.ptp(line, axis=0).max() > 0]
    parts += [shapely.LineString(line).buffer(radius, cap_style="flat") for line in links]
    return shapely.union_all(parts, grid_size=1e-9)


def union(pieces: Array, grow_m: float = SAME_M) -> shapely.Geometry:
    return shapely.union_all(shapely.polygons(pieces), grid_size=1e-9).buffer(grow_m)


def material_points(robot: Robot, kappa: Array) -> Array:
    """The same points of the body in every shape: along the fibre's edges, units, wheels."""
    shape = robot_shape(robot.geometry, [0.0, 0.0, 0.0, *kappa], 60)
    lines = np.concatenate([*shape.segments, *shape.links])
    around = [shape.units.reshape(-1, 2), shape.wheels.reshape(-1, 2)]
    edges = []
    for line in (*shape.segments, *shape.links):
        along = np.gradient(line, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        across = robot.geometry.fibre_radius_m * np.column_stack([-along[:, 1], along[:, 0]])
        edges += [line - across, line + across]
    return np.concatenate([lines, *edges, *around])


@given(robots, seeds, st.sampled_from([2e-4, 5e-4, 2e-3]))
def test_outer_pieces_hold_the_robot(robot: Robot, seed: int, sagitta_m: float) -> None:
    kappa = shape_of(robot, seed)
    made = footprint(robot.geometry, kappa, sagitta_m)
    body = drawn(robot, kappa)
    assert shapely.difference(body, union(made.outer)).area == 0.0
    assert made.radius_m >= np.linalg.norm(shapely.get_coordinates(body), axis=1).max() - SAME_M
    excess = shapely.hausdorff_distance(union(made.outer, 0.0), body)
    assert excess < 2 * sagitta_m + 1e-3  # the corners of longer chords


@given(robots, seeds, st.sampled_from([2e-4, 5e-4, 2e-3]))
def test_the_robot_holds_inner_pieces(robot: Robot, seed: int, sagitta_m: float) -> None:
    kappa = shape_of(robot, seed)
    made = footprint(robot.geometry, kappa, sagitta_m)
    # a line of 60 points is off the arc by kappa ds^2 / 8, less than 6 um
    body = drawn(robot, kappa).buffer(1e-5)
    assert shapely.difference(union(made.inner, 0.0), body).area == 0.0
    assert union(made.inner).within(union(made.outer, 2 * SAME_M))


@given(robots, seeds)
def test_pieces_are_convex_and_counter_clockwise(robot: Robot, seed: int) -> None:
    made = footprint(robot.geometry, shape_of(robot, seed))
    for pieces in (made.outer, made.inner, made.shrunk(1e-3).inner):
        sides = np.roll(pieces, -1, axis=1) - pieces
        ahead = np.roll(sides, -1, axis=1)
        assert (sides[..., 0] * ahead[..., 1] - sides[..., 1] * ahead[..., 0] > 0).all()


@given(robots, seeds, st.floats(0.0, 8e-3))
def test_shrunk_pieces_keep_away_from_the_edges_of_their_own(
    robot: Robot, seed: int, by_m: float
) -> None:
    made = footprint(robot.geometry, shape_of(robot, seed))
    smaller = made.shrunk(by_m)
    assert np.array_equal(smaller.outer, made.outer)
    wholes = shapely.polygons(made.inner)
    for piece in shapely.polygons(smaller.inner):
        gaps = [
            whole.exterior.distance(piece)
            for whole in wholes
            if shapely.covers(whole.buffer(SAME_M), piece)
        ]
        assert max(gaps) >= by_m - SAME_M


def test_what_is_thinner_than_twice_the_shrinking_is_gone() -> None:
    robot = ROBOTS[0]
    made = footprint(robot.geometry, [0.0, 0.0])
    thin = 2 * robot.geometry.fibre_radius_m
    assert len(made.shrunk(0.4 * thin).inner) > len(made.shrunk(0.6 * thin).inner) > 0
    assert not len(made.shrunk(1.0).inner)
    assert np.allclose(made.shrunk(0.0).inner, made.inner)


@given(robots, seeds, seeds)
def test_bending_moves_no_point_farther_than_it_says(robot: Robot, one: int, other: int) -> None:
    a, b = shape_of(robot, one), shape_of(robot, other)
    b = a + (b - a) * np.random.default_rng(one + other).choice([1.0, 0.1, 0.01])
    moved = np.linalg.norm(material_points(robot, a) - material_points(robot, b), axis=1).max()
    assert moved <= moved_by_bending_m(robot.geometry, np.abs(b - a)) + 1e-9


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_bound_of_bending_is_nearly_met(robot: Robot) -> None:
    """From straight, the farthest point of the robot moves nearly as far as the bound says."""
    count = robot.coordinates.segments
    straight = material_points(robot, np.zeros(count))
    for j, reach in enumerate(reach_per_curvature_m2(robot.geometry)):
        by = 1e-3 * np.eye(count)[j]
        moved = np.linalg.norm(material_points(robot, by) - straight, axis=1).max()
        assert 0.9 * reach * 1e-3 < moved <= reach * 1e-3 * (1 + 1e-6)
        assert moved_by_bending_m(robot.geometry, by) == pytest.approx(reach * 1e-3)


@given(robots, seeds)
@settings(max_examples=20)
def test_a_shape_bent_within_the_shrinking_holds_the_shrunk_pieces(robot: Robot, seed: int) -> None:
    """What the proofs of impossibility rest on: whatever the goal's box leaves, it is inside."""
    kappa, rng = shape_of(robot, seed), np.random.default_rng(seed)
    width = rng.uniform(0.0, 0.8, len(kappa))
    smaller = footprint(robot.geometry, kappa).shrunk(moved_by_bending_m(robot.geometry, width))
    other = kappa + width * rng.choice([-1, 1], len(kappa))
    body = drawn(robot, other).buffer(1e-5)
    left = union(smaller.inner, 0.0) if len(smaller.inner) else shapely.Polygon()
    assert shapely.difference(left, body).area == 0.0


def test_many_shapes_at_once_are_each_of_them() -> None:
    robot, kappa = ROBOTS[1], np.random.default_rng(0).uniform(-30, 30, (5, 2))
    kappa[0] = MOST_PER_M  # as many chords in all of them
    outer, inner = footprints(robot.geometry, kappa)
    one = footprint(robot.geometry, kappa[0])
    assert np.allclose(outer[0], one.outer)
    assert np.allclose(inner[0], one.inner)
    for row, pieces in zip(kappa, outer, strict=True):
        assert shapely.difference(drawn(robot, row), union(pieces)).area == 0.0


def test_what_curvatures_may_be_off_is_kept_on_top() -> None:
    robot = ROBOTS[0]
    sure, unsure = World(clearance_m=0.003), World(clearance_m=0.003, curvature_uncertainty_per_m=1)
    assert kept_m(sure, robot.geometry) == pytest.approx(0.003 - ROUNDING_M, abs=1e-12)
    extra = moved_by_bending_m(robot.geometry, 1.0)
    assert kept_m(unsure, robot.geometry) == pytest.approx(0.003 + extra - ROUNDING_M)
