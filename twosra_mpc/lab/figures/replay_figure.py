"""Figure of a replay: every phase as it was measured, and as the model has it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.identification.replay import PhaseReplay
from twosra_mpc.plotting import figures, plane
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import mode_name

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
        colours = [f"segment {j + 1}" for j in range(robot.coordinates.segments)]
        entries: dict[str, Any] = {
            name: plane.line("0.2", 1.6, dashes) for name, dashes in _LOOKS.items()
        }
        entries |= {"x, heading": plane.line(_X), "y": plane.line(_Y)}
        entries |= {
            name: plane.line(figures.SEGMENT_COLOURS[j], 4) for j, name in enumerate(colours)
        }
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
