"""The scene of an animation: the robot to scale, thermometers, stiffness and temperature over time.

The same for a plan and for a run in closed loop: what it shows is a ``Playback``.
"""

from __future__ import annotations

from itertools import chain
from textwrap import fill
from typing import Any, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.patches import Patch
from PIL import Image

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.trajectory import soft_and_changing
from twosra_mpc.plotting import figures, world_figures
from twosra_mpc.plotting.figures import settle
from twosra_mpc.plotting.plane import DASHED, draw_outline, line, number_units, robot_artists
from twosra_mpc.plotting.playback import Playback
from twosra_mpc.plotting.timeline_figures import (
    STAGE_LINE,
    draw_off_path,
    draw_stiffness,
    mark_melting,
)
from twosra_mpc.robot.coordinates import Array

SIZE_IN, DPI = (8.0, 6.6), 100  # of a film: 800 by 660 pixels
MARGIN_M, ABOVE = 0.02, 0.15  # around the motion; share of the plane that the words take
LETTERS = 72  # that fit above the plane
AHEAD = 0.25  # opacity of what is yet to come
HEATED: dict[str, Any] = {"fill": False, "ec": figures.HEATER_COLOUR}


class Scene:
    """The figure of an animation; ``show`` moves it to a row of the playback.

    Attributes:
        figure: The figure.
    """

    def __init__(self, playback: Playback, titles: tuple[str, str], duration_s: float) -> None:
        """Draw everything that does not move.

        Args:
            playback: What is shown.
            titles: Written in the corner below, and at the end of the film.
            duration_s: Of the film, for saying how fast time passes in it.
        """
        self._playback, self._ending, self._duration_s = playback, titles[1], duration_s
        self._segments = len(playback.intervals)
        self.figure = Figure(figsize=SIZE_IN, dpi=DPI)
        self._canvas = cast(Any, FigureCanvasAgg(self.figure))  # its methods have no types
        sizes: dict[str, Any] = {"left": 0.105, "right": 0.96, "top": 0.95, "bottom": 0.08}
        heights = [0.275 * self._segments, *[0.8] * bool(playback.off), 1.3]
        sizes["height_ratios"] = (6.85 - sum(heights), *heights)
        rows = self.figure.add_gridspec(1 + len(heights), 1, hspace=0.15, **sizes)
        gauges = max(0.7, 0.5 * self._segments)
        widths: dict[str, Any] = {"width_ratios": (6.4 - gauges, gauges), "wspace": 0.18}
        top = rows[0].subgridspec(2, 2, height_ratios=(1, 6), **widths)
        self._plane, self._gauges = (self.figure.add_subplot(at) for at in (top[:, 0], top[1, 1]))
        self._bars, *off, self._curves = (
            self.figure.add_subplot(rows[row + 1]) for row in range(len(heights))
        )
        self._timed = self._bars, *off, self._curves
        shapes = robot_shape(playback.problem.robot.geometry, playback.q, 2)
        self._centres = shapes.centres
        _set_plane(self._plane, playback, titles[0], shapes.wheels)
        self._floor_C, top_C = _set_gauges(self._gauges, playback)
        _set_bars(self._bars, playback)
        for ax in off:
            draw_off_path(ax, playback.off)
            playback.stretch.apply(ax).set(ylabel="off path\n[mm]", xticks=[])
            ax.tick_params(labelsize=8.5)
        _set_curves(self._curves, playback, (self._floor_C, top_C))
        self._moving: list[Artist] = []
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def show(self, row: int) -> None:
        """Move to a row."""
        for artist in self._moving:
            artist.remove()
        place = self._objects, self._robot, self._trails, self._nearest
        parts = (*place, self._words, self._columns, self._progress)
        self._moving = list(chain.from_iterable(part(row) for part in parts))
        settle(self._plane)

    def image(self, row: int) -> Image.Image:
        """Move to a row, and return a picture of it; only what moves is drawn."""
        self.show(row)
        self._canvas.restore_region(self._background)
        for artist in sorted(self._moving, key=Artist.get_zorder):
            assert isinstance(artist.axes, Axes)
            artist.axes.draw_artist(artist)
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")

    def _objects(self, row: int) -> list[Artist]:
        """Objects where they are."""
        playback, poses = self._playback, self._playback.objects[row]
        beside = robot_shape(playback.problem.robot.geometry, playback.q[row])
        style: dict[str, Any] = {"beside": beside, "size_pt": 9.5}
        return world_figures.draw_objects(self._plane, playback.problem, poses, **style)

    def _robot(self, row: int) -> list[Artist]:
        q, geometry = self._playback.q[row], self._playback.problem.robot.geometry
        mode, changing = soft_and_changing(self._playback.states(row))
        drawn = robot_artists(self._plane, robot_shape(geometry, q), mode, changing, 1.0, 8)
        return [*drawn, *number_units(self._plane, geometry, q, 11)]

    def _trails(self, row: int) -> list[Artist]:
        """Trails of the units' centres and of the middle link."""
        first, second = self._centres[: row + 1].transpose(1, 0, 2)
        link, artists = self._playback.q[: row + 1, :2], list[Artist]()
        colours = (*figures.UNIT_COLOURS, figures.MIDDLE_COLOUR)
        for path, colour in zip((first, second, link), colours, strict=True):
            artists += self._plane.plot(*path.T, c=colour, lw=1.3, zorder=2)
        return artists

    def _nearest(self, row: int) -> list[Artist]:
        """Nearest point of the robot to an obstacle, once it has been there."""
        nearest = self._playback.nearest
        if nearest is None or self._playback.time_s[row] < nearest.at_s:
            return []
        return world_figures.draw_nearest(self._plane, nearest)

    def _words(self, row: int) -> list[Artist]:
        playback, time_s, doing = self._playback, float(self._playback.time_s[row]), self._ending
        minutes, seconds = divmod(time_s, 60.0)
        clock = f"{minutes:z.0f} min {seconds:z04.1f} s" if minutes else f"{seconds:z.1f} s"
        if time_s < playback.time_s[-1]:
            pace = playback.stretch.seconds_per_length(time_s) / self._duration_s
            fast, slow = f"{pace:z.{int(pace < 3)}f} times as fast", f"at {pace:z.2g} of its speed"
            told = fast if pace > 1 else slow
            doing = f"{playback.doing(row)}  ({told})"
        style: dict[str, Any] = {"transform": self._plane.transAxes, "va": "top", "zorder": 9}
        style["bbox"] = figures.BEHIND_WORDS
        return [
            self._plane.text(0.012, 0.985, clock, fontsize=15, fontweight="bold", **style),
            self._plane.text(0.012, 0.905, fill(doing, LETTERS), fontsize=10.5, **style),
        ]

    def _columns(self, row: int) -> list[Artist]:
        """A thermometer a segment, in the colour of its state."""
        playback, ax, artists = self._playback, self._gauges, list[Artist]()
        warm, liquid = playback.temperature_C[row], playback.melt_fraction[row]
        for j, state in enumerate(playback.states(row)):
            height = warm[j] - self._floor_C
            artists += ax.bar(j, height, 0.5, self._floor_C, zorder=3, **figures.STATES[state])
            words = f"{warm[j]:z.0f} °C"
            if np.isfinite(liquid[j]):
                words += f"\n{100 * liquid[j]:z.0f} %\nliquid"
            style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8.5, "zorder": 4}
            artists.append(ax.text(j, 1.01, words, transform=ax.get_xaxis_transform(), **style))
            if playback.heated[row, j]:
                height = ax.get_ylim()[1] - self._floor_C
                artists += ax.bar(j, height, 0.5, self._floor_C, lw=2.5, zorder=5, **HEATED)
        return artists

    def _progress(self, row: int) -> list[Artist]:
        """Progress over time."""
        playback, artists = self._playback, list[Artist]()
        done = playback.time_s[: row + 1]
        for j, warm in enumerate(playback.temperature_C.T):
            look = {**figures.segment_curve(j), "zorder": 5}
            artists += self._curves.plot(done, warm[: row + 1], **look)
        rest: dict[str, Any] = {"fc": "white", "alpha": 0.7, "lw": 0, "zorder": 5}
        last = float(playback.time_s[-1])
        artists += [ax.axvspan(done[-1], last, **rest) for ax in self._timed[:-1]]
        now: dict[str, Any] = {"c": "0.2", "lw": 1.2, "zorder": 6}
        return [*artists, *(ax.axvline(done[-1], **now) for ax in self._timed)]


def _set_plane(ax: Axes, playback: Playback, title: str, corners: Array) -> None:
    problem = playback.problem
    reached = [robot_shape(playback.problem.robot.geometry, q, 2).wheels for q in playback.goals]
    for q in playback.goals:
        draw_outline(ax, playback.problem.robot.geometry, q)
    world_figures.draw_targets(ax, problem, playback.targets)
    first, last = (world_figures.outlines_m(problem, each) for each in playback.objects[[0, -1]])
    seen = [part.reshape(-1, 2) for part in (corners, *reached, *first, *last)]
    points = world_figures.shown_m(problem, np.concatenate(seen))
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    box = ax.get_position()
    width, height = SIZE_IN[0] * box.width, SIZE_IN[1] * box.height
    scale = max((high[0] - low[0]) / width, (high[1] - low[1]) / height / (1 - ABOVE))  # [m/in]
    middle = (low + high) / 2
    left, bottom = middle[0] - scale * width / 2, middle[1] - scale * height * (1 - ABOVE) / 2
    ax.set(xlim=(left, left + scale * width), ylim=(bottom, bottom + scale * height))
    shown = np.array([ax.get_xlim(), ax.get_ylim()]).T
    world_figures.draw_world(ax, problem, shown, 9.0)
    ax.set_aspect("equal")
    ax.set_ylabel("x, y [m]")
    ax.figure.text(0.012, 0.012, title, fontsize=9)
    ax.tick_params(labelsize=8.5)
    ax.locator_params(nbins=6)
    entries: dict[str, Any] = {name: Patch(**look) for name, look in figures.STATES.items()}
    del entries["heater current"]
    entries |= {"heater on": Patch(lw=2.0, **HEATED)}
    trails = (*figures.UNIT_COLOURS, figures.MIDDLE_COLOUR)
    entries["paths: units, link"] = tuple(line(colour, 1.3) for colour in trails)
    if playback.goals:
        entries["goal"] = DASHED
    if playback.targets:
        entries["carried to"] = DASHED
    if playback.nearest is not None:
        entries["nearest"] = line(figures.NEAREST_COLOUR)
    place = ax.figure.transFigure
    style: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (0.965, 0.944)}
    style |= {"ncols": len(entries), "columnspacing": 0.8, "handlelength": 1.3}
    style |= {"bbox_transform": place, "handler_map": {tuple: HandlerTuple(ndivide=None)}}
    ax.legend(entries.values(), entries, **style)


def _set_gauges(ax: Axes, playback: Playback) -> tuple[float, float]:
    """Prepare the thermometers, and return the range that they show [C]."""
    warm, numbers = playback.temperature_C, range(len(playback.intervals))
    floor = 5 * np.floor(warm.min() / 5 - 1)
    top = max(warm.max(), playback.problem.stiffness_thresholds_C[1]) + 3.0
    ax.bar(numbers, top - floor, 0.5, floor, fc="0.94", ec="0.6", lw=0.8, zorder=1)
    mark_melting(ax, playback.problem.stiffness_thresholds_C, label="", zorder=4)
    ax.set(xlim=(-0.5, len(numbers) - 0.5), ylim=(floor, top))
    ax.set_xticks(numbers, [str(j + 1) for j in numbers])
    ax.tick_params(axis="x", length=0)
    ax.tick_params(labelsize=8.5)
    ax.yaxis.set_major_formatter("{x:zg} °C")
    ax.spines["bottom"].set_visible(False)
    return float(floor), float(top)


def _set_bars(ax: Axes, playback: Playback) -> None:
    draw_stiffness(ax, playback.intervals, 0.7)
    playback.stretch.apply(ax)
    lanes = len(playback.intervals) - 0.5
    top = lanes + (0.55 if playback.stages else 0.0)
    for number, stage in enumerate(playback.stages, start=1):
        ax.plot([stage.to_s] * 2, [-0.5, lanes], **STAGE_LINE)
        style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8}
        ax.text(stage.to_s, lanes, str(number), **style)
    ax.set(ylim=(-0.5, top), xticks=[])
    ax.tick_params(length=0, labelsize=8.5)
    ax.spines[:].set_visible(False)


def _set_curves(ax: Axes, playback: Playback, range_C: tuple[float, float]) -> None:
    mark_melting(ax, playback.problem.stiffness_thresholds_C, label="")
    for j, warm in enumerate(playback.temperature_C.T):
        ax.plot(playback.time_s, warm, alpha=AHEAD, **figures.segment_curve(j))
        ax.plot([], [], label=f"segment {j + 1}", **figures.segment_curve(j))
    for phase in playback.phases:
        ax.axvspan(phase.start_s, phase.end_s, color="0.9", lw=0, zorder=0)
    playback.stretch.apply(ax, 0.011)
    ax.tick_params(labelsize=8.5)
    note = ", stretched where the robot is driven (grey)" if playback.phases else ""
    ax.set(ylabel="°C", xlabel=f"time [s]{note}", ylim=range_C)
    ax.legend(loc="center right", frameon=False)
