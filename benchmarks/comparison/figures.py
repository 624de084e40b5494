"""Figures of a comparison: how fast, and how much cheaper than greedy."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, PercentFormatter

from benchmarks.comparison.tables import PLANNERS, OneProblem, cost_ratios
from benchmarks.figure_style import (
    BLACK,
    BLUE,
    GREY,
    VERMILLION,
    print_figure,
    sequence_box,
    sequence_legend,
)
from benchmarks.summary import ecdf

_NAMED = 10  # problems that fit below the axis by name
_COLOURS = dict(zip(PLANNERS, (BLUE, VERMILLION, BLACK), strict=True))
_DASHES = dict(zip(PLANNERS, ("-", "--", ":"), strict=True))


def draw_wall_times(problems: Sequence[OneProblem], path: Path) -> None:
    """Empirical distribution of wall time over all problems; failures never reach the top."""
    with print_figure(path, height_in=2.7, width_in=5.0) as figure:
        ax = figure.subplots()
        for name in PLANNERS:
            records = [one[name] for one in problems]
            correct = [record.timing for record in records if record.correct]
            style: dict[str, Any] = {"color": _COLOURS[name], "ls": _DASHES[name], "where": "post"}
            label = f"{name} ({len(correct)}/{len(records)})"
            x, y = ecdf([1e3 * timing.median_s for timing in correct], len(records))
            ax.step([*x[:1], *x], [0.0, *y], label=label, **style)
            x, y = ecdf([1e3 * timing.cpu_median_s for timing in correct], len(records))
            ax.step([*x[:1], *x], [0.0, *y], lw=0.6, **style)
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.yaxis.set_major_formatter(PercentFormatter(1.0))
        ax.set(
            xlabel="wall time (thin: CPU time) [ms]",
            ylabel="problems solved correctly",
            ylim=(0.0, 1.02),
        )
        figure.legend(loc="outside upper center", ncols=len(PLANNERS), columnspacing=1.2)


def draw_cost_ratios(problems: Sequence[OneProblem], path: Path) -> None:
    """Cost relative to greedy with its lower bound, grouped by the greedy mode sequence."""
    ratios = cost_ratios(problems)
    shown = [one for one in problems if one["optimal"].problem in ratios]
    counts = Counter(one["greedy"].sequence for one in shown)
    with print_figure(path, height_in=2.9) as figure:
        ax = figure.subplots()
        ax.set_ylim(0.0, max([1.02, *(1.05 * ratio for ratio in ratios.values())]))
        left, room = 0.0, 0.075 * len(shown)  # at least so much, for the sequence above
        ticks: list[tuple[float, str]] = []
        for sequence, _ in counts.most_common():
            group = [one for one in shown if one["greedy"].sequence == sequence]
            group.sort(key=lambda one: ratios[one["optimal"].problem])
            spare = max(0.0, room - len(group))
            places = [left + spare / 2 + i for i in range(len(group))]
            ticks += zip(places, [one["optimal"].problem for one in group], strict=True)
            _draw_group(ax, places, group, ratios)
            middle = ((places[0] + places[-1]) / 2, ax.get_ylim()[1])
            place: dict[str, Any] = {"textcoords": "offset points", "annotation_clip": False}
            ax.annotate(f"{len(group)}", middle, xytext=(0, 3), ha="center", **place)
            place = {"xybox": (0, 14), "boxcoords": "offset points", "annotation_clip": False}
            sequence_box(sequence, middle, ax, 6.0, box_alignment=(0.5, 0.0), **place)
            left += len(group) + spare + 0.02 * len(shown)
        ax.axhline(1.0, color=GREY, lw=0.8)
        ax.set_xlabel("problem, by the greedy planner's mode sequence (above, with their number)")
        ax.set_ylabel("cost / greedy planner's cost")
        named = ticks if len(ticks) <= _NAMED else []
        ax.set_xticks([x for x, _ in named], [label for _, label in named])
        ax.grid(axis="x", visible=False)
        dot = Line2D([], [], color=BLUE, marker="o", ls="", ms=3.5, label="plan")
        bar = Line2D([], [], color=BLACK, marker="_", ls="", ms=6, label="proved lower bound")
        figure.legend(
            handles=[dot, bar, *sequence_legend()], loc="outside lower center", ncols=5,
            columnspacing=1.2, handlelength=1.2,
        )  # fmt: skip


def _draw_group(
    ax: Axes, places: Sequence[float], group: Sequence[OneProblem], ratios: dict[str, float]
) -> None:
    ax.plot(places, [ratios[one["optimal"].problem] for one in group], "o", color=BLUE, ms=3.5)
    bounds = [
        (one["optimal"].lower_bound or 0.0) / (one["greedy"].cost or math.inf) for one in group
    ]
    ax.plot(places, bounds, "_", color=BLACK, ms=3 if len(ratios) > _NAMED else 6, mew=0.8)
