"""Figures and animations: the only part of the package that knows matplotlib.

``plot_...`` makes a figure and may write it to a file; ``draw_...`` draws on axes that are given to
it and returns them; ``animate_...`` makes a film that a notebook shows. Nothing here needs a
display or changes ``rcParams``.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import twosra_mpc.plotting.quiet  # noqa: F401  # first: matplotlib speaks when it is imported
from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.plotting.figures import (
    CHANGING_COLOUR,
    DPI,
    FREEZING_COLOUR,
    RIGID_COLOUR,
    SEGMENT_COLOURS,
    SOFT_COLOUR,
    STYLE,
    check_figure_path,
    save_figure,
)
from twosra_mpc.plotting.film import Film, animate_plan, check_animation_path
from twosra_mpc.plotting.plan_figures import (
    plan_title,
    plot_comparison,
    plot_plan,
)
from twosra_mpc.plotting.plane import draw_outline, draw_robot
from twosra_mpc.plotting.timeline_figures import (
    TimeStretch,
    draw_configuration,
    draw_melt_fractions,
    draw_motion,
    draw_temperatures,
    draw_timeline,
    draw_wheel_speeds,
    plan_stretch,
)

if TYPE_CHECKING:
    from twosra_mpc.plotting.run_figures import animate_run, plot_run

__all__ = [
    "CHANGING_COLOUR",
    "DPI",
    "FREEZING_COLOUR",
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
    "draw_temperatures",
    "draw_timeline",
    "draw_wheel_speeds",
    "plan_stretch",
    "plan_title",
    "plot_comparison",
    "plot_plan",
    "plot_run",
    "robot_shape",
    "save_figure",
]


def __getattr__(name: str) -> Any:
    """Import what draws runs in closed loop when it is asked for: it brings the tracker along."""
    if name not in ("animate_run", "plot_run"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.run_figures"), name)
