"""Figure of a map: best mode sequence and duration over two coordinates of a goal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.lab.studio.goal_map import Cell
from twosra_mpc.plotting import figures

# Paul Tol's bright colours, which the colour-blind can tell apart.
_COLOURS = ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377"]
_PALE = 0.75  # share of white in the colour of what takes longest
_AXES = {"x": "x [m]", "y": "y [m]", "phi": "heading [rad]"}


@public
def plot_map(
    cells: Sequence[Cell], over: tuple[str, str], path: str | Path | None = None
) -> Figure:
    """Draw a map of goals: a colour for each mode sequence, paler where it takes longer.

    Args:
        cells: Of one grid, in any order.
        over: Names of the two coordinates.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If there is nothing to draw, matplotlib cannot write such a file, or the folder
            cannot be written.
    """
    if not cells:
        raise InputError("cells", cells, "at least one cell")
    x, y = (sorted({getattr(cell, name) for cell in cells}) for name in ("x", "y"))
    names = sorted({cell.sequence for cell in cells if cell.sequence})
    colours = dict(zip(names, _COLOURS * len(names), strict=False))
    taken = [cell.duration_s for cell in cells if cell.duration_s is not None]
    least, most = (min(taken), max(taken)) if taken else (0.0, 1.0)
    picture = np.ones((len(y), len(x), 3))
    for cell in cells:
        if cell.duration_s is not None:
            share = _PALE * (cell.duration_s - least) / max(most - least, 1e-9)
            colour = (1 - share) * np.array(to_rgb(colours[cell.sequence])) + share
            picture[y.index(cell.y), x.index(cell.x)] = colour
    with figures.styled_figure((7.2, 5.4), path) as figure:
        ax = figure.add_subplot()
        steps = [(line[-1] - line[0]) / max(len(line) - 1, 1) / 2 or 0.5 for line in (x, y)]
        extent = (x[0] - steps[0], x[-1] + steps[0], y[0] - steps[1], y[-1] + steps[1])
        ax.imshow(picture, origin="lower", extent=extent, aspect="auto")
        ax.set(xlabel=_axis(over[0]), ylabel=_axis(over[1]))
        ax.set_title(f"best mode sequence; paler is longer, {least:z.0f} to {most:z.0f} s")
        handles = [Patch(color=colours[name], label=name) for name in names]
        handles.append(Patch(fc="white", ec="0.5", label="no plan"))
        figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _axis(name: str) -> str:
    return _AXES.get(name, f"curvature {name.removeprefix('kappa')} [1/m]")
