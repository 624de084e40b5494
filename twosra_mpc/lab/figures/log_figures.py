"""Figures of logs: a segment fitted to one of heating, and one of motion as the model has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from twosra_mpc.lab.identification.heating_log import EvenLog, runs
from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.identification.replay import PhaseReplay
from twosra_mpc.lab.identification.thermal_fit import ThermalFit
from twosra_mpc.plotting import figures, plane, timeline_figures
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import mode_name

BODY_COLOUR = "#12997c"
MEASURED: dict[str, Any] = {"ls": "", "marker": ".", "ms": 3.0, "c": "0.6", "zorder": 2}
HELD: dict[str, Any] = {"color": "0.93", "lw": 0, "zorder": 0}
PHASES: dict[str, dict[str, Any]] = {
    "heating": {"c": figures.SOFT_COLOUR, "lw": 1.5, "zorder": 3},
    "cooling": {"c": figures.RIGID_COLOUR, "lw": 1.5, "zorder": 3},
}


def plot_thermal_fit(fit: ThermalFit, path: str | Path | None = None) -> Figure:
    """Draw a thermal fit over the time of its log.

    Args:
        fit: The fit.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 8.2), path) as figure:
        figure.suptitle(_title(fit), wrap=True)
        axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.5, 1.5, 0.6, 1.0))
        _draw_sensor(axes[0], fit)
        _draw_nodes(axes[1], fit)
        _draw_duty(axes[2], fit)
        _draw_residuals(axes[3], fit)
        time = fit.log.time_s
        axes[-1].set(xlabel="time [s]", xlim=(time[0], time[-1]))
        for ax in axes:
            for first, end in runs(fit.log.held):
                ax.axvspan(time[first], time[end - 1], **HELD)
        figure.align_ylabels(axes)
    return figure


def _title(fit: ThermalFit) -> str:
    found = fit.residuals
    unseen = fit.held_out_rms_C
    left_out = "" if math.isnan(unseen) else f", {unseen:z.2f} K in cycles left out of the fit"
    rms = f"{found.heating_rms_C:z.2f} K heating, {found.cooling_rms_C:z.2f} K cooling{left_out}"
    return f"{fit.robot}, {Path(fit.source).name}\nRMS residual {rms}"


def _draw_sensor(ax: Axes, fit: ThermalFit) -> None:
    log = fit.log
    ax.plot(log.time_s, log.sensor_C, **MEASURED, label="measured")
    _draw_phases(ax, log, fit.response.sensor_C, "model, ")
    handles, names = ax.get_legend_handles_labels()
    ax.set(ymargin=0.1, ylabel="raw sensor\n[°C]")
    ax.legend([*handles, Patch(**HELD)], [*names, "hold, not scored"], **figures.BESIDE)


def _draw_phases(ax: Axes, log: EvenLog, values: Array, name: str) -> None:
    """A line for each stretch of heating or cooling, with one label for all of a kind."""
    scored = ~log.held
    for phase, flags in (("heating", scored & log.heating), ("cooling", scored & ~log.heating)):
        chosen = np.where(flags, values, np.nan)
        ax.plot(log.time_s, chosen, **PHASES[phase], label=f"{name}{phase}")


def _draw_nodes(ax: Axes, fit: ThermalFit) -> None:
    log, core = fit.log, fit.response.core_C
    timeline_figures.mark_melting(ax, fit.segment.thresholds_C)
    look: dict[str, Any] = {"label": "core (in holds from the sensor)", **figures.curve(0)}
    ax.plot(log.time_s, core, c="#222222", **look)
    ax.plot(log.time_s, fit.response.body_C, c=BODY_COLOUR, label="body", **figures.curve(1))
    ax.set(ymargin=0.1, ylabel="model\n[°C]")
    ax.legend(**figures.BESIDE)


def _draw_duty(ax: Axes, fit: ThermalFit) -> None:
    look: dict[str, Any] = {"fc": figures.HEATER_COLOUR, "lw": 0, "label": "heater law"}
    ax.fill_between(fit.log.time_s[:-1], fit.response.duty, step="post", **look)
    ax.set(ylim=(0.0, 1.08), ylabel="share of\nfull power")
    ax.legend(**figures.BESIDE)


def _draw_residuals(ax: Axes, fit: ThermalFit) -> None:
    log = fit.log
    off = np.where(log.scored, fit.response.sensor_C - log.sensor_C, np.nan)
    ax.axhline(0.0, c="0.5", lw=0.8, zorder=1)
    _draw_phases(ax, log, off, "")
    ax.set(ymargin=0.12, ylabel="model -\nmeasured [K]")
    ax.legend(**figures.BESIDE)


_LOOKS = {"measured": "-", "predicted by the commands": ":", "as bent": "--"}
_X, _Y = figures.SEGMENT_COLOURS[:2]


def plot_replay(
    log: MotionLog, robot: Robot, phases: Sequence[PhaseReplay], path: str | Path | None = None
) -> Figure:
    """Draw the robot at both ends of every phase, its pose and its curvatures in time.

    Args:
        log: The log.
        robot: The robot, with the path model the phases were predicted by.
        phases: The replay, at least one.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 0.8 + 2.5 * len(phases)), path) as figure:
        figure.suptitle(f"{Path(log.source).name}, by {robot.name} ({robot.path.model})")
        grid = figure.subplots(len(phases), 4, squeeze=False, width_ratios=(1.3, 1, 1, 1))
        for axes, phase in zip(grid, phases, strict=True):
            _draw_ends(axes[0], robot, phase)
            _draw_in_time(axes[1:], phase)
        entries = {name: plane.line("0.2", 1.6, dashes) for name, dashes in _LOOKS.items()}
        entries |= {"x, heading": plane.line(_X), "y": plane.line(_Y)}
        for j, colour in enumerate(figures.SEGMENT_COLOURS[: robot.coordinates.segments]):
            entries[f"segment {j + 1}"] = plane.line(colour, 4)
        plane.legend_below(figure, entries, ncols=len(entries))
    return figure


def _draw_ends(ax: Axes, robot: Robot, phase: PhaseReplay) -> None:
    """Draw the robot as it was, has come to, and should have come to, as bent or commanded."""
    plane.draw_ends(ax, robot.geometry, phase.measured[[0, -1]], [phase.mode] * 2, 3.0)
    predicted = phase.predicted if phase.as_bent is None else phase.as_bent
    plane.draw_outline(ax, robot.geometry, predicted[-1])
    plane.frame(ax).set_aspect("equal", adjustable="datalim")
    ax.set_title(mode_name(phase.mode))


def _draw_in_time(axes: Sequence[Axes], phase: PhaseReplay) -> None:
    place, heading, bends = axes
    told = (phase.measured, phase.predicted, phase.as_bent)
    for q, dashes in zip(told, _LOOKS.values(), strict=True):
        if q is not None:
            _draw_columns(place, phase.time_s, 1e3 * (q[:, :2] - phase.measured[0, :2]), dashes)
            _draw_columns(heading, phase.time_s, q[:, 2:POSE], dashes)
            _draw_columns(bends, phase.time_s, q[:, POSE:], dashes)
    place.set(xlabel="time [s]", ylabel="moved [mm]")
    heading.set(xlabel="time [s]", ylabel="heading [rad]")
    bends.set(xlabel="time [s]", ylabel="curvature [1/m]")


def _draw_columns(ax: Axes, time_s: Array, columns: Array, dashes: str) -> None:
    for j, column in enumerate(columns.T):
        ax.plot(time_s, column, **figures.segment_curve(j, dashes))
