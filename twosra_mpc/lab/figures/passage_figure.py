"""Figure of the shapes that pass, over the curvatures of both segments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from twosra_mpc.lab.worlds.passages import VERDICTS, Passages
from twosra_mpc.plotting import figures, plane
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE

_COLOURS = ("#56b4a0", "#d3735a", "#f3d58a", "#e3e3e3")  # of VERDICTS, told apart by everyone
_WORDS = ("certified", "proved blocked", "undecided", "not allowed")
_SPAN_PT = 180.0  # of the marks of a row, together
_MARK: dict[str, Any] = {"ls": "", "ms": 9.0, "mfc": "white", "mec": "black", "mew": 1.4}
_MARKS = {"start": _MARK | {"marker": "o"}, "goal": _MARK | {"marker": "s"}}


def draw_passages(ax: Axes, passages: Passages) -> Axes:
    """Draw which shapes pass: a mark at each shape that was tried, in the colour of its verdict.

    Nothing is drawn between them, as nothing is known there.
    """
    codes = np.array([VERDICTS.index(each) for each in passages.verdicts.ravel().tolist()])
    kappa = passages.kappa_per_m
    style: dict[str, Any] = {"cmap": ListedColormap(_COLOURS), "vmin": -0.5, "vmax": 3.5}
    ax.scatter(np.repeat(kappa, len(kappa)), np.tile(kappa, len(kappa)), c=codes, marker="s",
               s=min(120.0, (_SPAN_PT / len(kappa)) ** 2), **style)  # fmt: skip
    ax.set(xlabel=r"$\kappa_1$ [1/m]", ylabel=r"$\kappa_2$ [1/m]", aspect="equal")
    return ax


def plot_passages(
    problem: Problem, passages: Passages, path: str | Path | None = None, title: str = ""
) -> Figure:
    """Draw which shapes pass, with those at the start and at the goal.

    Args:
        problem: What was asked.
        passages: What was found.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.
        title: Above the figure.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure((5.0, 5.4), path) as figure:
        ax = draw_passages(figure.subplots(), passages)
        ends = (problem.start.configuration[POSE:], problem.goal.configuration[POSE:])
        marks = {}
        for (name, style), kappa in zip(_MARKS.items(), ends, strict=True):
            if not np.isnan(kappa).any():
                ax.plot(*kappa, **style)
                marks[name] = Line2D([], [], **style | {"ms": 7.0})
        ax.set_title(title or problem.description, wrap=True)
        keys = dict(zip(_WORDS, (Patch(fc=colour) for colour in _COLOURS), strict=True))
        plane.legend_below(figure, {**keys, **marks}, 3)
    return figure
