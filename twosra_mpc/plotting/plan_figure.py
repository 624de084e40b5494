"""Figure of a plan: the robot in the plane, and everything over time.

Needs no display and leaves ``rcParams`` alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Phase, Samples
from twosra_mpc.plotting.figure_file import styled_figure
from twosra_mpc.plotting.robot_drawing import draw_robot, number_units
from twosra_mpc.plotting.style import (
    FAINT,
    METAL_COLOUR,
    RIGID_COLOUR,
    SOFT_COLOUR,
    UNIT_COLOUR,
)
from twosra_mpc.plotting.timeline import (
    configuration_at,
    draw_configuration,
    draw_melt_fractions,
    draw_motion,
    draw_temperatures,
    draw_timeline,
    draw_wheel_speeds,
    name_phases,
    phase_duration,
    plan_stretch,
    samples_of,
)
from twosra_mpc.robot.modes import mode_name

Array = NDArray[np.float64]

SIZE_IN = (10.0, 9.8)


def plot_plan(plan: Plan, path: str | Path | None = None) -> Figure:
    """Draw a plan: start, goal and every phase in the plane; stiffness and motion over time.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        NoPlanError: If the plan has no samples.
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    samples = samples_of(plan)
    with styled_figure(SIZE_IN, path) as figure:
        figure.suptitle(plan_title(plan), wrap=True)
        rows = figure.add_gridspec(2, 1, height_ratios=(0.85, 1.0))
        _draw_plane(figure.add_subfigure(rows[0]), plan, samples)
        _draw_over_time(figure.add_subfigure(rows[1]), plan)
    return figure


def plan_title(plan: Plan) -> str:
    """Mode sequence, duration and what is known, in one line."""
    sequence = " → ".join(mode_name(phase.mode) for phase in plan.phases) or "no motion"
    duration = "" if plan.duration_s is None else f" in {plan.duration_s:.1f} s"
    planner = "" if plan.planner == "optimal" else f"{plan.planner}, "
    gap = "no bound proved"
    if plan.gap is not None:
        gap = f"proved gap {100 * plan.gap:.2g} %" if plan.gap > 1e-5 else "proved gap < 0.001 %"
    return f"{sequence}{duration}: {planner}{plan.status}, {gap}"


def _draw_plane(figure: SubFigure, plan: Plan, samples: Samples) -> None:
    """Overview on the left; on the right, if there are several phases, a panel each."""
    phases = plan.phases if len(plan.phases) > 1 else ()
    outer = figure.add_gridspec(1, 2 if phases else 1, width_ratios=(1.0, 1.1) if phases else None)
    panels = [figure.add_subplot(outer[0])]
    _draw_overview(panels[0], plan, samples)
    rows = 2 if len(phases) <= 6 else 3
    columns = -(-len(phases) // rows)
    grid = outer[-1].subgridspec(rows, max(2 * columns, 1))
    for number, phase in enumerate(phases):
        row, column = divmod(number, columns)
        left = 2 * column + (row == rows - 1) * (rows * columns - len(phases))  # centred
        panels.append(figure.add_subplot(grid[row, left : left + 2]))
        _draw_phase(panels[-1], plan, samples, number, phase)
    times = [0.0, *(t for phase in plan.phases for t in phase[1:])]
    seen = [robot_shape(plan.robot.geometry, configuration_at(samples, t)).wheels for t in times]
    for panel in panels:
        panel.set_aspect("equal", adjustable="datalim")
        panel.update_datalim(np.concatenate(seen).reshape(-1, 2))
    _plane_legend(figure)


def _draw_overview(ax: Axes, plan: Plan, samples: Samples) -> None:
    geometry, ends, modes = plan.robot.geometry, samples.q[[0, -1]], samples.mode[[0, -1]].tolist()
    draw_robot(ax, geometry, ends[0], modes[0], alpha=FAINT, linewidth=5)
    draw_robot(ax, geometry, ends[1], modes[1], linewidth=5)
    for phase in reversed(plan.phases):  # the end of a phase lies over the start of the next
        _draw_path(ax, samples, phase)
    shapes = [robot_shape(geometry, q) for q in ends]
    start, goal = (shape.centres for shape in shapes)
    number_units(ax, geometry, ends[1])
    apart = np.linalg.norm(start[:, None] - goal, axis=2)
    i, j = np.argmax(apart.min(axis=1)), np.argmax(apart.min(axis=0))
    j = 1 - j if apart[i, j] < geometry.unit_side_m else j  # one label a unit
    for name, centre, shape in zip(("start", "goal"), (start[i], goal[j]), shapes, strict=True):
        outward = (centre - shape.origin) / np.linalg.norm(centre - shape.origin)
        tip, shift = centre + 0.9 * geometry.unit_side_m * outward, (5 * outward).tolist()
        side = ("center", "left", "right")[round(outward[0])]
        style: dict[str, Any] = {"ha": side, "va": "center", "fontweight": "bold", "zorder": 7}
        ax.annotate(name, tip, shift, textcoords="offset points", **style)
    ax.margins(0.15, 0.1)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def _draw_phase(ax: Axes, plan: Plan, samples: Samples, number: int, phase: Phase) -> None:
    geometry, mode = plan.robot.geometry, phase.mode
    draw_robot(
        ax, geometry, configuration_at(samples, phase.start_s), mode, alpha=FAINT, linewidth=3
    )
    draw_robot(ax, geometry, configuration_at(samples, phase.end_s), mode, linewidth=3)
    _draw_path(ax, samples, phase)
    ax.set_title(f"{number + 1}: {mode_name(phase.mode)}, {phase_duration(phase)}")
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set(visible=True, color="0.8")


def _draw_path(ax: Axes, samples: Samples, phase: Phase) -> None:
    """Path of b0 during a phase: blue while driving, red while bending."""
    low, high = np.searchsorted(samples.t_s, (phase.start_s - 1e-9, phase.end_s + 1e-9))
    colour = SOFT_COLOUR if any(phase.mode) else RIGID_COLOUR
    style: dict[str, Any] = {"marker": "o", "ms": 3.5, "mfc": "white", "markevery": [-1]}
    ax.plot(*samples.q[low:high, :2].T, color=colour, lw=1.5, zorder=5, **style)


def _plane_legend(figure: SubFigure) -> None:
    blue, red = RIGID_COLOUR, SOFT_COLOUR
    entries: dict[str, Any] = {
        "start (of phase)": Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR, alpha=FAINT),
        "goal (end of phase)": Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR),
        "rigid segment": Line2D([], [], color=blue, lw=4),
        "soft segment": Line2D([], [], color=red, lw=4),
        "path of the middle link": tuple(Line2D([], [], color=c, lw=1.5) for c in (blue, red)),
    }
    style: dict[str, Any] = {"ncols": 5, "handler_map": {tuple: HandlerTuple(ndivide=None)}}
    figure.legend(entries.values(), entries, loc="outside lower center", **style)


def _draw_over_time(figure: SubFigure, plan: Plan) -> None:
    axes = figure.subplots(5, 1, sharex=True, height_ratios=(1.25, 1.0, 1.0, 1.0, 0.6))
    stretch = plan_stretch(plan)
    name_phases(draw_timeline(axes[0], plan), plan, stretch)
    draws = (draw_configuration, draw_wheel_speeds, draw_temperatures, draw_melt_fractions)
    for ax, draw in zip(axes[1:], draws, strict=True):
        draw_motion(draw(ax, plan), plan)
    stretch.apply(axes[-1])
    note = "" if stretch.even else ", stretched inside the motion phases (grey)"
    axes[-1].set(xlabel=f"time [s]{note}")
    figure.align_ylabels(axes)
