"""Figures of measurements, studies and the paper: what `plotting` draws plans with, used."""

import twosra_mpc.plotting  # noqa: F401  # before matplotlib, which speaks when it is imported
from twosra_mpc.lab.figures.comparison_figure import plot_comparison
from twosra_mpc.lab.figures.paper_figures import (
    plot_error_decrease,
    plot_forward_kinematics,
    plot_published_tasks,
)

__all__ = [
    "plot_comparison",
    "plot_error_decrease",
    "plot_forward_kinematics",
    "plot_published_tasks",
]
