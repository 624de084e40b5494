"""Figures of a sweep of transition times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter

from benchmarks.figure_style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT,
    VERMILLION,
    print_figure,
    sequence_box,
    sequence_legend,
)
from benchmarks.plan_record import PlanRecord
from benchmarks.transition_sweep.tables import Sweep, column, freezing_times

_FREEZE = "freezing time of a segment [s]"
_UNPROVED = "#f3ead3"
_RUN: dict[str, Any] = {"marker": "o", "ms": 2.6, "mfc": LIGHT, "mec": GREY, "mew": 0.5}
_STOPPED: dict[str, Any] = {"marker": "^", "ms": 4.0, "mfc": "white", "mec": BLACK, "mew": 0.7}
_WITHOUT: dict[str, Any] = {"marker": "x", "ms": 4.0, "mec": BLACK, "mew": 0.9}
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")


def draw_sequences(sweep: Sweep, reference_s: float, path: Path) -> None:
    """Map of the best mode sequence: problems over transition times."""
    times = freezing_times(sweep)
    longest = max(len(plan.sequence) for plans in sweep.values() for plan in plans.values())
    block = min(6.0, 0.8 * 410 / len(times) / max(longest, 1))  # pt; the axes are 410 pt wide
    with print_figure(path, height_in=1.1 + 0.3 * len(sweep)) as figure:
        ax = figure.subplots()
        for row, plans in enumerate(sweep.values()):
            for i, freeze in enumerate(times):
                before = plans[times[i - 1]] if i else plans[freeze]
                _draw_cell(ax, (i, row), plans[freeze], block, before)
        ax.set(
            xlim=(-0.5, len(times) - 0.5),
            ylim=(len(sweep) - 0.5, -0.5),
            xlabel=f"{_FREEZE}, and how many times faster that is than the robot as it is",
        )
        labels = [f"{freeze:g}\n{reference_s / freeze:.3g}$\\times$" for freeze in times]
        ax.set_xticks(range(len(times)), labels)
        ax.set_yticks(range(len(sweep)), list(sweep))
        ax.grid(visible=False)
        for row in range(len(sweep) - 1):
            ax.axhline(row + 0.5, color="white", lw=1.2, zorder=1.5)
        ax.tick_params(length=0, which="both")
        ax.spines[["left", "bottom"]].set_visible(False)
        handles = [
            *sequence_legend(),
            Patch(fc=_UNPROVED, label="not proved optimal"),
            Line2D([], [], color=BLACK, lw=1.0, label="sequence changes"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=3, columnspacing=1.4)


def _draw_cell(
    ax: Axes, at: tuple[int, int], plan: PlanRecord, block_pt: float, before: PlanRecord
) -> None:
    """One plan in the map, with a mark on its left side if its sequence is not the one before."""
    i, row = at
    if plan.status != "optimal":
        ax.add_patch(Rectangle((i - 0.5, row - 0.5), 1, 1, fc=_UNPROVED, lw=0, zorder=1.0))
    if not plan.correct:
        ax.annotate("none", at, ha="center", va="center", fontsize=6.5, color=GREY)
        return
    sequence_box(plan.sequence, at, ax, block_pt)
    if before.correct and before.sequence != plan.sequence:
        ax.plot([i - 0.5] * 2, [row - 0.38, row + 0.38], color=BLACK, lw=1.2)


def draw_total_times(sweep: Sweep, labels: Sequence[str], path: Path) -> None:
    """Total time over transition time for some problems, with the sequences along the curve."""
    columns = min(3, len(labels))
    rows = -(-len(labels) // columns)
    with print_figure(path, height_in=0.5 + 2.2 * rows) as figure:
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for ax in grid.flat[len(labels) :]:
            ax.set_axis_off()
        for label, ax in zip(labels, grid.flat, strict=False):
            _draw_total_time(ax, sweep[label])
            ax.set_title(label, loc="left")
        ax.margins(x=0.16)
        low, high = ax.get_ylim()
        ax.set_ylim(0.6 * low, 3.0 * high)  # room for the sequences
        figure.supxlabel(_FREEZE, fontsize=8.5)
        figure.supylabel("total time of the plan [s]", fontsize=8.5)
        line = Line2D([], [], color=BLACK, marker="o", ms=2.5, label="best plan found")
        area = Patch(fc="#cfe3f1", label="proved gap")
        handles = [line, area, *sequence_legend()]
        figure.legend(
            handles=handles, loc="outside upper center", ncols=5, columnspacing=1.0,
            handlelength=1.4,
        )  # fmt: skip


def _draw_total_time(ax: Axes, plans: dict[float, PlanRecord]) -> None:
    times = [freeze for freeze in sorted(plans) if plans[freeze].correct]
    costs = [plans[freeze].cost or np.nan for freeze in times]
    bounds = [plans[freeze].lower_bound or np.nan for freeze in times]
    ax.fill_between(times, bounds, costs, color="#cfe3f1", lw=0)
    ax.plot(times, costs, color=BLACK, marker="o", ms=2.5, lw=1.0)
    ax.set(xscale="log", yscale="log")
    ax.xaxis.set_major_formatter(_PLAIN)
    ax.yaxis.set_major_formatter(_PLAIN)
    before, above = None, True
    for freeze, cost in reversed(list(zip(times, costs, strict=True))):
        sequence = plans[freeze].sequence
        if sequence != before:
            place = {"xybox": (-6, 16) if above else (6, -16), "boxcoords": "offset points"}
            arrow = {"arrowstyle": "-", "color": GREY, "lw": 0.6, "shrinkB": 1.5}
            sequence_box(sequence, (freeze, cost), ax, 4.6, arrowprops=arrow, **place)
            before, above = sequence, not above


def draw_proofs(sweep: Sweep, limit_s: float, path: Path) -> None:
    """Proved gap and wall time over transition time: every run, median and largest."""
    with print_figure(path, height_in=4.4, width_in=4.8) as figure:
        gap_ax, time_ax = figure.subplots(2, 1, sharex=True)
        _draw_spread(gap_ax, sweep, lambda plan: None if plan.gap is None else 100 * plan.gap)
        _draw_spread(time_ax, sweep, lambda plan: plan.timing.median_s)
        gap_ax.set_yscale("symlog", linthresh=1e-3)
        gap_ax.set(ylabel="proved gap [%]", ylim=(0.0, 150.0))
        gap_ax.set_yticks([0, 0.001, 0.01, 0.1, 1, 10, 100])
        gap_ax.axhline(1.0, color=GREY, lw=0.8, ls="--")
        time_ax.axhline(limit_s, color=GREY, lw=0.8, ls="--")
        for ax, value, text in ((gap_ax, 1.0, "asked"), (time_ax, limit_s, "limit")):
            ax.annotate(
                text, (1.0, value), xycoords=("axes fraction", "data"), fontsize=7.5, color=GREY,
                xytext=(2, 0), textcoords="offset points", va="center",
            )  # fmt: skip
        time_ax.set(yscale="log", ylabel="wall time [s]", xlabel=_FREEZE, xscale="log")
        for axis in (gap_ax.yaxis, time_ax.yaxis, time_ax.xaxis):
            axis.set_major_formatter(_PLAIN)
        handles = [
            Line2D([], [], color=BLUE, label="median"),
            Line2D([], [], color=VERMILLION, ls="--", label="largest"),
            Line2D([], [], ls="", label="run", **_RUN),
            Line2D([], [], ls="", label="stopped by limit", **_STOPPED),
            Line2D([], [], ls="", label="no plan", **_WITHOUT),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=5, columnspacing=1.0,
                      handlelength=1.4)  # fmt: skip


def _draw_spread(ax: Axes, sweep: Sweep, value: Callable[[PlanRecord], float | None]) -> None:
    x, middle, largest = [], [], []
    for freeze in freezing_times(sweep):
        shown = [(plan, y) for plan in column(sweep, freeze) if (y := value(plan)) is not None]
        for plan, y in shown:
            mark = _STOPPED if plan.stopped_early else _RUN
            if not plan.correct:
                mark = _WITHOUT
            ax.plot(freeze, y, ls="", clip_on=False, **mark)
        if shown:
            x.append(freeze)
            middle.append(float(np.median([y for _, y in shown])))
            largest.append(max(y for _, y in shown))
    ax.plot(x, middle, color=BLUE)
    ax.plot(x, largest, color=VERMILLION, ls="--")
