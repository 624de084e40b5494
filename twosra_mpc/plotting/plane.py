"""The plane in figures: an overview beside small panels to one scale, and what colours mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from twosra_mpc.plotting.style import (
    BARE,
    FAINT,
    METAL_COLOUR,
    PLANNED_COLOUR,
    RIGID_COLOUR,
    SOFT_COLOUR,
    UNIT_COLOUR,
)

FAINT_ROBOT = Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR, alpha=FAINT)
ROBOT = Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR)


def line(colour: str, width: float = 1.5, style: str = "-") -> Line2D:
    """What a legend shows for a line."""
    return Line2D([], [], c=colour, lw=width, ls=style)


RIGID, SOFT = line(RIGID_COLOUR, 4), line(SOFT_COLOUR, 4)
DASHED = line(PLANNED_COLOUR, 1.2, "--")


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
    ax.set(**BARE)
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
