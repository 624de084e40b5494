"""Plans side by side on one time axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twosra_mpc.arguments import public
from twosra_mpc.errors import InputError
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting import figures, timeline_figures
from twosra_mpc.plotting.plan_figures import WIDTH_IN, plan_title

HEAD_IN, THIN_LANE_IN, BETWEEN_IN = 0.3, 0.24, 0.16  # of plans side by side
MOTION: dict[str, Any] = {"color": "0.3", "alpha": 0.55, "lw": 1.2}  # there; may be very short


@public
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
        heights += (HEAD_IN + THIN_LANE_IN * made.robot.geometry.segments for made in each)
        heights.append(BETWEEN_IN)
    heights.pop()
    with figures.styled_figure((WIDTH_IN, sum(heights) + 1.0), path) as figure:
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
        handles = [*timeline_figures.state_handles(), Patch(**MOTION, label="motion")]
        figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


def _draw_row(ax: Axes, name: str, made: Plan) -> None:
    """Lanes of a plan, named above; its motion as lines that are never too thin to see."""
    timeline_figures.draw_lanes(ax, made)
    for phase in made.phases:
        ax.axvspan(phase.start_s, phase.end_s, **MOTION, zorder=4)
    ax.set_title(f"{name}: {plan_title(made)}", loc="left", fontsize=9)
    ax.set_yticks(ax.get_yticks(), [tick.get_text()[-1] for tick in ax.get_yticklabels()])
    ax.set_ylabel("segment", fontsize=8)
    ax.spines["bottom"].set_visible(False)
    ax.tick_params(axis="x", length=0)
