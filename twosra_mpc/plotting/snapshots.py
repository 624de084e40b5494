"""Snapshots along a plan: the robot at a few moments, its target ghosted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from twosra_mpc.errors import InputError
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plotting.figure_file import styled_figure
from twosra_mpc.plotting.plan_figure import plan_title
from twosra_mpc.plotting.robot_drawing import draw_robot, number_units
from twosra_mpc.plotting.style import (
    CHANGING_COLOUR,
    FAINT,
    METAL_COLOUR,
    RIGID_COLOUR,
    SOFT_COLOUR,
    UNIT_COLOUR,
)
from twosra_mpc.plotting.timeline import configuration_at, samples_of, segment_states
from twosra_mpc.robot.modes import Mode

WIDTH_IN, PANEL_IN, COLUMNS = 10.0, 2.1, 4
_CHANGING = ("melting", "freezing")


def plot_snapshots(
    plan: Plan, path: str | Path | None = None, times_s: Sequence[float] | None = None
) -> Figure:
    """Draw the robot at some moments of a plan, each in its own panel to one scale.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.
        times_s: The moments; by default the start, the start and end of every phase, and the end.

    Raises:
        NoPlanError: If the plan has no samples.
        InputError: If a moment is not in the plan, matplotlib cannot write such a file, or the
            folder cannot be written.
    """
    samples = samples_of(plan)
    moments = _telling_times(plan) if times_s is None else times_s
    columns = min(COLUMNS, len(moments))
    rows = -(-len(moments) // columns)
    with styled_figure((WIDTH_IN, PANEL_IN * rows + 0.8), path) as figure:
        figure.suptitle(plan_title(plan), wrap=True)
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        corners = robot_shape(plan.robot.geometry, samples.q, 2).wheels.reshape(-1, 2)
        for ax, time_s in zip(grid, moments, strict=False):
            draw_snapshot(ax, plan, time_s).set(xticks=[], yticks=[])
            ax.spines[:].set(visible=True, color="0.8")
            ax.set_aspect("equal", adjustable="datalim")
            ax.update_datalim(corners)
        for ax in grid[len(moments) :]:
            ax.remove()
        _legend(figure)
    return figure


def draw_snapshot(ax: Axes, plan: Plan, time_s: float) -> Axes:
    """Draw the robot at one moment: its target ghosted, the path of its middle link behind it.

    Raises:
        NoPlanError: If the plan has no samples.
        InputError: If the moment is not in the plan.
    """
    samples, geometry = samples_of(plan), plan.robot.geometry
    end_s = float(samples.t_s[-1])
    if not 0.0 <= time_s <= end_s:
        raise InputError("time_s", time_s, f"a time in the plan, 0 to {end_s:g} s")
    mode, changing = segment_modes(plan, time_s)
    q = configuration_at(samples, time_s)
    draw_robot(ax, geometry, samples.q[-1], plan.problem.goal.mode, alpha=FAINT)
    draw_robot(ax, geometry, q, mode, changing=changing)
    number_units(ax, geometry, q)
    behind = np.concatenate([samples.q[samples.t_s < time_s, :2], [q[:2]]])
    ax.plot(*behind.T, c="black", lw=1.0, zorder=5)
    ax.plot(*q[:2], "o", c="black", mfc="white", ms=3.5, zorder=5)
    ax.set_title(f"{time_s:.2f} s: {_names(plan, time_s)}")
    return ax


def segment_modes(plan: Plan, time_s: float) -> tuple[Mode, Mode]:
    """Which segments are soft at a time, and which melt or freeze; 1 where they do."""
    states = [_state(plan, segment, time_s) for segment in (1, 2)]
    soft, changing = ([int(state in which) for state in states] for which in (("soft",), _CHANGING))
    return (soft[0], soft[1]), (changing[0], changing[1])


def _state(plan: Plan, segment: int, time_s: float) -> str:
    after_s = float(samples_of(plan).t_s[-1]) + 1e-3  # the end shows the state that is reached
    begun = [
        what for low, _, what in segment_states(plan, segment, after_s) if low <= time_s + 1e-9
    ]
    return begun[-1]


def _names(plan: Plan, time_s: float) -> str:
    states = [_state(plan, segment, time_s) for segment in (1, 2)]
    return f"both {states[0]}" if states[0] == states[1] else ", ".join(states)


def _telling_times(plan: Plan) -> list[float]:
    """Start, starts and ends of phases that are not told by another moment, and end."""
    end_s = float(samples_of(plan).t_s[-1])
    edges = [0.0, *(t for phase in plan.phases for t in phase[1:]), end_s]
    return [t for t, before in zip(edges, [-np.inf, *edges], strict=False) if t - before > 1e-6]


def _legend(figure: Figure) -> None:
    looks = {"rigid": RIGID_COLOUR, "soft": SOFT_COLOUR, "melting or freezing": CHANGING_COLOUR}
    entries = {name: Line2D([], [], c=colour, lw=4) for name, colour in looks.items()}
    path = Line2D([], [], c="black", lw=1.0)
    target = Patch(fc=UNIT_COLOUR, ec=METAL_COLOUR, alpha=FAINT)
    handles, names = [*entries.values(), target, path], [*entries, "target", "path of middle link"]
    figure.legend(handles, names, loc="outside lower center", ncols=5)
