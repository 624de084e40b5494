"""Runs drawn and filmed: planned against executed, in the plane and over time.

Needs no display and leaves ``rcParams`` alone.
"""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from twosra_mpc.arguments import public
from twosra_mpc.checking.followed import Followed
from twosra_mpc.execution.run import CHANGING, Run, RunLog, times
from twosra_mpc.execution.simulation.plant import Truth
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.plan import planned_words
from twosra_mpc.plans.trajectory import Interval, Phase
from twosra_mpc.plotting import figures, plane, timeline_figures, world_figures
from twosra_mpc.plotting.film import Film, OnProgress, animate
from twosra_mpc.plotting.playback import Playback, places_s
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import mode_name
from twosra_mpc.validation import Seconds

Record = RunLog | Truth

ACCURACY_COLOUR = "#12997c"
_DECISIONS = {"replan": (figures.SOFT_COLOUR, "planned again"), "kept": ("0.7", "the plan stays")}
JOINED_S = 12.0  # drives of one mode that are less than this apart are shown as one


@public
def plot_run(run: Run, truth: Truth | None = None, path: str | Path | None = None) -> Figure:
    """Draw a run.

    Args:
        run: The run.
        truth: What really happened, if it was a simulation; otherwise what was believed is drawn.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    record = truth or run.log
    with figures.styled_figure((10.0, 10.4), path) as figure:
        figure.suptitle(run_title(run), wrap=True)
        rows = figure.add_gridspec(2, 1, height_ratios=(0.8, 1.0))
        _draw_plane(figure.add_subfigure(rows[0]), run, record)
        _draw_timeline(figure.add_subfigure(rows[1]), run, record)
    return figure


def run_title(run: Run) -> str:
    """Ending of the run, in a line or two."""
    against = f" (planned: {planned_words(run.plans[0])})" if run.plans else ""
    again = f", planned again {times(run.replans)}" if run.replans else ""
    first = f"{run.reason[0].upper()}{run.reason[1:]}"
    transitions = f"{run.transitions} transition{'s' * (run.transitions != 1)}"
    return f"{first}\nafter {run.duration_s:z.0f} s{against}, {transitions}{again}"


def joined_drives(run: Run) -> list[Phase]:
    """Drives of the robot, those of one mode that follow each other closely joined."""
    joined: list[Phase] = []
    for drive in run.drives:
        before = joined[-1] if joined else None
        if before and before.mode == drive.mode and drive.start_s - before.end_s < JOINED_S:
            joined[-1] = before._replace(end_s=drive.end_s)
        else:
            joined.append(Phase(*drive))
    return joined


def _draw_plane(figure: SubFigure, run: Run, record: Record) -> None:
    """The whole run on the left; on the right each drive, planned and executed."""
    geometry, drives = run.problem.robot.geometry, joined_drives(run)[:9]
    axes = plane.overview_and_panels(figure, len(drives), 1.15)
    modes = (run.problem.start_mode, run.problem.goal.mode)
    plane.draw_ends(axes[0], geometry, record.q, modes, 5)
    if not run.problem.ends_anywhere:
        plane.draw_outline(axes[0], geometry, goal_configuration(run))
    _draw_paths(axes[0], run, record, 0.0, math.inf)
    axes[0].margins(0.12, 0.1)
    axes[0].set(xlabel="x [m]", ylabel="y [m]")
    for number, (ax, drive) in enumerate(zip(axes[1:], drives, strict=True), start=1):
        _draw_drive(ax, run, record, number, drive)
    extent_m = robot_shape(geometry, record.q[::20], 2).wheels.reshape(-1, 2)
    if run.plans:
        extent_m = np.concatenate([extent_m, world_figures.seen_m(run.plans[0].trajectory)])
    if isinstance(record, Truth) and run.problem.objects:
        world_figures.draw_ends(axes[0], run.problem, record.objects[[0, -1]], record.q)
    else:  # where objects are last is not in a log
        first = np.array([item.pose.pose for item in run.problem.objects])
        world_figures.draw_objects(axes[0], run.problem, first, alpha=figures.FAINT)
    world_figures.show_world(axes, run.problem, extent_m, 6.0)
    entries: dict[str, Any] = {
        "start": plane.FAINT_ROBOT,
        "end": plane.ROBOT,
        "planned" if run.plans else "goal": plane.DASHED,
        "rigid": plane.RIGID,
        "soft": plane.SOFT,
        "path of unit 1": plane.line(figures.UNIT_COLOURS[0]),
        "of unit 2": plane.line(figures.UNIT_COLOURS[1]),
        "of the middle link": plane.line(figures.MIDDLE_COLOUR),
    }
    entries |= world_figures.legend_entries(run.problem, aims=False)
    plane.legend_below(figure, entries, 8)


def goal_configuration(run: Run) -> Array:
    """Goal of a run; free coordinates as planned first, or as reached."""
    goal = run.problem.goal.configuration
    reached = run.plans[0].trajectory.samples.q if run.plans else run.log.q
    return np.where(np.isnan(goal), reached[-1], goal)


def _draw_drive(ax: Axes, run: Run, record: Record, number: int, drive: Phase) -> None:
    geometry = run.problem.robot.geometry
    first, last = np.searchsorted(record.time_s, (drive.start_s, drive.end_s))
    driven = record.q[first : last + 1]
    plane.draw_ends(ax, geometry, driven, (drive.mode, drive.mode), 3)
    planned = _planned(run, 0.0, drive.end_s)
    if len(planned):
        plane.draw_outline(ax, geometry, planned[-1])
    _draw_paths(ax, run, record, drive.start_s, drive.end_s)
    took = drive.end_s - drive.start_s
    title = f"{number}: {mode_name(drive.mode)} at {drive.start_s:z.0f} s, {took:z.1f} s"
    ax.set_title(title, fontsize=9)


def _planned(run: Run, start_s: float, end_s: float) -> Array:
    """Planned configurations from one time to another, wherever there was a plan."""
    time_s, planned = run.log.time_s, run.log.planned
    return planned[_within(time_s, start_s, end_s) & ~np.isnan(planned[:, 0])]


def _within(time_s: Array, start_s: float, end_s: float) -> NDArray[np.bool_]:
    return (time_s >= start_s - 1e-6) & (time_s <= end_s + 1e-6)


def _draw_paths(ax: Axes, run: Run, record: Record, start_s: float, end_s: float) -> None:
    """Paths of the units' centres and of the middle link: executed, and dashed as planned."""
    styles: tuple[tuple[Array, dict[str, Any]], ...] = (
        (record.q[_within(record.time_s, start_s, end_s)], {"lw": 2.0}),
        (_planned(run, start_s, end_s), {"lw": 0.9, "ls": "--", "gapcolor": "white"}),
    )
    for rows, style in styles:
        centres = robot_shape(run.problem.robot.geometry, rows, 2).centres
        for unit, colour in enumerate(figures.UNIT_COLOURS):
            ax.plot(*centres[:, unit].T, c=colour, zorder=5, **style)
        ax.plot(*rows[:, :2].T, c=figures.MIDDLE_COLOUR, zorder=5, **style)


def _followed(run: Run, record: Record) -> list[Followed]:
    """How paths were followed; objects' only where it is known in truth."""
    objects = record.objects if isinstance(record, Truth) else np.empty((0, 0, POSE))
    return run.followed(record.time_s, record.q, objects)


def run_stretch(run: Run) -> timeline_figures.TimeStretch:
    """Time axis of a run, stretched where it was driven."""
    drives = joined_drives(run)
    least = min(0.12, 0.6 / max(len(drives), 1))
    return timeline_figures.TimeStretch.of(drives, run.duration_s or 1.0, least)


def _draw_timeline(figure: SubFigure, run: Run, record: Record) -> None:
    asked = not run.problem.ends_anywhere
    off = _followed(run, record)
    heights = [0.5 * run.problem.robot.coordinates.segments, 1.0, 0.9, 1.0]
    heights += [1.0] * asked + [0.8] * bool(off)
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    stretch, drives = run_stretch(run), joined_drives(run)
    note = "time [s]" + (", stretched where the robot was driven (grey)" if drives else "")
    stretch.apply(axes[-1]).set_xlabel(note)
    _draw_states(axes[0], run)
    timeline_figures.name_phases(axes[0], drives, stretch, "{number}: {mode}")
    _draw_curvatures(axes[1], run, record)
    timeline_figures.wheel_speeds(axes[2], run.log.time_s, run.log.wheel_rad_s, "steps-post")
    _draw_temperatures(axes[3], run, record)
    if asked:
        _draw_distances(axes[4], run, record)
    if off:
        timeline_figures.draw_off_path(axes[-1], off)
        axes[-1].plot([], [], c=figures.NEAREST_COLOUR, lw=1.0, label="what follows it")
        axes[-1].plot([], [], c=figures.TASK_COLOUR, lw=1.0, ls="--", label="tolerance")
        timeline_figures.finished(axes[-1], "off path\n[mm]")
    for ax, drive in product(axes, drives):
        ax.axvspan(drive.start_s, drive.end_s, color="0.9", lw=0, zorder=0)
    for ax, event in product(axes, run.events):
        if event.kind in _DECISIONS:
            colour, _ = _DECISIONS[event.kind]
            ax.axvline(event.time_s, color=colour, lw=1.0, ls=":", zorder=1)
    figure.align_ylabels(axes)


def reported_states(run: Run) -> tuple[tuple[Interval, ...], ...]:
    """For each segment, the intervals of its stiffness as its controller reported it."""
    log, heater = run.log, run.problem.robot.heater
    asked = np.where(log.setpoint_C >= heater.soft_setpoint_C, "melting", "freezing")
    still = np.where(log.stiffness > CHANGING, "soft", "rigid")
    states = np.where(log.stiffness == CHANGING, asked, still)
    return tuple(timeline_figures.intervals_of(log.time_s, column) for column in states.T)


def _draw_states(ax: Axes, run: Run) -> None:
    """A bar a segment, as reported."""
    intervals = reported_states(run)
    timeline_figures.draw_stiffness(ax, intervals, 0.6).set_ylim(-0.5, len(intervals) - 0.5)
    ax.tick_params(axis="y", length=0)
    handles: list[Any] = timeline_figures.state_handles("heater current")
    for kind in {event.kind for event in run.events} & _DECISIONS.keys():
        colour, words = _DECISIONS[kind]
        handles.append(Line2D([], [], c=colour, lw=1.0, ls=":", label=words))
    ax.legend(handles=handles, **figures.BESIDE)


def _draw_curvatures(ax: Axes, run: Run, record: Record) -> None:
    log = run.log
    for j, colour in enumerate(figures.SEGMENT_COLOURS[: record.q.shape[1] - POSE]):
        seen: dict[str, Any] = {"ls": "", "marker": ".", "ms": 2.5, "alpha": 0.35, "mew": 0}
        ax.plot(log.time_s, log.measured[:, POSE + j], c=colour, **seen)
        look: dict[str, Any] = {"label": timeline_figures.KAPPA[j], **figures.segment_curve(j)}
        ax.plot(record.time_s, record.q[:, POSE + j], **look)
        ax.plot(log.time_s, log.planned[:, POSE + j], **figures.segment_curve(j, "--"))
    if run.plans:
        ax.plot([], [], c=figures.PLANNED_COLOUR, lw=1.1, ls="--", label="planned")
    ax.plot([], [], c=figures.PLANNED_COLOUR, ls="", marker=".", alpha=0.6, label="camera")
    timeline_figures.finished(ax, "curvature\n[1/m]")


def _draw_distances(ax: Axes, run: Run, record: Record) -> None:
    """Distance from the goal in units of the accuracy, on a logarithmic axis."""
    errors = np.array([run.goal.error(at.copy()) for at in record.q])
    errors /= run.accuracy.scale(run.problem.robot.coordinates)
    of = {"position": slice(2), "heading": slice(2, POSE), "curvatures": slice(POSE, None)}
    free = np.isnan(run.problem.goal.configuration)
    parts = {
        "position": (np.hypot(errors[:, 0], errors[:, 1]), figures.RIGID_COLOUR),
        "heading": (np.abs(errors[:, 2]), figures.SEGMENT_COLOURS[0]),
        "curvatures": (np.abs(errors[:, POSE:]).max(axis=1), figures.SOFT_COLOUR),
    }
    parts = {name: part for name, part in parts.items() if not free[of[name]].all()}
    for number, (name, (distance, colour)) in enumerate(parts.items()):
        look: dict[str, Any] = {"c": colour, "label": name, **figures.curve(number)}
        ax.plot(record.time_s, np.maximum(distance, 1e-3), **look)
    position, heading = 1e3 * run.accuracy.position_m, math.degrees(run.accuracy.heading_rad)
    label = f"{position:zg} mm, {heading:z.3g}°, {run.accuracy.curvature_per_m:zg} 1/m"
    ax.axhline(1.0, c=ACCURACY_COLOUR, lw=1.0, ls="--", label=label)
    most = max(10.0, *(float(np.nanmax(distance)) for distance, _ in parts.values()))
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.set(ylim=(0.02, 2 * most), ylabel="from goal\n/ accuracy")
    ax.legend(**figures.BESIDE)


def _draw_temperatures(ax: Axes, run: Run, record: Record) -> None:
    log = run.log
    true = record.time_s, record.temperature_C
    sensed = None if record is log else (log.time_s, log.temperature_C)
    asked = log.time_s, log.setpoint_C
    timeline_figures.temperatures(ax, run.problem.stiffness_thresholds_C, true, asked, sensed)


@public
def animate_run(
    run: Run,
    path: str | Path | None = None,
    truth: Truth | None = None,
    *,
    duration_s: Seconds = 12.0,
    on_progress: OnProgress | None = None,
) -> Film:
    """Animate a run; a notebook shows what is returned.

    Args:
        run: The run.
        path: Where to save the animation, atomically; its ending (gif, mp4) is the format.
        truth: What really happened, if it was a simulation; otherwise what was believed is shown.
        duration_s: Of the animation, without its last frame.
        on_progress: Called with the frames done and the frames in all, after each of them.

    Raises:
        InputError: If such a file cannot be written.
    """
    words = {"optimal": "closed loop", "greedy": "greedy rule"}[run.executor]
    titles = f"{run.problem.robot.name}: {words}", run_title(run).splitlines()[0]
    return animate(run_playback(run, truth), titles, path, duration_s, on_progress)


def run_playback(run: Run, truth: Truth | None = None) -> Playback:
    """Play a run; ``truth`` as for ``animate_run``. Between its rows, a log is interpolated."""
    log, problem, stretch = run.log, run.problem, run_stretch(run)
    shown_s = np.minimum(places_s(stretch), log.time_s[-1])
    record = truth or log

    def then(values: Array) -> Array:
        return np.column_stack([np.interp(shown_s, record.time_s, v) for v in values.T])

    unknown = np.full((len(shown_s), problem.robot.coordinates.segments), np.nan)
    objects = np.empty((len(shown_s), 0, POSE))
    if truth is not None and problem.objects:
        objects = truth.objects[np.searchsorted(truth.time_s[:-1], shown_s)]
    sent = np.clip(np.searchsorted(log.time_s, shown_s + 1e-9) - 1, 0, None)
    return Playback(
        problem=problem,
        goals=(goal_configuration(run),) if not problem.ends_anywhere else (),
        nearest=None,
        phases=tuple(joined_drives(run)),
        intervals=reported_states(run),
        stretch=stretch,
        time_s=shown_s,
        q=then(record.q),
        temperature_C=then(record.temperature_C),
        melt_fraction=unknown if truth is None else then(truth.melt_fraction),
        heated=log.setpoint_C[sent] > problem.robot.heater.rigid_setpoint_C,
        objects=objects,
        targets=tuple(world_figures.targets(run.plans[0].trajectory)) if run.plans else (),
        off=tuple(_followed(run, record)),
    )
