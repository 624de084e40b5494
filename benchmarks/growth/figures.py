"""Figures of growth: wall time over phases and over the grid, with fitted slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullFormatter

from benchmarks.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    ORANGE,
    VERMILLION,
    print_figure,
)
from benchmarks.growth.fixed_sequence import SequenceSolve
from benchmarks.growth.tables import SearchRun, Value, cpu_s, medians
from benchmarks.summary import power_law

_SETTINGS = ((BLUE, "o", "-"), (VERMILLION, "s", "--"), (GREEN, "^", "-."), (ORANGE, "D", ":"))
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")


def draw_phases(
    searches: Sequence[SearchRun], solves: Sequence[SequenceSolve], limit_s: float, path: Path
) -> None:
    """Wall time of searches over ``max_phases``, CPU time of single programs over their phases."""
    with print_figure(path, height_in=3.0) as figure:
        left, right = figure.subplots(1, 2)
        _draw_searches(left, searches, limit_s)
        _draw_law(right, solves, lambda solve: solve.phases, cpu_s, "phases")
        right.set(xlabel="phases of the sequence", ylabel="CPU time [s]")
        right.set_title("(b) one nonlinear program", loc="left")


def draw_grid(solves: Sequence[SequenceSolve], path: Path) -> None:
    """CPU time of single programs over their grid, whole and per iteration."""
    with print_figure(path, height_in=2.9) as figure:
        left, right = figure.subplots(1, 2)
        for ax, value, title, unit in (
            (left, cpu_s, "(a) until solved", "CPU time [s]"),
            (right, lambda solve: 1e3 * solve.iteration_s, "(b) per iteration", "CPU time [ms]"),
        ):
            _draw_law(ax, solves, lambda solve: solve.intervals, value, "intervals")
            ax.set(xlabel="shooting intervals per phase", ylabel=unit)
            ax.set_title(title, loc="left")


def _draw_searches(ax: Axes, searches: Sequence[SearchRun], limit_s: float) -> None:
    settings = list(dict.fromkeys(run.setting for run in searches))
    for setting, (colour, marker, dash) in zip(settings, _SETTINGS, strict=False):
        same = [run for run in searches if run.setting == setting]
        x = sorted({run.max_phases for run in same})
        times = [[r.plan.timing.median_s for r in same if r.max_phases == n] for n in x]
        ax.plot(x, [np.median(t) for t in times], color=colour, marker=marker, ls=dash, ms=4,
                label=setting)  # fmt: skip
        ax.plot(x, [max(t) for t in times], color=colour, ls=dash, lw=0.6)
    ax.axhline(limit_s, color=GREY, lw=0.8, ls=(0, (5, 3)))
    ax.annotate(
        "time limit", (0.0, limit_s), xycoords=("axes fraction", "data"), xytext=(3, 2),
        textcoords="offset points", fontsize=7.5, color=GREY,
    )  # fmt: skip
    ax.set(yscale="log", xlabel="max_phases", ylabel="wall time [s]")
    ax.yaxis.set_major_formatter(_PLAIN)
    ax.xaxis.set_major_locator(MultipleLocator(1))
    ax.set_title("(a) whole search", loc="left")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, columnspacing=1.0)


def _draw_law(
    ax: Axes,
    solves: Sequence[SequenceSolve],
    size: Callable[[SequenceSolve], int],
    value: Value,
    name: str,
) -> None:
    """Every program, the medians, and the power law through them."""
    solved = [solve for solve in solves if solve.iterations]
    x, y = medians(solves, size, value)
    ax.plot(
        [size(solve) for solve in solved], [value(solve) for solve in solved], "o", ms=3,
        mfc=LIGHT, mec=GREY, mew=0.5, label="program",
    )  # fmt: skip
    ax.plot(x, y, "o", color=BLUE, ms=5, label="median")
    if len(x) > 1:
        scale, slope = power_law(x, y)
        law = f"{name}$^{{{slope:.2f}}}$"
        ax.plot(x, scale * np.array(x) ** slope, color=BLACK, lw=1.0, label=f"fit: {law}")
    ax.set(xscale="log", yscale="log")
    ax.set_xticks(x)
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(_PLAIN)
        axis.set_minor_formatter(NullFormatter())
    ax.tick_params(axis="x", which="minor", length=0)
    ax.legend(loc="upper left")
