"""What is around the robot, as values: what is accepted, and what every mistake is told."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from once import cases

from twosra_mpc import InputError, Problem, load_problem, plan
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.problem.world import MOST_CORNERS, MOST_OBSTACLES, Obstacle, World

START = {"x_m": -0.3, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
GOAL = {**START, "x_m": 0.3}
POST = {"name": "post", "disc": {"x_m": 0.0, "y_m": 0.3, "radius_m": 0.05}}


def scene(*obstacles: dict[str, Any], **overrides: Any) -> Problem:
    base = {"robot": "2sra-v1", "start": START, "goal": GOAL, "obstacles": list(obstacles)}
    return Problem(**{**base, **overrides})


@pytest.mark.parametrize(("corners", "allowed"), cases("world")["corners"])
def test_a_polygon_that_is_none_is_refused_by_its_index(corners: Any, allowed: str) -> None:
    with pytest.raises(InputError, match=allowed) as caught:
        scene(POST, POST | {"name": ""}, {"polygon_m": corners})
    assert caught.value.field.startswith("obstacles.2.polygon_m")


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"disc": {"x_m": 0.0, "y_m": 0.0, "radius_m": 0.0}}, "obstacles.1.disc.radius_m"),
        ({"disc": {"x_m": 0.0, "y_m": 0.0, "radius_m": -0.1}}, "obstacles.1.disc.radius_m"),
        ({"disc": {"x_m": math.nan, "y_m": 0.0, "radius_m": 0.1}}, "obstacles.1.disc.x_m"),
        ({"box": {"x_m": [0.1, 0.1], "y_m": [0, 1]}}, "obstacles.1.box.x_m"),
        ({"box": {"x_m": [0, 1], "y_m": [1, 0]}}, "obstacles.1.box.y_m"),
        ({"name": "nothing"}, "obstacles.1"),
        ({**POST, "box": {"x_m": [0, 1], "y_m": [0, 1]}}, "obstacles.1"),
        ({**POST}, "obstacles.1.name"),
        ({"dics": POST["disc"]}, "obstacles.1.dics"),
    ],
)
def test_an_obstacle_that_is_none_is_refused_by_its_index(given: Any, field: str) -> None:
    for make in (lambda: scene(POST, given), lambda: World(obstacles=[POST, given])):
        with pytest.raises(InputError) as caught:
            make()
        assert field in [error.field for error in (caught.value, *caught.value.others)]


@pytest.mark.parametrize(
    ("name", "value"),
    [("clearance_m", -1e-3), ("clearance_m", math.nan), ("curvature_uncertainty_per_m", -1.0)],
)
def test_what_is_to_be_kept_is_not_negative(name: str, value: float) -> None:
    with pytest.raises(InputError) as caught:
        scene(POST, **{name: value})
    assert caught.value.field == name


def test_a_name_twice_and_a_wrong_goal_are_told_at_once() -> None:
    with pytest.raises(InputError) as caught:
        scene(POST, POST, POST, goal={**GOAL, "kappa_per_m": [500.0, 0.0]})
    fields = [error.field for error in (caught.value, *caught.value.others)]
    assert fields == ["goal.kappa_per_m.0", "obstacles.1.name", "obstacles.2.name"]


def test_direction_and_overlap_do_not_matter() -> None:
    corners = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.1, 0.05]]
    one, other = (Obstacle(polygon_m=each) for each in (corners, corners[::-1]))
    assert shapely.Polygon(one.corners_m).equals(shapely.Polygon(other.corners_m))
    for each in (one, other):
        assert shapely.LinearRing(each.corners_m).is_ccw
    assert len(World(obstacles=[one, other]).obstacles) == 2


@pytest.mark.parametrize("radius_m", [1e-3, 0.05, 2.0])
def test_a_disc_lies_between_its_polygons(radius_m: float) -> None:
    disc = Obstacle(disc={"x_m": 0.3, "y_m": -0.2, "radius_m": radius_m})
    angles = np.linspace(0, 2 * np.pi, 500)
    rim = np.array([0.3, -0.2]) + radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
    outer, inner = shapely.Polygon(disc.corners_m), shapely.Polygon(disc.inner_corners_m)
    assert outer.buffer(1e-9).covers(shapely.Polygon(rim))
    assert shapely.Polygon(rim).buffer(1e-4 * radius_m).covers(inner)
    assert outer.area < 1.02 * math.pi * radius_m**2


def test_names_tell_obstacles_apart() -> None:
    box = {"box": {"x_m": [0, 1], "y_m": [0, 1]}}
    assert World(obstacles=[box, POST, box]).names == ("obstacle 1", "post", "obstacle 3")


def test_a_pass_counts_headings_modulo_full_turns() -> None:
    box = Pass(phi_rad=(3.0, 3.4), x_m=(0.0, 1.0))
    poses = np.array([[0.5, 9, 3.2], [0.5, 9, 3.2 - 2 * np.pi], [0.5, 9, 2.9], [1.1, 9, 3.2]])
    assert box.met(poses).tolist() == [True, True, False, False]
    assert np.isinf(box.ends[:, 1]).all()


def test_a_scenario_survives_its_file(tmp_path: Path) -> None:
    wall = {"polygon_m": [[0, 0.3], [0.1, 0.3], [0.05, 0.4]]}
    tasks = [{"do": "pass", "x_m": [-0.1, 0.1]}, {"do": "reach", **GOAL}]
    made = scene(
        POST, wall, clearance_m=0.004, workspace={"x_m": [-1, 1]}, goal=GOAL, tasks=tasks[:1]
    )
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(made.scenario()))
    assert load_problem(path) == made
    document = {**made.scenario(), "tasks": tasks}
    del document["goal"]
    path.write_text(json.dumps(document))
    assert load_problem(path) == made.with_values(goal=load_problem(path).goal)
    assert load_problem(path).goal.configuration.tolist() == made.goal.configuration.tolist()
    assert made.world == World(**dict(made.world))


@pytest.mark.parametrize("end", ["start", "goal"])
def test_an_end_that_overlaps_is_refused_with_what_and_by_how_much(end: str) -> None:
    x = -0.3 if end == "start" else 0.3
    half = 0.004  # of the fibre, straight along x
    box = {"name": "bar", "box": {"x_m": [x - 5e-3, x + 5e-3], "y_m": [half - 1.5e-3, 0.2]}}
    with pytest.raises(InputError, match=r"overlaps? bar by 1\.5 mm") as caught:
        plan(scene(POST, box))
    assert caught.value.field == end


def ring(corners: int, inner: float = 1.0) -> list[tuple[float, float]]:
    """Corners on a circle, every other one at a share of its radius."""
    angles = np.linspace(0.0, math.tau, corners, endpoint=False)
    radius = np.where(np.arange(corners) % 2, inner, 1.0)
    return list(zip(radius * np.cos(angles), radius * np.sin(angles), strict=True))


@pytest.mark.parametrize("seed", range(60))
def test_an_outline_is_refused_exactly_if_it_is_no_ring(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.permutation(64)[: rng.integers(3, 9)]
    outline = [(float(each // 8), float(each % 8)) for each in corners]
    if abs(shapely.LinearRing(outline).convex_hull.area) < 1e-9:
        return
    try:
        Obstacle(polygon_m=tuple(outline))
    except InputError:
        assert not shapely.LinearRing(outline).is_simple
    else:
        assert shapely.LinearRing(outline).is_simple


@pytest.mark.parametrize(("inner", "corners"), [(1.0, MOST_CORNERS), (0.5, 2_000)])
def test_as_many_corners_as_are_allowed_are_accepted(inner: float, corners: int) -> None:
    """Also those of a star, whose sides are within the boxes around half of the others."""
    assert len(Obstacle(polygon_m=tuple(ring(corners, inner))).corners_m) == corners


def test_too_many_corners_or_obstacles_are_refused_with_a_way_out() -> None:
    with pytest.raises(InputError, match=r"60000.*at most 20,000 corners.*simplify\(0.001\)"):
        Obstacle(polygon_m=tuple(ring(60_000)))
    posts = tuple(Obstacle(disc={"x_m": 0.1 * i, "y_m": 5.0, "radius_m": 0.01}) for i in range(10))
    with pytest.raises(InputError, match=r"4000.*at most 1,000 obstacles.*union_all"):
        World(obstacles=posts * (4 * MOST_OBSTACLES // len(posts)))
