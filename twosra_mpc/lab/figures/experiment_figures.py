"""Figures of the paper's experiments: trials, bending test, segments in thermal photographs.

Photograph, contour, medial line and fitted arc are after the paper's figure of section "Curvature
estimation", for any camera.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.photographs.picture import WHITE, Camera, upsampled
from twosra_mpc.lab.photographs.study import (
    ESTIMATORS,
    Estimate,
    Measured,
    load_cycles,
    mean_of_cycles,
    series,
)
from twosra_mpc.lab.reproduction.published_runs import PublishedTrajectory
from twosra_mpc.plotting import figures, plane
from twosra_mpc.plotting.timeline_figures import COORDINATES
from twosra_mpc.robot.coordinates import Array

SHOWN = 5  # pictures, evenly by curvature
TITLES = ("Photograph", "Contour", "Medial line", "Fitted arc")
_ROOM = 0.55  # of the segment's length, around what shines
_BAR_M = 0.01  # length of the scale bar [m]
_FINE = 8  # times finer is the picture whose contour is drawn

_CONTOUR: dict[str, Any] = {"colors": "#35c4ff", "linewidths": 1.2}
_THIN: dict[str, Any] = {"c": figures.CHANGING_COLOUR, "lw": 3.0}
_SMOOTH: dict[str, Any] = {"c": figures.SEGMENT_COLOURS[2], "lw": 1.4, "ls": (0, (3, 1.5))}
_LINE: dict[str, Any] = {"c": figures.RIGID_COLOUR, "ls": "", "marker": "o", "ms": 3.6}
_ARC: dict[str, Any] = {"c": figures.SOFT_COLOUR, "lw": 1.6}
_LOOKS: dict[str, dict[str, Any]] = {
    "published": {"c": figures.SEGMENT_COLOURS[2], "marker": "x", "ms": 4, "mew": 0.9},
    "arc": {"c": figures.SOFT_COLOUR, "marker": "o", "ms": 2.6},
}


def plot_curvature(
    estimates: Sequence[Estimate], camera: Camera, path: str | Path | None = None
) -> Figure:
    """Draw up to five pictures in four steps, and all estimates over their references, if any.

    Args:
        estimates: Estimates of pictures, of which at least one was not refused.
        camera: How they were taken.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    shown = _chosen(estimates)
    compared = len(estimates) > 1 and any(math.isfinite(e.reference_per_m) for e in estimates)
    height = 2.3 * len(shown) + 0.7
    with figures.styled_figure((9.2 + 4.6 * compared, height), path) as figure:
        pictures: Figure | SubFigure = figure
        if compared:
            pictures, beside = figure.subfigures(1, 2, width_ratios=(2, 1), squeeze=False)[0]
            top, bottom = beside.subplots(2, 1, sharex=True, height_ratios=(2, 1))
            draw_estimates(top, bottom, estimates)
        grid = pictures.subplots(len(shown), 4, squeeze=False)
        for axes, each in zip(grid, shown, strict=True):
            assert each.measured is not None  # as chosen
            draw_steps(axes, each, each.measured, camera)
        for ax, title in zip(grid[0], TITLES, strict=True):
            ax.set_title(title)
        entries = {
            "thinned line": plane.line(_THIN["c"], _THIN["lw"]),
            "its polynomial (published)": plane.line(_SMOOTH["c"], 1.4, "--"),
            "middle across": Line2D([], [], **_LINE),
            "arc": plane.line(_ARC["c"], 1.6),
        }
        plane.legend_below(pictures, entries, ncols=4)
    return figure


def _chosen(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Pictures evenly from the least curvature to the greatest."""
    measured = sorted((e for e in estimates if e.measured), key=lambda e: e.arc_per_m)
    places = np.linspace(0, len(measured) - 1, min(SHOWN, len(measured)))
    return [measured[int(place)] for place in np.round(places)]


def draw_steps(axes: Sequence[Axes], each: Estimate, measured: Measured, camera: Camera) -> None:
    """Draw one picture on four axes: as it is, its contour, both lines, and the arc."""
    grey = measured.photograph.grey
    for ax, faint in zip(axes, (1.0, 1.0, 0.35, 0.35), strict=True):
        # Bright parts pale for lines to be seen on them, the more the fainter.
        ax.imshow(255 * (1 - faint) + faint * grey, cmap="gray", vmin=0, vmax=WHITE)
        _frame(ax, measured, camera)
    _bar(axes[0], camera)
    axes[0].set_ylabel(f"{each.path.parent.name}/{each.path.name}", fontsize=8)
    fine, (top, left) = upsampled(measured.photograph, measured.region, _FINE)
    y, x = ((np.arange(size) + 0.5) / _FINE - 0.5 for size in fine.shape)
    axes[1].contour(x + left, y + top, fine, levels=[camera.threshold], **_CONTOUR)
    axes[2].plot(*measured.published.line_px.T, **_THIN)
    axes[2].plot(*measured.published.smooth_px.T, **_SMOOTH)
    mean, spread = each.published_per_m, measured.published.spread_per_m
    known = measured.published.known
    axes[2].set_xlabel(f"{mean:+z.1f} 1/m, spread {spread:z.1f} (on {known:z.0%})", fontsize=8.5)
    axes[3].plot(*measured.arc.line_px.T, **_LINE)
    axes[3].plot(*measured.arc.arc_px.T, **_ARC)
    error, chance = measured.arc.standard_error_per_m, measured.arc.p_value
    fits = f"p = {chance:z.2f}" if chance >= 0.01 else "p < 0.01"
    axes[3].set_xlabel(f"{each.arc_per_m:+z.1f} ± {error:z.1f} 1/m, {fits}", fontsize=8.5)


def _frame(ax: Axes, measured: Measured, camera: Camera) -> None:
    """Square part of the picture around the segment."""
    low, high = measured.arc.arc_px.min(axis=0), measured.arc.arc_px.max(axis=0)
    (x, y), half = (low + high) / 2, (0.5 + _ROOM / 2) * camera.length_px
    ax.set(xlim=(x - half, x + half), ylim=(y + half, y - half), xticks=(), yticks=())
    for spine in ax.spines.values():
        spine.set_visible(False)


def _bar(ax: Axes, camera: Camera) -> None:
    """A length to compare with."""
    long = _BAR_M / camera.scale_m
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x, y = left + 0.06 * (right - left), bottom + 0.08 * (top - bottom)
    ax.plot([x, x + long], [y, y], c="white", lw=2.5, solid_capstyle="butt")
    ax.text(x + long / 2, y + 0.03 * (top - bottom), "10 mm", c="white", ha="center", fontsize=7.5)


def draw_estimates(top: Axes, bottom: Axes, estimates: Sequence[Estimate]) -> None:
    """Draw both estimates over the references, and below how far off they are."""
    limit = 1.05 * float(np.nanmax([abs(each.reference_per_m) for each in estimates]))
    top.plot([-limit, limit], [-limit, limit], c="0.6", lw=0.8, zorder=0)
    bottom.axhline(0.0, c="0.6", lw=0.8, zorder=0)
    for name in ESTIMATORS:
        estimate, reference = series(estimates, name)
        off = estimate - reference
        mse = float(np.nanmean(off**2))
        top.plot(reference, estimate, ls="", label=f"{name}: MSE {mse:z.1f} 1/m²", **_LOOKS[name])
        bottom.plot(reference, off, ls="", **_LOOKS[name])
    top.set(ylabel="estimated curvature [1/m]", xlim=(-limit, limit))
    top.set_title("All pictures, against their references")
    top.legend(loc="upper left")
    bottom.set(xlabel="reference curvature [1/m]", ylabel="difference [1/m]")


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
