"""Figure of a heater in closed loop. It needs no display and leaves ``rcParams`` alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from twosra_mpc.control.stiffness_controller import StiffnessController
from twosra_mpc.lab.bench.heater_loop import HeaterRun
from twosra_mpc.plotting import figures
from twosra_mpc.plotting.timeline_figures import draw_stiffness, intervals_of
from twosra_mpc.thermal.model import thresholds_C

TRUE_COLOUR, MEASURED_COLOUR = "#222222", "#12997c"


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
        ax.axhline(melting, c="0.45", lw=0.8, label=f"melting point {melting:z.0f} °C")
    style: dict[str, Any] = {"lw": 1.0, "ls": "--"}
    ax.axhline(below, c=figures.RIGID_COLOUR, label=f"rigid below {below:z.1f} °C", **style)
    ax.axhline(above, c=figures.SOFT_COLOUR, label=f"soft above {above:z.1f} °C", **style)
    setpoint = np.where(run.soft_setpoint, hold, np.nan)
    ax.plot(
        run.time_s, run.measured_C, c=MEASURED_COLOUR, label="by the sensor", **figures.curve(0)
    )
    ax.plot(run.time_s, run.temperature_C, c=TRUE_COLOUR, label="segment", **figures.curve(1))
    dotted: dict[str, Any] = {
        "c": "0.45",
        "label": f"set-point {hold:z.0f} °C",
        **figures.curve(0, ":"),
    }
    ax.plot(run.time_s, setpoint, **dotted)
    ax.set(ylabel="temperature\n[°C]", ymargin=0.06)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(handles[::-1], labels[::-1], **figures.BESIDE)


def _draw_melt_fraction(ax: Axes, run: HeaterRun) -> None:
    ax.plot(run.time_s, run.melt_fraction, c=TRUE_COLOUR, label="segment", **figures.curve(0))
    dashed: dict[str, Any] = {"c": MEASURED_COLOUR, "label": "estimate", **figures.curve(0, "--")}
    ax.plot(run.time_s, run.estimated_melt_fraction, **dashed)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.set(ylabel="molten", ylim=(-0.06, 1.06), yticks=(0.0, 0.5, 1.0))
    ax.legend(**figures.BESIDE)


def _draw_current(ax: Axes, run: HeaterRun, controller: StiffnessController) -> None:
    limit, colour = controller.full_current_A, figures.HEATER_COLOUR
    ax.fill_between(run.time_s, run.current_A, step="post", fc=colour, alpha=0.25, lw=0)
    ax.step(run.time_s, run.current_A, c=colour, where="post", lw=1.2, label="current")
    ax.axhline(limit, c="0.45", lw=1.0, ls=":", label=f"limit {limit:zg} A")
    ax.set(ylabel="current\n[A]", ylim=(0.0, 1.12 * limit))
    ax.legend(**figures.BESIDE)
