"""One body: what meets the world is a unit's frame, wheels are where the kinematics has them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from flint import arb
from matplotlib.figure import Figure

from twosra_mpc import InputError, Robot, load_plan, load_problem, load_robot, plan, robot_names
from twosra_mpc.checking.clearance import Surroundings
from twosra_mpc.checking.fibre import nearest
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.lab.export.robot_chain import urdf
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.outline import outline_points, robot_shape
from twosra_mpc.physics.mjcf import mjcf
from twosra_mpc.plotting.plane import draw_outline, draw_robot
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.problem.world import Box, Obstacle, Workspace, World
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.space.contour import Contour, apart_m, parts
from twosra_mpc.space.footprint import footprints
from twosra_mpc.space.possible import blocked_unit, unit_apart
from twosra_mpc.space.separation import Proximity, placed

ROBOT = load_robot("2sra-v1")
STRAIGHT, BENT = np.zeros(5), np.array([0.1, -0.05, 0.4, 12.0, 20.0])
POST_M = 0.05  # from the straight robot's axis to a post beside the middle of unit 2


def middle_m(geometry: Geometry) -> float:
    """From b0 of the straight robot to the middle of a unit."""
    return geometry.middle_link_m / 2 + geometry.lengths_m[0] + geometry.unit_middle_m[0]


def post(robot: Robot) -> Obstacle:
    x = middle_m(robot.geometry)
    return Obstacle(box=Box(x_m=(x - 1e-3, x + 1e-3), y_m=(POST_M, 2 * POST_M)))


def by_gap(robot: Robot, gap_m: float) -> float:
    """Side of frames that face each other along the straight robot."""
    return 2 * middle_m(robot.geometry) - gap_m


def gap_of_proofs(robot: Robot) -> float:
    """As the certificate has it: units that must be 1 m apart are what is nearest."""
    far = robot.with_values(limits=robot.limits.with_values(unit_gap_m=1.0))
    return nearest(far, [[arb(0), arb(0)]]).apart_m + 1.0


def of_boxes(document: str, box: str, share: float) -> float:
    """Side of the square boxes of a document; they are alike."""
    sizes = {tuple(each.get("size", "").split()[:2]) for each in square_boxes(document, box)}
    (only,) = {float(side) for size in sizes for side in size}
    return only / share


def square_boxes(document: str, box: str) -> list[ElementTree.Element]:
    found = ElementTree.fromstring(document).iterfind(f".//{box}")
    return [each for each in found if len(set(each.get("size", "1 2").split()[:2])) == 1]


SIDES: dict[str, Callable[[Robot], float]] = {
    "limits": lambda r: by_gap(r, shape_margins(r, STRAIGHT[3:])["unit_gap_m"][0]),
    "proofs": lambda r: by_gap(r, gap_of_proofs(r)),
    "verification": lambda r: (
        2 * (POST_M - Surroundings(world(post(r)), r.geometry).nearest(STRAIGHT)[0])
    ),
    "guard": lambda r: (
        2 * (POST_M - Proximity(world(post(r)), r.geometry).nearest(STRAIGHT).distance_m)
    ),
    "contact": lambda r: (
        2
        * (
            POST_M
            - apart_m(r.geometry, Contour.of(post(r)), parts(r.geometry, STRAIGHT[None], 1))[0]
        )
    ).item(),
    "MJCF": lambda r: of_boxes(mjcf(r), "geom[@type='box']", 0.5),
    "URDF": lambda r: of_boxes(urdf(r), "box", 1.0),
}


def drawn(geometry: Geometry) -> dict[str, Array]:
    """Corners of both units (2, 4, 2) of the bent robot, by all that have them."""
    outer, _ = footprints(geometry, BENT[None, 3:])
    solid, dashed = (Figure().add_subplot() for _ in range(2))
    draw_robot(solid, geometry, BENT, (0, 0))
    draw_outline(dashed, geometry, BENT)
    return {
        "outline": robot_shape(geometry, BENT).units,
        "hull": outline_points(geometry)(BENT).full().T[:8].reshape(2, 4, 2),
        "footprint": placed(outer[:, :2], BENT[None])[0],
        "contact": np.stack([parts(geometry, BENT[None], j).solids[0, 1] for j in (0, 1)]),
        "figure": np.stack([patch.get_xy()[:4] for patch in solid.patches[:2]]),
        "plan": np.stack([patch.get_xy()[:4] for patch in dashed.patches[:2]]),
    }


def world(*obstacles: Obstacle) -> World:
    return World(obstacles=obstacles)


def changed(**lengths_m: float) -> Robot:
    return ROBOT.with_values(geometry=ROBOT.geometry.with_values(**lengths_m))


def wider_wheels(by_m: float) -> Robot:
    """The square of the wheels is wider about the same middle."""
    given = ROBOT.geometry
    return changed(unit_side_m=given.unit_side_m + by_m, end_link_m=given.end_link_m - by_m / 2)


@pytest.mark.parametrize("frame_m", [0.046, 0.051])
@pytest.mark.parametrize("consumer", SIDES)
def test_whatever_takes_the_body_takes_the_frame(consumer: str, frame_m: float) -> None:
    for robot in (changed(unit_frame_m=frame_m), wider_wheels(4e-3)):
        side_m = SIDES[consumer](robot)
        assert side_m == pytest.approx(robot.geometry.unit_frame_m, abs=2e-6)


@pytest.mark.parametrize("robot", [ROBOT, changed(unit_frame_m=0.051), wider_wheels(4e-3)])
def test_units_are_drawn_where_they_meet_the_world(robot: Robot) -> None:
    outline, *others = map(
        shapely.multipolygons, map(shapely.polygons, drawn(robot.geometry).values())
    )
    assert outline.area == pytest.approx(2 * robot.geometry.unit_frame_m**2)
    for other in others:
        assert shapely.hausdorff_distance(outline, other) < 1e-9


@pytest.mark.parametrize("more_m", [-1e-3, 1e-3])
@pytest.mark.parametrize("frame_m", [0.046, 0.051])
def test_a_gap_blocks_a_unit_exactly_if_it_is_narrower_than_the_frame(
    frame_m: float, more_m: float
) -> None:
    half = (frame_m + more_m) / 2
    walls = [Obstacle(box=Box(x_m=(-0.02, 0.02), y_m=y)) for y in ((half, 0.3), (-0.3, -half))]
    room = Workspace(x_m=(-0.5, 0.5), y_m=(-0.3, 0.3))
    here, there = (STRAIGHT + x * np.eye(5)[0] for x in (-0.28, 0.28))
    geometry = changed(unit_frame_m=frame_m).geometry
    world = World(obstacles=walls, workspace=room)
    assert (blocked_unit(geometry, world, here, there, 0.0) is None) == (more_m > 0)
    for kept_m, blocked in ((0.0, True), (-0.02, False)):  # wheels stand out by 13 mm
        assert (unit_apart(geometry, world, (here, there), (0.0, 0.0), kept_m) is None) != blocked


def wheels_of(robot: Robot) -> dict[str, Array]:
    """Places of the wheels of the bent robot (4, 2), or in their fibre ends for MJCF."""
    tree = ElementTree.fromstring(mjcf(robot))
    bodies = [tree.find(f".//body[@name='wheel{i}']") for i in (1, 2, 3, 4)]
    own = [each.get("pos", "").split()[:2] for each in bodies if each is not None]
    return {
        "outline": robot_shape(robot.geometry, BENT).wheels.mean(axis=1),
        "kinematics": kinematics(robot).wheel_poses(BENT).full()[:2].T,
        "MJCF": np.array(own, dtype=float),
    }


def test_wheels_do_not_follow_the_frame_and_the_frame_does_not_follow_them() -> None:
    by_m, given = 4e-3, wheels_of(ROBOT)
    for name, places in wheels_of(changed(unit_frame_m=0.051)).items():
        np.testing.assert_array_equal(places, given[name])
    for name, places in wheels_of(wider_wheels(by_m)).items():
        out_m = np.linalg.norm(places - given[name], axis=1)
        np.testing.assert_allclose(out_m, by_m / 2, atol=1e-8)
    before, after = (drawn(robot.geometry)["outline"] for robot in (ROBOT, wider_wheels(by_m)))
    np.testing.assert_allclose(after, before, atol=1e-12)


# --- the numbers


LENGTHS = re.compile(r"^(\w+) = \[?[-\d]")
SOURCE = re.compile(r"# .*\b(paper,? (I+\b|II-[A-D]|Table I)|code|uncertain|chosen)\b")


@pytest.mark.parametrize("name", robot_names())
def test_every_geometric_number_has_a_source(name: str) -> None:
    """In its own line: a section of the paper, the authors' code, or that it is a guess."""
    table, counted = "", 0
    for line in files("twosra_mpc").joinpath(f"robots/{name}.toml").read_text("utf-8").splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key = LENGTHS.match(line)
        measure = table == "segment" and key and key[1].endswith("_m")
        if key and (measure or table in ("geometry", "geometry.wheels", "path")):
            assert SOURCE.search(line), f"{name}, [{table}]: {line}"
            counted += 1
    assert counted >= 8


def test_the_papers_robot_is_the_papers() -> None:
    """Frame, tube and wheels of sections II-A and II-B; h1, h2, h3 of the authors' kinematics."""
    geometry = ROBOT.geometry
    assert (geometry.unit_frame_m, geometry.wheel_radius_m) == (0.046, 0.010)
    assert (geometry.side_wheel_m, *geometry.front_wheel_m) == pytest.approx(
        (0.0825, 0.054, 0.0285)
    )
    seen_m = geometry.unit_middle_m[0] - geometry.unit_frame_m / 2
    assert seen_m == pytest.approx(0.030, abs=1.01e-3)
    for name in ("2sra-v1-paper", "3sra"):
        other = load_robot(name).geometry
        assert other.with_values(segments=geometry.segments) == geometry


# --- files


def test_a_robot_file_must_say_its_frame() -> None:
    document = ROBOT.model_dump(mode="json")
    del document["geometry"]["unit_frame_m"]
    with pytest.raises(InputError, match=r"unit_frame_m.*required.*outline") as error:
        Robot.parse(document, "mine.toml")
    assert error.value.field == "geometry.unit_frame_m"


def test_a_plan_of_before_has_the_body_it_was_planned_with(tmp_path: Path) -> None:
    small = changed(unit_frame_m=ROBOT.geometry.unit_side_m)
    result = plan(load_problem("shape-change").with_values(robot=small))
    document = json.loads(json.dumps(result.to_dict()))
    del document["robot"]["geometry"]["unit_frame_m"]
    (path := tmp_path / "before.json").write_text(json.dumps(document), encoding="utf-8")
    assert load_plan(path).problem.robot == small
    found = [check.name for check in check_plan(path).checks if not check.ok]
    assert found == ["robot"]
