"""The robot drawn to scale in the plane."""

from __future__ import annotations

from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plotting.style import (
    CHANGING_COLOUR,
    METAL_COLOUR,
    PLANNED_COLOUR,
    RIGID_COLOUR,
    SOFT_COLOUR,
    UNIT_COLOUR,
)
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import Mode, rigid_mode

HATCH = (0.0, (0.25, 0.5))  # dashes of a changing segment, in line widths


def draw_robot(
    ax: Axes,
    geometry: Geometry,
    q: ArrayLike,
    mode: Mode,
    *,
    changing: Mode = (),
    alpha: float = 1.0,
    linewidth: float = 4.0,
) -> Axes:
    """Draw the robot to scale: soft segments red, rigid ones blue, changing ones hatched amber.

    Args:
        ax: Axes in m; give it an equal aspect to see the robot as it is.
        geometry: Lengths of the robot.
        q: Configuration [m, m, rad, 1/m ...], shape (3 + n,).
        mode: 1 where a segment is soft.
        changing: 1 where a segment melts or freezes, whatever ``mode`` says; default: nowhere.
        alpha: Opacity.
        linewidth: Width of the segments [pt]; the other lines scale with it.

    Returns:
        The axes.
    """
    robot_artists(ax, geometry, q, mode, changing=changing, alpha=alpha, linewidth=linewidth)
    return ax


def robot_artists(
    ax: Axes,
    geometry: Geometry,
    q: ArrayLike,
    mode: Mode,
    *,
    changing: Mode = (),
    alpha: float = 1.0,
    linewidth: float = 4.0,
) -> list[Artist]:
    """Draw the robot as ``draw_robot`` does; every artist drawn, the segments first."""
    shape, changes = robot_shape(geometry, q), changing or rigid_mode(len(mode))
    style: dict[str, Any] = {"alpha": alpha, "zorder": 3, "solid_capstyle": "butt"}
    fill: dict[str, Any] = {"alpha": alpha, "zorder": 3, "lw": linewidth / 5}
    hatch: dict[str, Any] = {"alpha": alpha, "zorder": 3.1, "c": "white", "ls": HATCH}
    artists: list[Artist] = []
    for arc, soft, now in zip(shape.segments, mode, changes, strict=True):
        colour = CHANGING_COLOUR if now else SOFT_COLOUR if soft else RIGID_COLOUR
        artists += ax.plot(*arc.T, lw=linewidth, c=colour, **style)
    for link in shape.links:
        artists += ax.plot(*link.T, lw=linewidth / 1.7, c=METAL_COLOUR, **style)
    for unit in shape.units:
        artists += ax.fill(*unit.T, fc=UNIT_COLOUR, ec=METAL_COLOUR, **fill)
    for wheel in shape.wheels:
        artists += ax.fill(*wheel.T, fc=METAL_COLOUR, ec="none", **fill)
    for arc, now in zip(shape.segments, changes, strict=True):
        if now:
            artists += ax.plot(*arc.T, lw=linewidth, **hatch)
    return artists


def draw_outline(ax: Axes, geometry: Geometry, q: ArrayLike) -> Axes:
    """Draw where the robot shall be, dashed; q as for ``draw_robot``."""
    shape = robot_shape(geometry, q)
    dashed: dict[str, Any] = {"lw": 1.2, "ls": "--", "zorder": 6}
    for arc in shape.segments:
        ax.plot(*arc.T, c=PLANNED_COLOUR, **dashed)
    for unit in shape.units:
        ax.fill(*unit.T, fill=False, ec=PLANNED_COLOUR, **dashed)
    return ax


def number_units(ax: Axes, geometry: Geometry, q: ArrayLike, size_pt: float = 8.5) -> list[Artist]:
    """Write 1 and 2 on the locomotion units; q as for ``draw_robot``."""
    style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": size_pt, "zorder": 8}
    centres = robot_shape(geometry, q, 2).centres.tolist()
    return [ax.text(x, y, str(number), **style) for number, (x, y) in enumerate(centres, start=1)]
