"""Objects in the plane: where they are, and where they shall be carried.

And the places of a mission: where each of its tasks is done.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Patch, Polygon

from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.trajectory import Stretch, Trajectory
from twosra_mpc.plotting import figures, plane
from twosra_mpc.plotting.figures import label
from twosra_mpc.problem.objects import Object
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import carries
from twosra_mpc.robot.coordinates import Array

UP = np.array([0.0, 1.0])
_ROUND = 64  # corners of a disc
_SHADE = 0.55  # of the colour of an object, for its edge and its name
_HELD_M = 0.06  # from an object to parts of the robot that its name must not lie on
_SAME_M = 0.03  # nearer to each other than that, places of tasks share a mark
_BESIDE_PT = 4.0  # from the edge of an object to its name


def fill_of(number: int) -> str:
    """Colour of object ``number``, from 0."""
    return figures.OBJECT_COLOURS[number % len(figures.OBJECT_COLOURS)]


def edge_of(number: int) -> str:
    """Colour of the edge of object ``number``, from 0."""
    red, green, blue = (_SHADE * part for part in to_rgb(fill_of(number)))
    return to_hex((red, green, blue))


def outline_m(item: Object, pose: Array) -> Array:
    """Corners of an object at a pose (3,), (m, 2); those of a disc are on its edge."""
    if item.disc is None:
        return item.at(pose).corners_m
    angles = np.arange(_ROUND) * math.tau / _ROUND
    return pose[:2] + item.disc.radius_m * np.column_stack([np.cos(angles), np.sin(angles)])


def outlines_m(problem: Problem, poses: Array) -> list[Array]:
    """Corners of every object whose pose is known, (objects, 3)."""
    return [outline_m(item, pose) for item, pose in zip(problem.objects, poses, strict=False)]


def targets(trajectory: Trajectory) -> list[tuple[int, Array]]:
    """Number of the object, from 0, and pose (3,), for each task that carries one.

    A heading that is free is the plan's.
    """
    problem, found = trajectory.problem, list[tuple[int, Array]]()
    names = [item.name for item in problem.objects]
    for i, task in carries(problem.tasks).items():
        number, phi = names.index(task.object), task.phi_rad
        if phi is None:
            done_s = np.array([trajectory.done_s[i]])
            phi = float(object_poses(trajectory, done_s)[0, number, 2])
        found.append((number, np.array([task.x_m, task.y_m, phi])))
    return found


def goals(trajectory: Trajectory) -> list[Array]:
    """Configuration (3 + n,) in which each goal is reached, those on the way and the last one."""
    problem = trajectory.problem
    done = zip(problem.tasks, trajectory.done_s, strict=False)
    on_the_way = [done_s for task, done_s in done if task.ends_in is not None]
    found = list(trajectory.configuration(on_the_way)) if on_the_way else []
    return [*found, trajectory.samples.q[-1]] if not problem.ends_anywhere else found


def seen_m(trajectory: Trajectory) -> Array:
    """Corners of objects wherever they rest, and where they shall be carried, (k, 2)."""
    problem = trajectory.problem
    rest_s = np.array([0.0, *trajectory.done_s, trajectory.duration_s])
    placed = [outlines_m(problem, poses) for poses in object_poses(trajectory, rest_s)]
    aims = [outline_m(problem.objects[number], pose) for number, pose in targets(trajectory)]
    return np.concatenate([np.zeros((0, 2)), *(part for each in placed for part in each), *aims])


def extent_m(trajectory: Trajectory, q: Array) -> Array:
    """Corners of the wheels at configurations (m, 3 + n), and of objects, (k, 2)."""
    wheels = robot_shape(trajectory.problem.robot.geometry, q, 2).wheels
    return np.concatenate([wheels.reshape(-1, 2), seen_m(trajectory)])


def draw_objects(
    ax: Axes,
    problem: Problem,
    poses: Array,
    *,
    beside: RobotShape | None = None,
    ahead: Array | None = None,
    alpha: float = 1.0,
    size_pt: float | None = 8.0,
) -> list[Artist]:
    """Draw objects at poses (objects, 3), each with its name beside it; every artist drawn.

    Args:
        ax: Axes in m.
        problem: Whose objects they are.
        poses: Where they are.
        beside: The robot; names are not on it.
        ahead: Direction from objects to their names, (2,) or a row each; default: away from the
            robot, or up.
        alpha: Opacity.
        size_pt: Of the names; None: without.
    """
    artists: list[Artist] = []
    ways = [None] * len(poses) if ahead is None else np.broadcast_to(ahead, (len(poses), 2))
    for number, corners in enumerate(outlines_m(problem, poses)):
        style: dict[str, Any] = {"fc": fill_of(number), "ec": edge_of(number), "alpha": alpha}
        artists.append(ax.add_patch(Polygon(corners, lw=1.2, zorder=2.2, **style)))
        if size_pt is not None:
            edge, way = free_side(corners, beside, ways[number])
            name, colour = problem.objects[number].name, edge_of(number)
            artists.append(_name(ax, name, edge, way, colour, size_pt))
    return artists


def draw_ends(ax: Axes, trajectory: Trajectory) -> None:
    """Draw objects where they are last, and faintly where they are first."""
    problem, samples = trajectory.problem, trajectory.samples
    first, last = object_poses(trajectory, samples.t_s[[0, -1]], samples.q[[0, -1]])
    if (first != last).any():
        apart = first[:, None, :2] - samples.q[:, :2]
        nearest = np.linalg.norm(apart, axis=2).argmin(axis=1)  # where its task's number may be
        away = apart[np.arange(len(first)), nearest]
        draw_objects(ax, problem, first, ahead=away, alpha=figures.FAINT)
    shape = robot_shape(problem.robot.geometry, samples.q[-1], 2)
    draw_objects(ax, problem, last, beside=shape)


def free_side(
    corners: Array, robot: RobotShape | None, ahead: Array | None = None
) -> tuple[Array, Array]:
    """Place where the name of a polygon (m, 2) may begin, and its direction from the middle.

    Arguments are those of ``draw_objects``.
    """
    middle = corners.mean(axis=0)
    if ahead is None:
        ahead = UP if robot is None else middle - robot.origin
    length = float(np.hypot(*ahead))
    way = ahead / length if length > 0 else UP
    if robot is None:
        return middle + way * ((corners - middle) @ way).max(), way
    parts = np.concatenate([robot.units.reshape(-1, 2), robot.wheels.reshape(-1, 2)]) - middle
    size = np.linalg.norm(corners - middle, axis=1).max()
    near = np.linalg.norm(parts, axis=1) < size + _HELD_M
    taken = np.concatenate([corners - middle, parts[near]])
    return middle + way * (taken @ way).max(), way


def _name(ax: Axes, name: str, at: Array, way: Array, colour: Any, size_pt: float) -> Artist:
    """Write a name from a place on in a direction."""
    side = ("center", "left", "right")[round(way[0])]
    level = ("center", "bottom", "top")[round(way[1])]
    words: dict[str, Any] = {"ha": side, "va": level, "fontsize": size_pt, "color": colour}
    words |= {"zorder": 8.5, "bbox": figures.BEHIND_WORDS}
    return label(ax, name, at, _BESIDE_PT * way, **words)


def draw_targets(ax: Axes, problem: Problem, aims: Sequence[tuple[int, Array]]) -> None:
    """Draw where objects shall be carried, as ``targets`` has it: their outlines, dashed."""
    for number, pose in aims:
        corners = outline_m(problem.objects[number], pose)
        style: dict[str, Any] = {"fill": False, "ec": edge_of(number), "ls": "--", "lw": 1.2}
        ax.add_patch(Polygon(corners, zorder=2.3, **style))


def number_places(ax: Axes, trajectory: Trajectory, each: Sequence[Stretch]) -> None:
    """Mark where the middle link is when each stage is done, by numbers; near ones share a mark."""
    if not each:
        return
    at = trajectory.configuration([stage.to_s for stage in each])[:, :2]
    marks: list[tuple[Array, str]] = []
    for number, place in enumerate(at, start=1):
        same = [i for i, (other, _) in enumerate(marks) if np.hypot(*(other - place)) < _SAME_M]
        if same:
            marks[same[0]] = (marks[same[0]][0], f"{marks[same[0]][1]}, {number}")
        else:
            marks.append((place, str(number)))
    round_box = {"boxstyle": "round,pad=0.25", "fc": "white", "ec": figures.STAGE_COLOUR, "lw": 1.0}
    for place, numbers in marks:
        words: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 8}
        label(ax, numbers, place, color=figures.STAGE_COLOUR, bbox=round_box, **words)


def legend_entries(problem: Problem) -> dict[str, Any]:
    """Legend of objects and goals on the way; empty where there are none."""
    entries = resting_entries(problem)
    if carries(problem.tasks):
        entries["carried to"] = Patch(fill=False, ec=edge_of(0), ls="--", lw=1.2)
    if any(task.ends_in is not None for task in problem.tasks):
        entries["goal to reach"] = plane.DASHED
    return entries


def resting_entries(problem: Problem) -> dict[str, Any]:
    """Legend of objects that are drawn where they rest."""
    return {"object": Patch(fc=fill_of(0), ec=edge_of(0), lw=1.2)} if problem.objects else {}
