"""The figure of a plan: all there is to see."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import product
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from twosra_mpc.arguments import public
from twosra_mpc.checking.surroundings import closest_approach
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.branches import Policy
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.plan import Plan, planned_words, quality
from twosra_mpc.plans.trajectory import Phase, Samples, Stretch, stretches
from twosra_mpc.plotting import figures, plane, timeline_figures, world_figures
from twosra_mpc.plotting.figures import CHANGING_COLOUR, RIGID_COLOUR, SOFT_COLOUR, short
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import is_rigid, mode_name

WIDTH_IN = 10.0  # of figures
HEIGHT_IN, LANE_IN = 9.2, 0.4  # of the figure of a plan, with a lane for each segment
STAGES_IN = 0.8  # for the tasks of a mission
BRANCH_IN = 0.4  # for each outcome of a policy
ROOM = 0.12  # around what panels show, for names, in its size
CLOSE = 0.7  # of the robot's size, from its middle to the edges of a close look


@public
def plot_plan(plan: Plan, path: str | Path | None = None, policy: Policy | None = None) -> Figure:
    """Draw a plan: start, goal and every phase in the plane; stiffness and motion over time.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.
        policy: What is done where joint bends miss, if that is to be seen as well.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    lanes_in = LANE_IN * plan.robot.geometry.segments + (STAGES_IN if plan.trajectory.done_s else 0)
    policy_in = BRANCH_IN * (2 + len(policy.branches)) if policy is not None else 0.0
    with figures.styled_figure((WIDTH_IN, HEIGHT_IN + lanes_in + policy_in), path) as figure:
        figure.suptitle(plan_title(plan), wrap=True)
        heights = (4.5, 4.5 + lanes_in, policy_in)[: 2 if policy is None else 3]
        rows = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        _draw_plane(figure.add_subfigure(rows[0]), plan)
        _draw_over_time(figure.add_subfigure(rows[1]), plan)
        if policy is not None:
            _draw_policy(figure.add_subfigure(rows[2]).subplots(), plan, policy)
    return figure


def _draw_policy(ax: Axes, plan: Plan, policy: Policy) -> None:
    """Draw how long each outcome takes, as far as it goes as planned and from then on."""
    known_s = [plan.known_end_s(each.phase - 1) for each in policy.branches]
    outcomes = zip(policy.outcomes, policy.sentences, [policy.planned_s, *known_s], strict=True)
    for row, ((*_, cost_s), words, known) in enumerate(outcomes):
        ax.barh(row, known, 0.3, color=RIGID_COLOUR)
        ax.barh(row, cost_s - known, 0.3, known, color=CHANGING_COLOUR)
        above: dict[str, Any] = {"va": "bottom", "fontsize": 7, "bbox": figures.BEHIND_WORDS}
        ax.text(0.0, row - 0.22, words, **above)
    for words, at_s, dashes in (
        (policy.what, policy.cost_s, "-"),
        ("no policy below", policy.lower_bound, "--"),
    ):
        ax.axvline(at_s, color="0.2", ls=dashes, lw=1.2, label=f"{words} {at_s:z.0f} s")
    ax.set(ylim=(len(known_s) + 0.4, -0.8), yticks=(), xlabel="time until all is confirmed [s]")
    ax.legend(**figures.BESIDE)


@public
def plan_title(plan: Plan) -> str:
    """Mode sequence, or how many tasks, duration and status; in a second line, what is known."""
    sequence = " → ".join(mode_name(phase.mode) for phase in plan.phases) or "no motion"
    if each := stretches(plan.trajectory):
        sequence = f"{len(each)} task{'s' * (len(each) > 1)}"
    planner = "" if plan.planner == "optimal" else f"planner {plan.planner}, "
    return f"{sequence} in {planned_words(plan)}: {planner}{plan.status}\n{quality(plan)}"


_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


def phase_rows(samples: Samples, phase: Phase) -> Array:
    """Configurations of a phase, both ends included, (rows, 3 + n)."""
    low, high = np.searchsorted(samples.t_s, (phase.start_s - 1e-9, phase.end_s + 1e-9))
    return samples.q[low:high]


def _draw_plane(figure: SubFigure, plan: Plan) -> None:
    """Overview on the left; on the right, if there are several, a panel a phase, or a task."""
    each = stretches(plan.trajectory)
    panels = len(each or plan.phases)
    axes = plane.overview_and_panels(figure, panels if panels > 1 else 0, 1.1)
    _draw_overview(axes[0], plan, each)
    if each:
        for number, (ax, stage) in enumerate(zip(axes[1:], each, strict=False), start=1):
            _draw_stage(ax, plan, stage)
            ax.set_title(fill(f"{number}: {short(stage.words)}, {stage.to_s:z.1f} s", 24))
    else:
        for number, (ax, phase) in enumerate(zip(axes[1:], plan.phases, strict=False), start=1):
            q = phase_rows(plan.trajectory.samples, phase)
            plane.draw_ends(ax, plan.robot.geometry, q, (phase.mode, phase.mode), 3)
            _draw_path(ax, q, phase)
            took = timeline_figures.phase_duration(phase)
            ax.set_title(f"{number}: {mode_name(phase.mode)}, {took}")
    seen = plan.trajectory.configuration([0.0, *(t for phase in plan.phases for t in phase[1:])])
    extent_m = world_figures.extent_m(plan.trajectory, seen)
    world_figures.show_world(axes, plan.problem, extent_m, 6.0)
    nearest = closest_approach(plan.trajectory)
    world_figures.draw_nearest(axes[0], nearest)
    if nearest is not None:
        q, mode = nearest.configuration, plan.robot.rigid
        plane.draw_robot(axes[0], plan.robot.geometry, q, mode, alpha=figures.FAINT / 2)
    for ax, stage in zip(axes[1:], each, strict=False):
        ax.margins(ROOM)
        if stage.task is not None and stage.task.touches:
            _look_closely(ax, plan, stage)
    last, part = _end_name(plan), "task" if each else "phase"
    entries = {
        f"start (of {part})": plane.FAINT_ROBOT,
        f"{last} (end of {part})" if last == "goal" else f"end (of {part})": plane.ROBOT,
        "rigid segment": plane.RIGID,
        "soft segment": plane.SOFT,
        "path of the middle link": tuple(map(plane.line, (RIGID_COLOUR, SOFT_COLOUR))),
    }
    entries |= world_figures.legend_entries(plan.problem, nearest)
    plane.legend_below(figure, entries, 5)


def _end_name(plan: Plan) -> str:
    """Name of the end of a plan: not all have a goal."""
    return "goal" if not plan.problem.ends_anywhere else "end"


def _draw_stage(ax: Axes, plan: Plan, stage: Stretch) -> None:
    """Draw the robot and the objects before and after a stage, and its path."""
    trajectory, geometry = plan.trajectory, plan.robot.geometry
    ends = trajectory.at([stage.from_s, stage.to_s])
    poses = object_poses(trajectory, ends.t_s, ends.q)
    plane.draw_ends(ax, geometry, ends.q, ends.mode.tolist(), 3)
    within = [p for p in plan.phases if stage.from_s <= (p.start_s + p.end_s) / 2 <= stage.to_s]
    for phase in reversed(within):
        _draw_path(ax, phase_rows(trajectory.samples, phase), phase)
    world_figures.draw_objects(ax, plan.problem, poses[0], alpha=figures.FAINT, size_pt=None)
    ahead = None if stage.task is not None and stage.task.touches else world_figures.UP
    shape = robot_shape(geometry, ends.q[1])
    world_figures.draw_objects(ax, plan.problem, poses[1], beside=shape, ahead=ahead, size_pt=7.0)


def _look_closely(ax: Axes, plan: Plan, stage: Stretch) -> None:
    """Show only the robot at the end of a stage, with a bar that says how large it is."""
    shape = robot_shape(plan.robot.geometry, plan.trajectory.configuration(stage.to_s)[0], 8)
    corners = np.concatenate([part.reshape(-1, 2) for part in (shape.wheels, shape.segments)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = CLOSE * float((high - low).max())
    middle = (low + high) / 2
    ax.dataLim.set_points(np.array([middle - half, middle + half]))
    ax.autoscale_view()
    path = plan.trajectory.configuration(np.linspace(stage.from_s, stage.to_s, 100))[:, :2]
    bars = middle + _CORNERS * (half - np.array([0.025, 0.015]))  # of these the farthest from it
    x, y = bars[np.linalg.norm(path - bars[:, None], axis=2).min(axis=1).argmax()].tolist()
    ax.plot([x - 0.025, x + 0.025], [y] * 2, c="0.2", lw=2.0, solid_capstyle="butt", zorder=9)
    words: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 7}
    words |= {"color": "0.2", "zorder": 8.9, "bbox": figures.BEHIND_WORDS}
    ax.annotate("50 mm", (x, y), (0, 3), **words)


def _draw_overview(ax: Axes, plan: Plan, each: Sequence[Stretch]) -> None:
    geometry, samples = plan.robot.geometry, plan.trajectory.samples
    ends, modes = samples.q[[0, -1]], samples.mode[[0, -1]].tolist()
    plane.draw_ends(ax, geometry, ends, modes, 5)
    for phase in reversed(plan.phases):  # the end of a phase lies over the start of the next
        _draw_path(ax, phase_rows(samples, phase), phase)
    plane.number_units(ax, geometry, ends[1])
    shapes = robot_shape(geometry, ends, 2)
    start, goal = shapes.centres
    apart = np.linalg.norm(start[:, None] - goal, axis=2)
    i, j = np.argmax(apart.min(axis=1)), np.argmax(apart.min(axis=0))
    j = 1 - j if apart[i, j] < geometry.unit_frame_m else j  # one label a unit
    labelled, names = (start[i], goal[j]), ("start", _end_name(plan))
    for name, centre, origin in zip(names, labelled, shapes.origin, strict=True):
        outward = (centre - origin) / np.linalg.norm(centre - origin)
        tip, shift = centre + 0.9 * geometry.unit_frame_m * outward, (5 * outward).tolist()
        side = ("center", "left", "right")[round(outward[0])]
        style: dict[str, Any] = {"ha": side, "va": "center", "fontweight": "bold", "zorder": 7}
        style["bbox"] = figures.BEHIND_WORDS
        ax.annotate(name, tip, shift, textcoords="offset points", **style)
    if each:
        _draw_mission(ax, plan, each)
    ax.margins(0.15, 0.1)
    ax.set(xlabel="x [m]", ylabel="y [m]")


def _draw_mission(ax: Axes, plan: Plan, each: Sequence[Stretch]) -> None:
    """Draw where objects are first and last, and where each task is done."""
    trajectory, samples = plan.trajectory, plan.trajectory.samples
    ends = object_poses(trajectory, samples.t_s[[0, -1]], samples.q[[0, -1]])
    world_figures.draw_ends(ax, plan.problem, ends, samples.q)
    world_figures.draw_targets(ax, plan.problem, world_figures.targets(trajectory))
    for q in world_figures.goals(trajectory):
        plane.draw_outline(ax, plan.robot.geometry, q)
    world_figures.number_places(ax, trajectory, each)


def _draw_path(ax: Axes, q: Array, phase: Phase) -> None:
    """Path of b0 during a phase: blue while driving, red while bending."""
    colour = RIGID_COLOUR if is_rigid(phase.mode) else SOFT_COLOUR
    style: dict[str, Any] = {"marker": "o", "ms": 3.5, "mfc": "white", "markevery": [-1]}
    ax.plot(*q[:, :2].T, color=colour, lw=1.5, zorder=5, **style)


def _draw_over_time(figure: SubFigure, plan: Plan) -> None:
    heights: tuple[float, ...] = (0.25 + 0.5 * plan.robot.geometry.segments, 1.0, 1.0, 1.0, 0.7)
    stretch, each = timeline_figures.plan_stretch(plan), stretches(plan.trajectory)
    levels = timeline_figures.label_levels(each, stretch)
    if each:
        heights = (0.15 + timeline_figures.LEVEL * (1 + max(levels)), *heights)
    *above, lanes, curvature, wheels, temperature, liquid = figure.subplots(
        len(heights), 1, sharex=True, height_ratios=heights
    )
    timeline_figures.draw_timeline(lanes, plan)
    timeline_figures.name_phases(lanes, plan.phases, stretch, "{number}: {mode}\n{took}")
    timeline_figures.draw_configuration(curvature, plan)
    timeline_figures.draw_wheel_speeds(wheels, plan)
    timeline_figures.draw_temperatures(temperature, plan)
    timeline_figures.draw_melt_fractions(liquid, plan)
    for ax in (curvature, wheels, temperature, liquid):
        timeline_figures.draw_motion(ax, plan)
    stretch.apply(liquid)
    if above:
        timeline_figures.name_stages(above[0], each, levels)
        for ax, stage in product((lanes, curvature, wheels, temperature, liquid), each):
            ax.axvline(stage.to_s, **timeline_figures.STAGE_LINE)
    note = "" if stretch.even else ", stretched inside the motion phases (grey)"
    liquid.set(xlabel=f"time [s]{note}")
    figure.align_ylabels([lanes, curvature, wheels, temperature, liquid])


def plan_html(plan: Plan) -> str:
    """Return the figure of a plan as an HTML element that needs no other file."""
    address = figures.picture_address(plot_plan(plan), "png")
    return f'<img src="{address}" alt="{escape(plan_title(plan))}" style="max-width: 100%">'
