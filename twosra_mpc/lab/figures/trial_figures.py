"""Figures of the paper's trials and of its bending test, beside our simulations and estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.photographs.study import Estimate, load_cycles, mean_of_cycles
from twosra_mpc.lab.reproduction.published_runs import PublishedTrajectory
from twosra_mpc.plotting import figures, plane
from twosra_mpc.plotting.timeline_figures import COORDINATES
from twosra_mpc.robot.coordinates import Array

_MEASURED, _SIMULATED = "-", "--"
_NAMES = ("x", "y", "φ", "κ₁", "κ₂")


def plot_trials(
    logs: Mapping[int, MotionLog],
    simulated: Mapping[int, PublishedTrajectory],
    path: str | Path | None = None,
) -> Figure:
    """Draw trials over their simulations, row by row as published, and the error over true time.

    Args:
        logs: Trial -> its log, at least one.
        simulated: Trial -> its simulation.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((13.0, 0.7 + 2.3 * len(logs)), path) as figure:
        grid = figure.subplots(len(logs), 4, squeeze=False)
        for axes, (number, log) in zip(grid, sorted(logs.items()), strict=True):
            _draw_trial(axes, log, simulated[number].q)
            axes[0].set_title(f"trial {number}", loc="left", fontweight="bold")
        for ax in grid[-1][:3]:
            ax.set_xlabel("row of the log")
        grid[-1][3].set_xlabel("time since the log begins [s]")
        entries = {
            "measured": plane.line("0.2", 1.6),
            "simulated, held at its end": plane.line("0.2", 1.2, "--"),
            "x, heading, segment 1": plane.line(figures.SEGMENT_COLOURS[0], 4),
            "y, segment 2": plane.line(figures.SEGMENT_COLOURS[1], 4),
            "moving": Patch(fc=figures.SOFT_COLOUR, alpha=0.35),
        }
        plane.legend_below(figure, entries, 5)
    return figure


def _draw_trial(axes: Sequence[Axes], log: MotionLog, simulation: Array) -> None:
    rows = np.arange(max(len(log.q), len(simulation)))
    for ax, (columns, _, label) in zip(axes, COORDINATES.values(), strict=False):
        for q, dashes in ((log.q, _MEASURED), (simulation, _SIMULATED)):
            held = q[np.minimum(rows, len(q) - 1)][:, columns]
            shown = slice(0, len(q)) if q is log.q else slice(None)
            for j, column in enumerate(held.T):
                ax.plot(rows[shown], column[shown], **figures.segment_curve(j, dashes))
        ax.set_ylabel(label)
    left = np.linalg.norm(log.q - simulation[-1], axis=1)
    ax = axes[3]
    for phase in log.phases:
        ends = log.time_s[[phase.start, phase.stop - 1]]
        ax.axvspan(*ends, color=figures.SOFT_COLOUR, alpha=0.35)
    ax.plot(log.time_s, left / left[0], c="0.1", lw=1.6)
    ax.set(ylabel="|q - qₜ| / |q₀ - qₜ|", ylim=(0.0, None))


def plot_distances(
    published: Mapping[int, Sequence[float]],
    ours: Mapping[int, Sequence[float]],
    path: str | Path | None = None,
) -> Figure:
    """Draw distances by dynamic time warping as bars, those published and those found.

    Args:
        published: Trial -> a distance for each coordinate of q, (5,).
        ours: The same of trials whose logs are there.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((9.0, 3.6), path) as figure:
        ax, width = figure.subplots(), 0.8 / len(_NAMES)
        colours = (*figures.SEGMENT_COLOURS, figures.RIGID_COLOUR)
        for number, (name, colour) in enumerate(zip(_NAMES, colours, strict=False)):
            shift = (number - (len(_NAMES) - 1) / 2) * width
            outline: dict[str, Any] = {"fc": "none", "ec": colour, "lw": 1.4}
            filled: dict[str, Any] = {"fc": colour, "alpha": 0.55, "label": name}
            for values, look in ((published, outline), (ours, filled)):
                places = np.array(list(values)) + shift
                ax.bar(places, [each[number] for each in values.values()], width * 0.82, **look)
        ax.set_xticks(list(published), [f"trial {number}" for number in published])
        ax.set(ylabel="distance (no unit)", title="outlined: published; filled: from the logs")
        ax.legend(loc="upper right", ncols=len(_NAMES))
    return figure


def plot_spread(estimates: Sequence[Estimate], path: str | Path | None = None) -> Figure:
    """Draw the mean load and unload of each folder: reference, published mean and spread, arc.

    Args:
        estimates: Estimates with references, folder by folder.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    folders = list(dict.fromkeys(each.path.parent for each in estimates))
    with figures.styled_figure((5.2 * len(folders), 3.8), path) as figure:
        grid = figure.subplots(1, len(folders), squeeze=False)[0]
        for ax, folder in zip(grid, folders, strict=True):
            _draw_cycle(ax, [each for each in estimates if each.path.parent == folder])
            ax.set(title=folder.name, xlabel="share of a load and unload")
        grid[0].set_ylabel("curvature [1/m]")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _draw_cycle(ax: Axes, estimates: Sequence[Estimate]) -> None:
    """Means over the repeats of one folder."""
    known = [(e, e.measured) for e in estimates if e.measured and np.isfinite(e.published_per_m)]
    if not known:
        return
    reference = np.array([each.reference_per_m for each, _ in known])
    cycles = load_cycles(reference)
    constant, mean, arc, spread = (
        mean_of_cycles(np.array(values), cycles)
        for values in (
            reference,
            [each.published_per_m for each, _ in known],
            [each.arc_per_m for each, _ in known],
            [measured.published.spread_per_m for _, measured in known],
        )
    )
    place, colour = np.linspace(0.0, 1.0, len(mean)), figures.SEGMENT_COLOURS[2]
    band: dict[str, Any] = {"color": colour, "alpha": 0.2, "lw": 0}
    band["label"] = "its spread along the segment"
    ax.fill_between(place, mean - spread, mean + spread, **band)
    ax.plot(place, constant, c="0.1", lw=1.6, label="reference (constant curvature)")
    ax.plot(place, mean, c=colour, lw=1.6, ls="--", label="published steps, mean")
    ax.plot(place, arc, c=figures.SOFT_COLOUR, lw=1.2, label="arc")
