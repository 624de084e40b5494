"""Figure of many random problems: the error over normalised time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twosra_mpc.lab.reproduction.greedy_statistics import StudyProblem
from twosra_mpc.plotting import figures, plane
from twosra_mpc.robot.modes import MODES, mode_name

_FK, _PLANNER = "0.45", figures.SOFT_COLOUR


def plot_error_curves(problems: Sequence[StudyProblem], path: str | Path | None = None) -> Figure:
    """Draw the error over normalised time, by FK and by the published planner.

    Args:
        problems: Random problems with targets by FK, all of the same normalised times.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((12.0, 3.6), path) as figure:
        for ax, mode in zip(figure.subplots(1, len(MODES), sharey=True), MODES, strict=True):
            group = [one for one in problems if one.target_mode == mode]
            ax.plot([0.0, 1.0], [1.0, 0.0], c="0.7", lw=0.8, ls=":", zorder=0)
            for curves, colour in (
                ([one.fk_error for one in group], _FK),
                ([one.error for one in group], _PLANNER),
            ):
                if curves:
                    _band(ax, np.array(curves), colour)
            ax.set(title=f"target by FK in {mode_name(mode)} ({len(group)})", xlim=(0.0, 1.0))
            ax.set(xlabel="share of the time")
        figure.axes[0].set(ylabel=r"$|q - q_t|$ / largest", ylim=(0.0, 1.02))
        entries = {
            "forward kinematics, median": plane.line(_FK, 1.6),
            "published planner, median": plane.line(_PLANNER, 1.6),
            "straight line": plane.line("0.7", 0.8, ":"),
        }
        plane.legend_below(figure, entries, 3)
    return figure


def _band(ax: Axes, curves: np.ndarray, colour: str) -> None:
    """Median of curves (n, times), and where nine of ten are."""
    low, middle, high = np.percentile(curves, [5.0, 50.0, 95.0], axis=0)
    time = np.linspace(0.0, 1.0, len(middle))
    ax.fill_between(time, low, high, color=colour, alpha=0.25, lw=0)
    ax.plot(time, middle, c=colour, **figures.curve(0 if colour == _FK else 1))
