"""Figure of a plan: the robot in the plane, and everything over time.

Needs no display and leaves ``rcParams`` alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Phase, Samples
from twosra_mpc.plotting import plane
from twosra_mpc.plotting.figure_file import styled_figure
from twosra_mpc.plotting.robot_drawing import draw_robot, number_units
from twosra_mpc.plotting.style import FAINT, RIGID_COLOUR, SOFT_COLOUR
from twosra_mpc.plotting.timeline import (
    draw_configuration,
    draw_melt_fractions,
    draw_motion,
    draw_temperatures,
    draw_timeline,
    draw_wheel_speeds,
    name_phases,
    phase_duration,
    plan_stretch,
)
from twosra_mpc.robot.modes import is_rigid, mode_name

Array = NDArray[np.float64]

WIDTH_IN, HEIGHT_IN, LANE_IN = 10.0, 9.0, 0.4  # with a lane for each segment


def plot_plan(plan: Plan, path: str | Path | None = None) -> Figure:
    """Draw a plan: start, goal and every phase in the plane; stiffness and motion over time.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    lanes_in = LANE_IN * plan.robot.geometry.segments
    with styled_figure((WIDTH_IN, HEIGHT_IN + lanes_in), path) as figure:
        figure.suptitle(plan_title(plan), wrap=True)
        rows = figure.add_gridspec(2, 1, height_ratios=(4.5, 4.5 + lanes_in))
        _draw_plane(figure.add_subfigure(rows[0]), plan)
        _draw_over_time(figure.add_subfigure(rows[1]), plan)
    return figure


def plan_title(plan: Plan) -> str:
    """Mode sequence, duration and what is known, in one line."""
    sequence = " → ".join(mode_name(phase.mode) for phase in plan.phases) or "no motion"
    planner = "" if plan.planner == "optimal" else f"{plan.planner}, "
    gap = "no bound proved"
    if plan.gap is not None:
        gap = f"proved gap {100 * plan.gap:.2g} %" if plan.gap > 1e-5 else "proved gap < 0.001 %"
    return f"{sequence} in {plan.duration_s:.1f} s: {planner}{plan.status}, {gap}"


def phase_rows(samples: Samples, phase: Phase) -> Array:
    """Configurations of a phase, both ends included, (rows, 3 + n)."""
    low, high = np.searchsorted(samples.t_s, (phase.start_s - 1e-9, phase.end_s + 1e-9))
    return samples.q[low:high]


def _draw_plane(figure: SubFigure, plan: Plan) -> None:
    """Overview on the left; on the right, if there are several phases, a panel each."""
    phases = plan.phases if len(plan.phases) > 1 else ()
    axes = plane.overview_and_panels(figure, len(phases), 1.1)
    _draw_overview(axes[0], plan)
    for number, (ax, phase) in enumerate(zip(axes[1:], phases, strict=True), start=1):
        q = phase_rows(plan.trajectory.samples, phase)
        draw_robot(ax, plan.robot.geometry, q[0], phase.mode, alpha=FAINT, linewidth=3)
        draw_robot(ax, plan.robot.geometry, q[-1], phase.mode, linewidth=3)
        _draw_path(ax, q, phase)
        ax.set_title(f"{number}: {mode_name(phase.mode)}, {phase_duration(phase)}")
    seen = plan.trajectory.configuration([0.0, *(t for phase in plan.phases for t in phase[1:])])
    plane.to_one_scale(axes, robot_shape(plan.robot.geometry, seen, 2).wheels)
    entries = {
        "start (of phase)": plane.FAINT_ROBOT,
        "goal (end of phase)": plane.ROBOT,
        "rigid segment": plane.RIGID,
        "soft segment": plane.SOFT,
        "path of the middle link": (plane.line(RIGID_COLOUR), plane.line(SOFT_COLOUR)),
    }
    plane.legend_below(figure, entries, 5)


def _draw_overview(ax: Axes, plan: Plan) -> None:
    geometry, samples = plan.robot.geometry, plan.trajectory.samples
    ends, modes = samples.q[[0, -1]], samples.mode[[0, -1]].tolist()
    draw_robot(ax, geometry, ends[0], modes[0], alpha=FAINT, linewidth=5)
    draw_robot(ax, geometry, ends[1], modes[1], linewidth=5)
    for phase in reversed(plan.phases):  # the end of a phase lies over the start of the next
        _draw_path(ax, phase_rows(samples, phase), phase)
    number_units(ax, geometry, ends[1])
    shapes = robot_shape(geometry, ends, 2)
    start, goal = shapes.centres
    apart = np.linalg.norm(start[:, None] - goal, axis=2)
    i, j = np.argmax(apart.min(axis=1)), np.argmax(apart.min(axis=0))
    j = 1 - j if apart[i, j] < geometry.unit_side_m else j  # one label a unit
    labelled = (start[i], goal[j])
    for name, centre, origin in zip(("start", "goal"), labelled, shapes.origin, strict=True):
        outward = (centre - origin) / np.linalg.norm(centre - origin)
        tip, shift = centre + 0.9 * geometry.unit_side_m * outward, (5 * outward).tolist()
        side = ("center", "left", "right")[round(outward[0])]
        style: dict[str, Any] = {"ha": side, "va": "center", "fontweight": "bold", "zorder": 7}
        ax.annotate(name, tip, shift, textcoords="offset points", **style)
    ax.margins(0.15, 0.1)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def _draw_path(ax: Axes, q: Array, phase: Phase) -> None:
    """Path of b0 during a phase: blue while driving, red while bending."""
    colour = RIGID_COLOUR if is_rigid(phase.mode) else SOFT_COLOUR
    style: dict[str, Any] = {"marker": "o", "ms": 3.5, "mfc": "white", "markevery": [-1]}
    ax.plot(*q[:, :2].T, color=colour, lw=1.5, zorder=5, **style)


def _draw_over_time(figure: SubFigure, plan: Plan) -> None:
    segments = plan.robot.geometry.segments
    heights = (0.25 + 0.5 * segments, 1.0, 1.0, 1.0, 0.7)
    axes = figure.subplots(5, 1, sharex=True, height_ratios=heights)
    stretch = plan_stretch(plan)
    name_phases(draw_timeline(axes[0], plan), plan.phases, stretch, "{number}: {mode}\n{took}")
    draws = (draw_configuration, draw_wheel_speeds, draw_temperatures, draw_melt_fractions)
    for ax, draw in zip(axes[1:], draws, strict=True):
        draw_motion(draw(ax, plan), plan)
    stretch.apply(axes[-1])
    note = "" if stretch.even else ", stretched inside the motion phases (grey)"
    axes[-1].set(xlabel=f"time [s]{note}")
    figure.align_ylabels(axes)
