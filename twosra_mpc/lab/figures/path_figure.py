"""Figure of the paths of a locomotion unit: exact, and the spirals and cardioids fitted to them.

After the paper's figure of section "LU Paths Estimation", for any robot. Needs no display and
leaves ``rcParams`` alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from twosra_mpc.errors import InputError
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
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plotting import figures, plane
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import Mode

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
