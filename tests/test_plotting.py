"""Figures show what the plan says, read well, and are written whole or not at all."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import chain, combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import same_color, to_rgb
from matplotlib.figure import Figure
from once import planned

from twosra_mpc import InputError, load_problem, load_robot, plotting
from twosra_mpc.files import data_file
from twosra_mpc.lab.figures import plot_comparison
from twosra_mpc.lab.figures.atlas_figure import NO_PLAN_COLOUR, OTHER_COLOUR, SEQUENCE_COLOURS
from twosra_mpc.plans.plan import planned_words
from twosra_mpc.plans.trajectory import Phase, stiffness_intervals
from twosra_mpc.plotting import (
    CHANGING_COLOUR,
    DPI,
    RIGID_COLOUR,
    SOFT_COLOUR,
    TimeStretch,
    draw_configuration,
    draw_melt_fractions,
    draw_outline,
    draw_temperatures,
    draw_timeline,
    draw_wheel_speeds,
    plan_title,
    plot_plan,
    robot_shape,
)
from twosra_mpc.plotting.figures import (
    FREEZING_COLOUR,
    HEATER_COLOUR,
    MIDDLE_COLOUR,
    STATES,
    UNIT_COLOURS,
    picture_address,
)
from twosra_mpc.plotting.plane import robot_artists

ROBOT = load_robot("2sra-v1")
TIMELINE = 5  # axes over time: stiffness, curvature, wheel speed, temperature, melt fraction
PLANS = [
    ("paper-1", "optimal"),
    ("paper-1", "greedy"),
    ("move-and-shape", "optimal"),
    ("rigid-move", "optimal"),
]
BENT = (0.238, 0.276, -0.24, -38.0, -24.0)


@cache
def drawn(name: str, planner: str = "optimal") -> Figure:
    return plot_plan(planned(name, planner=planner))


def axes_of() -> Axes:
    return Figure().add_subplot()


def colour(soft: int) -> str:
    return SOFT_COLOUR if soft else RIGID_COLOUR


# --- the robot


DEUTERANOPIA = ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413))
DEUTERANOPIA = (*DEUTERANOPIA, (-0.011820, 0.042940, 0.968881))  # Machado et al. 2009, severity 1
PROTANOPIA = ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216))
PROTANOPIA = (*PROTANOPIA, (-0.003882, -0.048116, 1.051998))
LUMINANCE = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))


def cielab(name: str, seen: object) -> np.ndarray:
    """CIELAB of a colour as an eye sees it that mixes linear red, green and blue so."""
    part = np.array(to_rgb(name))
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    xyz = np.array(LUMINANCE) @ np.clip(np.array(seen) @ linear, 0.0, 1.0)
    x, y, z = np.cbrt(np.maximum(xyz / (0.9505, 1.0, 1.089), 0.008856))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("seen", [np.eye(3), DEUTERANOPIA, PROTANOPIA])
@pytest.mark.parametrize(
    ("colours", "least"),
    [
        ([look["fc"] for look in STATES.values()], 25.0),
        ([MIDDLE_COLOUR, *UNIT_COLOURS], 35.0),
        ([RIGID_COLOUR, SOFT_COLOUR, MIDDLE_COLOUR], 20.0),
        ([*SEQUENCE_COLOURS, OTHER_COLOUR, NO_PLAN_COLOUR], 20.0),
        (SEQUENCE_COLOURS, 25.0),
    ],
)
def test_colours_are_told_apart_by_those_who_do_not_see_red_or_green(
    colours: list[str], least: float, seen: object
) -> None:
    places = [cielab(name, seen) for name in colours]
    assert min(np.linalg.norm(a - b) for a, b in combinations(places, 2)) > least


def test_the_report_has_the_colours_of_the_figures() -> None:
    style = data_file("lab/report/page.css")
    named = {"rigid": RIGID_COLOUR, "soft": SOFT_COLOUR, "melting": CHANGING_COLOUR}
    named |= {"freezing": FREEZING_COLOUR, "trace-4": MIDDLE_COLOUR, "heater": HEATER_COLOUR}
    for name, shade in named.items():
        assert re.search(rf"--{name}: (#\w+)", style)[1] == shade  # type: ignore[index]


def test_robot_artists_are_all_that_is_drawn() -> None:
    ax = axes_of()
    artists = robot_artists(ax, robot_shape(ROBOT.geometry, BENT), (1, 0), (0, 1), 1.0, 4.0)
    assert set(artists) == {*ax.lines, *ax.patches}


def test_an_outline_is_the_robot_dashed() -> None:
    ax = axes_of()
    assert draw_outline(ax, ROBOT.geometry, BENT) is ax
    shape = robot_shape(ROBOT.geometry, BENT)
    for line, arc in zip(ax.lines, shape.segments, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), arc)
        assert line.get_linestyle() == "--"
    for patch, unit in zip(ax.patches, shape.units, strict=True):
        np.testing.assert_array_equal(patch.get_path().vertices[:4], unit)
        assert not patch.get_fill()


# --- the figure


@pytest.mark.parametrize(("name", "planner"), PLANS)
def test_labels_carry_units(name: str, planner: str) -> None:
    figure = drawn(name, planner)
    labels = [ax.get_ylabel() for ax in figure.axes[-TIMELINE:][1:]]
    labels += [figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()]
    assert all("[" in label for label in [*labels, figure.axes[-1].get_xlabel()])


@pytest.mark.parametrize(("name", "planner"), PLANS)
def test_every_phase_has_its_panel_with_its_colours_and_poses(name: str, planner: str) -> None:
    result = planned(name, planner=planner)
    panels = drawn(name, planner).axes[1:-TIMELINE]
    assert len(panels) == (len(result.phases) if len(result.phases) > 1 else 0)
    for ax, phase in zip(panels, result.phases, strict=False):
        before, after = ax.lines[:2], ax.lines[5:7]
        for lines, t in ((before, phase.start_s), (after, phase.end_s)):
            q = result.samples.q[np.argmin(abs(result.samples.t_s - t))]
            arcs = robot_shape(result.robot.geometry, q).segments
            for line, soft, arc in zip(lines, phase.mode, arcs, strict=True):
                assert same_color(line.get_color(), colour(soft))
                np.testing.assert_allclose(line.get_xydata(), arc, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("share", "told"),
    [
        (0.9, "feasible\nproved within 10 % of the best"),
        (0.99995, "optimal\nproved within 0.005 % of the best"),
        (1.0, "optimal\nproved within 0.001 % of the best"),
    ],
)
def test_title_tells_sequence_duration_status_and_gap(share: float, told: str) -> None:
    result = planned("rigid-move", motion="fastest", gap=0.01)
    title = plan_title(replace(result, lower_bound=share * result.cost.total))
    assert title.startswith(f"[0,0] in {result.cost.time_s:.1f} s: {told}")
    assert title.endswith(told)


def test_title_of_a_greedy_plan_claims_no_proof() -> None:
    assert plan_title(planned("paper-1", planner="greedy")).endswith(
        "planner greedy, feasible\nno bound proved"
    )


def test_a_plan_without_motion_can_be_drawn() -> None:
    start = load_problem("rigid-move").start
    goal = {"x_m": start.x_m, "y_m": start.y_m}
    result = planned("rigid-move", goal=goal)
    assert not result.phases
    plot_plan(result).canvas.draw()


# --- over time


@pytest.mark.parametrize(("name", "planner"), [*PLANS, ("three-segments", "optimal")])
def test_bars_are_soft_exactly_where_the_mode_is(name: str, planner: str) -> None:
    result = planned(name, planner=planner)
    t = result.samples.t_s
    for j, states in enumerate(stiffness_intervals(result.trajectory)):
        assert [low for low, _, _ in states] == [0.0, *(high for _, high, _ in states[:-1])]
        for low, high, state in states:
            inside = (t > low + 1e-6) & (t < high - 1e-6)
            assert np.all(result.samples.mode[inside, j] == (state == "soft")), state


def test_lanes_heaters_and_motion_stand_where_the_plan_has_them() -> None:
    result, ax = planned("paper-1"), axes_of()
    assert draw_timeline(ax, result) is ax
    bars = [patch for patch in ax.patches if patch.get_height() == 0.5]
    states = chain.from_iterable(reversed(stiffness_intervals(result.trajectory)))
    for bar, (low, high, state) in zip(bars, states, strict=True):
        assert (bar.get_x(), bar.get_width()) == pytest.approx((low, high - low))
        assert same_color(bar.get_facecolor(), STATES[state]["fc"])
        assert bool(bar.get_hatch()) == (state in ("melting", "freezing"))
    spans = [patch for patch in ax.patches if patch not in bars]
    for span, phase in zip(spans, result.phases, strict=True):
        assert (span.get_x(), span.get_width()) == pytest.approx(
            (phase.start_s, phase.end_s - phase.start_s)
        )
    for heater, current in zip(
        ax.collections, result.samples.heater_current_A.T[::-1], strict=True
    ):
        on = result.samples.t_s[current > 0]
        points = heater.get_paths()[0].vertices
        raised = points[points[:, 1] > points[:, 1].min() + 0.01]
        assert raised[:, 0].min() == on.min()


@pytest.mark.parametrize(
    ("draw", "values"),
    [
        (draw_configuration, "q[:, 3:]"),
        (partial(draw_configuration, coordinate="position"), "q[:, :2]"),
        (partial(draw_configuration, coordinate="heading"), "q[:, 2:3]"),
        (draw_temperatures, "temperature_C"),
        (draw_melt_fractions, "melt_fraction"),
    ],
)
def test_curves_are_the_samples(draw: Callable[..., Axes], values: str) -> None:
    result, ax = planned("paper-1"), axes_of()
    assert draw(ax, result) is ax
    assert ax.get_ylabel().endswith("]")
    name, _, columns = values.partition("[:, ")
    expected = getattr(result.samples, name)
    if columns:
        first, _, last = columns.removesuffix("]").partition(":")
        expected = expected[:, int(first or 0) : int(last) if last else None]
    drawn_values = [line.get_ydata() for line in ax.lines if line.get_linewidth() > 1.0]
    np.testing.assert_array_equal(np.transpose(drawn_values), expected)


@pytest.mark.parametrize("robot", ["2sra-v1", "2sra-v1-paper"])
def test_wheel_speeds_are_drawn_as_the_ramps_and_jumps_they_are(robot: str) -> None:
    result, ax = planned("paper-1", robot=robot), axes_of()
    assert draw_wheel_speeds(ax, result) is ax
    times, speeds = ax.lines[0].get_xdata(), [line.get_ydata() for line in ax.lines]
    samples = result.samples
    assert ax.lines[0].get_drawstyle() == "default"
    np.testing.assert_array_equal(times[::2], samples.t_s[:-1])
    np.testing.assert_array_equal(times[1::2], samples.t_s[1:])
    np.testing.assert_array_equal(np.transpose(speeds)[::2], samples.wheel_rad_s[:-1])
    turned = np.trapezoid(speeds, times, axis=1)
    expected = result.trajectory.wheel_travel_rad(result.duration_s)[0]
    np.testing.assert_allclose(turned, expected, rtol=1e-3)  # between samples wheels bend a little
    jumps = np.abs(np.diff(speeds)[:, 1::2]).max()  # where no time passes
    assert jumps < 1e-5 if robot == "2sra-v1" else jumps > 1.0


def test_time_axis_is_invertible_and_gives_short_phases_room() -> None:
    phases = [Phase((0, 0), 0.0, 0.05), Phase((1, 0), 63.0, 63.02), Phase((1, 1), 100.0, 300.0)]
    stretch = TimeStretch.of(phases, 300.0 + 1e-12)
    t = np.linspace(0.0, 300.0, 1001)
    np.testing.assert_allclose(stretch.inverse(stretch.forward(t)), t, atol=1e-6)
    assert np.all(np.diff(stretch.forward(t)) > 0)
    for phase in phases:
        assert np.ptp(stretch.forward(np.array(phase[1:]))) > 0.08
    assert {0.0, 63.0, 63.02, 100.0} <= set(stretch.ticks())


# --- comparison


def test_plans_side_by_side_share_one_time_axis_and_are_named() -> None:
    rivals = [planned("paper-1", planner=planner) for planner in ("optimal", "greedy")]
    figure = plot_comparison({"paper-1": rivals, "move": [planned("rigid-move")]})
    figure.canvas.draw()
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles[0].startswith(
        f"paper-1: [0,0] → [1,0] → [1,1] in {planned_words(rivals[0])}: opt"
    )
    assert f"{planned_words(rivals[1])}: planner greedy, feasible\nno bound proved" in titles[1]
    assert titles[2].startswith("move: [0,0] in")
    assert len({ax.get_xlim() for ax in figure.axes}) == 1
    for ax, result in zip(figure.axes, [*rivals, planned("rigid-move")], strict=True):
        reach = max(patch.get_x() + patch.get_width() for patch in ax.patches)
        assert reach == pytest.approx(result.duration_s)
        assert reach <= ax.get_xlim()[1]
    places = [ax.get_position() for ax in figure.axes]
    assert len({(round(place.x0, 6), round(place.x1, 6)) for place in places}) == 1


def test_nothing_cannot_be_compared() -> None:
    with pytest.raises(InputError, match="at least one plan"):
        plot_comparison({"paper-1": []})


# --- files and errors


def test_figure_is_written_at_readme_width(tmp_path: Path) -> None:
    figure = plot_plan(planned("shape-change"), tmp_path / "plan.png")
    data = (tmp_path / "plan.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    assert int.from_bytes(data[16:20], "big") == figure.get_figwidth() * DPI == 1600
    assert [file.name for file in tmp_path.iterdir()] == ["plan.png"]


def test_the_ending_chooses_the_format(tmp_path: Path) -> None:
    path = tmp_path / "plan.SVG"
    plot_plan(planned("rigid-move"), str(path))
    assert path.read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize("name", ["plan.docx", "plan"])
def test_an_unknown_ending_is_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.png.*\.pdf.*\.svg") as caught:
        plot_plan(planned("rigid-move"), tmp_path / name)
    assert caught.value.field == "output"
    assert not list(tmp_path.iterdir())


def test_global_settings_are_left_alone() -> None:
    before = dict(mpl.rcParams)
    plot_plan(planned("rigid-move"))
    assert dict(mpl.rcParams) == before


def test_settings_of_a_user_change_no_figure(tmp_path: Path) -> None:
    """As a ``matplotlibrc`` has them; SVG draws its names from them, and is the same each time."""
    own = {"text.usetex": True, "font.size": 30.0, "savefig.transparent": True, "axes.grid": True}
    made = []
    for settings in ({}, own):
        with mpl.rc_context(settings):
            figure = plot_plan(planned("rigid-move"), path := tmp_path / "plan.png")
            made.append((path.read_bytes(), picture_address(figure, "svg")))
    assert made[0] == made[1]


def test_every_public_name_is_there() -> None:
    for name in plotting.__all__:
        assert getattr(plotting, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'plot_nothing'"):
        _ = plotting.plot_nothing


def test_neither_window_toolkit_nor_tracker_is_loaded() -> None:
    code = (
        "import sys, twosra_mpc.plotting\n"
        "sys.exit(any(name in sys.modules for name in ('matplotlib.pyplot', 'osqp')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
