"""Snapshots along a plan: the robot at a few moments, its target ghosted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twosra_mpc.errors import InputError
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.stiffness import State, soft_and_changing, state_at, stiffness_intervals
from twosra_mpc.plotting import plane
from twosra_mpc.plotting.figure_file import styled_figure
from twosra_mpc.plotting.plan_figure import plan_title
from twosra_mpc.plotting.robot_drawing import draw_robot, number_units
from twosra_mpc.plotting.style import CHANGING_COLOUR, FAINT

WIDTH_IN, PANEL_IN, COLUMNS = 10.0, 2.1, 4


def plot_snapshots(
    plan: Plan, path: str | Path | None = None, times_s: Sequence[float] | None = None
) -> Figure:
    """Draw the robot at some moments of a plan, each in its own panel to one scale.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.
        times_s: The moments; by default the start, the start and end of every phase, and the end.

    Raises:
        InputError: If a moment is not in the plan, matplotlib cannot write such a file, or the
            folder cannot be written.
    """
    moments = _telling_times(plan) if times_s is None else times_s
    columns = min(COLUMNS, len(moments))
    rows = -(-len(moments) // columns)
    with styled_figure((WIDTH_IN, PANEL_IN * rows + 0.8), path) as figure:
        figure.suptitle(plan_title(plan), wrap=True)
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, time_s in zip(grid, moments, strict=False):
            plane.frame(draw_snapshot(ax, plan, time_s))
        for ax in grid[len(moments) :]:
            ax.remove()
        shapes = robot_shape(plan.robot.geometry, plan.trajectory.samples.q, 2)
        plane.to_one_scale(figure.axes, shapes.wheels)
        entries = {
            "rigid": plane.RIGID,
            "soft": plane.SOFT,
            "melting or freezing": plane.line(CHANGING_COLOUR, 4),
            "target": plane.FAINT_ROBOT,
            "path of middle link": plane.line("black", 1.0),
        }
        plane.legend_below(figure, entries, 5)
    return figure


def draw_snapshot(ax: Axes, plan: Plan, time_s: float) -> Axes:
    """Draw the robot at one moment: its target ghosted, the path of its middle link behind it.

    Raises:
        InputError: If the moment is not in the plan.
    """
    trajectory, geometry = plan.trajectory, plan.robot.geometry
    if not 0.0 <= time_s <= trajectory.duration_s:
        allowed = f"a time in the plan, 0 to {trajectory.duration_s:g} s"
        raise InputError("time_s", time_s, allowed)
    states = [state_at(each, time_s) for each in stiffness_intervals(trajectory)]
    mode, changing = soft_and_changing(states)
    past = trajectory.samples.t_s[trajectory.samples.t_s < time_s]
    q = trajectory.configuration([*past, time_s])
    draw_robot(ax, geometry, trajectory.samples.q[-1], plan.problem.goal.mode, alpha=FAINT)
    draw_robot(ax, geometry, q[-1], mode, changing=changing)
    number_units(ax, geometry, q[-1])
    ax.plot(*q[:, :2].T, c="black", lw=1.0, zorder=5)
    ax.plot(*q[-1, :2], "o", c="black", mfc="white", ms=3.5, zorder=5)
    ax.set_title(f"{time_s:.2f} s: {_in_words(states)}")
    return ax


def _in_words(states: Sequence[State]) -> str:
    if len(states) == 1 or len(set(states)) > 1:
        return ", ".join(states)
    return f"{'both' if len(states) == 2 else 'all'} {states[0]}"


def _telling_times(plan: Plan) -> list[float]:
    """Start, starts and ends of phases that are not told by another moment, and end."""
    end_s = plan.trajectory.duration_s
    edges = [0.0, *(t for phase in plan.phases for t in phase[1:]), end_s]
    return [t for t, before in zip(edges, [-np.inf, *edges], strict=False) if t - before > 1e-6]
