"""Surroundings, drawn: obstacles, workspace, boxes to drive through, nearest points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Polygon, Rectangle

from twosra_mpc.checking.sweep import Clearance
from twosra_mpc.plotting import figures
from twosra_mpc.plotting.figures import label
from twosra_mpc.plotting.plane import line, to_one_scale
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array

_FAR_M = 100.0  # edges of what is free: out of every picture
_NEAR, _LEAST_NEAR_M = 0.2, 0.05  # around a motion, in its size: obstacles there are shown
OBSTACLE: dict[str, Any] = {
    "fc": figures.OBSTACLE_COLOUR,
    "ec": figures.OBSTACLE_EDGE_COLOUR,
    "hatch": "///",
    "lw": 0.8,
}
TASK: dict[str, Any] = {"fill": False, "ec": figures.TASK_COLOUR, "ls": "--", "lw": 1.2}


def shown_m(problem: Problem, points: Array) -> Array:
    """Points (..., 2) to be seen, and with them what of obstacles is near, (k, 2) [m]."""
    seen = points.reshape(-1, 2)
    low, high = seen.min(axis=0), seen.max(axis=0)
    near = max(_NEAR * float((high - low).max()), _LEAST_NEAR_M)
    parts = problem.world.within(low - near, high + near)
    return np.concatenate([seen, *(corners for _, corners, _ in parts)])


def names_m(problem: Problem, points: Array) -> dict[str, tuple[float, float]]:
    """Name of each obstacle in the box of some points (k, 2) -> middle of its part there [m]."""
    parts = problem.world.within(points.min(axis=0), points.max(axis=0))
    return {name: middle for name, _, middle in parts}


def draw_world(ax: Axes, problem: Problem, points: Array, size_pt: float = 8.0) -> None:
    """Draw workspace, obstacles and boxes of tasks, and name what is seen with ``points`` (k, 2).

    None of it changes what the axes show.
    """
    if problem.workspace is not None:
        low, high = np.clip(problem.workspace.corners_m, -_FAR_M, _FAR_M)
        style: dict[str, Any] = {"fill": False, "ec": "0.4", "lw": 0.8, "zorder": 1}
        ax.add_artist(Rectangle(tuple(low), *(high - low), **style))
    seen = points.min(axis=0), points.max(axis=0)
    words: dict[str, Any] = {"fontsize": size_pt, "zorder": 2.5}
    for obstacle in problem.obstacles:
        ax.add_artist(Polygon(obstacle.inner_corners_m, **OBSTACLE, zorder=0.8))
    for name, (x, y) in names_m(problem, points).items():
        middle: dict[str, Any] = {"ha": "center", "va": "center", "color": "0.25"}
        label(ax, name, (x, y), bbox=figures.BEHIND_WORDS, **middle, **words)
    for number, task in enumerate(problem.passes, start=1):
        low, high = np.clip(task.ends[:, :2], -_FAR_M, _FAR_M)
        ax.add_artist(Rectangle(tuple(low), *(high - low), **TASK, zorder=1.5))
        x, y = np.clip((low[0], high[1]), *seen).tolist()
        above = "bottom" if y == high[1] else "top"
        told = task.name or f"task {number}"
        label(ax, told, (x, y), va=above, color=figures.TASK_COLOUR, **words)


def show_world(
    axes: Sequence[Axes], problem: Problem, points: Array, small_pt: float = 8.0
) -> None:
    """Draw what is around points (..., 2) on axes, to one scale; words are small on all but one."""
    shown = shown_m(problem, points)
    for ax, size_pt in zip(axes, (8.0, *[small_pt] * len(axes)), strict=False):
        draw_world(ax, problem, shown, size_pt)
    to_one_scale(axes, shown)


def draw_nearest(ax: Axes, nearest: Clearance | None) -> list[Artist]:
    """Draw a line between the nearest points of robot and obstacle, with its length."""
    if nearest is None:
        return []
    style: dict[str, Any] = {"c": figures.NEAREST_COLOUR, "zorder": 9, "lw": 1.6, "ms": 2.5}
    style |= {"scalex": False, "scaley": False, "marker": "o"}
    words: dict[str, Any] = {"fontsize": 8, "zorder": 9, "fontweight": "bold", "va": "top"}
    words |= {"color": figures.NEAREST_COLOUR, "bbox": figures.BEHIND_WORDS}
    at = nearest.points_m.mean(axis=0)
    told = label(ax, length(nearest), at, (4, -5), **words)
    return [*ax.plot(*nearest.points_m.T, **style), told]


def length(nearest: Clearance) -> str:
    """Distance in words."""
    by_mm = 1e3 * nearest.least_m
    return f"{by_mm:z.1f} mm" if by_mm > 0 else f"{-by_mm:z.1f} mm inside"


def legend_entries(problem: Problem, nearest: Clearance | None) -> dict[str, Any]:
    """Legend of what is drawn; empty where nothing is."""
    entries: dict[str, Any] = {}
    if problem.obstacles:
        entries["obstacle"] = Patch(**OBSTACLE)
    if problem.passes:
        entries["box to drive through"] = Patch(**TASK)
    if nearest is not None:
        at = f"{length(nearest)}, {nearest.name} at {nearest.at_s:z.1f} s"
        entries[f"nearest: {at}"] = line(figures.NEAREST_COLOUR, 1.6)
    return entries
