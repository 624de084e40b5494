"""What the figures have in common: size for print, colours safe for the colour-blind, sequences.

Colours are those of Okabe and Ito. A mode sequence is drawn as two lanes, segment 1 above segment
2, with one block per phase: coloured where the segment is soft, grey where it is rigid.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnnotationBbox, DrawingArea
from matplotlib.patches import Patch, Rectangle

from twosra_mpc.plotting.figure_file import save_figure
from twosra_mpc.robot.modes import ModeSequence

BLACK, BLUE, ORANGE = "#000000", "#0072B2", "#E69F00"
GREEN, VERMILLION, PURPLE, SKY = "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
GREY, LIGHT = "#7f7f7f", "#cccccc"
SOFT = (BLUE, ORANGE)  # segment 1, segment 2
DPI = 300
WIDTH_IN = 7.0  # two columns of a paper

STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "figure.facecolor": "white",
}


@contextmanager
def print_figure(path: Path, height_in: float, width_in: float = WIDTH_IN) -> Iterator[Figure]:
    """Yield a figure in the style of print, and write it to ``path`` at the end."""
    with rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        save_figure(figure, path)


def sequence_box(
    sequence: ModeSequence, at: tuple[float, float], ax: Axes, block_pt: float, **place: Any
) -> AnnotationBbox:
    """Draw a mode sequence at a point of the axes' data, ``block_pt`` wide per phase."""
    area = DrawingArea(block_pt * len(sequence), 2 * block_pt, 0, 0)
    for i, mode in enumerate(sequence):
        for j, soft in enumerate(mode):
            colour = SOFT[j] if soft else LIGHT
            corner = (i * block_pt, (1 - j) * block_pt)
            area.add_artist(
                Rectangle(corner, block_pt, block_pt, fc=colour, ec="white", lw=block_pt / 10)
            )
    box = AnnotationBbox(area, at, frameon=False, pad=0.0, **place)
    ax.add_artist(box)
    return box


def sequence_legend() -> Sequence[Patch]:
    """What the blocks of a sequence mean, as entries of a legend."""
    return (
        Patch(fc=SOFT[0], label="segment 1 soft (upper lane)"),
        Patch(fc=SOFT[1], label="segment 2 soft (lower lane)"),
        Patch(fc=LIGHT, label="rigid"),
    )
