"""Figure of plans side by side on one time axis: how long each takes, and what it waits for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twosra_mpc.errors import InputError
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting.figure_file import styled_figure
from twosra_mpc.plotting.plan_figure import plan_title
from twosra_mpc.plotting.timeline import draw_lanes, state_handles

WIDTH_IN, HEAD_IN, LANE_IN, BETWEEN_IN = 10.0, 0.3, 0.24, 0.16
MOTION_COLOUR = "0.35"  # phases are too short for an area


def plot_comparison(plans: Mapping[str, Sequence[Plan]], path: str | Path | None = None) -> Figure:
    """Draw plans on one time axis: a block a problem, in it a row a plan.

    Args:
        plans: Name of each problem -> its plans, e.g. one of each planner.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If there is nothing to compare, matplotlib cannot write such a file, or the
            folder cannot be written.
    """
    every = list(chain.from_iterable(plans.values()))
    if not every:
        raise InputError("plans", dict(plans), "at least one plan")
    end_s = max(made.trajectory.duration_s for made in every) or 1.0
    heights = list[float]()
    for each in plans.values():
        heights += (HEAD_IN + LANE_IN * made.robot.geometry.segments for made in each)
        heights.append(BETWEEN_IN)
    heights.pop()
    with styled_figure((WIDTH_IN, sum(heights) + 1.0), path) as figure:
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        row, axes = 0, list[Axes]()
        for name, each in plans.items():
            for made in each:
                axes.append(figure.add_subplot(grid[row], sharex=axes[0] if axes else None))
                _draw_row(axes[-1], name, made)
                axes[-1].tick_params(labelbottom=False)
                row += 1
            row += 1
        axes[-1].tick_params(labelbottom=True)
        axes[-1].set(xlim=(0.0, 1.005 * end_s), xlabel="time [s]")
        motion = Patch(fc=MOTION_COLOUR, label="motion")
        figure.legend(handles=[*state_handles(), motion], loc="outside lower center", ncols=6)
    return figure


def _draw_row(ax: Axes, name: str, made: Plan) -> None:
    """Lanes of a plan, named above; its motion as lines that are never too thin to see."""
    draw_lanes(ax, made)
    for phase in made.phases:
        ax.axvspan(phase.start_s, phase.end_s, color=MOTION_COLOUR, lw=1.2, zorder=4)
    ax.set_title(f"{name}: {plan_title(made)}", loc="left", fontsize=9)
    ax.set_yticks(ax.get_yticks(), [tick.get_text()[-1] for tick in ax.get_yticklabels()])
    ax.set_ylabel("segment", fontsize=8)
    ax.spines["bottom"].set_visible(False)
    ax.tick_params(axis="x", length=0)
