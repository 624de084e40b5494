"""Figures of heating: a heater in closed loop, and the fit of a segment to a heating log.

They need no display and leave ``rcParams`` alone.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from twosra_mpc.control.controller import StiffnessController
from twosra_mpc.control.heater_loop import HeaterRun
from twosra_mpc.identification.heating_log import EvenLog, runs
from twosra_mpc.identification.thermal import ThermalFit
from twosra_mpc.plotting import figures
from twosra_mpc.plotting.timeline import draw_stiffness, intervals_of
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.thermal.model import thresholds_C

TRUE_COLOUR, MEASURED_COLOUR, BODY_COLOUR = "#222222", "#12997c", "#12997c"
MEASURED: dict[str, Any] = {"ls": "", "marker": ".", "ms": 3.0, "c": "0.6", "zorder": 2}
HELD: dict[str, Any] = {"color": "0.93", "lw": 0, "zorder": 0}
PHASES: dict[str, dict[str, Any]] = {
    "heating": {"c": figures.SOFT_COLOUR, "lw": 1.5, "zorder": 3},
    "cooling": {"c": figures.RIGID_COLOUR, "lw": 1.5, "zorder": 3},
}


def plot_heater(
    run: HeaterRun, controller: StiffnessController, name: str, path: str | Path | None = None
) -> Figure:
    """Draw a run over time.

    Args:
        run: The run.
        controller: The controller that made it, for its thresholds.
        name: Name of the robot.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 6.6), path) as figure:
        figure.suptitle(f"Heater of one segment in closed loop: {name}")
        axes = figure.subplots(4, 1, sharex=True, height_ratios=(0.42, 1.9, 0.75, 0.75))
        _draw_stiffness(axes[0], run)
        _draw_temperature(axes[1], run, controller)
        _draw_melt_fraction(axes[2], run)
        _draw_current(axes[3], run, controller)
        for event in run.events:
            for ax in axes[1:]:
                ax.axvline(event.time_s, color="0.85", lw=0.8, zorder=0)
        axes[-1].set(xlim=(0.0, run.time_s[-1]), xlabel="time [s]")
        figure.align_ylabels(axes)
    return figure


def _draw_stiffness(ax: Axes, run: HeaterRun) -> None:
    """A bar for the set-point, and one for what the controller reports."""
    asked = np.where(run.soft_setpoint, "soft", "rigid")
    reported = np.where(run.stiffness == "changing", "melting", run.stiffness)
    draw_stiffness(ax, [intervals_of(run.time_s, states) for states in (asked, reported)], 0.62)
    ax.set(ylim=(-0.5, 1.5), yticks=(0, 1), yticklabels=("reported", "set-point"))
    ax.tick_params(axis="y", length=0)
    ax.spines[:].set_visible(False)
    ax.tick_params(axis="x", length=0)
    looks = {"soft": "soft", "changing": "melting", "rigid": "rigid"}
    handles = [Patch(label=name, **figures.STATES[look]) for name, look in looks.items()]
    ax.legend(handles=handles, **figures.BESIDE)


def _draw_temperature(ax: Axes, run: HeaterRun, controller: StiffnessController) -> None:
    rule = controller.rule
    above, below, hold = rule.liquid_above_C, rule.solid_below_C, controller.soft_setpoint_C
    changing = figures.CHANGING_COLOUR
    ax.axhspan(below, above, color=changing, alpha=0.25, lw=0, label="melting, freezing")
    melting, liquid = thresholds_C(rule.observer.model)
    if melting == liquid:
        ax.axhline(melting, c="0.45", lw=0.8, label=f"melting point {melting:.0f} °C")
    style: dict[str, Any] = {"lw": 1.0, "ls": "--"}
    ax.axhline(below, c=figures.RIGID_COLOUR, label=f"rigid below {below:.1f} °C", **style)
    ax.axhline(above, c=figures.SOFT_COLOUR, label=f"soft above {above:.1f} °C", **style)
    setpoint = np.where(run.soft_setpoint, hold, np.nan)
    ax.plot(run.time_s, setpoint, c="0.45", lw=1.2, ls=":", label=f"set-point {hold:.0f} °C")
    ax.plot(run.time_s, run.measured_C, c=MEASURED_COLOUR, lw=1.2, label="by the sensor")
    ax.plot(run.time_s, run.temperature_C, c=TRUE_COLOUR, lw=1.6, label="segment")
    ax.set(ylabel="temperature\n[°C]", ymargin=0.06)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], **figures.BESIDE)


def _draw_melt_fraction(ax: Axes, run: HeaterRun) -> None:
    ax.plot(run.time_s, run.melt_fraction, c=TRUE_COLOUR, lw=1.6, label="segment")
    dashed: dict[str, Any] = {"c": MEASURED_COLOUR, "lw": 1.2, "ls": "--", "label": "estimate"}
    ax.plot(run.time_s, run.estimated_melt_fraction, **dashed)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.set(ylabel="molten", ylim=(-0.06, 1.06), yticks=(0.0, 0.5, 1.0))
    ax.legend(**figures.BESIDE)


def _draw_current(ax: Axes, run: HeaterRun, controller: StiffnessController) -> None:
    limit, colour = controller.full_current_A, figures.HEATER_COLOUR
    ax.fill_between(run.time_s, run.current_A, step="post", fc=colour, alpha=0.25, lw=0)
    ax.step(run.time_s, run.current_A, c=colour, where="post", lw=1.2, label="current")
    ax.axhline(limit, c="0.45", lw=1.0, ls=":", label=f"limit {limit:g} A")
    ax.set(ylabel="current\n[A]", ylim=(0.0, 1.12 * limit))
    ax.legend(**figures.BESIDE)


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
    unseen = fit.rows[0].held_out_rms_C
    left_out = "" if math.isnan(unseen) else f", {unseen:.2f} K in cycles left out of the fit"
    rms = f"{found.heating_rms_C:.2f} K heating, {found.cooling_rms_C:.2f} K cooling{left_out}"
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
    log, solid, liquid = fit.log, fit.segment.solid_below_C, fit.segment.liquid_above_C
    core = fit.response.core_C
    label = f"changing, {solid:.3g} to {liquid:.3g} °C"
    ax.axhspan(solid, liquid, color="0.5", lw=1, ls=":", alpha=0.4, label=label)
    ax.plot(log.time_s, core, c="#222222", lw=1.5, label="core (in holds from the sensor)")
    body = fit.response.other + log.ambient_C
    ax.plot(log.time_s, body, c=BODY_COLOUR, lw=1.5, label="body")
    ax.set(ymargin=0.1, ylabel="model\n[°C]")
    ax.legend(**figures.BESIDE)


def _draw_duty(ax: Axes, fit: ThermalFit) -> None:
    duty, time = fit.response.duty, fit.log.time_s
    ax.fill_between(
        time[:-1], duty, step="post", fc=figures.HEATER_COLOUR, lw=0, label="heater law"
    )
    ax.set(ylim=(0.0, 1.08), ylabel="share of\nfull power")
    ax.legend(**figures.BESIDE)


def _draw_residuals(ax: Axes, fit: ThermalFit) -> None:
    log = fit.log
    off = np.where(log.scored, fit.response.sensor_C - log.sensor_C, np.nan)
    ax.axhline(0.0, c="0.5", lw=0.8, zorder=1)
    _draw_phases(ax, log, off, "")
    ax.set(ymargin=0.12, ylabel="model -\nmeasured [K]")
    ax.legend(**figures.BESIDE)
