"""Sweep of a plan: the robot every few millimetres, among what is around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from twosra_mpc.arguments import public
from twosra_mpc.checking.surroundings import closest_approach
from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.carried import carried
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Phase
from twosra_mpc.plotting import figures, object_figures, plane, world_figures
from twosra_mpc.plotting.figures import RIGID_COLOUR, SOFT_COLOUR
from twosra_mpc.plotting.plan_figures import plan_title
from twosra_mpc.robot.coordinates import POSE, Array, composed
from twosra_mpc.robot.modes import is_rigid

_SIZE_IN = (7.0, 6.2)  # of the figure
_STEP_M = 0.006  # that some corner moves from one robot drawn to the next
_LOOKED_AT = 400  # times of a phase
_PALE = 0.16  # opacity of one of many poses on top of each other


@public
def plot_sweep(plan: Plan, path: str | Path | None = None) -> Figure:
    """Draw all that the robot passes over: blue where it drives, red where it bends.

    Args:
        plan: The plan.
        path: Where to save the figure, atomically; its ending (png, pdf, svg, ...) is the format.

    Raises:
        InputError: If matplotlib cannot write such a file, or the folder cannot be written.
    """
    with figures.styled_figure(_SIZE_IN, path) as figure:
        ax = figure.subplots()
        figure.suptitle(plan_title(plan), wrap=True)
        draw_sweep(ax, plan)
        shapes = robot_shape(plan.robot.geometry, plan.trajectory.samples.q, 2)
        seen = [shapes.wheels.reshape(-1, 2), object_figures.seen_m(plan.trajectory)]
        shown = world_figures.shown_m(plan.problem, np.concatenate(seen))
        nearest = closest_approach(plan.trajectory)
        world_figures.draw_world(ax, plan.problem, shown)
        world_figures.draw_nearest(ax, nearest)
        plane.to_one_scale([ax], shown)
        ax.set(xlabel="x [m]", ylabel="y [m]")
        entries = {
            "start": plane.FAINT_ROBOT,
            "end": plane.ROBOT,
            "swept while driving": plane.line(RIGID_COLOUR, 6),
            "swept while bending": plane.line(SOFT_COLOUR, 6),
            **object_figures.resting_entries(plan.problem),
            **world_figures.legend_entries(plan.problem, nearest),
        }
        plane.legend_below(figure, entries, 3)
    return figure


@public
def draw_sweep(ax: Axes, plan: Plan) -> Axes:
    """Draw the robot of a plan every few millimetres, pale, and where it starts and ends.

    Objects are drawn where they are first and last, and pale where they are carried.
    """
    geometry, samples = plan.robot.geometry, plan.trajectory.samples
    for phase in plan.phases:
        colour = RIGID_COLOUR if is_rigid(phase.mode) else SOFT_COLOUR
        shape = robot_shape(geometry, _spread(plan, phase), 12)
        solid = [*shape.units.reshape(-1, 4, 2), *shape.wheels.reshape(-1, 4, 2)]
        ax.add_collection(PolyCollection(solid, fc=colour, ec="none", alpha=_PALE, zorder=2))
        fibre = [*shape.segments.reshape(-1, 12, 2), *shape.links.reshape(-1, 2, 2)]
        ax.add_collection(LineCollection(fibre, colors=colour, lw=2.0, alpha=_PALE, zorder=2))
    for item in carried(plan.trajectory):
        colour, thing = object_figures.fill_of(item.object), plan.problem.objects[item.object]
        held = [p for p in plan.phases if item.from_s <= (p.start_s + p.end_s) / 2 <= item.to_s]
        poses = [composed(_spread(plan, phase)[:, :POSE], item.pose_in_b0) for phase in held]
        outlines = [object_figures.outline_m(thing, pose) for each in poses for pose in each]
        ax.add_collection(PolyCollection(outlines, fc=colour, ec="none", alpha=_PALE, zorder=2.1))
    plane.draw_ends(ax, geometry, samples.q[[0, -1]], samples.mode[[0, -1]].tolist(), 4)
    object_figures.draw_ends(ax, plan.trajectory)
    return ax


def _spread(plan: Plan, phase: Phase) -> Array:
    """Configurations of a phase between which no corner moves much, (m, 3 + n)."""
    q = plan.trajectory.configuration(np.linspace(phase.start_s, phase.end_s, _LOOKED_AT))
    corners = robot_shape(plan.robot.geometry, q, 2).wheels.reshape(len(q), -1, 2)
    moved = np.linalg.norm(np.diff(corners, axis=0), axis=-1).max(axis=-1)
    passed = np.append(0.0, np.cumsum(moved)) // _STEP_M
    kept: Array = q[np.append(True, np.diff(passed) > 0)]
    return kept
