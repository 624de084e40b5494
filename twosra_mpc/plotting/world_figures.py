"""Surroundings, drawn: obstacles, workspace, boxes to drive through, objects, places of tasks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Patch, Polygon, Rectangle

from twosra_mpc.checking.sweep import Clearance
from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.trajectory import Stretch, Trajectory
from twosra_mpc.plotting import figures, plane
from twosra_mpc.plotting.figures import label
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Follow, carries
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array

_FAR_M = 100.0  # edges of what is free: out of every picture
_NEAR, _LEAST_NEAR_M = 0.2, 0.05  # around a motion, in its size: obstacles there are shown
OBSTACLE: dict[str, Any] = {"fc": figures.OBSTACLE_COLOUR, "ec": figures.OBSTACLE_EDGE_COLOUR}
OBSTACLE |= {"hatch": "///", "lw": 0.8}
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
    for path in followed(problem):
        points = path.line.at(np.linspace(0.0, path.line.length_m[-1], _FINE))
        ahead = np.gradient(points, axis=0)
        far = np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]  # none where it turns back
        aside = ahead[:, ::-1] * [-1, 1] / far * path.position_tolerance_m
        ax.add_artist(Polygon([*points + aside, *(points - aside)[::-1]], **TASK))
    for number, task in enumerate(problem.passes, start=1):
        low, high = np.clip(task.ends[:, :2], -_FAR_M, _FAR_M)
        ax.add_artist(Rectangle(tuple(low), *(high - low), **TASK, zorder=1.5))
        x, y = np.clip((low[0], high[1]), *seen).tolist()
        words |= {"va": "bottom" if y == high[1] else "top", "color": figures.TASK_COLOUR}
        label(ax, task.name or f"task {number}", (x, y), **words)


def followed(problem: Problem) -> list[Follow]:
    """Tasks that follow a path."""
    return [stage.follows for stage in problem.stages if stage.follows is not None]


def show_world(
    axes: Sequence[Axes], problem: Problem, points: Array, small_pt: float = 8.0
) -> None:
    """Draw what is around points (..., 2) on axes, to one scale; words are small on all but one."""
    shown = shown_m(problem, points)
    for ax, size_pt in zip(axes, (8.0, *[small_pt] * len(axes)), strict=False):
        draw_world(ax, problem, shown, size_pt)
    plane.to_one_scale(axes, shown)


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


UP = np.array([0.0, 1.0])
_ROUND = 64  # corners of a disc
_FINE = 400  # points of a path
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
            words = {"fontsize": size_pt, "color": edge_of(number)}
            artists.append(_name(ax, problem.objects[number].name, edge, way, words))
    return artists


def draw_ends(ax: Axes, problem: Problem, ends: Array, q: Array) -> None:
    """Draw objects where they are last, and faintly where they are first: ends, (2, objects, 3)."""
    first, last = ends
    if (first != last).any():
        apart = first[:, None, :2] - q[:, :2]
        nearest = np.linalg.norm(apart, axis=2).argmin(axis=1)  # where its task's number may be
        away = apart[np.arange(len(first)), nearest]
        draw_objects(ax, problem, first, ahead=away, alpha=figures.FAINT)
    draw_objects(ax, problem, last, beside=robot_shape(problem.robot.geometry, q[-1], 2))


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


def _name(ax: Axes, name: str, at: Array, way: Array, words: dict[str, Any]) -> Artist:
    """Write a name from a place on in a direction."""
    side = ("center", "left", "right")[round(way[0])]
    level = ("center", "bottom", "top")[round(way[1])]
    words |= {"ha": side, "va": level, "zorder": 8.5, "bbox": figures.BEHIND_WORDS}
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


def legend_entries(
    problem: Problem, nearest: Clearance | None = None, *, aims: bool = True
) -> dict[str, Any]:
    """Legend of what is drawn, with ``aims`` also of what shall be; empty where nothing is."""
    entries: dict[str, Any] = {}
    if problem.objects:
        entries["object"] = Patch(fc=fill_of(0), ec=edge_of(0), lw=1.2)
    if aims and carries(problem.tasks):
        entries["carried to"] = Patch(fill=False, ec=edge_of(0), ls="--", lw=1.2)
    if aims and any(task.ends_in is not None for task in problem.tasks):
        entries["goal to reach"] = plane.DASHED
    if problem.obstacles:
        entries["obstacle"] = Patch(**OBSTACLE)
    if problem.passes:
        entries["box to drive through"] = Patch(**TASK)
    if followed(problem):
        entries["path to follow"] = Patch(**TASK)
    if nearest is not None:
        at = f"{length(nearest)}, {figures.short(nearest.name)} at {nearest.at_s:z.1f} s"
        entries[f"nearest: {at}"] = plane.line(figures.NEAREST_COLOUR, 1.6)
    return entries
