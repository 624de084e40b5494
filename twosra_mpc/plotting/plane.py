"""The robot to scale in the plane; overviews beside panels, and what the colours mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.arguments import public
from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.plotting import figures
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import Mode, rigid_mode

HATCH = (0.0, (0.25, 0.5))  # dashes of a changing segment, in line widths
_COLOURS = {  # (soft, changing)
    (False, False): figures.RIGID_COLOUR,
    (False, True): figures.CHANGING_COLOUR,
    (True, False): figures.SOFT_COLOUR,
    (True, True): figures.FREEZING_COLOUR,
}
FAINT_ROBOT = Patch(fc=figures.UNIT_COLOUR, ec=figures.METAL_COLOUR, alpha=figures.FAINT)
ROBOT = Patch(fc=figures.UNIT_COLOUR, ec=figures.METAL_COLOUR)


def line(colour: str, width: float = 1.5, style: str = "-") -> Line2D:
    """Legend handle of a line."""
    return Line2D([], [], c=colour, lw=width, ls=style)


RIGID, SOFT = line(figures.RIGID_COLOUR, 4), line(figures.SOFT_COLOUR, 4)
DASHED = line(figures.PLANNED_COLOUR, 1.2, "--")


def overview_and_panels(figure: SubFigure, count: int, right: float) -> list[Axes]:
    """Axes for an overview on the left and, ``right`` times as wide, ``count`` panels, if any."""
    if count == 0:
        return [figure.subplots()]
    outer = figure.add_gridspec(1, 2, width_ratios=(1.0, right))
    axes = [figure.add_subplot(outer[0])]
    rows = 1 if count < 2 else 2 if count <= 6 else 3
    columns = -(-count // rows)
    grid = outer[1].subgridspec(rows, 2 * columns)
    for number in range(count):
        row, column = divmod(number, columns)
        left = 2 * column + (row == rows - 1) * (rows * columns - count)  # the last row is centred
        axes.append(figure.add_subplot(grid[row, left : left + 2]))
        frame(axes[-1])
    return axes


def frame(ax: Axes) -> Axes:
    """Make axes a framed picture without scales."""
    ax.set(**figures.BARE)
    ax.spines[:].set(visible=True, color="0.8")
    return ax


def to_one_scale(axes: Sequence[Axes], points: NDArray[Any]) -> None:
    """Let all axes show at least these points, (..., 2) [m], with x and y alike."""
    for ax in axes:
        ax.set_aspect("equal", adjustable="datalim")
        ax.update_datalim(points.reshape(-1, 2))


def legend_below(figure: Figure | SubFigure, entries: Mapping[str, Any], ncols: int) -> None:
    """Say below a figure what is what; an entry of several lines shows them side by side."""
    style: dict[str, Any] = {"ncols": ncols, "handler_map": {tuple: HandlerTuple(ndivide=None)}}
    style |= {"loc": "outside lower center", "columnspacing": 1.2}
    figure.legend(entries.values(), entries, **style)


@public
def draw_robot(
    ax: Axes,
    geometry: Geometry,
    q: ArrayLike,
    mode: Mode,
    *,
    changing: Mode = (),
    alpha: float = 1.0,
    linewidth: float = 4.0,
) -> Axes:
    """Draw the robot to scale: soft segments red, rigid ones blue.

    Melting ones are amber, freezing ones light blue, both hatched.

    Args:
        ax: Axes in m; give it an equal aspect to see the robot as it is.
        geometry: Lengths of the robot.
        q: Configuration [m, m, rad, 1/m ...], shape (3 + n,).
        mode: 1 where a segment is soft.
        changing: 1 where a segment freezes, if ``mode`` is 1, or melts; default: nowhere.
        alpha: Opacity.
        linewidth: Width of the segments [pt]; the other lines scale with it.

    Returns:
        The axes.
    """
    changes = changing or rigid_mode(len(mode))
    robot_artists(ax, robot_shape(geometry, q), mode, changes, alpha, linewidth)
    return ax


def robot_artists(
    ax: Axes, shape: RobotShape, mode: Mode, changing: Mode, alpha: float, linewidth: float
) -> list[Artist]:
    """Draw a robot's shape as ``draw_robot`` does; every artist drawn, the segments first."""
    style: dict[str, Any] = {"alpha": alpha, "zorder": 3, "solid_capstyle": "butt"}
    fill: dict[str, Any] = {"alpha": alpha, "zorder": 3, "lw": linewidth / 5}
    hatch: dict[str, Any] = {"alpha": alpha, "zorder": 3.1, "c": "white", "ls": HATCH}
    artists: list[Artist] = []
    for arc, soft, now in zip(shape.segments, mode, changing, strict=True):
        artists += ax.plot(*arc.T, lw=linewidth, c=_COLOURS[bool(soft), bool(now)], **style)
    for link in shape.links:
        artists += ax.plot(*link.T, lw=linewidth / 1.7, c=figures.METAL_COLOUR, **style)
    for unit in shape.units:
        artists += ax.fill(*unit.T, fc=figures.UNIT_COLOUR, ec=figures.METAL_COLOUR, **fill)
    for wheel in shape.wheels:
        artists += ax.fill(*wheel.T, fc=figures.METAL_COLOUR, ec="none", **fill)
    for arc, now in zip(shape.segments, changing, strict=True):
        if now:
            artists += ax.plot(*arc.T, lw=linewidth, **hatch)
    return artists


def draw_ends(
    ax: Axes, geometry: Geometry, q: NDArray[Any], modes: Sequence[Mode], linewidth: float
) -> None:
    """Draw the robot at the first of some configurations, faintly, and at the last."""
    draw_robot(ax, geometry, q[0], modes[0], alpha=figures.FAINT, linewidth=linewidth)
    draw_robot(ax, geometry, q[-1], modes[-1], linewidth=linewidth)


@public
def draw_outline(ax: Axes, geometry: Geometry, q: ArrayLike) -> Axes:
    """Draw where the robot shall be, dashed; q as for ``draw_robot``."""
    shape = robot_shape(geometry, q)
    dashed: dict[str, Any] = {"lw": 1.2, "ls": "--", "zorder": 6}
    for arc in shape.segments:
        ax.plot(*arc.T, c=figures.PLANNED_COLOUR, **dashed)
    for unit in shape.units:
        ax.fill(*unit.T, fill=False, ec=figures.PLANNED_COLOUR, **dashed)
    return ax


def number_units(ax: Axes, geometry: Geometry, q: ArrayLike, size_pt: float = 8.5) -> list[Artist]:
    """Write 1 and 2 on the locomotion units; q as for ``draw_robot``."""
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": size_pt, "zorder": 8}
    centres = robot_shape(geometry, q, 2).centres.tolist()
    return [ax.text(x, y, str(number), **style) for number, (x, y) in enumerate(centres, start=1)]
