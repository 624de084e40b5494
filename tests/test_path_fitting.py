"""Fitted spirals and cardioids are the published ones, follow the exact paths, and are drawn."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from twosra_mpc import InputError, Mode, Robot, load_robot
from twosra_mpc.lab.figures.identification_figures import (
    CURVES,
    MODES,
    POSES,
    held_pose,
    path_curves,
    plot_paths,
    spiral_points,
)
from twosra_mpc.lab.identification import path_fitting as fitting
from twosra_mpc.lab.identification.path_fitting import (
    CASES,
    SPIRAL_BENDS_RAD,
    CardioidFit,
    Case,
    SpiralFit,
    exact_path,
    fit_cardioids,
    fit_spirals,
    fitted_path_tables,
)
from twosra_mpc.model.chain import fibre_end_pose
from twosra_mpc.model.path_models import Arc, LogSpiral, PathModel, path_model
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import SOFT_1, SOFT_2, SOFT_BOTH, soft_segments

Array = NDArray[np.float64]

ROBOT = load_robot("2sra-v1-paper")
PAPER = ROBOT.geometry
TABLE_I = [  # a / l, b, c_x / l, c_y / l as printed; c_x of II in the frame of I and III
    (2.325, 0.3165, -0.1223, 0.1782),
    (3.3041, 0.083, -0.1988, 0.1640),
    (2.4471, 0.2229, -0.2722, 0.3949),
]
OWN_FITS = [  # the same by an independent program, with rms and largest residual / l
    (2.3254, 0.3164, -0.1221, 0.1774, 0.0067, 0.020),
    (3.3045, 0.0830, -0.1989, 0.1644, 0.0082, 0.035),
    (2.4468, 0.2227, -0.2723, 0.3945, 0.0104, 0.025),
]
LINKS_MM = [0.0, 5.0, 30.0, 80.0, 800.0]


def lengths(segment_mm: float, link_mm: float) -> Geometry:
    new = {"segment_length_m": segment_mm / 1000, "middle_link_m": link_mm / 1000}
    return PAPER.with_values(**new)


SUCCESSOR = lengths(77.0, 0.0)


def with_path(table: dict[str, object]) -> Robot:
    return Robot(**{**ROBOT.model_dump(), "path": table})


def integrated(geometry: Geometry, case: Case, alpha: float) -> tuple[float, float, float]:
    """Moving end (x, y) and heading by adding up short chords of the fibre (midpoint rule)."""
    l, l0, n = geometry.lengths_m[0], geometry.middle_link_m, 4000  # noqa: E741
    soft, link = np.full(n, l / n), np.full(n, l0 / n)
    bend, none = np.full(n, alpha / n), np.zeros(n)
    pieces = {
        "I": [(soft, bend)],
        "II": [(soft, bend), (link, none), (soft, none)],
        "III": [(soft, bend), (link, none), (soft, bend)],
    }[case]
    steps, turns = (np.concatenate(part) for part in zip(*pieces, strict=True))
    heading = np.cumsum(turns) - turns / 2
    x, y = np.sum(steps * np.cos(heading)), np.sum(steps * np.sin(heading))
    return -float(x), float(y), float(np.sum(turns))


# The exact paths.


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("alpha", [-2.0, 0.0, 1e-9, 0.7, np.pi, 2 * np.pi])
@pytest.mark.parametrize("link_mm", LINKS_MM)
def test_the_moving_end_is_where_the_fibre_ends(case: Case, alpha: float, link_mm: float) -> None:
    geometry = lengths(40.0, link_mm)
    expected = integrated(geometry, case, alpha)[:2]
    assert exact_path(case, geometry, alpha)[0] == pytest.approx(
        expected, abs=1e-8 + link_mm * 1e-9
    )


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("alpha", [-1.0, 0.0, 0.5, 3.0])
def test_the_drawn_fibre_ends_on_the_path_and_holds_the_held_end(case: Case, alpha: float) -> None:
    q = held_pose(PAPER, case, alpha)
    symbol = ca.SX.sym("q", 5)
    (moved, _), (held, heading) = (
        _in_the_plane(q, ca.Function("end", [symbol], [fibre_end_pose(PAPER, symbol, j)])(q))
        for j in (0, 1)
    )
    assert moved == pytest.approx(complex(*exact_path(case, PAPER, alpha)[0]), abs=1e-12)
    assert held == pytest.approx(0.03 + 0.04 if case == "I" else 0.0, abs=1e-12)
    assert heading == pytest.approx(0.0, abs=1e-12)


def _in_the_plane(q: Array, pose: ca.DM) -> tuple[complex, float]:
    """Place x + i y and heading of a pose given in b0."""
    x, y, turn = pose.full().ravel()
    return complex(q[0] + 1j * q[1] + np.exp(1j * q[2]) * (x + 1j * y)), float(q[2] + turn)


def test_an_unknown_case_is_refused() -> None:
    with pytest.raises(InputError, match="I, II, III"):
        exact_path("IV", PAPER, 0.0)  # type: ignore[arg-type]


# Spirals.


def test_table_i_is_reproduced() -> None:
    for fit, row in zip(fit_spirals(PAPER), TABLE_I, strict=True):
        assert (fit.scale, fit.growth) == pytest.approx(row[:2], rel=1.1e-3)
        assert fit.centre == pytest.approx(row[2:], rel=5e-3)


def test_the_spirals_agree_with_an_independent_fit() -> None:
    for fit, row in zip(fit_spirals(PAPER), OWN_FITS, strict=True):
        assert (fit.scale, fit.growth) == pytest.approx(row[:2], rel=5e-4)
        assert fit.centre == pytest.approx(row[2:4], abs=1e-4)
        assert (fit.rms_l, fit.max_l) == pytest.approx(row[4:], rel=0.02)


@pytest.mark.parametrize(
    ("ratio", "growth", "scale"),
    [
        (1.0, 0.1318, 2.757),
        (1.5, 0.0948, 3.101),
        (1.575, 0.0909, 3.161),
        (1.75, 0.0830, 3.305),
        (2.0, 0.0738, 3.519),
        (3.0, 0.0511, 4.435),
    ],
)
def test_spiral_ii_depends_on_the_rigid_length(ratio: float, growth: float, scale: float) -> None:
    _, fit, _ = fit_spirals(lengths(40.0, 40.0 * (ratio - 1)))
    assert (fit.growth, fit.scale) == pytest.approx((growth, scale), rel=1e-3)


def test_the_paper_fitted_a_link_of_30_mm_not_23() -> None:
    shorter, paper = fit_spirals(lengths(40.0, 23.0)), fit_spirals(PAPER)
    assert (shorter[2].scale, shorter[2].growth) == pytest.approx((2.279, 0.2434), rel=5e-4)
    assert shorter[0] == paper[0]
    assert shorter[1].growth / paper[1].growth == pytest.approx(1.095, abs=2e-3)
    assert shorter[1].scale / paper[1].scale == pytest.approx(1 - 0.044, abs=2e-3)


@pytest.mark.parametrize("factor", [1e-3, 2.5, 1e3])
def test_fits_scale_with_the_lengths(factor: float) -> None:
    scaled = lengths(40.0 * factor, 30.0 * factor)
    for fit, same in zip(fit_spirals(scaled), fit_spirals(PAPER), strict=True):
        assert (fit.scale, fit.growth, *fit.centre) == pytest.approx(
            (same.scale, same.growth, *same.centre), rel=1e-5
        )
        assert (fit.rms_l, fit.max_l) == pytest.approx((same.rms_l, same.max_l), rel=1e-5)
    for heart, same_heart in zip(fit_cardioids(scaled), fit_cardioids(PAPER), strict=True):
        assert heart.radius_m == pytest.approx(factor * same_heart.radius_m, rel=1e-6)
        assert heart.centre_m[0] == pytest.approx(factor * same_heart.centre_m[0], rel=1e-6)
        assert heart.phi_per_alpha == pytest.approx(same_heart.phi_per_alpha, rel=1e-6)


@pytest.mark.parametrize("link_mm", LINKS_MM)
def test_no_neighbouring_spiral_fits_better(link_mm: float) -> None:
    geometry = lengths(40.0, link_mm)
    for case, fit in zip(CASES, fit_spirals(geometry), strict=True):
        points = exact_path(case, geometry, SPIRAL_BENDS_RAD[case]) / geometry.lengths_m[0]
        best = np.array([fit.scale, fit.growth, *fit.centre])
        assert _spiral_rms(points, best, fit.start_rad) == pytest.approx(fit.rms_l, rel=1e-9)
        for change in np.vstack([np.eye(4), -np.eye(4)]) * 1e-3:
            assert _spiral_rms(points, best * (1 + change), fit.start_rad) >= fit.rms_l - 1e-9


def _spiral_rms(points: Array, guess: Array, start: float) -> float:
    a, b, x, y = guess
    across, up = points[:, 0] - x, points[:, 1] - y
    theta = start + np.unwrap(np.arctan2(up, -across))
    return float(np.sqrt(np.mean((np.hypot(across, up) - a * np.exp(-b * theta)) ** 2)))


# Cardioids.


def test_the_successors_cardioids_are_reproduced() -> None:
    a, rms_mm = (0.0216, 0.0490, 0.0428), (0.01, 0.06, 0.30)
    ends = [(2.44, 3.84), (2.20, 4.09), (1.74, 4.54)]
    a_printed, ends_printed = (0.021, 0.049, 0.042), [(2.42, 3.87), (2.19, 4.09), (1.73, 4.56)]
    fits = fit_cardioids(SUCCESSOR)
    assert [fit.radius_m for fit in fits] == pytest.approx(a, abs=5.1e-5)
    assert [fit.radius_m for fit in fits] == pytest.approx(a_printed, abs=9e-4)
    assert [1000 * fit.rms_m for fit in fits] == pytest.approx(rms_mm, abs=5e-3)
    for i, (case, fit) in enumerate(zip(CASES, fits, strict=True)):
        assert _end_angles(case, fit) == pytest.approx(ends[i], abs=5.1e-3)
        line = np.pi + fit.phi_per_alpha * np.array([-1, 1]) * np.pi / 2
        assert line == pytest.approx(ends[i], abs=0.015)
        assert line == pytest.approx(ends_printed[i], abs=0.03)


def _end_angles(case: Case, fit: CardioidFit) -> Array:
    """Polar angles about the cusp of the ends of the path, the side of positive bends last."""
    across, up = (exact_path(case, SUCCESSOR, [-np.pi / 2, np.pi / 2]) - fit.centre_m).T
    return np.pi + np.arctan2(up, -across)


def test_half_circles_are_harder_for_cardioids() -> None:
    quarter, half = fit_cardioids(SUCCESSOR), fit_cardioids(SUCCESSOR, np.pi)
    assert [1000 * fit.radius_m for fit in half] == pytest.approx([21.42, 49.84, 41.8], abs=0.05)
    assert [1000 * fit.rms_m for fit in half] == pytest.approx([0.148, 2.39, 14.08], rel=0.01)
    assert all(wide.rms_m > 10 * near.rms_m for wide, near in zip(half, quarter, strict=True))


def test_a_double_arc_without_link_is_one_long_arc() -> None:
    """III with l0 = 0 and bend alpha each is I with twice the length and the bend."""
    one, _, _ = fit_cardioids(SUCCESSOR, np.pi)
    _, _, three = fit_cardioids(SUCCESSOR, np.pi / 2)
    assert three.radius_m == pytest.approx(2 * one.radius_m, rel=1e-6)
    assert three.phi_per_alpha == pytest.approx(2 * one.phi_per_alpha, rel=1e-6)
    assert three.centre_m[0] == pytest.approx(2 * one.centre_m[0], rel=1e-6)


@pytest.mark.parametrize("link_mm", LINKS_MM)
@pytest.mark.parametrize("alpha_max", [0.3, np.pi / 2, np.pi])
def test_no_neighbouring_cardioid_fits_better(link_mm: float, alpha_max: float) -> None:
    geometry = lengths(40.0, link_mm)
    for case, fit in zip(CASES, fit_cardioids(geometry, alpha_max), strict=True):
        points = exact_path(case, geometry, np.linspace(0.0, alpha_max, 201))
        best = np.array([fit.radius_m, *fit.centre_m])
        assert _cardioid_rms(points, best) == pytest.approx(fit.rms_m, rel=1e-9)
        for change in np.vstack([np.eye(3), -np.eye(3)])[[0, 1, 3, 4]] * 1e-5:
            assert _cardioid_rms(points, best + change) >= fit.rms_m - 1e-12


def _cardioid_rms(points: Array, guess: Array) -> float:
    across, up = (points - guess[1:]).T
    radius = np.hypot(across, up)
    model = 2 * guess[0] * (1 - np.cos(np.arctan2(up, across)))
    return float(np.sqrt(np.mean((radius - model) ** 2)))


@pytest.mark.parametrize("fit", [fit_spirals, fit_cardioids])
def test_a_fit_that_misses_the_path_is_refused(
    fit: Callable[[Geometry], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fitting, "_WORST", 1e-6)
    with pytest.raises(InputError, match=r"(spiral|cardioid) I follows") as caught:
        fit(PAPER)
    assert caught.value.value == {"segment_length_m": 0.04, "middle_link_m": 0.03}


def test_all_fits_of_a_robot_take_less_than_a_second() -> None:
    start = time.process_time()
    fitted_path_tables(ROBOT)
    assert time.process_time() - start < 1.0


# The tables of a robot file.


def test_the_fitted_tables_make_robots() -> None:
    tables = fitted_path_tables(ROBOT)
    for name, table in tables.items():
        robot = with_path(table)
        assert robot.path.model == name
        assert path_model(robot) is not None
    assert tables["log_spiral_corrected"]["scale"] == pytest.approx([2.325, 3.304, 2.447], rel=1e-3)
    assert tables["log_spiral"]["scale"] == pytest.approx([2.325, 3.304, 4.925], rel=1e-3)


def test_the_fitted_spirals_have_the_speed_of_the_exact_paths() -> None:
    """Kinematics note, section 2: ratio of the rates, with row III at its own phase."""
    tables = fitted_path_tables(ROBOT)
    alpha, own = ca.SX.sym("alpha"), ca.SX.sym("own")
    exact = Arc(PAPER, at_wheel=False)

    def rate(path: PathModel, mode: Mode, unit: int, own: ca.SX, other: ca.SX) -> ca.SX:
        """Rate of the last soft segment; ``own`` is the bend next to the unit that moves."""
        both = ca.vertcat(own, other) if unit == 0 else ca.vertcat(other, own)
        return path.bends(both, mode)[unit].bending[max(soft_segments(mode))]

    bends = np.array([0.0, 0.5, 1.0, np.pi / 2, 2.4, np.pi])
    expected = [
        (0.872, 0.962, 1.047, 1.134, 1.230, 1.277),
        (0.884, 0.918, 0.946, 0.970, 0.994, 1.009),
        (0.843, 0.956, 1.034, 1.065, 0.978, 0.767),
    ]
    for name in ("log_spiral", "log_spiral_corrected"):
        spiral = path_model(with_path(tables[name]))
        assert isinstance(spiral, LogSpiral)
        ratios = [
            rate(spiral, mode, unit, near, far) / rate(exact, mode, unit, near, far)
            for mode, unit, near, far in (
                (SOFT_1, 0, alpha, own),
                (SOFT_2, 0, own, alpha),
                (SOFT_BOTH, 1, alpha, alpha),
            )
        ]
        rates = ca.Function("ratios", [alpha, own], ratios)(bends.reshape(1, -1), 0.0)
        assert [ratio.full().ravel() for ratio in rates] == [
            pytest.approx(row, rel=4e-3) for row in expected
        ]


# Curves and figure.


@pytest.mark.parametrize("geometry", [PAPER, SUCCESSOR], ids=["paper", "successor"])
def test_curves_lie_where_the_fits_say(geometry: Geometry) -> None:
    l = geometry.lengths_m[0]  # noqa: E741
    for curves in path_curves(geometry, points=1001):
        spiral, cardioid = curves.spiral_fit, curves.cardioid_fit
        assert curves.exact[0] == pytest.approx(exact_path(curves.case, geometry, 0.0)[0] / l)
        apart = np.hypot(*(curves.exact - curves.spiral).T)
        assert apart.max() <= spiral.max_l * 1.5
        assert np.sqrt(np.mean(apart**2)) == pytest.approx(spiral.rms_l, rel=0.1)
        near = np.linalg.norm(curves.cardioid[:, None] - curves.exact, axis=2).min(axis=1)
        assert near.max() < cardioid.max_m / l + 0.01


def test_spirals_hold_their_equation() -> None:
    fit = SpiralFit(2.0, 0.1, (0.3, -0.2), 0.0, 0.0, np.pi)
    assert spiral_points(fit, 0.0) == pytest.approx((0.3 - 2 * np.exp(-0.1 * np.pi), -0.2))
    assert spiral_points(fit, [np.pi / 2])[0] == pytest.approx(
        (0.3, 2 * np.exp(-0.15 * np.pi) - 0.2)
    )
    assert fit.scale_from_pi == fit.scale


def test_the_figure_shows_paths_fits_fibre_and_residuals(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    figure = plot_paths(ROBOT, tmp_path / "paths.png")
    assert dict(mpl.rcParams) == before
    assert [path.name for path in tmp_path.iterdir()] == ["paths.png"]
    assert len(figure.axes) == 3
    for ax, curves in zip(figure.axes, path_curves(PAPER), strict=True):
        drawn = (curves.exact, curves.spiral, curves.cardioid)
        lines = [line for line in ax.lines if len(line.get_xdata()) == len(curves.exact)]
        for line, points, style in zip(lines, drawn, CURVES.values(), strict=True):
            assert line.get_color() == style["c"]
            assert line.get_xydata() == pytest.approx(points)
        marks = [line for line in ax.lines if isinstance(line.get_marker(), tuple)]
        bends = SPIRAL_BENDS_RAD[curves.case][-1] * np.arange(POSES)[::-1] / POSES
        places = np.concatenate([mark.get_xydata() for mark in marks])
        assert places == pytest.approx(exact_path(curves.case, PAPER, bends) / 0.04, abs=1e-12)
        assert f"{40 * curves.spiral_fit.rms_l:.2f} mm" in ax.get_title()


def test_paths_of_another_number_of_segments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="2: spirals and cardioids"):
        plot_paths(load_robot("3sra"), tmp_path / "paths.png")
    assert not list(tmp_path.iterdir())


def test_soft_segments_are_red_and_rigid_ones_blue() -> None:
    for ax, mode in zip(plot_paths(ROBOT).axes, MODES.values(), strict=True):
        arcs = [line for line in ax.lines if len(line.get_xdata()) == 40]
        red, _, blue = np.array([to_rgb(line.get_color()) for line in arcs]).T
        assert np.sum(red > blue) == POSES * sum(mode)
        assert np.sum(red < blue) == POSES * (2 - sum(mode))
