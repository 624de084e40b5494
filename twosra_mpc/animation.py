"""Animation of a run: the robot to scale, its segments' stiffness and temperature under it.

Time passes at a constant pace along the stretched time axis of the figure: driving takes a few
seconds, and minutes of waiting a few seconds more; the clock in the corner tells. Needs no display.
"""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter, writers
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.execution.plant import Truth
from twosra_mpc.execution.run import Run
from twosra_mpc.files import atomic_path
from twosra_mpc.modes import mode_name
from twosra_mpc.plotting import (
    CHANGING_COLOUR,
    SEGMENT_COLOURS,
    SOFT_COLOUR,
    STATES,
    STYLE,
    TimeStretch,
    draw_robot,
    robot_shape,
)
from twosra_mpc.run_figure import (
    PLANNED_COLOUR,
    draw_outline,
    goal_configuration,
    joined_drives,
    reported_states,
    run_stretch,
    run_title,
)

Array = NDArray[np.float64]

SIZE_IN, DPI = (8.0, 7.0), 100
FRAMES_PER_S = 15
LAST_FRAME_S = 2.0  # how long the end is shown
MARGIN_M, ABOVE = 0.02, 0.14  # around the run; share of the plane that the words take
AHEAD = 0.25  # opacity of what is yet to come
_ENDINGS = (".gif", ".mp4")


def check_animation_path(path: str | Path) -> None:
    """Check that an animation of this ending can be written here.

    Raises:
        InputError: If it cannot.
    """
    ending = Path(path).suffix.lower()
    if ending not in _ENDINGS:
        raise InputError("output", str(path), f"a file ending in {' or '.join(_ENDINGS)}")
    if ending == ".mp4" and not writers.is_available("ffmpeg"):
        allowed = "a file ending in .gif: .mp4 needs the program ffmpeg, which is not installed"
        raise InputError("output", str(path), allowed)


def animate_run(
    run: Run, path: str | Path, truth: Truth | None = None, *, duration_s: float = 11.0
) -> None:
    """Write an animation of a run, atomically.

    Args:
        run: The run.
        path: Where to save it; its ending (gif, mp4) is the format.
        truth: What really happened, if it was a simulation; otherwise what was believed is shown.
        duration_s: Of the animation, without its last frame.

    Raises:
        InputError: If such a file cannot be written.
    """
    check_animation_path(path)
    stretch = run_stretch(run)
    count = max(2, round(duration_s * FRAMES_PER_S))
    places = [*np.linspace(0.0, 1.0, count), *[1.0] * round(LAST_FRAME_S * FRAMES_PER_S)]
    times = stretch.inverse(np.array(places)).tolist()
    made: AbstractMovieWriter
    if Path(path).suffix.lower() == ".gif":
        made = PillowWriter(fps=FRAMES_PER_S)
    else:
        made = FFMpegWriter(fps=FRAMES_PER_S)
    with rc_context(STYLE), atomic_path(path) as temporary:
        scene = Scene(run, truth, stretch)
        with made.saving(scene.figure, str(temporary), DPI):
            for number, time_s in enumerate(times):
                later_s = times[min(number + 1, len(times) - 1)]
                scene.show(time_s, (later_s - time_s) * FRAMES_PER_S)
                made.grab_frame()


class Scene:
    """The figure of an animation; ``show`` moves it to a time.

    Attributes:
        figure: The figure.
    """

    def __init__(self, run: Run, truth: Truth | None, stretch: TimeStretch) -> None:
        """Draw everything that does not move."""
        log = run.log
        self.run, self._drives = run, joined_drives(run)
        if truth is None:
            self._time_s, self._q, self._warm = log.time_s, log.q, log.temperature_C
        else:
            self._time_s, self._q, self._warm = truth.time_s, truth.q, truth.temperature_C
        self._states = [reported_states(run, segment) for segment in (0, 1)]
        self.figure = Figure(figsize=SIZE_IN, dpi=DPI)
        FigureCanvasAgg(self.figure)
        sizes: dict[str, Any] = {"left": 0.11, "right": 0.97, "top": 0.95, "bottom": 0.075}
        grid = self.figure.add_gridspec(3, 1, height_ratios=(5.0, 0.5, 1.3), hspace=0.13, **sizes)
        self._plane = self.figure.add_subplot(grid[0])
        self._bars, self._curves = (
            self.figure.add_subplot(grid[1]),
            self.figure.add_subplot(grid[2]),
        )
        self._moving: list[Artist] = []
        self._set_plane()
        self._set_bars()
        self._set_curves(stretch)

    def show(self, time_s: float, pace: float) -> None:
        """Move to a time.

        Args:
            time_s: The time.
            pace: Seconds of the run that pass in a second of the animation.
        """
        for artist in self._moving:
            artist.remove()
        self._moving = [*self._robot(time_s), *self._trails(time_s), *self._words(time_s, pace)]
        done = self._time_s <= time_s + 1e-9
        for ax in (self._bars, self._curves):
            self._moving.append(ax.axvline(time_s, c="0.2", lw=1.2, zorder=6))
        for j, colour in enumerate(SEGMENT_COLOURS):
            self._moving += self._curves.plot(
                self._time_s[done], self._warm[done, j], c=colour, lw=2.0, zorder=5
            )
        self._moving.append(
            self._bars.axvspan(time_s, float(self._time_s[-1]), fc="white", alpha=0.7, lw=0)
        )

    def _robot(self, time_s: float) -> list[Artist]:
        states = [self._state(segment, time_s) for segment in (0, 1)]
        soft = (int(states[0] == "soft"), int(states[1] == "soft"))
        q, geometry = self._at(time_s), self.run.problem.robot.geometry
        artists = draw_robot(self._plane, geometry, q, soft, linewidth=8)
        for segment, state in enumerate(states):
            if state in ("melting", "freezing"):
                line = artists[segment]
                assert isinstance(line, Line2D)
                line.set_color(CHANGING_COLOUR)
                hatch: dict[str, Any] = {"c": "white", "lw": 8, "ls": (0, (0.25, 0.5)), "zorder": 4}
                artists += self._plane.plot(*line.get_data(), **hatch)
        for number, unit in enumerate(robot_shape(geometry, q, 2).units):
            x, y = unit.mean(axis=0)
            style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 8}
            artists.append(self._plane.text(x, y, str(number + 1), **style))
        return artists

    def _trails(self, time_s: float) -> list[Artist]:
        """Where the units' centres and the middle link have been."""
        done = self._time_s <= time_s + 1e-9
        artists: list[Artist] = []
        for j, colour in enumerate(SEGMENT_COLOURS):
            artists += self._plane.plot(*self._centres[done, j].T, c=colour, lw=1.3, zorder=2)
        artists += self._plane.plot(*self._q[done, :2].T, c=SOFT_COLOUR, lw=1.3, zorder=2)
        return artists

    def _words(self, time_s: float, pace: float) -> list[Artist]:
        minutes, seconds = divmod(time_s, 60.0)
        clock = f"{minutes:.0f} min {seconds:04.1f} s" if minutes else f"{seconds:.1f} s"
        driven = [d for d in self._drives if d.start_s - 1e-9 <= time_s < d.end_s - 1e-9]
        doing = f"driving in mode {mode_name(driven[0].mode)}" if driven else self._waiting(time_s)
        ended = time_s >= self._time_s[-1] - 1e-9
        if ended:
            doing = run_title(self.run).splitlines()[0]
        else:
            doing += (
                f"  ({pace:.0f} times as fast)" if pace > 1.5 else f"  (at {pace:.1f} of its speed)"
            )
        style: dict[str, Any] = {"transform": self._plane.transAxes, "va": "top", "zorder": 9}
        return [
            self._plane.text(0.012, 0.985, clock, fontsize=15, fontweight="bold", **style),
            self._plane.text(0.012, 0.905, doing, fontsize=10.5, **style),
        ]

    def _waiting(self, time_s: float) -> str:
        """What is being waited for."""
        changing = {
            f"segment {segment + 1} is {state}"
            for segment in (0, 1)
            if (state := self._state(segment, time_s)) in ("melting", "freezing")
        }
        if changing:
            return " and ".join(sorted(changing))
        if (self.run.log.setpoint_C[self._logged(time_s)] > self._rigid_C).any():
            return "heating"
        soft = "soft" in [self._state(segment, time_s) for segment in (0, 1)]
        return "cooling" if soft else "waiting"

    def _state(self, segment: int, time_s: float) -> str:
        states = self._states[segment]
        place = bisect_right([low for low, _, _ in states], time_s + 1e-9) - 1
        return states[max(place, 0)][2]

    def _logged(self, time_s: float) -> int:
        return max(0, bisect_right(self.run.log.time_s.tolist(), time_s + 1e-9) - 1)

    def _at(self, time_s: float) -> Array:
        return np.array([np.interp(time_s, self._time_s, column) for column in self._q.T])

    @property
    def _rigid_C(self) -> float:
        return self.run.problem.robot.heater.rigid_setpoint_C

    def _set_plane(self) -> None:
        geometry, ax, run = self.run.problem.robot.geometry, self._plane, self.run
        draw_outline(ax, run, goal_configuration(run))
        shapes = [robot_shape(geometry, q, 2) for q in self._q]
        self._centres = np.array([shape.units.mean(axis=1) for shape in shapes])
        corners = np.concatenate([shape.wheels.reshape(-1, 2) for shape in shapes])
        low, high = corners.min(axis=0) - MARGIN_M, corners.max(axis=0) + MARGIN_M
        box = ax.get_position()
        width, height = SIZE_IN[0] * box.width, SIZE_IN[1] * box.height
        scale = max((high[0] - low[0]) / width, (high[1] - low[1]) / height / (1 - ABOVE))  # [m/in]
        middle = (low + high) / 2
        left, bottom = middle[0] - scale * width / 2, middle[1] - scale * height * (1 - ABOVE) / 2
        ax.set(xlim=(left, left + scale * width), ylim=(bottom, bottom + scale * height))
        ax.set_aspect("equal")
        ax.set_ylabel("x, y [m]")
        ax.set_title(_title(run), loc="left")
        ax.tick_params(labelsize=8.5)
        ax.locator_params(nbins=6)

    def _set_bars(self) -> None:
        ax = self._bars
        for segment, row in ((0, 1.0), (1, 0.0)):
            for low, high, state in self._states[segment]:
                ax.barh(row, high - low, 0.7, low, **STATES[state])
        ax.set(ylim=(-0.5, 1.5), yticks=(0, 1), yticklabels=("segment 2", "segment 1"))
        ax.tick_params(length=0, labelsize=8.5)
        ax.spines[:].set_visible(False)
        handles: list[Any] = [
            Patch(label=name, **STATES[name]) for name in STATES if name != "heater current"
        ]
        handles.append(Line2D([], [], c=PLANNED_COLOUR, lw=1.2, ls="--", label="goal"))
        style: dict[str, Any] = {"loc": "lower right", "ncols": 5, "bbox_to_anchor": (1.0, 0.985)}
        self._plane.legend(handles=handles, columnspacing=1.0, handlelength=1.5, **style)

    def _set_curves(self, stretch: TimeStretch) -> None:
        ax, problem = self._curves, self.run.problem
        solid, liquid = problem.stiffness_thresholds_C
        ax.axhspan(solid, liquid, color="0.5", lw=1, ls=":", alpha=0.5)
        for j, colour in enumerate(SEGMENT_COLOURS):
            style: dict[str, Any] = {"c": colour, "lw": 1.2, "alpha": AHEAD}
            ax.plot(self._time_s, self._warm[:, j], **style)
            ax.plot([], [], c=colour, lw=2.0, label=f"segment {j + 1}")
        for each in (self._bars, ax):
            each.set_xscale("function", functions=(stretch.forward, stretch.inverse))
            each.set(xlim=(0.0, stretch.knots_s[-1]), xticks=[])
        for drive in self._drives:
            ax.axvspan(drive.start_s, drive.end_s, color="0.9", lw=0, zorder=0)
        ticks = stretch.ticks(0.011)
        ax.set_xticks(list(ticks), list(ticks.values()))
        ax.tick_params(labelsize=8.5)
        ax.set(ylabel="°C", xlabel="time [s], stretched where the robot is driven (grey)")
        ax.legend(loc="center right", frameon=False)


def _title(run: Run) -> str:
    words = {"optimal": "closed loop", "greedy": "greedy rule"}
    return f"{run.problem.robot.name}: {words[run.executor]}"
