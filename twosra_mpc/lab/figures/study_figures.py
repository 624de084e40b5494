"""Figures of many random problems: modes, durations, and how the error falls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twosra_mpc.lab.reproduction.greedy_statistics import (
    GroupStatistics,
    OptimalProblem,
    StudyProblem,
    StudyStatistics,
)
from twosra_mpc.plotting import figures, plane
from twosra_mpc.robot.modes import MODES, Mode, mode_name

_MODE_COLOURS: dict[Mode, str] = dict(
    zip(MODES, (figures.RIGID_COLOUR, "#f2a7ab", "#dd5b66", "#8f1620"), strict=True)
)
_COUNT_COLOURS = ("#cfe0f1", "#8fb8df", "#4a86c5", "#1f4e86", "#0c2544", "#000000")
_FK, _PLANNER = "0.45", figures.SOFT_COLOUR


def plot_modes(
    statistics: StudyStatistics,
    planned: Sequence[OptimalProblem],
    path: str | Path | None = None,
) -> Figure:
    """Draw how many modes the published planner used, which was its last, and both durations.

    Args:
        statistics: Of random problems, by the mode in which FK made their targets.
        planned: Both planners on the same problems, with waits.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((12.0, 3.9), path) as figure:
        counts, last, durations = figure.subplots(1, 3)
        groups = statistics.by_target
        numbers = sorted({number for group in groups.values() for number in group.recorded})
        names = [f"{number} mode{'s' * (number > 1)}" for number in numbers]
        colours = dict(zip(names, _COUNT_COLOURS, strict=False))
        _stack(
            counts,
            groups,
            {
                name: [group.recorded.get(number, 0) for group in groups.values()]
                for name, number in zip(names, numbers, strict=True)
            },
            colours,
        )
        counts.set(title="Modes used, recorded steps", ylabel="problems")
        ends = {mode_name(mode): [g.last.get(mode, 0) for g in groups.values()] for mode in MODES}
        _stack(last, groups, ends, {mode_name(mode): c for mode, c in _MODE_COLOURS.items()})
        last.set(title="Last recorded mode")
        _draw_durations(durations, planned)
    return figure


def _stack(
    ax: Axes,
    groups: Mapping[Mode, GroupStatistics],
    layers: Mapping[str, Sequence[int]],
    colours: Mapping[str, str],
) -> None:
    below, places = np.zeros(len(groups)), np.arange(len(groups))
    for name, values in layers.items():
        ax.bar(places, values, bottom=below, color=colours[name], label=name, width=0.7)
        below += values
    ax.set_xticks(places, [mode_name(mode) for mode in groups])
    ax.set(xlabel="target by FK in mode", ylim=(0.0, 1.25 * max(below.max(initial=0.0), 1.0)))
    ax.legend(loc="upper center", ncols=4, columnspacing=0.9, handlelength=1.0)


def _draw_durations(ax: Axes, planned: Sequence[OptimalProblem]) -> None:
    """Share of the problems that take at most so long."""
    pairs = np.array([(one.duration_s, one.greedy_duration_s) for one in planned]).reshape(-1, 2)
    both = np.sort(pairs[np.isfinite(pairs).all(axis=1)], axis=0)
    share = np.arange(1, len(both) + 1) / len(both) if len(both) else np.empty(0)
    looks = (("this planner", figures.RIGID_COLOUR, "-"), ("greedy rule", _PLANNER, "--"))
    for durations, (name, colour, dashes) in zip(both.T, looks, strict=True):
        ax.step(durations, share, where="post", c=colour, ls=dashes, lw=1.6, label=name)
    ax.set(title="Durations with melting and freezing", xlabel="at most so long [s]")
    ax.set(ylabel="share of those that both plan", ylim=(0.0, 1.02), xlim=(0.0, None))
    ax.legend(loc="lower right")


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
