"""Figure of a cold start."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.cold_start.processes import PLAN
from benchmarks.cold_start.tables import Parts, names, wall_times
from benchmarks.figure_style import BLUE, GREY, LIGHT, VERMILLION, print_figure
from benchmarks.suite import Record


def draw_cold_start(records: Sequence[Record], parts: Parts, scenario: str, path: Path) -> None:
    """Wall times of the commands, and the parts of a plan from the shell."""
    with print_figure(path, height_in=4.0) as figure:
        top, bottom = figure.subplots(2, 1, height_ratios=(3, len(parts)), sharex=True)
        _draw_commands(top, records, scenario)
        _draw_parts(bottom, parts)
        bottom.set_xlabel("wall time [ms]")
        bottom.set_xlim(0.0, 1.1e3 * max(wall_times(records, PLAN)))


def _draw_commands(ax: Axes, records: Sequence[Record], scenario: str) -> None:
    shown = names(scenario)
    for i, command in enumerate(shown):
        times = 1e3 * np.array(wall_times(records, command))
        middle = float(np.median(times))
        ax.barh(i, middle, color=BLUE, height=0.6, alpha=0.85)
        ax.plot(times, np.full(len(times), i), "o", ms=2.5, mfc=LIGHT, mec=GREY, mew=0.5)
        ax.annotate(f"{middle:.0f}", (max(times), i), xytext=(5, 0), textcoords="offset points",
                    va="center")  # fmt: skip
    ax.set_yticks(range(len(shown)), list(shown.values()), family="monospace")
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_title("(a) commands: median (bar) and every process (dots)", loc="left")


def _draw_parts(ax: Axes, parts: Parts) -> None:
    left = 0.0
    for i, (name, seconds) in enumerate(parts.items()):
        colour = LIGHT if name.startswith("import") else VERMILLION
        ax.barh(i, 1e3 * seconds, left=1e3 * left, color=colour, height=0.7)
        ax.annotate(f"{1e3 * seconds:.0f}", (1e3 * (left + max(seconds, 0.0)), i), xytext=(4, 0),
                    textcoords="offset points", va="center")  # fmt: skip
        left += seconds
    ax.set_yticks(range(len(parts)), list(parts))
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_title("(b) parts of the first command, one after another", loc="left")
