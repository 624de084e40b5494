"""Free slices: sums and sweeps against brute force, and what is free against a drawn robot."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from worlds import ARC_ROBOT, STRAIGHT, corridor, random_world, true_margins

from twosra_mpc.problem.world import Obstacle, World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.space.convex import convex_parts
from twosra_mpc.space.footprint import Footprint, footprint, kept_m
from twosra_mpc.space.minkowski import (
    kept_by_all,
    merged,
    minkowski_sums,
    parts_around,
    parts_within,
    swept,
    turned,
)
from twosra_mpc.space.possible import Region, components_in
from twosra_mpc.space.slices import FreeSlices, certified_slices, possible_slices

SHAPES = (STRAIGHT, (30.0, 30.0), (40.0, -25.0), (-60.0, 20.0))


def both(world: World, kappa: tuple[float, ...], headings: int) -> tuple[FreeSlices, FreeSlices]:
    geometry = ARC_ROBOT.geometry
    kept, pieces = kept_m(world, geometry), footprint(geometry, kappa)
    return tuple(
        make(pieces, world, kept, headings) for make in (certified_slices, possible_slices)
    )


def holds(slices: FreeSlices, poses: Array) -> Array:
    return np.array([slices.component(pose) is not None for pose in poses])


def random_convex(rng: np.random.Generator) -> Array:
    hull = shapely.MultiPoint(rng.normal(size=(7, 2))).convex_hull
    return shapely.get_coordinates(shapely.orient_polygons(hull))[:-1]


def test_minkowski_sums_are_the_hulls_of_all_sums_of_corners() -> None:
    rng = np.random.default_rng(0)
    for _ in range(40):
        one, other = random_convex(rng), random_convex(rng)
        padded = np.concatenate([one, one[-1:]])
        found = shapely.Polygon(minkowski_sums(padded[None], other[None])[0, 0])
        hull = shapely.MultiPoint((one[:, None] + other).reshape(-1, 2)).convex_hull
        assert found.is_valid
        assert found.symmetric_difference(hull).area < 1e-12


@pytest.mark.parametrize("half_turn", [0.0, 0.01, 0.05, 0.3])
def test_sweeps_hold_every_turned_piece_and_every_turned_piece_what_all_keep(
    half_turn: float,
) -> None:
    pieces = np.array(footprint(ARC_ROBOT.geometry, (30.0, -20.0)).outer)
    for piece in pieces:
        outer = shapely.Polygon(swept(piece[None], half_turn, 0.002)[0])
        inner = [shapely.Polygon(c) for c in kept_by_all(piece[None], half_turn, 0.0)]
        grown = [shapely.Polygon(c) for c in kept_by_all(piece[None], half_turn, 0.002)]
        for angle in np.linspace(-half_turn, half_turn, 7):
            at = shapely.Polygon(turned(piece[None], np.array([angle]))[0, 0])
            around = at.buffer(0.002, quad_segs=64)
            assert outer.buffer(1e-9).covers(around)
            assert all(at.buffer(1e-9).covers(part) for part in inner)
            assert all(around.buffer(1e-6).covers(part) for part in grown)


@pytest.mark.parametrize("corners", [3, 60, 20_000])
def test_a_convex_outline_is_one_part_however_short_its_sides_are(corners: int) -> None:
    angles = np.linspace(0.0, 2 * np.pi, corners, endpoint=False)
    outline = 0.01 * np.column_stack([np.cos(angles), np.sin(angles)])
    (part,) = convex_parts(outline)
    np.testing.assert_array_equal(part, outline)


def test_points_on_the_sides_of_a_convex_outline_are_no_corners() -> None:
    square = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    along = np.linspace(square, np.roll(square, -1, axis=0), 8)[:-1]
    dense = turned(np.moveaxis(along, 0, 1).reshape(1, -1, 2), np.array([0.3]))[0, 0]
    (part,) = convex_parts(dense)
    np.testing.assert_array_equal(part, dense[::7])


def test_convex_parts_fill_their_obstacles_and_are_convex() -> None:
    corners = [(0, 0), (3, 0), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)]
    parts = parts_around([Obstacle(polygon_m=corners), Obstacle(polygon_m=corners[:3])], 0.0)
    areas = [shapely.Polygon(part).area for part in parts]
    hulls = [shapely.MultiPoint(part).convex_hull.area for part in parts]
    assert areas == pytest.approx(hulls)
    assert sum(areas) == pytest.approx(5 + 3)
    alone = convex_parts(np.array(corners, dtype=float))
    assert all(shapely.is_ccw(shapely.LinearRing(part)) for part in alone)
    assert len(parts) <= 5
    assert len(merged([np.array([(i, 0), (i + 1, 0), (i + 1, 1), (i, 1)]) for i in range(5)])) == 1


def sampled(worlds: int, count: int, headings: int = 72) -> tuple[int, int]:
    """How many poses are certified, and how many free, with none of them wrong."""
    certified = free = 0
    for seed, kappa in zip(range(worlds), itertools.cycle(SHAPES), strict=False):
        overrides = {} if seed % 4 else {"workspace": None, "clearance_m": 0.01}
        world = random_world(seed, **overrides)
        rng = np.random.default_rng(seed)
        poses = rng.uniform([-0.6, -0.6, -7.0], [0.6, 0.6, 7.0], (count, 3))
        margins = true_margins(world, kappa, poses)
        sure, possible = (holds(slices, poses) for slices in both(world, kappa, headings))
        assert margins[sure].min() > -1e-5
        assert possible[margins > 1e-5].all()
        certified += sure.sum()
        free += (margins > 1e-5).sum()
    return certified, free


def test_what_is_certified_is_free_and_what_is_free_is_possible() -> None:
    certified, free = sampled(worlds=2, count=60)
    assert 0.6 * free < certified < free


def decide(world: World, headings: int) -> str:
    ends = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    sure, possible = both(world, STRAIGHT, headings)
    if sure.component(ends[0]) == sure.component(ends[1]) is not None:
        return "certified"
    if possible.component(ends[0]) != possible.component(ends[1]):
        return "blocked"
    return "undecided"


def test_a_corridor_made_narrower_goes_from_certified_to_blocked_and_never_back() -> None:
    widths = np.arange(90, 50, -4)
    order = ["certified", "undecided", "blocked"]
    found = [order.index(decide(corridor(mm / 1e3), 72)) for mm in widths]
    assert found == sorted(found)
    assert {found[0], found[-1]} == {0, 2}
    assert found.count(1) * 4 <= 30


def test_finer_slices_decide_more() -> None:
    bands = [
        sum(decide(corridor(mm / 1e3), headings) == "undecided" for mm in range(56, 80, 4))
        for headings in (72, 180)
    ]
    assert bands[0] > bands[1]


@pytest.mark.parametrize("seed", range(2))
def test_a_mirrored_scene_has_mirrored_slices(seed: int) -> None:
    world, kappa = random_world(seed), (30.0, -10.0)
    flipped = [np.array(part) * [1, -1] for part in parts_around(world.obstacles, 0.0)]
    mirrored = World(
        workspace=world.workspace, obstacles=[{"polygon_m": part.tolist()} for part in flipped]
    )
    poses = np.random.default_rng(seed).uniform([-0.5, -0.5, -3], [0.5, 0.5, 3], (200, 3))
    pieces = footprint(ARC_ROBOT.geometry, kappa)
    turned_over = Footprint(
        *(part[:, ::-1] * np.array([1, -1]) for part in (pieces.outer, pieces.inner))
    )
    here = certified_slices(pieces, world, 0.002, 36)
    there = certified_slices(turned_over, mirrored, 0.002, 36)
    assert here.component_of.max() == there.component_of.max()
    assert (holds(here, poses) == holds(there, poses * [1, -1, -1])).all()
    assert shapely.area(here.parts).sum() == pytest.approx(shapely.area(there.parts).sum())


def test_outside_of_obstacles_without_a_workspace_all_is_connected() -> None:
    world = random_world(3, workspace=None)
    sure, possible = both(world, (30.0, 30.0), 36)
    far = np.array([[5.0, 3.0, 0.1], [-4.0, 0.2, 2.0], [0.1, -7.0, -2.0]])
    for slices in (sure, possible):
        assert len({slices.component(pose) for pose in far}) == 1


def test_the_distance_that_shapes_leave_between_them_is_that_of_their_components() -> None:
    wall = corridor(0.02)  # neither shape gets through
    (_, one), (_, other) = (both(wall, kappa, 36) for kappa in ((30.0, 30.0), STRAIGHT))
    start, goal = np.array([-0.5, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])
    left, right = components_in(one, start, start), components_in(other, goal, goal)
    ahead, behind = Region.of(one, left), Region.of(other, right)
    assert ahead.apart_m(Region.of(other, components_in(other, start, start))) == 0
    reached = [
        shapely.total_bounds(slices.parts[np.isin(slices.component_of, list(found))])
        for slices, found in ((one, left), (other, right))
    ]
    assert ahead.apart_m(behind) == pytest.approx(reached[1][0] - reached[0][2], abs=0.01)
    assert ahead.apart_m(Region.of(other, frozenset())) == np.inf


@pytest.mark.parametrize("seed", range(8))
def test_smoother_obstacles_hold_the_rough_ones_and_are_as_near_as_is_said(seed: int) -> None:
    rng, within_m = np.random.default_rng(seed), 4e-4 * (1 + seed)
    angles = (np.arange(30) + rng.uniform(-0.3, 0.3, 30)) * 2 * np.pi / 30
    radius = rng.uniform(0.03, [0.05, 0.031][seed % 2], 30)[:, None]
    rough = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    obstacle = Obstacle(polygon_m=tuple(map(tuple, rough.tolist())))
    own, parts = shapely.Polygon(rough), parts_around([obstacle], within_m)
    whole = shapely.union_all([shapely.Polygon(part) for part in parts])
    assert own.difference(whole).area < 1e-12
    assert whole.difference(own.buffer(within_m)).area < 1e-12
    for part in map(shapely.Polygon, parts):
        assert part.convex_hull.area == pytest.approx(part.area)
    assert len(parts) <= len(parts_around([obstacle], 0.0))
    inner = parts_within([obstacle])
    held = shapely.union_all([shapely.Polygon(part) for part in inner])
    assert held.difference(own).area < 1e-12
    assert own.difference(held.buffer(5e-3)).area < 1e-12
