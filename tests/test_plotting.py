"""Figures show what the plan says, read well, and are written whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import casadi as ca
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from twosra_mpc import InputError, NoPlanError, Plan, Status, load_problem, load_robot, plan
from twosra_mpc.model.kinematics import fibre_end_pose, kinematics
from twosra_mpc.modes import MODES, Mode
from twosra_mpc.plan import Phase
from twosra_mpc.plotting import (
    DPI,
    RIGID_COLOUR,
    SOFT_COLOUR,
    TimeStretch,
    draw_robot,
    plan_title,
    plot_plan,
    robot_shape,
    segment_states,
)

ROBOT = load_robot("2sra-v1")
TIMELINE = 5  # axes over time: stiffness, curvature, wheel speed, temperature, melt fraction
PLANS = [
    ("paper-1", "optimal"),
    ("paper-1", "greedy"),
    ("move-and-shape", "optimal"),
    ("rigid-move", "optimal"),
]
CONFIGURATIONS = [
    (0.0, 0.0, 0.0, 0.0, 0.0),
    (0.2, -0.1, 0.7, 1e-9, -1e-9),
    (0.238, 0.276, -0.24, -38.0, -24.0),
    (-1.0, 2.0, 3.0, 78.5, -60.0),
]


@cache
def made(name: str, planner: str = "optimal") -> Plan:
    return plan(load_problem(name, planner=planner))


@cache
def drawn(name: str, planner: str = "optimal") -> Figure:
    return plot_plan(made(name, planner))


def without_plan() -> Plan:
    return replace(made("rigid-move"), samples=None, status=Status.INFEASIBLE, message="no way")


def axes_of() -> Axes:
    return Figure().add_subplot()


def colour(soft: int) -> str:
    return SOFT_COLOUR if soft else RIGID_COLOUR


def to_world(q: tuple[float, ...], x: float, y: float) -> np.ndarray:
    c, s = np.cos(q[2]), np.sin(q[2])
    return np.array([q[0] + c * x - s * y, q[1] + s * x + c * y])


# --- the robot


@pytest.mark.parametrize("q", CONFIGURATIONS)
def test_segments_end_where_the_kinematics_puts_the_fibre_ends(q: tuple[float, ...]) -> None:
    shape, symbol = robot_shape(ROBOT.geometry, q), ca.SX.sym("q", 5)
    for j, side in enumerate((-1, 1)):
        pose = ca.Function("pose", [symbol], [fibre_end_pose(ROBOT.geometry, symbol, j)])
        x, y, angle = np.ravel(pose(q).full())
        tip = to_world(q, x, y)
        np.testing.assert_allclose(shape.segments[j, -1], tip, rtol=0, atol=1e-9)
        root = to_world(q, side * ROBOT.geometry.middle_link_m / 2, 0.0)
        np.testing.assert_allclose(shape.segments[j, 0], root, rtol=0, atol=1e-9)
        direction = side * np.array([np.cos(angle + q[2]), np.sin(angle + q[2])])
        link = tip + ROBOT.geometry.end_link_m * direction
        np.testing.assert_allclose(shape.links[1 + j], [tip, link], rtol=0, atol=1e-9)
        centre = link + ROBOT.geometry.unit_side_m / 2 * direction
        np.testing.assert_allclose(shape.units[j].mean(axis=0), centre, rtol=0, atol=1e-9)


@pytest.mark.parametrize("q", CONFIGURATIONS)
def test_segments_are_arcs_of_the_right_length_and_curvature(q: tuple[float, ...]) -> None:
    for arc, kappa in zip(robot_shape(ROBOT.geometry, q, 400).segments, q[3:], strict=True):
        steps = np.diff(arc, axis=0)
        length = np.linalg.norm(steps, axis=1)
        assert length.sum() == pytest.approx(ROBOT.geometry.segment_length_m, rel=1e-4)
        turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
        np.testing.assert_allclose(np.abs(turns) / length[1:], abs(kappa), rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("q", CONFIGURATIONS)
def test_wheels_stand_and_roll_where_the_kinematics_says(q: tuple[float, ...]) -> None:
    poses = kinematics(ROBOT).wheel_poses(q).full()
    for corners, (x, y, psi) in zip(robot_shape(ROBOT.geometry, q).wheels, poses.T, strict=True):
        np.testing.assert_allclose(corners.mean(axis=0), to_world(q, x, y), rtol=0, atol=1e-9)
        edges = np.diff(corners[[0, 1, 2]], axis=0)
        rolling = np.array([np.cos(psi + q[2]), np.sin(psi + q[2])])
        extents = sorted(abs(edges @ rolling))
        np.testing.assert_allclose(extents, [0.0, 2 * ROBOT.geometry.wheel_radius_m], atol=1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_a_segment_is_drawn_red_exactly_when_it_is_soft(mode: Mode) -> None:
    ax = axes_of()
    artists = draw_robot(ax, ROBOT.geometry, CONFIGURATIONS[2], mode)
    shape = robot_shape(ROBOT.geometry, CONFIGURATIONS[2])
    for artist, soft, arc in zip(artists, mode, shape.segments, strict=False):
        assert same_color(artist.get_color(), colour(soft))
        np.testing.assert_array_equal(artist.get_xydata(), arc)
    assert set(artists) == {*ax.lines, *ax.patches}


# --- the figure


@pytest.mark.parametrize(("name", "planner"), PLANS)
def test_labels_carry_units_and_do_not_overlap(name: str, planner: str) -> None:
    figure = drawn(name, planner)
    figure.canvas.draw()
    labels = [ax.get_ylabel() for ax in figure.axes[-TIMELINE:][1:]]
    labels += [figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()]
    assert all("[" in label for label in [*labels, figure.axes[-1].get_xlabel()])
    for first, second in combinations(visible_texts(figure), 2):
        assert not first[1].overlaps(second[1]), (first, second)
    inside = figure.bbox.padded(1.0)
    for text, box in visible_texts(figure):
        assert inside.containsx(box.x0), text
        assert inside.containsx(box.x1), text


def visible_texts(figure: Figure) -> list[tuple[str, Bbox]]:
    """Texts and their places, without ticks outside the axes."""
    assert isinstance(figure.canvas, FigureCanvasAgg)
    hidden = set()
    for ax in figure.axes:
        for axis, limits in ((ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim())):
            for tick in axis.get_major_ticks():
                if not min(limits) <= tick.get_loc() <= max(limits):
                    hidden |= {tick.label1, tick.label2}
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text not in hidden]
    renderer = figure.canvas.get_renderer()
    return [(t.get_text(), t.get_window_extent(renderer)) for t in texts if t.get_text().strip()]


@pytest.mark.parametrize(("name", "planner"), PLANS)
def test_every_phase_has_its_panel_with_its_colours_and_poses(name: str, planner: str) -> None:
    result = made(name, planner)
    panels = drawn(name, planner).axes[1:-TIMELINE]
    assert len(panels) == (len(result.phases) if len(result.phases) > 1 else 0)
    assert result.samples is not None
    for ax, phase in zip(panels, result.phases, strict=False):
        before, after = ax.lines[:2], ax.lines[5:7]
        for lines, t in ((before, phase.start_s), (after, phase.end_s)):
            q = result.samples.q[np.argmin(abs(result.samples.t_s - t))]
            arcs = robot_shape(result.robot.geometry, q).segments
            for line, soft, arc in zip(lines, phase.mode, arcs, strict=True):
                assert same_color(line.get_color(), colour(soft))
                np.testing.assert_allclose(line.get_xydata(), arc, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("share", "told"), [(0.9, "proved gap 10 %"), (0.99995, "0.005 %"), (1.0, "< 0.001 %")]
)
def test_title_tells_sequence_duration_status_and_gap(share: float, told: str) -> None:
    result = made("rigid-move")
    assert result.cost is not None
    title = plan_title(replace(result, lower_bound=share * result.cost.total))
    assert title.startswith(f"[0,0] in {result.cost.time_s:.1f} s: optimal, ")
    assert title.endswith(told)


def test_title_of_a_greedy_plan_claims_no_proof() -> None:
    assert plan_title(made("paper-1", "greedy")).endswith("greedy, feasible, no bound proved")


def test_a_plan_without_motion_can_be_drawn() -> None:
    start = load_problem("rigid-move").start
    goal = {"x_m": start.x_m, "y_m": start.y_m}
    result = plan(load_problem("rigid-move", goal=goal))
    assert not result.phases
    plot_plan(result).canvas.draw()


# --- over time


@pytest.mark.parametrize(("name", "planner"), PLANS)
def test_bars_are_soft_exactly_where_the_mode_is(name: str, planner: str) -> None:
    result = made(name, planner)
    assert result.samples is not None
    t = result.samples.t_s
    for segment in (1, 2):
        states = segment_states(result, segment, float(t[-1]))
        assert [low for low, _, _ in states] == [0.0, *(high for _, high, _ in states[:-1])]
        for low, high, state in states:
            inside = (t > low + 1e-6) & (t < high - 1e-6)
            assert np.all(result.samples.mode[inside, segment - 1] == (state == "soft")), state


def test_time_axis_is_invertible_and_gives_short_phases_room() -> None:
    phases = [Phase((0, 0), 0.0, 0.05), Phase((1, 0), 63.0, 63.02), Phase((1, 1), 100.0, 300.0)]
    stretch = TimeStretch.of(phases, 300.0 + 1e-12)
    t = np.linspace(0.0, 300.0, 1001)
    np.testing.assert_allclose(stretch.inverse(stretch.forward(t)), t, atol=1e-6)
    assert np.all(np.diff(stretch.forward(t)) > 0)
    for phase in phases:
        assert np.ptp(stretch.forward(np.array(phase[1:]))) > 0.08
    assert {0.0, 63.0, 63.02, 100.0} <= set(stretch.ticks())


# --- files and errors


def test_figure_is_written_at_readme_width(tmp_path: Path) -> None:
    figure = plot_plan(made("shape-change"), tmp_path / "plan.png")
    data = (tmp_path / "plan.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    assert int.from_bytes(data[16:20], "big") == figure.get_figwidth() * DPI == 1600
    assert [file.name for file in tmp_path.iterdir()] == ["plan.png"]


def test_the_ending_chooses_the_format(tmp_path: Path) -> None:
    path = tmp_path / "plan.SVG"
    plot_plan(made("rigid-move"), str(path))
    assert path.read_bytes().startswith(b"<?xml")


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half_written(_: Figure, path: Path, **__: object) -> None:
        path.write_text("half")
        raise OSError(28, "No space left on device")

    target = tmp_path / "plan.png"
    target.write_text("old")
    monkeypatch.setattr(Figure, "savefig", half_written)
    with pytest.raises(OSError, match="No space left"):
        plot_plan(made("rigid-move"), target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("name", ["plan.docx", "plan"])
def test_an_unknown_ending_is_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.pdf.*\.png.*\.svg") as caught:
        plot_plan(made("rigid-move"), tmp_path / name)
    assert caught.value.field == "output"
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="folder that exists"):
        plot_plan(made("rigid-move"), tmp_path / "nowhere" / "plan.png")


def test_a_plan_without_samples_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NoPlanError, match="no way") as caught:
        plot_plan(without_plan(), tmp_path / "plan.png")
    assert caught.value.status == Status.INFEASIBLE
    assert not list(tmp_path.iterdir())


def test_global_settings_are_left_alone() -> None:
    before = dict(mpl.rcParams)
    plot_plan(made("rigid-move"))
    assert dict(mpl.rcParams) == before


def test_no_window_toolkit_is_loaded() -> None:
    code = "import sys, twosra_mpc.plotting; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
