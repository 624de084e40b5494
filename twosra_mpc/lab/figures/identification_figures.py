"""Figures of what is identified: segments by logs of heating, motion by logs, paths of the units.

The paths are after the paper's figure of section "LU Paths Estimation", for any robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from twosra_mpc import InputError, Mode, Robot, robot_shape
from twosra_mpc.lab.identification.heating_log import EvenLog, runs
from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.identification.path_fitting import (
    CARDIOID_BEND_RAD,
    CASES,
    SPIRAL_BENDS_RAD,
    CardioidFit,
    Case,
    SpiralFit,
    exact_path,
    fit_cardioids,
    fit_spirals,
    polar,
)
from twosra_mpc.lab.identification.replay import PhaseReplay
from twosra_mpc.lab.identification.thermal_fit import ThermalFit
from twosra_mpc.plotting import figures, plane, timeline_figures
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import mode_name

BODY_COLOUR = "#12997c"
MEASURED: dict[str, Any] = {"ls": "", "marker": ".", "ms": 3.0, "c": "0.6", "zorder": 2}
HOLD: dict[str, Any] = {"color": "0.93", "lw": 0, "zorder": 0}
PHASES: dict[str, dict[str, Any]] = {
    "heating": {"c": figures.SOFT_COLOUR, "lw": 1.5, "zorder": 3},
    "cooling": {"c": figures.RIGID_COLOUR, "lw": 1.5, "zorder": 3},
}


def plot_thermal_fit(fit: ThermalFit, path: str | Path | None = None) -> Figure:
    """Draw a thermal fit over the time of its log.

    Args:
        fit: The fit.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 8.2), path) as figure:
        figure.suptitle(_thermal_title(fit), wrap=True)
        axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.5, 1.5, 0.6, 1.0))
        _draw_sensor(axes[0], fit)
        _draw_nodes(axes[1], fit)
        _draw_duty(axes[2], fit)
        _draw_residuals(axes[3], fit)
        time = fit.log.time_s
        axes[-1].set(xlabel="time [s]", xlim=(time[0], time[-1]))
        for ax in axes:
            for first, end in runs(fit.log.held):
                ax.axvspan(time[first], time[end - 1], **HOLD)
        figure.align_ylabels(axes)
    return figure


def _thermal_title(fit: ThermalFit) -> str:
    found = fit.residuals
    unseen = fit.held_out_rms_C
    left_out = "" if math.isnan(unseen) else f", {unseen:z.2f} K in cycles left out of the fit"
    rms = f"{found.heating_rms_C:z.2f} K heating, {found.cooling_rms_C:z.2f} K cooling{left_out}"
    return f"{fit.robot}, {Path(fit.source).name}\nRMS residual {rms}"


def _draw_sensor(ax: Axes, fit: ThermalFit) -> None:
    log = fit.log
    ax.plot(log.time_s, log.sensor_C, **MEASURED, label="measured")
    _draw_phases(ax, log, fit.response.sensor_C, "model, ")
    handles, names = ax.get_legend_handles_labels()
    ax.set(ymargin=0.1, ylabel="raw sensor\n[°C]")
    ax.legend([*handles, Patch(**HOLD)], [*names, "hold, not scored"], **figures.BESIDE)


def _draw_phases(ax: Axes, log: EvenLog, values: Array, name: str) -> None:
    """A line for each stretch of heating or cooling, with one label for all of a kind."""
    scored = ~log.held
    for phase, flags in (("heating", scored & log.heating), ("cooling", scored & ~log.heating)):
        chosen = np.where(flags, values, np.nan)
        ax.plot(log.time_s, chosen, **PHASES[phase], label=f"{name}{phase}")


def _draw_nodes(ax: Axes, fit: ThermalFit) -> None:
    log, core = fit.log, fit.response.core_C
    timeline_figures.mark_melting(ax, fit.segment.thresholds_C)
    look: dict[str, Any] = {"label": "core (in holds from the sensor)", **figures.curve(0)}
    ax.plot(log.time_s, core, c="#222222", **look)
    ax.plot(log.time_s, fit.response.body_C, c=BODY_COLOUR, label="body", **figures.curve(1))
    ax.set(ymargin=0.1, ylabel="model\n[°C]")
    ax.legend(**figures.BESIDE)


def _draw_duty(ax: Axes, fit: ThermalFit) -> None:
    look: dict[str, Any] = {"fc": figures.HEATER_COLOUR, "lw": 0, "label": "heater law"}
    ax.fill_between(fit.log.time_s[:-1], fit.response.duty, step="post", **look)
    ax.set(ylim=(0.0, 1.08), ylabel="share of\nfull power")
    ax.legend(**figures.BESIDE)


def _draw_residuals(ax: Axes, fit: ThermalFit) -> None:
    log = fit.log
    off = np.where(log.scored, fit.response.sensor_C - log.sensor_C, np.nan)
    ax.axhline(0.0, c="0.5", lw=0.8, zorder=1)
    _draw_phases(ax, log, off, "")
    ax.set(ymargin=0.12, ylabel="model -\nmeasured [K]")
    ax.legend(**figures.BESIDE)


_LOOKS = {"measured": "-", "predicted by the commands": ":", "as bent": "--"}
_X, _Y = figures.SEGMENT_COLOURS[:2]


def plot_replay(
    log: MotionLog, robot: Robot, phases: Sequence[PhaseReplay], path: str | Path | None = None
) -> Figure:
    """Draw the robot at both ends of every phase, its pose and its curvatures in time.

    Args:
        log: The log.
        robot: The robot, with the path model the phases were predicted by.
        phases: The replay, at least one.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 0.8 + 2.5 * len(phases)), path) as figure:
        figure.suptitle(f"{Path(log.source).name}, by {robot.name} ({robot.path.model})")
        grid = figure.subplots(len(phases), 4, squeeze=False, width_ratios=(1.3, 1, 1, 1))
        for axes, phase in zip(grid, phases, strict=True):
            _draw_ends(axes[0], robot, phase)
            _draw_in_time(axes[1:], phase)
        entries = {name: plane.line("0.2", 1.6, dashes) for name, dashes in _LOOKS.items()}
        entries |= {"x, heading": plane.line(_X), "y": plane.line(_Y)}
        for j, colour in enumerate(figures.SEGMENT_COLOURS[: robot.coordinates.segments]):
            entries[f"segment {j + 1}"] = plane.line(colour, 4)
        plane.legend_below(figure, entries, ncols=len(entries))
    return figure


def _draw_ends(ax: Axes, robot: Robot, phase: PhaseReplay) -> None:
    """Draw the robot as it was, has come to, and should have come to, as bent or commanded."""
    plane.draw_ends(ax, robot.geometry, phase.measured[[0, -1]], [phase.mode] * 2, 3.0)
    predicted = phase.predicted if phase.as_bent is None else phase.as_bent
    plane.draw_outline(ax, robot.geometry, predicted[-1])
    plane.frame(ax).set_aspect("equal", adjustable="datalim")
    ax.set_title(mode_name(phase.mode))


def _draw_in_time(axes: Sequence[Axes], phase: PhaseReplay) -> None:
    place, heading, bends = axes
    told = (phase.measured, phase.predicted, phase.as_bent)
    for q, dashes in zip(told, _LOOKS.values(), strict=True):
        if q is not None:
            _draw_columns(place, phase.time_s, 1e3 * (q[:, :2] - phase.measured[0, :2]), dashes)
            _draw_columns(heading, phase.time_s, q[:, 2:POSE], dashes)
            _draw_columns(bends, phase.time_s, q[:, POSE:], dashes)
    place.set(xlabel="time [s]", ylabel="moved [mm]")
    heading.set(xlabel="time [s]", ylabel="heading [rad]")
    bends.set(xlabel="time [s]", ylabel="curvature [1/m]")


def _draw_columns(ax: Axes, time_s: Array, columns: Array, dashes: str) -> None:
    for j, column in enumerate(columns.T):
        ax.plot(time_s, column, **figures.segment_curve(j, dashes))


POSES = 4  # bends the fibre is drawn at, evenly from straight on
PALE = 0.55  # share of white in the colours of the fibre

MODES: dict[Case, Mode] = {"I": (1, 0), "II": (0, 1), "III": (1, 1)}
TITLES: dict[Case, str] = {
    "I": "I: one segment soft, its own LU moves",
    "II": "II: one segment soft, the opposite LU moves",
    "III": "III: both segments soft",
}
CURVES: dict[str, dict[str, Any]] = {
    "exact path": {"c": "#222222", "lw": 1.1, "ls": "-", "zorder": 4},
    "logarithmic spiral": {"c": "#12997c", "lw": 2.0, "ls": (0, (4, 2)), "zorder": 5},
    "cardioid": {"c": "#e07b00", "lw": 2.6, "ls": (0, (0.1, 1.6)), "zorder": 6},
}
CURVES["cardioid"]["dash_capstyle"] = "round"
UNIT: dict[str, Any] = {"ls": "", "marker": "s", "ms": 8.0, "mfc": figures.UNIT_COLOUR, "zorder": 7}
UNIT["mec"] = figures.METAL_COLOUR
HELD: dict[str, Any] = {"ls": "", "marker": "o", "ms": 5.0, "mfc": "white", "zorder": 8}
HELD["mec"] = "#222222"
CENTRE: dict[str, Any] = {"ls": "", "marker": "+", "ms": 7.0, "mew": 1.6, "zorder": 9}


@dataclass(frozen=True, eq=False)
class PathCurves:
    """Curves of one case, in units of l, for bends from straight towards +y.

    Attributes:
        case: I, II or III.
        exact: Moving fibre end, over the range of Table I, (n, 2).
        spiral: The spiral at the same turns about its centre, (n, 2).
        cardioid: The cardioid, over the range it was fitted to, (n, 2).
        spiral_fit: The spiral's parameters.
        cardioid_fit: The cardioid's parameters.
    """

    case: Case
    exact: Array
    spiral: Array
    cardioid: Array
    spiral_fit: SpiralFit
    cardioid_fit: CardioidFit


def plot_paths(robot: Robot, path: str | Path | None = None) -> Figure:
    """Draw the path of the moving fibre end and its fits, in the cases I, II and III.

    Args:
        robot: The robot; only its geometry counts.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If the robot has not two segments, a fit fails, matplotlib cannot write such a
            file, or the folder cannot be written.
    """
    if robot.geometry.segments != 2:
        allowed = "2: spirals and cardioids are the paths of units with two segments between them"
        raise InputError("segments", robot.geometry.segments, allowed)
    with figures.styled_figure((10.0, 4.7), path) as figure:
        curves = path_curves(robot.geometry)
        figure.suptitle(_title(robot), wrap=True)
        for ax, case_curves in zip(figure.subplots(1, 3), curves, strict=True):
            _draw_case(ax, robot.geometry, case_curves)
        _legend(figure)
    return figure


def path_curves(geometry: Geometry, points: int = 241) -> list[PathCurves]:
    """Exact path and fitted curves of the three cases, as points to draw, in units of l."""
    length, curves = geometry.lengths_m[0], []
    fits = zip(CASES, fit_spirals(geometry), fit_cardioids(geometry), strict=True)
    for case, spiral, cardioid in fits:
        bends = np.linspace(0.0, SPIRAL_BENDS_RAD[case][-1], points)
        exact = exact_path(case, geometry, bends) / length
        drawn = spiral_points(spiral, polar(exact, *spiral.centre)[1])
        turn = cardioid.phi_per_alpha * np.linspace(0.0, CARDIOID_BEND_RAD, points)
        radius = 2 * cardioid.radius_m * (1 + np.cos(turn))
        successor = _cartesian(radius, turn, cardioid.centre_m) / length
        curves.append(PathCurves(case, exact, drawn, successor, spiral, cardioid))
    return curves


def _title(robot: Robot) -> str:
    length, link = robot.geometry.lengths_m[0], robot.geometry.middle_link_m
    lengths = f"l = {1e3 * length:z.3g} mm, l₀ = {1e3 * link:z.3g} mm"
    return f"Paths of a locomotion unit (LU): {robot.name}, {lengths}"


def _draw_case(ax: Axes, geometry: Geometry, curves: PathCurves) -> None:
    middle = (curves.exact.min(axis=0) + curves.exact.max(axis=0)) / 2
    for alpha in np.linspace(SPIRAL_BENDS_RAD[curves.case][-1], 0.0, POSES + 1)[1:].tolist():
        end = _draw_fibre(ax, geometry, curves.case, alpha)
        text = f"{np.degrees(alpha):z.0f}°" if alpha else "alpha = 0°"
        shift = 17 * (end - middle) / np.linalg.norm(end - middle) if alpha else (8.0, -12.0)
        place: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": "center"}
        ax.annotate(text, (end[0], end[1]), shift, fontsize=8.5, **place)
    drawn = (curves.exact, curves.spiral, curves.cardioid)
    for points, style in zip(drawn, CURVES.values(), strict=True):
        ax.plot(*points.T, **style)
    cusp = np.array(curves.cardioid_fit.centre_m) / geometry.lengths_m[0]
    ax.plot(0.0, 0.0, **HELD)
    ax.plot(*curves.spiral_fit.centre, **CENTRE, mec=CURVES["logarithmic spiral"]["c"])
    ax.plot(*cusp, **CENTRE, mec=CURVES["cardioid"]["c"])
    lines = [TITLES[curves.case], *_residuals(curves, geometry)]
    ax.set_title("\n".join(lines), fontsize=9, linespacing=1.35)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.15)
    ax.set(xlabel="x / l", ylabel="y / l")


def _residuals(curves: PathCurves, geometry: Geometry) -> list[str]:
    """A line a curve: root mean square of the radial residuals."""
    length = geometry.lengths_m[0]
    spiral, cardioid = curves.spiral_fit.rms_l * length, curves.cardioid_fit.rms_m
    return [
        f"{name}: {_digits(1e3 * rms)} mm rms ({_digits(100 * rms / length)} % of l)"
        for name, rms in (("spiral", spiral), ("cardioid", cardioid))
    ]


def _digits(value: float) -> str:
    """Two significant digits."""
    return f"{value:z#.2g}".rstrip(".")


def held_pose(geometry: Geometry, case: Case, alpha: float) -> Array:
    """Configuration q (5,) [m, m, rad, 1/m, 1/m] with the held end where the paths have it.

    LU1 moves; the soft segments bend by ``alpha`` [rad]. In case I the middle link is held, with
    segment 1's root at the origin; in II and III the end of segment 2 is, heading along x.
    """
    kappa = np.array(MODES[case]) * alpha / geometry.lengths_m[0]
    held = robot_shape(geometry, [0.0, 0.0, 0.0, *kappa], 2).ends[1]
    x, y, angle = (-geometry.half_link_m, 0.0, 0.0) if case == "I" else held
    c, s = np.cos(angle), np.sin(angle)
    return np.array([-c * x - s * y, s * x - c * y, -angle, *kappa])


def _draw_fibre(ax: Axes, geometry: Geometry, case: Case, alpha: float) -> Array:
    """The fibre in pale colours and a mark for the moving LU, whose place (2,) is returned."""
    shape = robot_shape(geometry, held_pose(geometry, case, alpha))
    style: dict[str, Any] = {"solid_capstyle": "butt", "zorder": 2}
    length = geometry.lengths_m[0]
    ax.plot(*shape.links[1].T / length, lw=2.4, c=_pale(figures.METAL_COLOUR), **style)
    for arc, soft in zip(shape.segments / length, MODES[case], strict=True):
        colour = figures.SOFT_COLOUR if soft else figures.RIGID_COLOUR
        ax.plot(*arc.T, lw=3.2, c=_pale(colour), **style)
    end, heading = shape.ends[0, :2] / length, shape.ends[0, 2]
    ax.plot(*end, **UNIT | {"marker": (4, 0, 45 + np.degrees(heading))})
    return end


def _pale(colour: str) -> str:
    """Mix with white, so that fibres that cross do not darken each other."""
    red, green, blue = (PALE + (1 - PALE) * part for part in to_rgb(colour))
    return to_hex((red, green, blue))


def _legend(figure: Figure) -> None:
    ranges = {"cardioid": f"cardioid, alpha ≤ {np.degrees(CARDIOID_BEND_RAD):z.3g}°"}
    entries = {ranges.get(name, name): Line2D([], [], **look) for name, look in CURVES.items()}
    entries |= {
        "soft segment": plane.line(_pale(figures.SOFT_COLOUR), 3.2),
        "rigid segment": plane.line(_pale(figures.RIGID_COLOUR), 3.2),
        "moving LU": Line2D([], [], **UNIT | {"ms": 6}),
        "held end": Line2D([], [], **HELD),
    }
    colours = [CURVES[name]["c"] for name in ("logarithmic spiral", "cardioid")]
    centres = tuple(Line2D([], [], **CENTRE, mec=colour) for colour in colours)
    plane.legend_below(figure, {**entries, "centre of spiral, cusp of cardioid": centres}, 4)


def spiral_points(fit: SpiralFit, turn_rad: ArrayLike) -> Array:
    """Points of a spiral / l at turns (n,) about its centre, shape (n, 2)."""
    turn = np.asarray(turn_rad, dtype=float)
    radius = fit.scale * np.exp(-fit.growth * (fit.start_rad + turn))
    return _cartesian(radius, turn, fit.centre)


def _cartesian(radius: Array, turn: Array, centre: tuple[float, float]) -> Array:
    """Points (n, 2) at distances and turns (n,) about a centre."""
    return np.stack([-radius * np.cos(turn), radius * np.sin(turn)], axis=-1) + centre
