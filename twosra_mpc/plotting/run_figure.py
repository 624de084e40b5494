"""Figure of a run: planned against executed, in the plane and over time.

Needs no display and leaves ``rcParams`` alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from twosra_mpc.execution.run import CHANGING, Drive, Run, times
from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.trajectory import Phase
from twosra_mpc.plotting.figure_file import styled_figure
from twosra_mpc.plotting.robot_drawing import draw_outline, draw_robot
from twosra_mpc.plotting.style import (
    BESIDE,
    FAINT,
    METAL_COLOUR,
    PLANNED_COLOUR,
    RIGID_COLOUR,
    SEGMENT_COLOURS,
    SOFT_COLOUR,
    STATES,
    UNIT_COLOUR,
)
from twosra_mpc.plotting.time_axis import TimeStretch
from twosra_mpc.robot.modes import mode_name

Array = NDArray[np.float64]

SIZE_IN = (10.0, 10.4)
ACCURACY_COLOUR = "#12997c"
JOINED_S = 12.0  # drives of one mode that are less than this apart are shown as one


def plot_run(run: Run, truth: Truth | None = None, path: str | Path | None = None) -> Figure:
    """Draw a run.

    Args:
        run: The run.
        truth: What really happened, if it was a simulation; otherwise what was believed is drawn.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    time_s, q = (run.log.time_s, run.log.q) if truth is None else (truth.time_s, truth.q)
    with styled_figure(SIZE_IN, path) as figure:
        figure.suptitle(run_title(run), wrap=True)
        rows = figure.add_gridspec(2, 1, height_ratios=(0.8, 1.0))
        _draw_plane(figure.add_subfigure(rows[0]), run, time_s, q)
        _draw_timeline(figure.add_subfigure(rows[1]), run, truth, time_s, q)
    return figure


def run_title(run: Run) -> str:
    """How the run ended, in a line or two."""
    planned = run.plans[0].duration_s if run.plans else None
    against = "" if planned is None else f" (planned: {planned:.0f} s)"
    again = f", planned again {times(run.replans)}" if run.replans else ""
    first = f"{run.reason[0].upper()}{run.reason[1:]}"
    transitions = f"{run.transitions} transition{'s' * (run.transitions != 1)}"
    return f"{first}\nafter {run.duration_s:.0f} s{against}, {transitions}{again}"


def joined_drives(run: Run) -> list[Drive]:
    """Drives, those of one mode that follow each other closely joined."""
    joined: list[Drive] = []
    for drive in run.drives:
        before = joined[-1] if joined else None
        if before and before.mode == drive.mode and drive.start_s - before.end_s < JOINED_S:
            joined[-1] = before._replace(end_s=drive.end_s)
        else:
            joined.append(drive)
    return joined


def _draw_plane(figure: SubFigure, run: Run, time_s: Array, q: Array) -> None:
    """The whole run on the left; on the right each drive, planned and executed."""
    drives = joined_drives(run)[:9]
    outer = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.15))
    panels = [figure.add_subplot(outer[0])]
    _draw_overview(panels[0], run, time_s, q)
    rows = 1 if len(drives) < 2 else 2 if len(drives) <= 6 else 3
    columns = max(1, -(-len(drives) // rows))
    grid = outer[1].subgridspec(rows, 2 * columns)
    for number, drive in enumerate(drives):
        row, column = divmod(number, columns)
        left = 2 * column + (row == rows - 1) * (rows * columns - len(drives))  # centred
        panels.append(figure.add_subplot(grid[row, left : left + 2]))
        _draw_drive(panels[-1], run, time_s, q, number, drive)
    corners = robot_shape(run.problem.robot.geometry, q[::20], 2).wheels
    for panel in panels:
        panel.set_aspect("equal", adjustable="datalim")
        panel.update_datalim(corners.reshape(-1, 2))
    _plane_legend(figure, planned=bool(run.plans))


def _draw_overview(ax: Axes, run: Run, time_s: Array, q: Array) -> None:
    geometry = run.problem.robot.geometry
    draw_robot(ax, geometry, q[0], run.problem.start_mode, alpha=FAINT, linewidth=5)
    draw_robot(ax, geometry, q[-1], run.problem.goal.mode, linewidth=5)
    draw_outline(ax, geometry, goal_configuration(run))
    _draw_paths(ax, run, time_s, q, 0.0, math.inf)
    ax.margins(0.12, 0.1)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def goal_configuration(run: Run) -> Array:
    """Goal of a run; free coordinates as planned first, or as reached."""
    goal = run.problem.goal.configuration
    samples = run.plans[0].samples if run.plans else None
    other = run.log.q[-1] if samples is None else samples.q[-1]
    return np.where(np.isnan(goal), other, goal)


def _draw_drive(ax: Axes, run: Run, time_s: Array, q: Array, number: int, drive: Drive) -> None:
    geometry, mode = run.problem.robot.geometry, drive.mode
    first, last = np.searchsorted(time_s, (drive.start_s, drive.end_s))
    draw_robot(ax, geometry, q[first], mode, alpha=FAINT, linewidth=3)
    draw_robot(ax, geometry, q[min(last, len(q) - 1)], mode, linewidth=3)
    rows = run.log.time_s <= drive.end_s + 1e-6
    planned = run.log.planned[rows]
    planned = planned[~np.isnan(planned[:, 0])]
    if len(planned):
        draw_outline(ax, geometry, planned[-1])
    _draw_paths(ax, run, time_s, q, drive.start_s, drive.end_s)
    took = drive.end_s - drive.start_s
    ax.set_title(f"{number + 1}: {mode_name(mode)} at {drive.start_s:.0f} s, {took:.1f} s")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set(visible=True, color="0.8")


def _draw_paths(ax: Axes, run: Run, time_s: Array, q: Array, start_s: float, end_s: float) -> None:
    """Paths of the units' centres and of the middle link: executed, and dashed as planned."""
    geometry = run.problem.robot.geometry
    log = run.log
    logged = (log.time_s >= start_s - 1e-6) & (log.time_s <= end_s + 1e-6)
    done = (time_s >= start_s - 1e-6) & (time_s <= end_s + 1e-6)
    planned = log.planned[logged]
    planned = planned[~np.isnan(planned[:, 0])]
    styles: tuple[tuple[Array, dict[str, Any]], ...] = (
        (planned, {"ls": "--", "lw": 1.0, "alpha": 0.8}),
        (q[done], {"ls": "-", "lw": 1.5}),
    )
    for rows, style in styles:
        if not len(rows):
            continue
        centres = robot_shape(geometry, rows, 2).centres
        for unit, colour in enumerate(SEGMENT_COLOURS):
            ax.plot(*centres[:, unit].T, c=colour, zorder=5, **style)
        ax.plot(*rows[:, :2].T, c=SOFT_COLOUR, zorder=5, **style)


def _plane_legend(figure: SubFigure, *, planned: bool) -> None:
    entries: dict[str, Any] = {
        "start": Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR, alpha=FAINT),
        "end": Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR),
        "planned" if planned else "goal": Line2D([], [], c=PLANNED_COLOUR, lw=1.2, ls="--"),
        "rigid": Line2D([], [], c=RIGID_COLOUR, lw=4),
        "soft": Line2D([], [], c=SOFT_COLOUR, lw=4),
        "path of unit 1": Line2D([], [], c=SEGMENT_COLOURS[0], lw=1.5),
        "of unit 2": Line2D([], [], c=SEGMENT_COLOURS[1], lw=1.5),
        "of the middle link": Line2D([], [], c=SOFT_COLOUR, lw=1.5),
    }
    figure.legend(entries.values(), entries, loc="outside lower center", ncols=8, columnspacing=1.2)


def run_stretch(run: Run) -> TimeStretch:
    """Time axis of a run, stretched where it was driven."""
    drives = joined_drives(run)
    phases = [Phase(*drive) for drive in drives]
    least = min(0.12, 0.6 / max(len(drives), 1))
    return TimeStretch.of(phases, run.duration_s or 1.0, least)


def _draw_timeline(
    figure: SubFigure, run: Run, truth: Truth | None, time_s: Array, q: Array
) -> None:
    axes = figure.subplots(5, 1, sharex=True, height_ratios=(1.0, 1.0, 1.0, 0.9, 1.0))
    stretch, drives = run_stretch(run), joined_drives(run)
    note = "time [s]" + (", stretched where the robot was driven (grey)" if drives else "")
    stretch.apply(axes[-1]).set_xlabel(note)
    _draw_stiffness(axes[0], run, stretch, drives)
    _draw_curvatures(axes[1], run, time_s, q)
    _draw_distances(axes[2], run, time_s, q)
    _draw_wheel_speeds(axes[3], run)
    _draw_temperatures(axes[4], run, truth)
    for ax in axes[1:]:
        ax.legend(**BESIDE)
    for ax in (axes[1], axes[3], axes[4]):
        ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
    for ax, drive in product(axes, drives):
        ax.axvspan(drive.start_s, drive.end_s, color="0.9", lw=0, zorder=0)
    for ax, event in product(axes, run.events):
        if event.kind == "replan":
            ax.axvline(event.time_s, color=SOFT_COLOUR, lw=1.0, ls=":", zorder=1)
    figure.align_ylabels(axes)


def reported_states(run: Run, segment: int) -> list[tuple[float, float, str]]:
    """(from, to, state) of segment 0 or 1 [s]; "rigid", "melting", "soft" or "freezing"."""
    log, heater = run.log, run.problem.robot.heater
    melting = log.setpoint_C[:, segment] >= heater.soft_setpoint_C
    changing = np.where(melting, "melting", "freezing")
    told = log.stiffness[:, segment]
    states = np.where(told == CHANGING, changing, np.where(told > CHANGING, "soft", "rigid"))
    edges = [0, *(np.flatnonzero(states[1:] != states[:-1]) + 1).tolist(), len(states) - 1]
    return [
        (float(log.time_s[i]), float(log.time_s[j]), str(states[i])) for i, j in pairwise(edges)
    ]


def _draw_stiffness(ax: Axes, run: Run, stretch: TimeStretch, drives: Sequence[Drive]) -> None:
    """A bar a segment, as reported; the drives named above."""
    for segment, row in ((0, 1.0), (1, 0.0)):
        for low, high, state in reported_states(run, segment):
            ax.barh(row, high - low, 0.6, low, **STATES[state])
    for number, drive in enumerate(drives):
        middle = stretch.forward(np.array(drive[1:])).mean()
        text = f"{number + 1}: {mode_name(drive.mode)}"
        ax.text(middle, 1.0, text, transform=ax.transAxes, ha="center", va="bottom", fontsize=8.5)
    ax.set(ylim=(-0.5, 1.5), yticks=(0, 1), yticklabels=("segment 2", "segment 1"))
    ax.tick_params(axis="y", length=0)
    names = [name for name in STATES if name != "heater current"]
    handles: list[Any] = [Patch(label=name, **STATES[name]) for name in names]
    if run.replans:
        handles.append(Line2D([], [], c=SOFT_COLOUR, lw=1.0, ls=":", label="planned again"))
    ax.legend(handles=handles, **BESIDE)


def _draw_curvatures(ax: Axes, run: Run, time_s: Array, q: Array) -> None:
    log = run.log
    for j, colour in enumerate(SEGMENT_COLOURS):
        seen: dict[str, Any] = {"ls": "", "marker": ".", "ms": 2.5, "alpha": 0.35, "mew": 0}
        ax.plot(log.time_s, log.measured[:, 3 + j], c=colour, **seen)
        ax.plot(log.time_s, log.planned[:, 3 + j], c=colour, lw=1.1, ls="--")
        ax.plot(time_s, q[:, 3 + j], c=colour, lw=1.5, label=rf"$\kappa_{j + 1}$")
    if run.plans:
        ax.plot([], [], c=PLANNED_COLOUR, lw=1.1, ls="--", label="planned")
    ax.plot([], [], c=PLANNED_COLOUR, ls="", marker=".", alpha=0.6, label="camera")
    ax.set(ymargin=0.12, ylabel="curvature\n[1/m]")


def _draw_distances(ax: Axes, run: Run, time_s: Array, q: Array) -> None:
    """Distance from the goal in units of the accuracy, on a logarithmic axis."""
    errors = np.array([run.problem.goal.error(at.copy()) for at in q]) / run.accuracy.scale(
        run.problem.robot.coordinates
    )
    parts = {
        "position": (np.hypot(errors[:, 0], errors[:, 1]), RIGID_COLOUR),
        "heading": (np.abs(errors[:, 2]), "#7b5ea7"),
        "curvatures": (np.abs(errors[:, 3:]).max(axis=1), SOFT_COLOUR),
    }
    for name, (distance, colour) in parts.items():
        ax.plot(time_s, np.maximum(distance, 1e-3), c=colour, lw=1.3, label=name)
    position, heading = 1e3 * run.accuracy.position_m, math.degrees(run.accuracy.heading_rad)
    label = f"{position:g} mm, {heading:g}°, {run.accuracy.curvature_per_m:g} 1/m"
    ax.axhline(1.0, c=ACCURACY_COLOUR, lw=1.0, ls="--", label=label)
    most = max(10.0, *(float(np.nanmax(distance)) for distance, _ in parts.values()))
    ax.set_yscale("log")
    ax.set(ylim=(0.02, 2 * most), ylabel="from goal\n/ accuracy")


def _draw_wheel_speeds(ax: Axes, run: Run) -> None:
    for wheel, speed in enumerate(run.log.wheel_rad_s.T):
        colour, dashes = SEGMENT_COLOURS[wheel // 2], ("-", "--")[wheel % 2]
        style: dict[str, Any] = {"c": colour, "where": "post", "lw": 1.0}
        ax.step(run.log.time_s, speed, dashes, label=f"wheel {wheel + 1}", **style)
    ax.set(ymargin=0.12, ylabel="wheel speed\n[rad/s]")


def _draw_temperatures(ax: Axes, run: Run, truth: Truth | None) -> None:
    log, problem = run.log, run.problem
    solid, liquid = problem.stiffness_thresholds_C
    melting = f"{solid:g} °C" if solid == liquid else f"{solid:g} to {liquid:g} °C"
    ax.axhspan(solid, liquid, color="0.5", lw=1, ls=":", alpha=0.5, label=f"melts at {melting}")
    for j, colour in enumerate(SEGMENT_COLOURS):
        style: dict[str, Any] = {"c": colour, "label": f"segment {j + 1}"}
        if truth is None:
            ax.plot(log.time_s, log.temperature_C[:, j], lw=1.5, **style)
        else:
            ax.plot(truth.time_s, truth.temperature_C[:, j], lw=1.5, **style)
            ax.plot(log.time_s, log.temperature_C[:, j], c=colour, lw=0.9, ls=":")
        ax.step(log.time_s, log.setpoint_C[:, j], where="post", c=colour, lw=0.9, ls="--")
    if truth is not None:
        ax.plot([], [], c=PLANNED_COLOUR, lw=0.9, ls=":", label="by the sensor")
    ax.plot([], [], c=PLANNED_COLOUR, lw=0.9, ls="--", label="set-point")
    ax.set(ymargin=0.12, ylabel="temperature\n[°C]")
