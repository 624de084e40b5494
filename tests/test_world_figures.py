"""Obstacles and boxes to drive through in figures, films, the report and exports."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from once import planned, solved

from twosra_mpc import Plan, load_problem
from twosra_mpc.checking.surroundings import closest_approach
from twosra_mpc.checking.sweep import Clearance
from twosra_mpc.checking.verification import verify
from twosra_mpc.lab.report import report_page
from twosra_mpc.lab.report.page import scenario_toml
from twosra_mpc.plotting import figures, plot_plan
from twosra_mpc.plotting.playback import plan_playback
from twosra_mpc.plotting.scene import Scene
from twosra_mpc.plotting.world_figures import draw_world, names_m, shown_m
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array

FAR = Obstacle(name="moon", disc={"x_m": 50.0, "y_m": 0.0, "radius_m": 1.0})
NOTCHED = [(-0.3, 0.1), (-0.25, 0.12), (-0.2, 0.1), (-0.22, 0.2), (-0.3, 0.2)]


@cache
def among() -> Plan:
    """A plan with a wall beside its way, and a box on it."""
    made = planned("move-and-shape")
    x, y = made.trajectory.configuration(made.phases[0].end_s)[0, :2].tolist()
    wall = {"x_m": (-2.0, 2.0), "y_m": (-2.0, y - 0.05)}
    problem = made.problem.with_values(
        obstacles=[Obstacle(name="wall", box=wall), Obstacle(polygon_m=NOTCHED), FAR],
        tasks=[Pass(name="door", x_m=(x - 0.02, x + 0.02), y_m=(y - 0.01, y + 0.03))],
    )
    trajectory = replace(made.trajectory, problem=problem, done_s=(made.phases[0].end_s,))
    return replace(made, trajectory=trajectory, verification=verify(trajectory))


def nearest() -> Clearance:
    found = closest_approach(among().trajectory)
    assert found is not None
    return found


def view(ax: Any) -> Array:
    return np.array([ax.get_xlim(), ax.get_ylim()]).T


def drawn(ax: Any) -> tuple[list[Array], list[Array], list[str]]:
    """Outlines of obstacles, boxes with dashes, and all words of axes."""
    hatched = (item for item in ax.patches if isinstance(item, Polygon) and item.get_hatch())
    polygons = [np.array(item.get_xy())[:-1] for item in hatched]
    boxes = [np.array(item.get_bbox()) for item in ax.patches if isinstance(item, Rectangle)]
    return polygons, boxes, [text.get_text() for text in ax.texts]


def test_every_plane_of_a_plan_shows_its_surroundings() -> None:
    made = among()
    overview, *others = plot_plan(made).axes[: 1 + len(made.problem.stages)]
    for ax in (overview, *others):
        polygons, boxes, words = drawn(ax)
        for corners, obstacle in zip(polygons, made.problem.obstacles, strict=True):
            assert corners == pytest.approx(obstacle.inner_corners_m)
        assert boxes == [pytest.approx(made.problem.tasks[0].ends[:, :2])]
        assert {"wall", "obstacle 2", "door"} <= set(words)
        assert "moon" not in words
        assert np.abs(view(ax)).max() < 1.0  # far obstacles do not count
    red = [line for line in overview.lines if line.get_color() == figures.NEAREST_COLOUR]
    assert red[0].get_xydata() == pytest.approx(nearest().points_m)
    told = f"{1e3 * nearest().least_m:.1f} mm"
    assert told in drawn(overview)[2]
    legend = [text.get_text() for text in overview.figure.legends[0].get_texts()]
    assert f"nearest: {told}, wall at {nearest().at_s:.1f} s" in legend


def test_without_obstacles_nothing_is_said_of_them() -> None:
    made = planned("move-and-shape")
    ax = plot_plan(made).axes[0]
    assert drawn(ax) == ([], [], drawn(ax)[2])
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert not [words for words in legend if "nearest" in words or "obstacle" in words]
    points = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert (shown_m(made.problem, points) == points).all()


def test_what_is_near_is_seen_and_named_where_it_is_seen() -> None:
    problem = among().problem
    points = np.array([[-0.15, -0.12], [0.3, 0.1]])
    seen = shown_m(problem, points)
    assert (seen.min(axis=0) < points.min(axis=0)).any()
    assert np.abs(seen).max() <= 0.5
    low, high = seen.min(axis=0), seen.max(axis=0)
    named = names_m(problem, seen)
    assert "wall" in named
    assert "moon" not in named
    for x, y in named.values():
        assert (low <= (x, y)).all()
        assert ((x, y) <= high).all()


def test_films_show_surroundings_and_the_nearest_points() -> None:
    playback = plan_playback(among(), 0.1)
    scene = Scene(playback, ("robot", "end"), 1.0)
    plane = scene.figure.axes[0]
    polygons, boxes, words = drawn(plane)
    assert len(polygons) == 3
    assert len(boxes) == 1
    assert {"wall", "door"} <= set(words)
    low, high = view(plane)
    assert (low < -0.15).any()
    assert (low < playback.q[:, :2].min(axis=0)).all()
    assert (high > playback.q[:, :2].max(axis=0)).all()
    for row in (0, 500, 1000):
        scene.image(row)
        told = f"{1e3 * nearest().least_m:.1f} mm" in drawn(plane)[2]
        assert told == (playback.time_s[row] >= nearest().at_s)


def test_the_report_shows_them_and_can_be_planned_again(tmp_path: Path) -> None:
    result = replace(solved("move-and-shape"), problem=among().problem, plan=among())
    page = report_page(result)
    shapes = re.findall(r'<polygon class="obstacle" points="([^"]*)"', page)
    assert len(shapes) == 3
    first = np.array([pair.split(",") for pair in shapes[0].split()], dtype=float)
    wall = among().problem.obstacles[0].corners_m
    assert first == pytest.approx(wall * (1e3, -1e3), abs=0.01)
    assert len(re.findall('<polygon class="task"', page)) == 1
    words = f"{1e3 * nearest().least_m:.1f} mm, wall at {nearest().at_s:.1f} s"
    assert f"nearest to an obstacle: {words}" in page
    assert "Obstacles and slipping wheels are not" not in page
    file = tmp_path / "scenario.toml"
    file.write_text(scenario_toml(among().problem))
    again = load_problem(file)
    assert (again.obstacles, again.tasks) == (among().problem.obstacles, among().problem.tasks)


def test_a_workspace_is_drawn_to_its_edges() -> None:
    problem = solved("move-and-shape").problem.with_values(workspace={"x_m": (-1.0, 2.0)})
    ax = Figure().subplots()
    draw_world(ax, problem, np.array([[0.0, 0.0], [1.0, 1.0]]))
    (box,) = drawn(ax)[1]
    assert box[:, 0].tolist() == [-1.0, 2.0]
    assert np.abs(box[:, 1]).min() >= 10.0


def test_names_are_drawn_as_they_are_written(tmp_path: Path) -> None:
    """None is a formula: Matplotlib takes what is between two $ for one."""
    made, names = among(), ("Ba$$in $x$", r"a_b^{c} $\frac$ %s {0}")
    given = zip(made.problem.obstacles, names, strict=False)
    named = [each.model_copy(update={"name": name}) for each, name in given]
    problem = made.problem.with_values(obstacles=named)
    made = replace(made, trajectory=replace(made.trajectory, problem=problem))
    figure = plot_plan(made, tmp_path / "plan.svg")
    assert set(names) <= {text.get_text() for text in figure.axes[0].texts}
