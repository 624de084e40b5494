"""The scene of an animation: the robot to scale, thermometers, stiffness and temperature over time.

The same for a plan and for a run in closed loop: what it shows is a `Story`.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from itertools import chain
from textwrap import fill
from typing import Any, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.trajectory import Phase
from twosra_mpc.plotting.film import Moment
from twosra_mpc.plotting.robot_drawing import draw_outline, number_units, robot_artists
from twosra_mpc.plotting.style import (
    HEATER_COLOUR,
    PLANNED_COLOUR,
    SEGMENT_COLOURS,
    SOFT_COLOUR,
    STATES,
)
from twosra_mpc.plotting.time_axis import TimeStretch
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.robot.modes import mode_name

Array = NDArray[np.float64]

SIZE_IN, DPI = (8.0, 6.6), 100
MARGIN_M, ABOVE = 0.02, 0.15  # around the motion; share of the plane that the words take
LETTERS = 72  # that fit above the plane
AHEAD = 0.25  # opacity of what is yet to come
CHANGING = ("melting", "freezing")


@dataclass(frozen=True, eq=False)
class Story:
    """What an animation shows; arrays are on one time grid.

    Attributes:
        title: Written above.
        ending: Said at the end.
        geometry: Of the robot.
        melting_C: Temperatures below which metal is solid and above which it is liquid.
        goal: Configuration to reach [m, m, rad, 1/m, 1/m], (5,).
        time_s: Time, (n,).
        q: Configuration [m, m, rad, 1/m, 1/m], (n, 5).
        temperature_C: Of the segments, (n, 2).
        melt_fraction: Of the segments, NaN where not known, (n, 2).
        heated: Whether the heaters are on, (n, 2).
        states: (from, to, state) of both segments [s], as of ``segment_states``.
        drives: When the robot is driven, and in which mode.
        stretch: Time axis.
    """

    title: str
    ending: str
    geometry: Geometry
    melting_C: tuple[float, float]
    goal: Array
    time_s: Array
    q: Array
    temperature_C: Array
    melt_fraction: Array
    heated: NDArray[np.bool_]
    states: tuple[list[tuple[float, float, str]], list[tuple[float, float, str]]]
    drives: tuple[Phase, ...]
    stretch: TimeStretch

    def state(self, segment: int, time_s: float) -> str:
        """State of segment 0 or 1 at a time."""
        states = self.states[segment]
        place = bisect_right([low for low, _, _ in states], time_s + 1e-9) - 1
        return states[max(place, 0)][2]

    def at(self, values: Array, time_s: float) -> Array:
        """Rows of an array on the grid, interpolated to a time."""
        return np.array([np.interp(time_s, self.time_s, column) for column in values.T])

    def until(self, values: Array, time_s: float) -> Array:
        """Rows of an array on the grid up to a time, with one at that time."""
        done = values[self.time_s < time_s]
        return np.concatenate([done, [self.at(values, time_s)]])

    def doing(self, time_s: float) -> str:
        """What happens at a time, in words."""
        if time_s >= self.time_s[-1] - 1e-9:
            return self.ending
        for drive in self.drives:
            if drive.start_s - 1e-9 <= time_s < drive.end_s - 1e-9:
                return f"driving in mode {mode_name(drive.mode)}"
        states = [self.state(segment, time_s) for segment in (0, 1)]
        if states[0] == states[1] and states[0] in CHANGING:
            return f"both segments are {states[0]}"
        changing = [
            f"segment {j} is {state}" for j, state in enumerate(states, 1) if state in CHANGING
        ]
        if changing:
            return " and ".join(changing)
        row = max(0, bisect_right(self.time_s.tolist(), time_s + 1e-9) - 1)
        if self.heated[row].any():
            return "heating"
        return "cooling" if "soft" in states else "waiting"


class Scene:
    """The figure of an animation; ``show`` moves it to a moment.

    Attributes:
        figure: The figure.
    """

    def __init__(self, story: Story) -> None:
        """Draw everything that does not move."""
        self._story = story
        self.figure = Figure(figsize=SIZE_IN, dpi=DPI)
        self._canvas = cast(Any, FigureCanvasAgg(self.figure))  # its methods have no types
        sizes: dict[str, Any] = {"left": 0.105, "right": 0.96, "top": 0.95, "bottom": 0.08}
        rows = self.figure.add_gridspec(3, 1, height_ratios=(5.0, 0.55, 1.3), hspace=0.15, **sizes)
        top = rows[0].subgridspec(2, 2, width_ratios=(5.4, 1.0), height_ratios=(1, 6), wspace=0.18)
        self._plane, self._gauges = (self.figure.add_subplot(at) for at in (top[:, 0], top[1, 1]))
        self._bars, self._curves = (self.figure.add_subplot(rows[row]) for row in (1, 2))
        shapes = robot_shape(story.geometry, story.q, 2)
        self._centres = shapes.centres.reshape(-1, 4)
        _set_plane(self._plane, story, shapes.wheels)
        self._floor_C, top_C = _set_gauges(self._gauges, story)
        _set_bars(self._bars, story)
        _set_curves(self._curves, story, (self._floor_C, top_C))
        self._moving: list[Artist] = []
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def show(self, moment: Moment) -> None:
        """Move to a moment."""
        for artist in self._moving:
            artist.remove()
        time_s = moment.time_s
        self._moving = [
            *self._robot(time_s),
            *self._trails(time_s),
            *self._words(moment),
            *self._columns(time_s),
            *self._progress(time_s),
        ]

    def image(self, moment: Moment) -> Image.Image:
        """Move to a moment, and return a picture of it; only what moves is drawn."""
        self.show(moment)
        self._canvas.restore_region(self._background)
        for artist in sorted(self._moving, key=Artist.get_zorder):
            assert isinstance(artist.axes, Axes)
            artist.axes.draw_artist(artist)
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")

    def _robot(self, time_s: float) -> list[Artist]:
        states = [self._story.state(segment, time_s) for segment in (0, 1)]
        q, geometry = self._story.at(self._story.q, time_s), self._story.geometry
        mode = (int(states[0] == "soft"), int(states[1] == "soft"))
        changing = (int(states[0] in CHANGING), int(states[1] in CHANGING))
        drawn = robot_artists(self._plane, geometry, q, mode, changing=changing, linewidth=8)
        return [*drawn, *number_units(self._plane, geometry, q, 11)]

    def _trails(self, time_s: float) -> list[Artist]:
        """Where the units' centres and the middle link have been."""
        centres = self._story.until(self._centres, time_s)
        link = self._story.until(self._story.q[:, :2], time_s)
        paths = ((centres[:, :2], SEGMENT_COLOURS[0]), (centres[:, 2:], SEGMENT_COLOURS[1]))
        lines = [
            self._plane.plot(*path.T, c=colour, lw=1.3, zorder=2)
            for path, colour in (*paths, (link, SOFT_COLOUR))
        ]
        return list(chain.from_iterable(lines))

    def _words(self, moment: Moment) -> list[Artist]:
        minutes, seconds = divmod(moment.time_s, 60.0)
        clock = f"{minutes:.0f} min {seconds:04.1f} s" if minutes else f"{seconds:.1f} s"
        doing, pace = self._story.doing(moment.time_s), moment.pace
        if doing != self._story.ending:
            slow = f"at {pace:.2g} of its speed"
            doing += f"  ({f'{pace:.0f} times as fast' if pace > 1.5 else slow})"
        style: dict[str, Any] = {"transform": self._plane.transAxes, "va": "top", "zorder": 9}
        return [
            self._plane.text(0.012, 0.985, clock, fontsize=15, fontweight="bold", **style),
            self._plane.text(0.012, 0.905, fill(doing, LETTERS), fontsize=10.5, **style),
        ]

    def _columns(self, time_s: float) -> list[Artist]:
        """A thermometer a segment, in the colour of its state."""
        story, ax, artists = self._story, self._gauges, list[Artist]()
        row = max(0, bisect_right(story.time_s.tolist(), time_s + 1e-9) - 1)
        warm, liquid = story.at(story.temperature_C, time_s), story.at(story.melt_fraction, time_s)
        for j in (0, 1):
            look = STATES[story.state(j, time_s)]
            artists += ax.bar(j, warm[j] - self._floor_C, 0.5, self._floor_C, zorder=3, **look)
            words = f"{warm[j]:.0f} °C"
            if np.isfinite(liquid[j]):
                words += f"\n{100 * liquid[j]:.0f} %\nliquid"
            style: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8.5, "zorder": 4}
            artists.append(ax.text(j, 1.01, words, transform=ax.get_xaxis_transform(), **style))
            if story.heated[row, j]:
                edge: dict[str, Any] = {"fill": False, "ec": HEATER_COLOUR, "lw": 2.5, "zorder": 5}
                height = ax.get_ylim()[1] - self._floor_C
                artists += ax.bar(j, height, 0.5, self._floor_C, **edge)
        return artists

    def _progress(self, time_s: float) -> list[Artist]:
        """What is done, over time."""
        story, artists = self._story, list[Artist]()
        done = story.until(story.time_s[:, None], time_s)[:, 0]
        warm = story.until(story.temperature_C, time_s)
        for j, colour in enumerate(SEGMENT_COLOURS):
            artists += self._curves.plot(done, warm[:, j], c=colour, lw=2.0, zorder=5)
        rest: dict[str, Any] = {"fc": "white", "alpha": 0.7, "lw": 0}
        artists.append(self._bars.axvspan(time_s, float(story.time_s[-1]), **rest))
        now: dict[str, Any] = {"c": "0.2", "lw": 1.2, "zorder": 6}
        return [*artists, *(ax.axvline(time_s, **now) for ax in (self._bars, self._curves))]


def _set_plane(ax: Axes, story: Story, corners: Array) -> None:
    draw_outline(ax, story.geometry, story.goal)
    goal = robot_shape(story.geometry, story.goal, 2).wheels
    points = np.concatenate([corners.reshape(-1, 2), goal.reshape(-1, 2)])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    box = ax.get_position()
    width, height = SIZE_IN[0] * box.width, SIZE_IN[1] * box.height
    scale = max((high[0] - low[0]) / width, (high[1] - low[1]) / height / (1 - ABOVE))  # [m/in]
    middle = (low + high) / 2
    left, bottom = middle[0] - scale * width / 2, middle[1] - scale * height * (1 - ABOVE) / 2
    ax.set(xlim=(left, left + scale * width), ylim=(bottom, bottom + scale * height))
    ax.set_aspect("equal")
    ax.set_ylabel("x, y [m]")
    ax.set_title(story.title, loc="left")
    ax.tick_params(labelsize=8.5)
    ax.locator_params(nbins=6)
    looks = {name: Patch(**look) for name, look in STATES.items() if name != "heater current"}
    looks["heater on"] = Patch(fill=False, ec=HEATER_COLOUR, lw=2.0)
    handles = [*looks.values(), Line2D([], [], c=PLANNED_COLOUR, lw=1.2, ls="--")]
    style: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.235, 0.985), "ncols": 6}
    style |= {"columnspacing": 1.0, "handlelength": 1.5}
    ax.legend(handles, [*looks, "goal"], **style)


def _set_gauges(ax: Axes, story: Story) -> tuple[float, float]:
    """Prepare the thermometers, and return the range that they show [C]."""
    low, high = float(story.temperature_C.min()), float(story.temperature_C.max())
    floor, top = 5 * np.floor(low / 5 - 1), max(high, story.melting_C[1]) + 3.0
    ax.bar((0, 1), top - floor, 0.5, floor, fc="0.94", ec="0.6", lw=0.8, zorder=1)
    _mark_melting(ax, story, zorder=4)
    ax.set(xlim=(-0.5, 1.5), ylim=(floor, top))
    ax.set_xticks((0, 1), ("1", "2"))
    ax.tick_params(axis="x", length=0)
    ax.tick_params(labelsize=8.5)
    ax.yaxis.set_major_formatter("{x:g} °C")
    ax.spines["bottom"].set_visible(False)
    return float(floor), float(top)


def _mark_melting(ax: Axes, story: Story, zorder: float) -> None:
    ax.axhspan(*story.melting_C, fc="0.5", lw=0, alpha=0.2, zorder=zorder)
    for edge in set(story.melting_C):
        ax.axhline(edge, c="0.4", lw=1, ls=":", zorder=zorder)


def _set_bars(ax: Axes, story: Story) -> None:
    for states, row in zip(story.states, (1.0, 0.0), strict=True):
        for low, high, state in states:
            ax.barh(row, high - low, 0.7, low, **STATES[state])
    story.stretch.apply(ax)
    ax.set(ylim=(-0.5, 1.5), yticks=(0, 1), yticklabels=("segment 2", "segment 1"), xticks=[])
    ax.tick_params(length=0, labelsize=8.5)
    ax.spines[:].set_visible(False)


def _set_curves(ax: Axes, story: Story, range_C: tuple[float, float]) -> None:
    _mark_melting(ax, story, zorder=1)
    for j, colour in enumerate(SEGMENT_COLOURS):
        style: dict[str, Any] = {"c": colour, "lw": 1.2, "alpha": AHEAD}
        ax.plot(story.time_s, story.temperature_C[:, j], **style)
        ax.plot([], [], c=colour, lw=2.0, label=f"segment {j + 1}")
    for drive in story.drives:
        ax.axvspan(drive.start_s, drive.end_s, color="0.9", lw=0, zorder=0)
    story.stretch.apply(ax, 0.011)
    ax.tick_params(labelsize=8.5)
    note = ", stretched where the robot is driven (grey)" if story.drives else ""
    ax.set(ylabel="°C", xlabel=f"time [s]{note}", ylim=range_C)
    ax.legend(loc="center right", frameon=False)
