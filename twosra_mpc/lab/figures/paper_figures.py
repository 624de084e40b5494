"""The figures of the paper, drawn anew from our own runs.

The paper is Labazanova et al., IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749; its simulations are
run by ``greedy.published``, on the model as published. Next to them stand the plans of this
package for the same tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twosra_mpc import Mode, Plan, load_problem, plan, robot_shape
from twosra_mpc.arguments import public
from twosra_mpc.lab.reproduction.published_runs import (
    SIMULATIONS,
    PublishedTrajectory,
    forward_kinematics,
    published_trajectory,
)
from twosra_mpc.plotting import figures, plane
from twosra_mpc.plotting.plan_figures import phase_rows
from twosra_mpc.plotting.timeline_figures import COORDINATES
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import MODES, RIGID, mode_name

SIMULATION_OF_TASK = {simulation.task: simulation for simulation in SIMULATIONS.values()}
_COLOURS = ("#222222", "#12997c", "#e07b00", "#7b5ea7", "#2a6fbb")
TASK_COLOURS = dict(zip(SIMULATION_OF_TASK, _COLOURS, strict=True))
STEPS = 60  # of forward kinematics
START = (0.30, 0.2, 0.2, 10.0, -10.0)  # of forward kinematics
LEAST_SHARE = 1e-4  # of the distance at the start; less is not drawn
INPUTS: dict[Mode, tuple[float, ...]] = {  # [m/s, m/s, m/s, m/s, rad/s], constant
    (0, 0): (0.0, 0.0, 0.02, 0.01, 0.25),
    (0, 1): (0.008, 0.008, 0.0, 0.0, 0.0),
    (1, 0): (0.008, -0.01, 0.0, 0.0, 0.0),
    (1, 1): (0.012, 0.014, 0.0, 0.0, 0.0),
}


class _Piece(NamedTuple):
    """Configurations (n, 5) that follow each other in one mode."""

    mode: Mode
    q: Array


@public
def plot_forward_kinematics(path: str | Path | None = None) -> Figure:
    """Draw configurations by forward kinematics, and as the published planner reaches their end.

    A column a mode. Inputs of forward kinematics are constant; its last configuration is what the
    planner is given as target.

    Args:
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 7.6), path) as figure:
        figure.suptitle("Forward kinematics, and the published planner on the way to its end")
        grid = figure.subplots(4, len(MODES), sharex=True)
        for column, mode in zip(grid.T, MODES, strict=True):
            inputs = np.array(INPUTS[mode])
            driven = forward_kinematics(np.array(START), mode, inputs)[: STEPS + 1]
            planned = published_trajectory(START, driven[-1])
            _draw_study(column, mode, driven, planned)
            column[-1].set(xlabel="share of the motion")
        for row in grid:
            for ax in row[1:]:
                ax.set_ylabel("")
        figure.align_ylabels(grid[:, 0])
        forward = Line2D([], [], c="0.4", lw=1.2, ls="--", label="forward kinematics")
        planner = Line2D([], [], c="0.1", lw=1.8, label="published planner")
        switch = Line2D([], [], c="0.6", lw=0.8, ls=":", label="change of mode")
        handles = [forward, planner, switch]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


@public
def plot_error_decrease(path: str | Path | None = None) -> Figure:
    """Draw how the distance to the target falls: in the published loop, and in real time.

    The distance is the published norm, which adds m, rad and 1/m without weights, as a share of
    its first value. Left the published loop, which does not know time for melting and freezing;
    right both planners with it.

    Args:
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((10.0, 4.2), path) as figure:
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.0, 1.35))
        for number, (task, colour) in enumerate(TASK_COLOURS.items()):
            _draw_loop_error(left, task, {"c": colour, **figures.curve(number)})
            for made, dashes in zip(both_plans(task), ("-", "--"), strict=True):
                samples = made.trajectory.samples
                share = _share(samples.q, samples.q[-1])
                right.plot(samples.t_s, share, c=colour, **figures.curve(number, dashes))
                size = 11 - 1.5 * number  # those that lie on each other are seen
                end: dict[str, Any] = {"ms": size, "mfc": colour if dashes == "-" else "white"}
                right.plot(samples.t_s[-1], LEAST_SHARE, "^", c=colour, clip_on=False, **end)
        left.set(xlabel="time of the loop [s]", ylabel="|q - qₜ| / |q₀ - qₜ|")
        left.set(yscale="log", ylim=(LEAST_SHARE, 1.5), title="as published, without waits")
        left.yaxis.set_major_formatter("{x:g}")
        right.set(xlabel="time [s]", title="with melting and freezing")
        for ax in (left, right):
            ax.set_xlim(0.0, None)
        handles = [
            *(
                Line2D([], [], c=colour, label=task, **figures.curve(number))
                for number, (task, colour) in enumerate(TASK_COLOURS.items())
            ),
            Line2D([], [], c="0.3", marker="o", ms=4, ls="", label="change of mode"),
            Line2D([], [], c="0.3", lw=1.5, marker="^", label="this planner, end"),
            Line2D([], [], c="0.3", lw=1.5, ls="--", marker="^", mfc="white", label="greedy, end"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=8)
    return figure


@public
def plot_published_tasks(path: str | Path | None = None) -> Figure:
    """Draw the five published tasks: start, target and path, as published and as planned here.

    The published simulations have no time for melting and freezing; the time written above them is
    that of the greedy rule as a plan of this package.

    Args:
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((13.0, 6.6), path) as figure:
        grid = figure.subplots(2, len(TASK_COLOURS))
        for column, task in zip(grid.T, TASK_COLOURS, strict=True):
            made, greedy = both_plans(task)
            published = _published_pieces(SIMULATION_OF_TASK[task].run_freely())
            geometry = made.robot.geometry
            samples = made.trajectory.samples
            planned = [_Piece(phase.mode, phase_rows(samples, phase)) for phase in made.phases]
            shown = ((published, greedy, f"{task}\n"), (planned, made, ""))
            for ax, (pieces, timed, above) in zip(column, shown, strict=True):
                _draw_task(ax, geometry, pieces)
                ax.set_title(f"{above}{_sequence(pieces)}\n{timed.duration_s:z.0f} s with waits")
            ends = np.concatenate([piece.q[[0, -1]] for piece in (*published, *planned)])
            plane.to_one_scale(column, robot_shape(geometry, ends, 2).wheels)
        for row, name in zip(grid, ("as published", "this planner"), strict=True):
            row[0].set_ylabel(name, fontsize=11, fontweight="bold")
        entries: dict[str, Any] = {
            "start": plane.FAINT_ROBOT,
            "target": plane.ROBOT,
            "path with a soft segment": plane.line(figures.SOFT_COLOUR, 1.4),
            "path with both rigid": plane.line(figures.RIGID_COLOUR, 1.4),
            "change of mode": Line2D([], [], c="0.3", marker="o", mfc="white", ms=4, ls=""),
        }
        plane.legend_below(figure, entries, 5)
    return figure


PAPER_FIGURES: dict[str, Callable[[Path], Figure]] = {
    "forward-kinematics": plot_forward_kinematics,
    "error-decrease": plot_error_decrease,
    "published-tasks": plot_published_tasks,
}


def _draw_study(
    axes: Sequence[Axes], mode: Mode, driven: Array, planned: PublishedTrajectory
) -> None:
    """Position, heading, curvature and distance of one mode's study over its length."""
    done = (planned.iteration + 1) / (planned.iteration[-1] + 1)  # of the loop
    place: dict[str, Any] = {"textcoords": "offset points", "va": "center"}
    for ax, (columns, names, label) in zip(axes, COORDINATES.values(), strict=False):
        curves = zip(names, driven.T[columns], planned.q.T[columns], strict=False)
        for j, (name, far, reached) in enumerate(curves):
            ax.plot(done, reached, **figures.segment_curve(j))
            ax.plot(np.linspace(0.0, 1.0, len(far)), far, **figures.segment_curve(j, "--"))
            ax.annotate(name, (1.0, far[-1]), (4, 0), color=figures.SEGMENT_COLOURS[j], **place)
        ax.set_ylabel(label)
    share = _share(driven, driven[-1])
    axes[-1].plot(done, _share(planned.q, driven[-1]), **figures.segment_curve(0))
    axes[-1].plot(np.linspace(0.0, 1.0, len(share)), share, **figures.segment_curve(0, "--"))
    axes[-1].set(ylabel="distance\nto target", ylim=(-0.03, 1.03))
    for ax, row in product(axes, _mode_changes(planned)):
        ax.axvline(done[row], c="0.6", lw=0.8, ls=":", zorder=0)
    sequence = _sequence(_published_pieces(planned))
    axes[0].set_title(f"driven in {mode_name(mode)}, planned\n{sequence}", fontsize=9)


def _share(q: Array, target: Array) -> Array:
    """Published distance to the target as a share of the first."""
    distance = np.linalg.norm(q - target, axis=1)
    return np.maximum(distance / distance[0], 1e-9)


@cache
def both_plans(task: str) -> tuple[Plan, Plan]:
    """Plans of this planner and of the greedy rule for the robot as the paper models it."""
    problem = load_problem(task, robot="2sra-v1-paper")
    greedy = plan(problem.with_values(planner="greedy"))
    return plan(problem).require(), greedy.require()


def _mode_changes(planned: PublishedTrajectory) -> list[int]:
    """Rows that are the first in a new mode; row 0 is the start, and row 1 the first of all."""
    changed = np.any(np.diff(planned.mode[1:], axis=0) != 0, axis=1)
    return [row + 2 for row in np.flatnonzero(changed).tolist()]


def _draw_loop_error(ax: Axes, task: str, look: dict[str, Any]) -> None:
    simulation = SIMULATION_OF_TASK[task]
    planned = simulation.run_freely()
    time_s = (planned.iteration + 1) * simulation.step_s
    share = _share(planned.q, simulation.goal)
    changes = np.array(_mode_changes(planned))
    ax.step(time_s, share, where="post", **look)  # steps too short are not recorded
    ax.plot(time_s[changes], share[changes - 1], "o", c=look["c"], ms=4)


def _published_pieces(planned: PublishedTrajectory) -> list[_Piece]:
    """Split configurations by mode; a piece begins where the one before ends."""
    edges, modes = [1, *_mode_changes(planned), len(planned.mode)], planned.mode.tolist()
    return [_Piece(tuple(modes[i]), planned.q[i - 1 : j]) for i, j in pairwise(edges)]


def _sequence(pieces: Sequence[_Piece]) -> str:
    return " → ".join(mode_name(piece.mode) for piece in pieces)


def _draw_task(ax: Axes, geometry: Geometry, pieces: Sequence[_Piece]) -> None:
    """Start, target, and the paths of middle link (by mode) and units."""
    start_and_target = np.array([pieces[0].q[0], pieces[-1].q[-1]])
    plane.draw_ends(ax, geometry, start_and_target, (RIGID, RIGID), 3)
    for piece in reversed(pieces):  # the end of a piece lies over the start of the next
        colour = figures.SOFT_COLOUR if any(piece.mode) else figures.RIGID_COLOUR
        ends: dict[str, Any] = {"marker": "o", "ms": 3.0, "mfc": "white", "markevery": [-1]}
        ax.plot(*piece.q[:, :2].T, c=colour, lw=1.4, zorder=5, **ends)
        centres = robot_shape(geometry, piece.q, 2).centres
        for unit in (0, 1):
            ax.plot(*centres[:, unit].T, c=colour, lw=0.9, zorder=4)
    plane.frame(ax)
