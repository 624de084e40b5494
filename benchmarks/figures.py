"""All figures, in one style: the package's own with a grid.

A mode sequence is drawn as one lane for each segment, the first on top, with one block per phase
in the colour of its state. Colours of lines are Okabe and Ito's, safe for the colour-blind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.offsetbox import AnnotationBbox, DrawingArea
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, PercentFormatter

from benchmarks.measurement import PlanRecord
from twosra_mpc.plotting.figures import RIGID_COLOUR, SOFT_COLOUR, styled_figure

BLACK, BLUE, VERMILLION, GREEN, ORANGE = COLOURS = (
    *("#000000", "#0072B2", "#D55E00", "#009E73", "#E69F00"),
)
GREY, LIGHT, PALE_YELLOW = "#7f7f7f", "#cccccc", "#f3ead3"
_SETTINGS: dict[Any, Any] = {
    **{"axes.grid": True, "grid.color": "#e6e6e6", "grid.linewidth": 0.6, "axes.axisbelow": True},
    "lines.linewidth": 1.4,
}
_DOT: dict[str, Any] = {"marker": "o", "ms": 2.6, "mfc": LIGHT, "mec": GREY, "mew": 0.5, "ls": ""}
_STOPPED = {**_DOT, "marker": "^", "ms": 4.0, "mfc": "white", "mec": BLACK}
_WITHOUT = {**_DOT, "marker": "x", "ms": 4.0, "mec": BLACK, "mew": 0.9}
_PLAIN = FuncFormatter(lambda value, _: f"{value:zg}")
_FREEZE = "freezing time of a segment [s]"

Plans = Mapping[str, PlanRecord]
Sweep = Mapping[str, Mapping[float, PlanRecord]]  # label -> freezing time [s] -> plan


@contextmanager
def _figure(path: Path, height_in: float, width_in: float = 7.0) -> Iterator[Figure]:
    with styled_figure((width_in, height_in), path) as figure, rc_context(_SETTINGS):
        yield figure


def _legend(figure: Figure, columns: int, handles: Sequence[Any]) -> None:
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, handlelength=1.4)


def _key(label: str, **style: Any) -> Line2D:
    return Line2D([], [], label=label, **style)


def _log(ax: Axes, **settings: Any) -> None:
    """Logarithmic axes with plain numbers."""
    ax.set(xscale="log", yscale="log", **settings)
    ax.xaxis.set_major_formatter(_PLAIN)
    ax.yaxis.set_major_formatter(_PLAIN)


def _spread(ax: Axes, values: Mapping[Any, Sequence[float]], colour: str, label: str) -> None:
    """Every value over x, the medians, and the largest."""
    for x, several in values.items():
        ax.plot([x] * len(several), several, clip_on=False, **_DOT)
    ax.plot([*values], [np.median(v) for v in values.values()], "-", color=colour, label=label)
    ax.plot([*values], [max(v) for v in values.values()], "--", color=colour, lw=0.7)


def draw_wall_times(planners: Mapping[str, Plans], path: Path) -> None:
    """Empirical distribution of wall time over all problems; failures never reach the top."""
    with _figure(path, height_in=2.7, width_in=5.0) as figure:
        ax = figure.subplots()
        for (name, plans), colour in zip(planners.items(), COLOURS, strict=False):
            timings = [plan.timing for plan in plans.values() if plan.correct]
            label = f"{name} ({len(timings)}/{len(plans)})"
            shares = np.arange(len(timings) + 1) / len(plans)
            for width, clock in ((1.4, "median_s"), (0.6, "cpu_median_s")):
                x = sorted(1e3 * getattr(timing, clock) for timing in timings)
                ax.step([0.0, *x], shares, where="post", color=colour, lw=width,
                        label=label if width > 1 else None)  # fmt: skip
        ax.set(xscale="log", xlabel="wall time (thin: CPU time) [ms]",
               ylabel="problems solved correctly", ylim=(0.0, 1.02))  # fmt: skip
        ax.xaxis.set_major_formatter(_PLAIN)
        ax.yaxis.set_major_formatter(PercentFormatter(1.0))
        _legend(figure, 3, ax.get_legend_handles_labels()[0])


def draw_cost_ratios(ours: Plans, greedy: Plans, ratios: Mapping[str, float], path: Path) -> None:
    """Cost relative to greedy with its lower bound, in ascending order."""
    labels = sorted(ratios, key=lambda label: ratios[label])
    bounds = [(ours[x].lower_bound or 0.0) / (greedy[x].cost or math.inf) for x in labels]
    with _figure(path, height_in=2.7) as figure:
        ax = figure.subplots()
        ax.plot(range(len(labels)), [ratios[label] for label in labels], "o", color=BLUE, ms=3.5,
                label="plan")  # fmt: skip
        ax.plot(range(len(labels)), bounds, "_", color=BLACK, label="proved lower bound")
        ax.axhline(1.0, color=GREY, lw=0.8)
        named = len(labels) <= 10  # more do not fit below the axis
        ax.set_xticks(range(len(labels)) if named else [], labels if named else [])
        ax.set(xlabel="problem", ylabel="cost / greedy planner's cost", ylim=(0.0, None))
        ax.grid(axis="x", visible=False)
        _legend(figure, 2, ax.get_legend_handles_labels()[0])


def draw_sequences(sweep: Sweep, times: Sequence[float], reference_s: float, path: Path) -> None:
    """Map of the best mode sequence: problems over transition times."""
    longest = max(len(plan.sequence) for plans in sweep.values() for plan in plans.values())
    block_pt = min(6.0, 330 / len(times) / max(longest, 1))
    with _figure(path, height_in=1.1 + 0.3 * len(sweep)) as figure:
        ax = figure.subplots()
        for row, plans in enumerate(sweep.values()):
            for i, freeze in enumerate(times):
                _draw_sequence(ax, (i, row), plans[freeze], block_pt)
                if i and plans[freeze].sequence != plans[times[i - 1]].sequence:
                    ax.plot([i - 0.5] * 2, [row - 0.38, row + 0.38], color=BLACK, lw=1.2)
        ax.set(xlim=(-0.5, len(times) - 0.5), ylim=(len(sweep) - 0.5, -0.5),
               xlabel=f"{_FREEZE}, and how many times faster than the robot as it is")  # fmt: skip
        names = [f"{freeze:zg}\n{reference_s / freeze:z.3g}$\\times$" for freeze in times]
        ax.set_xticks(range(len(times)), names)
        ax.set_yticks(range(len(sweep)), list(sweep))
        ax.grid(visible=False)
        colours = {"rigid": RIGID_COLOUR, "soft": SOFT_COLOUR, "not proved optimal": PALE_YELLOW}
        keys = [Patch(fc=colour, label=label) for label, colour in colours.items()]
        _legend(figure, 4, [*keys, _key("sequence changes", color=BLACK, lw=1.2)])


def _draw_sequence(ax: Axes, at: tuple[int, int], plan: PlanRecord, block_pt: float) -> None:
    if plan.status != "optimal":
        ax.add_patch(Rectangle((at[0] - 0.5, at[1] - 0.5), 1, 1, fc=PALE_YELLOW, lw=0, zorder=1.0))
    lanes = max(map(len, plan.sequence), default=0)
    area = DrawingArea(block_pt * len(plan.sequence), lanes * block_pt, 0, 0)
    for i, mode in enumerate(plan.sequence):
        for j, soft in enumerate(mode):
            corner = (i * block_pt, (lanes - 1 - j) * block_pt)
            colour = SOFT_COLOUR if soft else RIGID_COLOUR
            area.add_artist(Rectangle(corner, block_pt, block_pt, fc=colour, ec="white", lw=0.6))
    ax.add_artist(AnnotationBbox(area, at, frameon=False, pad=0.0))


def draw_proofs(columns: Mapping[Any, Sequence[PlanRecord]], limit_s: float, path: Path) -> None:
    """Cost, gap and wall time over transition time: every run, median and largest."""
    with _figure(path, height_in=6.0, width_in=4.8) as figure:
        cost_ax, gap_ax, time_ax = figure.subplots(3, 1, sharex=True)
        values: dict[Axes, Callable[[PlanRecord], float | None]] = {
            cost_ax: lambda plan: plan.cost,
            gap_ax: lambda plan: None if plan.gap is None else 100 * plan.gap,
            time_ax: lambda plan: plan.timing.median_s,
        }
        for ax, value in values.items():
            known = {x: [y for p in plans if (y := value(p)) is not None]
                     for x, plans in columns.items()}  # fmt: skip
            _spread(ax, {x: several for x, several in known.items() if several}, BLUE, "median")
            for freeze, plans in columns.items():
                for plan in (plan for plan in plans if plan.stopped_early or not plan.correct):
                    ax.plot(freeze, value(plan) or np.nan, clip_on=False,
                            **(_STOPPED if plan.correct else _WITHOUT))  # fmt: skip
        _log(cost_ax, ylabel="cost [s]")
        _log(time_ax, ylabel="wall time [s]", xlabel=_FREEZE)
        gap_ax.set_yscale("symlog", linthresh=1e-3)
        gap_ax.set(ylabel="proved gap [%]", ylim=(0.0, 150.0))
        gap_ax.set_yticks([0, 0.001, 0.01, 0.1, 1, 10, 100])
        gap_ax.yaxis.set_major_formatter(_PLAIN)
        for ax, y, text in ((gap_ax, 1.0, "asked"), (time_ax, limit_s, "limit")):
            _draw_limit(ax, y, text)
        _legend(figure, 5, [
            _key("median", color=BLUE), _key("largest", color=BLUE, ls="--", lw=0.7),
            _key("run", **_DOT), _key("stopped by limit", **_STOPPED), _key("no plan", **_WITHOUT),
        ])  # fmt: skip


def _draw_limit(ax: Axes, y: float, text: str) -> None:
    ax.axhline(y, color=GREY, lw=0.8, ls=(0, (5, 3)))
    ax.annotate(text, (1.0, y), xycoords=("axes fraction", "data"), xytext=(2, 0), fontsize=7.5,
                textcoords="offset points", va="center", color=GREY)  # fmt: skip


def draw_cold_start(parts: Mapping[str, float], path: Path) -> None:
    """The parts of a plan from the shell [s], one after another."""
    with _figure(path, height_in=3.0) as figure:
        ax = figure.subplots()
        times = 1e3 * np.array([*parts.values()])
        left = np.cumsum(times) - times
        colours = [LIGHT if name.startswith("import") else VERMILLION for name in parts]
        ax.bar_label(ax.barh([*parts], times, left=left, color=colours), fmt="%.0f", padding=3)
        ax.invert_yaxis()
        ax.grid(axis="y", visible=False)
        ax.set(xlabel="wall time [ms]")
        ax.margins(x=0.08)
