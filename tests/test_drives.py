"""Drives among obstacles: certified ones are clear, and roads leave nothing out."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import shapely
from worlds import ARC_ROBOT, STRAIGHT, corridor, random_world, true_margins

from benchmarks.studies.passages import decide
from twosra_mpc.model.flow import roll_out, twists
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.problem.speeds import rigid_rows
from twosra_mpc.problem.world import World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import RIGID
from twosra_mpc.space.balls import Balls, Room
from twosra_mpc.space.drives import Drives
from twosra_mpc.space.footprint import footprint, kept_m
from twosra_mpc.space.lattice import lattice
from twosra_mpc.space.roadmap import roadmap
from twosra_mpc.space.screws import clear_legs, moved
from twosra_mpc.space.slices import FreeSlices, certified_slices, components

BENT = (30.0, 30.0)


def slices_of(world: World, kappa: tuple[float, ...], headings: int = 36) -> FreeSlices:
    geometry = ARC_ROBOT.geometry
    return certified_slices(footprint(geometry, kappa), world, kept_m(world, geometry), headings)


def along(poses: Array, points: int = 60) -> Array:
    """Poses on every leg of a drive, (m, 3)."""
    shares = np.tile(np.linspace(0, 1, points), len(poses) - 1)
    start, end = (np.repeat(part, points, axis=0) for part in (poses[:-1], poses[1:]))
    return moved(start, twists(start, end), shares)


@pytest.mark.parametrize("seed", range(2))
def test_balls_are_free_and_a_way_through_them_is_clear(seed: int) -> None:
    """What a pose spares is no more than there is, and all within that travel of it is free."""
    rng, world, geometry = np.random.default_rng(seed), random_world(seed), ARC_ROBOT.geometry
    outlines = [shapely.Polygon(each.corners_m).segmentize(2e-3) for each in world.obstacles]
    corners = [shapely.get_coordinates(outline)[:-1] for outline in outlines]
    world = world.with_values(
        obstacles=[{"polygon_m": c + rng.uniform(-1e-4, 1e-4, c.shape)} for c in corners]
    )
    pieces = footprint(geometry, BENT, 5e-5)
    room, radius_m = Room(pieces, world, kept_m(world, geometry)), pieces.radius_m
    poses = rng.uniform([-0.5, -0.5, -np.pi], [0.5, 0.5, np.pi], (150, 3))
    spare_m = room.spare_m(poses)
    free = poses[spare_m > 0], spare_m[spare_m > 0]
    assert (free[1] <= true_margins(world, BENT, free[0]) + 1e-6).all()
    turns = rng.uniform(-1, 1, len(free[1]))
    angle, by = rng.uniform(-np.pi, np.pi, len(turns)), free[1] * (1 - np.abs(turns))
    within = np.column_stack([by * np.cos(angle), by * np.sin(angle), turns * free[1] / radius_m])
    assert true_margins(world, BENT, free[0] + within).min() >= -2e-6
    start, goal = free[0][0], free[0][-1]
    found = Balls(room.spare_m, radius_m, np.array([start, goal])).way()
    assert found is not None
    assert np.abs(found[[0, -1]] - [start, goal])[:, :2].max() == 0
    assert true_margins(world, BENT, along(found, 3)).min() >= -2e-6


def test_screws_end_where_they_should_with_a_constant_twist() -> None:
    rng = np.random.default_rng(0)
    start, end = rng.uniform(-2, 2, (2, 50, 3))
    twist = twists(start, end)
    off = moved(start, twist, np.ones(50)) - end
    off[:, 2] = (off[:, 2] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-12
    half = moved(start, twist, np.full(50, 0.5))
    assert np.abs(twists(half, end) - twist / 2).max() < 1e-12
    speed = (moved(start, twist, np.full(50, 1e-7)) - start) / 1e-7
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    ahead = np.column_stack([c * speed[:, 0] + s * speed[:, 1], c * speed[:, 1] - s * speed[:, 0]])
    assert np.abs(ahead - twist[:, :2]).max() < 1e-5


def test_a_world_without_free_slices_has_no_roads_to_offer() -> None:
    tight = World(workspace={"x_m": (-0.05, 0.05), "y_m": (-0.05, 0.05)})
    drives = Drives(ARC_ROBOT, tight, BENT)
    assert not len(drives.certified_slices(drives.headings[0]).parts)
    assert drives.spread(10).shape == (0, 3)
    assert drives.estimates_s(np.zeros(3), np.zeros((2, 3))).tolist() == [0.0, 0.0]


def test_times_of_legs_are_those_of_the_limits() -> None:
    """As a plan drives them, to the last digit: none seems to be hidden that is not."""
    drives = Drives(ARC_ROBOT, World(), BENT)
    rng = np.random.default_rng(3)
    end = np.vstack([[0.001, 0.0, 0.0], [0.3, 0.2, 1.0], rng.uniform(-0.5, 0.5, (20, 3))])
    for time, twist in zip(
        drives.leg_times_s(np.zeros_like(end), end), twists(np.zeros(3), end), strict=True
    ):
        inputs = np.concatenate([[0.0, 0.0], twist]).reshape(1, 1, -1)
        motion = roll_out(ARC_ROBOT, np.array([0.0, 0.0, 0.0, *BENT]), (RIGID,), inputs)
        assert time == pytest.approx(fastest(motion)[0].duration_s, rel=1e-6)


def test_legs_are_clear_exactly_where_their_least_distance_allows_it() -> None:
    rng = np.random.default_rng(1)
    start, end = rng.uniform(-1, 1, (2, 80, 3))

    def clear(poses: Array) -> Array:  # of a disc of radius 0.1 to the origin: exact
        return np.hypot(*poses[:, :2].T) - 0.1

    twist = twists(start, end)
    least = [
        clear(moved(p, s, np.linspace(0, 1, 2000))).min() for p, s in zip(start, twist, strict=True)
    ]
    found = clear_legs(clear, start, twist, 0.0, 0.2)
    assert (found == (np.array(least) >= 0.2)).all()
    assert 10 < found.sum() < 70


@pytest.mark.parametrize(("seed", "kappa"), [(0, BENT), (1, STRAIGHT), (2, (40.0, -25.0))])
def test_roads_connect_exactly_what_slices_do(seed: int, kappa: tuple[float, ...]) -> None:
    slices = slices_of(random_world(seed, 9), kappa)
    roads = roadmap(slices, rigid_rows(ARC_ROBOT, kappa), 0.05)
    label = components(len(roads.poses), roads.edges)
    component = [slices.component(pose) for pose in roads.poses[::7]]
    pairs = {(c, int(own)) for c, own in zip(component, label[::7], strict=True) if c is not None}
    assert len(pairs) == len({c for c, _ in pairs}) == len({own for _, own in pairs})
    assert label.max() == slices.component_of.max()
    assert component.count(None) < 0.01 * len(component)  # on the edge but for rounding


def test_grid_nodes_and_moves_are_those_inside_the_slices() -> None:
    slices = slices_of(random_world(4, 9), BENT, 12)
    grid = lattice(slices, 0.05)
    k = slices.index_of(grid.poses[:, 2])
    assert all(slices.parts_at(pose) for pose in grid.poses[::7])
    free = shapely.union_all(slices.parts[slices.first[3] : slices.first[4]])
    x, y = (0.05 * v.ravel() for v in np.meshgrid(np.arange(-14, 15), np.arange(-14, 15)))
    assert (k == 3).sum() == shapely.contains_xy(free, x, y).sum()
    here = grid.poses[k == 3, :2]
    one, other = np.triu_indices(len(here), k=1)
    near = np.abs(here[one] - here[other]).max(axis=1) < 0.06
    lines = shapely.linestrings(np.stack([here[one[near]], here[other[near]]], axis=1))
    assert (k[grid.moves[:, 0]] == 3).sum() == shapely.contains(free, lines).sum()
    assert (np.diff(k[grid.turns], axis=1) % 12 == 1).all()


@pytest.mark.parametrize(("seed", "kappa"), [(5, BENT), (6, STRAIGHT), (9, (40.0, -25.0))])
def test_drives_are_clear_in_a_drawn_robots_eyes(seed: int, kappa: tuple[float, ...]) -> None:
    world = random_world(seed, 10)
    drives = Drives(ARC_ROBOT, world, kappa)
    rng = np.random.default_rng(seed)
    poses = rng.uniform([-0.5, -0.5, -3], [0.5, 0.5, 3], (300, 3))
    poses = poses[drives.clear(poses) > drives.kept_m][:6]
    found = 0
    for start, goal in zip(poses[::2], poses[1::2], strict=True):
        drive, verdict = drives.best(start, goal), decide(drives, start, goal)[0]
        assert (drive is not None) == (verdict == "certified")
        if drive is not None:
            assert drives.proof(drive[0], drive[-1])(drive[:-1], drive[1:]).all()
            assert true_margins(world, kappa, along(drive)).min() > -1e-5
            assert (drive[0] == start).all()
            assert np.allclose(np.exp(1j * drive[-1]), np.exp(1j * goal))
            assert (np.abs(np.diff(drive[:, 2])) <= np.pi).all()
            found += 1
    assert found >= 2


def test_a_corridor_of_90_mm_is_driven_through_and_one_of_50_mm_proved_blocked() -> None:
    start, goal = np.array([-0.5, 0.1, 2.0]), np.array([0.5, -0.1, -1.0])
    world = corridor(0.09)
    drives = Drives(ARC_ROBOT, world, STRAIGHT)
    drive = drives.best(start, goal)
    assert drive is not None
    assert drives.proof(drive[0], drive[-1])(drive[:-1], drive[1:]).all()
    assert true_margins(world, STRAIGHT, along(drive)).min() > -1e-5
    assert drives.time_s(drive) < 2 * drives.time_s(np.array([start, goal]))
    narrow = Drives(ARC_ROBOT, corridor(0.05), STRAIGHT)
    assert narrow.best(start, goal) is None
    assert decide(narrow, start, goal)[0] == "blocked"


def test_a_start_nearer_than_the_clearance_is_left_and_one_that_overlaps_is_not() -> None:
    world = World(obstacles=[{"box": {"x_m": (0.0, 0.2), "y_m": (-0.2, 0.2)}}], clearance_m=0.01)
    drives = Drives(ARC_ROBOT, world, STRAIGHT)
    goal = np.array([0.4, 0.0, 1.0])
    near, inside = np.array([-0.145 - 0.004, 0.0, 0.0]), np.array([-0.1, 0.0, 0.0])
    assert drives.kept_m - drives.lent_m(near) == pytest.approx(0.004)
    drive = drives.best(near, goal)
    assert drive is not None
    margins = true_margins(world, STRAIGHT, along(drive)) + world.clearance_m
    assert margins.min() > 0.0039 - 1e-5
    assert margins[60:].min() > 0.01 - 1e-5
    assert drives.best(inside, goal) is None
    assert decide(drives, inside, goal)[0] == "blocked"


@pytest.mark.parametrize("apart_m", [0.0005, 0.0019, 0.00199])
def test_a_tight_wall_is_left_alongside(apart_m: float) -> None:
    """A leg parallel to the wall keeps what the start does, and no more."""
    edge = 0.036 + apart_m  # wheels reach 36 mm to the side
    wall = {"box": {"x_m": (-0.5, 0.8), "y_m": (edge, edge + 0.05)}}
    world = World(obstacles=[wall], clearance_m=0.002)
    drives = Drives(ARC_ROBOT, world, STRAIGHT)
    start, along_it = np.zeros(3), np.array([0.3, 0.0, 0.0])
    assert true_margins(world, STRAIGHT, start[None])[0] == pytest.approx(apart_m - 0.002, abs=1e-6)
    assert drives.clear_legs(start, along_it, drives.lent_m(start)).all()
    assert not drives.clear_legs(start, along_it).any()
    nearer = np.array([0.3, 3e-4, 0.0])
    assert not drives.clear_legs(start, nearer, drives.lent_m(start)).any()


def test_a_goal_that_no_slice_holds_is_reached_by_a_straight_leg() -> None:
    world = corridor(0.081, 0.6)
    drives = Drives(ARC_ROBOT, world, STRAIGHT, headings=(12,))
    start, goal = np.array([-0.5, 0.1, 2.0]), np.array([-0.27, 0.0, 0.0])
    assert drives.certified_slices(12).component(goal) is None
    drive = drives.best(start, goal)
    assert drive is not None
    assert true_margins(world, STRAIGHT, along(drive)).min() > -1e-5


def test_fields_say_how_long_it_takes_to_get_there() -> None:
    drives = Drives(ARC_ROBOT, random_world(5, 6), BENT)
    start = np.array([-0.4, -0.4, 0.0])
    field = drives.field(start)
    assert field is not None
    for i in range(0, len(field.times_s), 997):
        node, time = field.roadmap.poses[i], field.times_s[i]
        path = field.path(node)
        if path is not None and np.isfinite(time):
            legs = twists(path[:-1], path[1:])
            assert (path[0] == start).all()
            assert np.abs(legs @ drives.rows.T).max(axis=1).sum() <= time + 1e-3
    assert np.isfinite(field.times_s).mean() > 0.9
    assert drives.field(np.array([0.59, 0.59, 0.0])) is None


@pytest.mark.parametrize(("wide_m", "poses"), [(0.1, 3), (0.25, 4)])
def test_walls_that_one_or_two_poses_get_around_need_no_polygons(wide_m: float, poses: int) -> None:
    code = f"""if True:
        import sys
        import numpy as np
        from twosra_mpc import load_robot
        from twosra_mpc.problem.world import World
        from twosra_mpc.space.drives import Drives
        walls = [(-0.15, -{wide_m}, 0.08), (0.15, -0.08, {wide_m})]
        world = World(obstacles=[{{"box": {{"x_m": (x, x + 0.02), "y_m": y}}}} for x, *y in walls])
        drives = Drives(load_robot("2sra-v1"), world, (0.0, 0.0))
        assert len(drives.best(np.array([-0.4, 0, 0]), np.array([0.5, 0.1, 0]))) == {poses}
        assert "shapely" not in sys.modules
    """
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("obstacles", [[], [{"box": {"x_m": (0.0, 0.01), "y_m": (0.0, 0.01)}}]])
def test_where_the_robot_does_not_fit_nothing_is_driven(obstacles: list[dict[str, object]]) -> None:
    edges = {"x_m": (-0.05, 0.05), "y_m": (-0.05, 0.05)}
    drives = Drives(ARC_ROBOT, World(workspace=edges, obstacles=obstacles), STRAIGHT)
    start, goal = np.zeros(3), np.array([0.01, 0.0, 0.5])
    assert drives.best(start, goal) is None
    assert decide(drives, start, goal)[0] == "blocked"
    assert drives.field(start) is None
