"""Figures, film, report and exports follow the number of segments of the robot."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from once import planned

from twosra_mpc import Plan, Robot, load_robot
from twosra_mpc.lab.analysis.critical_path import activities, critical_path
from twosra_mpc.lab.identification.motion_log import save_authors_csv
from twosra_mpc.lab.report.player import film_of, lanes
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.trajectory import soft_and_changing
from twosra_mpc.plotting import (
    CHANGING_COLOUR,
    FREEZING_COLOUR,
    RIGID_COLOUR,
    SEGMENT_COLOURS,
    SOFT_COLOUR,
    STYLE,
    draw_configuration,
    draw_melt_fractions,
    draw_robot,
    draw_timeline,
    plot_plan,
)
from twosra_mpc.plotting.film import LEAST
from twosra_mpc.plotting.playback import PLACES, plan_playback
from twosra_mpc.plotting.scene import Scene
from twosra_mpc.robot.modes import all_modes

SEGMENTS = 3


@pytest.fixture(scope="module")
def three() -> Plan:
    return planned("three-segments")


def axes_of() -> Axes:
    return Figure().add_subplot()


def of_segments(segments: int) -> Robot:
    given = load_robot("3sra")
    geometry = given.geometry.model_dump() | {"segments": segments}
    return Robot(**dict(given) | {"geometry": geometry, "segments": ()})


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_every_segment_is_drawn_in_the_colour_of_its_state(segments: int) -> None:
    geometry = of_segments(segments).geometry
    q = [0.1, 0.2, 0.3, *(20.0, -30.0, 10.0, 25.0)[:segments]]
    shape = robot_shape(geometry, q)
    modes = all_modes(segments)
    for mode, changing in itertools.product(modes, (modes[0], modes[-1])):
        ax = axes_of()
        assert draw_robot(ax, geometry, q, mode, changing=changing) is ax
        assert len(ax.lines) == segments + (segments + 1) + sum(changing)  # and links, hatches
        for line, arc, soft, now in zip(ax.lines, shape.segments, mode, changing, strict=False):
            expected = SOFT_COLOUR if soft else RIGID_COLOUR
            if now:
                expected = FREEZING_COLOUR if soft else CHANGING_COLOUR
            assert same_color(line.get_color(), expected)
            np.testing.assert_array_equal(line.get_xydata(), arc)
        hatches = [line.get_xydata() for line in ax.lines if same_color(line.get_color(), "white")]
        expected = [arc for arc, now in zip(shape.segments, changing, strict=True) if now]
        np.testing.assert_array_equal(hatches, expected)


def test_a_lane_a_curve_and_a_colour_for_every_segment(three: Plan) -> None:
    samples, ax = three.trajectory.samples, axes_of()
    draw_timeline(ax, three)
    assert [text.get_text() for text in ax.get_yticklabels()] == [
        f"segment {number}" for number in range(SEGMENTS, 0, -1)
    ]
    assert len(ax.collections) == SEGMENTS  # heater currents
    for draw, values in (
        (draw_configuration, samples.q[:, 3:]),
        (draw_melt_fractions, samples.melt_fraction),
    ):
        ax = draw(axes_of(), three)
        np.testing.assert_array_equal(np.transpose([line.get_ydata() for line in ax.lines]), values)
        colours = [line.get_color() for line in ax.lines]
        assert colours == list(SEGMENT_COLOURS[:SEGMENTS])


def test_the_figure_has_a_panel_a_phase_and_its_title(three: Plan) -> None:
    figure = plot_plan(three)
    titles = [ax.get_title() for ax in figure.axes]
    for number, phase in enumerate(three.phases, start=1):
        mode = f"[{','.join(map(str, phase.mode))}]"
        assert any(title.startswith(f"{number}: {mode}, ") for title in titles)


def test_the_film_shows_where_everything_is(three: Plan) -> None:
    playback = plan_playback(three, LEAST)
    with rc_context(STYLE):
        scene = Scene(playback, ("three", "the end"), 12.0)
    plane, gauges, bars, _ = scene.figure.axes
    assert len(bars.get_yticks()) == len(gauges.get_xticks()) == SEGMENTS
    exact = three.trajectory.at(playback.time_s)
    np.testing.assert_array_equal(playback.q, exact.q)
    np.testing.assert_array_equal(playback.temperature_C, exact.temperature_C)
    for phase in three.phases:
        row = int(np.searchsorted(playback.time_s, (phase.start_s + phase.end_s) / 2))
        scene.show(row)
        soft, _ = soft_and_changing(playback.states(row))
        assert all(s >= moved for s, moved in zip(soft, phase.mode, strict=True))
        drawn = [line for line in plane.lines if line.get_linewidth() == 8][:SEGMENTS]
        arcs = robot_shape(three.robot.geometry, exact.q[row]).segments
        for line, arc, is_soft in zip(drawn, arcs, soft, strict=True):
            np.testing.assert_allclose(line.get_xydata(), arc, rtol=0, atol=1e-12)
            assert same_color(line.get_color(), SOFT_COLOUR) == bool(is_soft)
        assert f"in mode [{','.join(map(str, phase.mode))}]" in playback.doing(row)
    assert playback.states(PLACES - 1) == ["rigid"] * SEGMENTS


def test_the_words_count_the_segments(three: Plan) -> None:
    playback = plan_playback(three, LEAST)
    said = {playback.doing(row) for row in range(PLACES)}
    assert any("all segments are freezing" in words for words in said)
    assert not any("both" in words for words in said)


def test_activities_name_every_segment(three: Plan) -> None:
    told = [str(item) for item in activities(three)]
    names = {0: "driving", 1: "bending segment {}", 2: "bending segments {} and {}"}
    for phase in three.phases:
        soft = [j + 1 for j, flag in enumerate(phase.mode) if flag]
        assert names.get(len(soft), "bending all segments").format(*soft) in told
    assert "freezing all segments" in told
    path = critical_path(three)
    assert sum(item.duration_s for item in path) == pytest.approx(three.duration_s)


def test_the_page_has_a_lane_a_state_and_a_tube_for_every_segment(three: Plan) -> None:
    playback = plan_playback(three)
    film = film_of(three, playback)
    assert {len(state) for state in film["state"]} == {SEGMENTS}
    assert len(film["poses"][0]["segments"]) == SEGMENTS
    assert len(film["poses"][0]["links"]) == SEGMENTS + 1
    names = [lane.name for lane in lanes(three, playback.stretch)]
    assert names[-2:] == [f"segment {SEGMENTS}", f"heater {SEGMENTS}"]
    bending = next(lane for lane in lanes(three, playback.stretch) if lane.name == "motion")
    assert any("segment 3" in span.title for span in bending.spans)


def test_exports_have_columns_for_every_segment(three: Plan, tmp_path: Path) -> None:
    save_authors_csv(three, tmp_path / "plan.csv")
    with (tmp_path / "plan.csv").open(newline="") as stream:
        header = next(csv.reader(stream))
    assert ",".join(header) == "x,y,angle,k1,k2,k3,v1,v2,u0,v0,r0,s1,s2,s3,time"
