"""Figures and animations: the only part of the package that knows matplotlib.

``plot_...`` makes a figure and may write it to a file; ``draw_...`` draws on axes that are given to
it and returns them; ``animate_...`` makes a film that a notebook shows. Nothing here needs a
display or changes ``rcParams``.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.plotting.animation import animate_plan
from twosra_mpc.plotting.comparison_figure import plot_comparison
from twosra_mpc.plotting.figure_file import check_figure_path, save_figure
from twosra_mpc.plotting.film import Film, check_animation_path
from twosra_mpc.plotting.paper_figures import (
    plot_error_decrease,
    plot_forward_kinematics,
    plot_published_tasks,
)
from twosra_mpc.plotting.plan_figure import plan_title, plot_plan
from twosra_mpc.plotting.robot_drawing import draw_outline, draw_robot
from twosra_mpc.plotting.snapshots import draw_snapshot, plot_snapshots
from twosra_mpc.plotting.style import (
    CHANGING_COLOUR,
    DPI,
    RIGID_COLOUR,
    SEGMENT_COLOURS,
    SOFT_COLOUR,
    STYLE,
)
from twosra_mpc.plotting.time_axis import TimeStretch
from twosra_mpc.plotting.timeline import (
    draw_configuration,
    draw_melt_fractions,
    draw_motion,
    draw_temperatures,
    draw_timeline,
    draw_wheel_speeds,
    plan_stretch,
)

if TYPE_CHECKING:
    from twosra_mpc.plotting.run_animation import animate_run
    from twosra_mpc.plotting.run_figure import plot_run

__all__ = [
    "CHANGING_COLOUR",
    "DPI",
    "RIGID_COLOUR",
    "SEGMENT_COLOURS",
    "SOFT_COLOUR",
    "STYLE",
    "Film",
    "RobotShape",
    "TimeStretch",
    "animate_plan",
    "animate_run",
    "check_animation_path",
    "check_figure_path",
    "draw_configuration",
    "draw_melt_fractions",
    "draw_motion",
    "draw_outline",
    "draw_robot",
    "draw_snapshot",
    "draw_temperatures",
    "draw_timeline",
    "draw_wheel_speeds",
    "plan_stretch",
    "plan_title",
    "plot_comparison",
    "plot_error_decrease",
    "plot_forward_kinematics",
    "plot_plan",
    "plot_published_tasks",
    "plot_run",
    "plot_snapshots",
    "robot_shape",
    "save_figure",
]

_OF_RUNS = {"animate_run": "run_animation", "plot_run": "run_figure"}


def __getattr__(name: str) -> Any:
    """Import what draws runs in closed loop when it is asked for: it brings the tracker along."""
    if name not in _OF_RUNS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_OF_RUNS[name]}"), name)
