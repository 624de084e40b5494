"""Missions in figures, films, the report and exports: objects, contact, tasks."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forged_missions import CUP_IN_B0, fetched, reshaped
from matplotlib.colors import to_hex
from matplotlib.patches import Polygon
from test_missions import SCENARIOS

from twosra_mpc import Plan, load_problem
from twosra_mpc.lab.analysis.explanation import task_costs
from twosra_mpc.lab.report import report_page
from twosra_mpc.lab.report.page import scenario_toml
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.plan import Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.plans.trajectory import Stretch, stretches
from twosra_mpc.plotting import (
    figures,
    plot_plan,
    timeline_figures,
    world_figures,
)
from twosra_mpc.plotting.playback import plan_playback
from twosra_mpc.plotting.scene import Scene
from twosra_mpc.problem.tasks import Stage
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array, composed


def result(made: Plan) -> Result:
    return Result(
        made.problem, "optimal", Status.FEASIBLE, "", None, None, Stats(0.0, 0, 0, 0), made
    )


@cache
def page(name: str) -> str:
    return report_page(result({"fetched": fetched, "reshaped": reshaped}[name]()))


def motion(text: str) -> dict[str, Any]:
    found = re.search(r'id="motion-data">(.*?)</script>', text)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def drawn_objects(ax: Any) -> list[Array]:
    """Outlines that are filled in the colour of an object."""
    filled = (item for item in ax.patches if isinstance(item, Polygon) and item.get_fill())
    there = [item for item in filled if to_hex(item.get_facecolor()) in figures.OBJECT_COLOURS]
    return [np.array(item.get_xy())[:-1] for item in there]


def outlines(made: Plan, time_s: float) -> list[Array]:
    poses = object_poses(made.trajectory, np.array([time_s]))[0]
    return world_figures.outlines_m(made.problem, poses)


def test_a_disc_is_drawn_on_its_edge_and_a_box_by_its_corners() -> None:
    disc = Object(name="a", pose={"x_m": 0, "y_m": 0}, disc={"radius_m": 0.03})
    round_about = world_figures.outline_m(disc, np.array([0.2, 0.1, 0.0])) - [0.2, 0.1]
    assert np.hypot(*round_about.T) == pytest.approx(0.03)
    box = {"x_m": (-0.02, 0.02), "y_m": (-0.01, 0.01)}
    cube = Object(name="b", pose={"x_m": 0, "y_m": 0}, box=box)
    turned = world_figures.outline_m(cube, np.array([0.0, 0.0, np.pi / 2]))
    assert sorted(np.abs(turned).ravel()) == pytest.approx([0.01] * 4 + [0.02] * 4)


def test_in_a_film_what_is_held_moves_with_the_robot_and_else_rests() -> None:
    made, playback = fetched(), plan_playback(fetched(), 0.1)
    scene = Scene(playback, ("robot", "end"), 1.0)
    grasped_s, carried_s, _ = made.trajectory.done_s
    own = world_figures.outline_m(made.problem.objects[0], np.zeros(3))
    for row in (0, 300, *np.searchsorted(playback.time_s, [grasped_s + 3, carried_s]).tolist()):
        scene.image(row)
        (drawn,) = drawn_objects(scene.figure.axes[0])
        middle, time_s = drawn.mean(axis=0), playback.time_s[row]
        if time_s <= grasped_s:
            assert middle == pytest.approx([0.32, 0.10])
        else:
            assert middle == pytest.approx(composed(playback.q[row, :3], CUP_IN_B0)[:2], abs=2e-6)
        assert drawn - middle == pytest.approx(own, abs=0.01)
        words = [text.get_text() for text in scene.figure.axes[0].texts]
        assert "cup" in words
        number = 1 + int(np.searchsorted(made.trajectory.done_s, time_s, side="right"))
        assert any(text.startswith(f"{number} of 3: ") for text in words)
    numbers = [text.get_text() for text in scene.figure.axes[2].texts]
    assert numbers == ["1", "2", "3"]


def test_a_plan_has_a_panel_a_task_and_says_when_each_is_done() -> None:
    made = fetched()
    overview, *panels = plot_plan(made).axes[:4]
    for ax, stage, number in zip(
        panels, stretches(made.trajectory), itertools.count(1), strict=False
    ):
        assert ax.get_title() == f"{number}: {stage.words}, {stage.to_s:.1f} s"
        assert drawn_objects(ax)[-1] == pytest.approx(outlines(made, stage.to_s)[0])
    first, last = drawn_objects(overview)
    assert first == pytest.approx(outlines(made, 0.0)[0])
    assert last == pytest.approx(outlines(made, made.duration_s)[0])


def test_levels_keep_words_off_each_other_and_off_the_lines_of_others() -> None:
    rng = np.random.default_rng(4)
    stretch = timeline_figures.TimeStretch((0.0, 100.0), (0.0, 1.0))
    for _ in range(50):
        times_s = np.sort(rng.uniform(0.0, 100.0, 6)).tolist()
        each = [
            Stretch(Stage((), words="x" * int(rng.integers(1, 30))), 0.0, time_s)
            for time_s in times_s
        ]
        levels = timeline_figures.label_levels(each, stretch)
        for (i, one), (j, other) in itertools.combinations(enumerate(each), 2):
            words = timeline_figures.stage_words(i + 1, one)
            if one.to_s / 100 + timeline_figures.LETTER * (1 + len(words)) > other.to_s / 100:
                assert levels[i] > levels[j]
        assert set(levels) == set(range(max(levels) + 1))


def test_a_mission_without_a_goal_draws_none_and_prints_no_nan() -> None:
    made = fetched()
    assert made.problem.ends_anywhere
    playback = plan_playback(made)
    assert playback.goals == ()
    legend = Scene(playback, ("robot", "end"), 1.0).figure.axes[0].get_legend()
    assert "goal" not in [text.get_text() for text in legend.get_texts()]
    text = page("fetched")
    assert 'class="ghost goal"' not in text
    assert "Goal, after re-integration" not in text
    assert "NaN" not in text
    assert ">nan" not in text
    words = [item.get_text() for item in plot_plan(made).axes[0].texts]
    assert "end" in words
    assert "goal" not in words


def test_goals_on_the_way_are_drawn_as_ghosts() -> None:
    made = reshaped()
    ends = made.trajectory.configuration([*made.trajectory.done_s, made.duration_s])
    assert np.array(world_figures.goals(made.trajectory)) == pytest.approx(ends)
    assert page("reshaped").count('class="ghost goal"') == 3
    dashed = [line for line in plot_plan(made).axes[0].lines if line.get_linestyle() == "--"]
    assert len(dashed) == 3 * made.robot.geometry.segments


def test_the_report_moves_objects_and_has_a_table_of_tasks() -> None:
    made, text = fetched(), page("fetched")
    film = motion(text)["film"]
    for frame in (0, 400, 560, 1000):
        placed = film["poses"][film["pose"][frame]]["objects"]
        x, y, phi = object_poses(made.trajectory, np.array([film["time_s"][frame]]))[0, 0].tolist()
        told = [float(part) for part in re.findall(r"-?[\d.]+", placed[0])]
        assert told == pytest.approx([1e3 * x, -1e3 * y, -np.degrees(phi)], abs=0.02)
    assert len(re.findall('<polygon class="target"', text)) == 1
    assert "1 grasp cup" in text
    grasp, carry, release = task_costs(made)
    assert [row.words for row in (grasp, carry, release)] == [
        "grasp cup",
        "carry cup",
        "release cup",
    ]
    assert grasp.held == carry.held == "caged: proved, it cannot leave"
    assert release.held != grasp.held
    for row in (grasp, carry, release):
        assert f"<td>{row.words}</td>" in text
    assert {film["events"][0], film["events"][-1]} == {0, 1000}


def test_what_is_pushed_is_said_to_be_held_by_contact_alone() -> None:
    made = fetched()
    things = [made.problem.objects[0].with_values(friction=0.3)]
    tasks = [made.problem.tasks[0].with_values(hold="pushed"), *made.problem.tasks[1:]]
    problem = made.problem.with_values(objects=things, tasks=tasks)
    pushed = replace(made, trajectory=replace(made.trajectory, problem=problem))
    expected = "pushed: held only while contact is kept"
    assert [row.held for row in task_costs(pushed)][:2] == [expected] * 2


@pytest.mark.parametrize("name", SCENARIOS)
def test_missions_are_built_in_and_come_back_from_a_report(name: str, tmp_path: Path) -> None:
    problem = load_problem(name)
    file = tmp_path / "scenario.toml"
    file.write_text(scenario_toml(problem))
    assert load_problem(file) == problem
