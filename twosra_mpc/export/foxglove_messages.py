"""The robot as Foxglove's own messages: a scene to scale, and the frames of its parts.

Frames: ``world``; ``b0`` in the middle link, x from locomotion unit 1 to unit 2; ``b1`` and ``b2``
at the ends of the fibre, x along it in the same direction. z is up, the floor is at zero.
Needs the package foxglove-sdk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from foxglove import messages
from numpy.typing import ArrayLike

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.trajectory import State
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.geometry import Geometry

# As in the figures.
STIFFNESS_COLOURS: dict[State, str] = {
    "rigid": "#2a6fbb",
    "soft": "#c8202f",
    "melting": "#f6b04e",
    "freezing": "#86c5da",
}
UNIT_COLOUR, METAL_COLOUR = "#eceff1", "#455a64"

OBSTACLE_COLOUR, TASK_COLOUR = "#737373", "#12997c"
OBJECT_COLOURS = ("#d8b384", "#c3a5dd", "#8ccfd6", "#e9a9c0")

OBSTACLE_HEIGHT_M = 0.1  # for the picture: the plane is all there is
UNIT_HEIGHT_M = 0.078  # of the authors' locomotion units
FIBRE_HEIGHT_M = 0.03  # for the picture: not published
SEGMENT_THICKNESS_M, LINK_THICKNESS_M = 0.008, 0.005
ARC_POINTS, TEXT_M = 24, 0.03
_FAR_M = 10.0  # edges of boxes that are free


def scene(
    geometry: Geometry, time_s: float, q: ArrayLike, states: Sequence[State]
) -> messages.SceneUpdate:
    """The robot at ``q`` [m, m, rad, 1/m ...], (3 + n,), its segments in these states."""
    shape = robot_shape(geometry, q, ARC_POINTS)
    height_m = 2 * geometry.wheel_radius_m
    cubes = [_cube(unit, UNIT_HEIGHT_M, UNIT_COLOUR) for unit in shape.units]
    cubes += [_cube(wheel, height_m, METAL_COLOUR) for wheel in shape.wheels]
    lines = [_line(link, LINK_THICKNESS_M, METAL_COLOUR) for link in shape.links]
    lines += [
        _line(segment, SEGMENT_THICKNESS_M, STIFFNESS_COLOURS[state])
        for segment, state in zip(shape.segments, states, strict=True)
    ]
    robot = _entity("robot", time_s, cubes=cubes, lines=lines)
    return messages.SceneUpdate(entities=[robot])


def objects(problem: Problem, time_s: float, poses: Array) -> messages.SceneUpdate:
    """Every object at a pose, (objects, 3): its walls, named, in a colour of its own."""
    entities = []
    for number, (item, pose) in enumerate(zip(problem.objects, poses, strict=True)):
        colour = OBJECT_COLOURS[number % len(OBJECT_COLOURS)]
        corners = item.at(pose).inner_corners_m
        parts: dict[str, Any] = {
            "lines": [_loop(corners, OBSTACLE_HEIGHT_M, colour)],
            "triangles": [_sides(corners, colour)],
            "texts": [_text(item.name, corners, colour)],
        }
        entities.append(_entity(f"object {item.name}", time_s, **parts))
    return messages.SceneUpdate(entities=entities)


def surroundings(problem: Problem) -> messages.SceneUpdate:
    """Obstacles as walls along their edges, boxes to drive through on the floor, all named."""
    named = zip(problem.world.names, problem.obstacles, strict=True)
    entities = [
        _entity(
            name,
            0.0,
            lines=[_loop(obstacle.inner_corners_m, OBSTACLE_HEIGHT_M, OBSTACLE_COLOUR)],
            triangles=[_sides(obstacle.inner_corners_m, OBSTACLE_COLOUR)],
            texts=[_text(name, obstacle.inner_corners_m, OBSTACLE_COLOUR)],
        )
        for name, obstacle in named
    ]
    for number, task in enumerate(problem.passes, start=1):
        name = task.name or f"task {number}"
        (left, low), (right, high) = np.clip(task.ends[:, :2], -_FAR_M, _FAR_M)
        box = np.array([(left, low), (right, low), (right, high), (left, high)])
        lines, texts = [_loop(box, 0.0, TASK_COLOUR)], [_text(name, box, TASK_COLOUR)]
        entities.append(_entity(f"{task.do} {name}", 0.0, lines=lines, texts=texts))
    return messages.SceneUpdate(entities=entities)


def _entity(name: str, time_s: float, **parts: Any) -> messages.SceneEntity:
    return messages.SceneEntity(
        timestamp=_clock(time_s),
        frame_id="world",
        id=name,
        lifetime=messages.Duration(0),  # until replaced
        **parts,
    )


def _sides(corners: Array, colour: str) -> messages.TriangleListPrimitive:
    """Walls on the edges of a polygon (m, 2)."""
    points = [
        messages.Point3(x=x, y=y, z=z)
        for z in (0.0, OBSTACLE_HEIGHT_M)
        for x, y in corners.tolist()
    ]
    count = len(corners)
    edges = [(i, (i + 1) % count) for i in range(count)]
    halves = [(i, j, j + count, i, j + count, i + count) for i, j in edges]
    indices = [index for half in halves for index in half]
    return messages.TriangleListPrimitive(
        pose=_pose(0.0, 0.0, 0.0, 0.0), points=points, indices=indices, color=_rgba(colour)
    )


def _loop(corners: Array, z: float, colour: str) -> messages.LinePrimitive:
    return messages.LinePrimitive(
        type=messages.LinePrimitiveLineType.LineLoop,
        pose=_pose(0.0, 0.0, z, 0.0),
        thickness=LINK_THICKNESS_M,
        points=[messages.Point3(x=x, y=y, z=0.0) for x, y in corners.tolist()],
        color=_rgba(colour),
    )


def _text(words: str, corners: Array, colour: str) -> messages.TextPrimitive:
    x, y = corners.mean(axis=0).tolist()
    return messages.TextPrimitive(
        pose=_pose(x, y, OBSTACLE_HEIGHT_M, 0.0),
        billboard=True,
        font_size=TEXT_M,
        color=_rgba(colour),
        text=words,
    )


def frames(geometry: Geometry, time_s: float, q: ArrayLike) -> messages.FrameTransforms:
    """The middle link in the world, and the fibre ends in it, at ``q``."""
    x, y, phi, *kappa = np.array(q, dtype=float).tolist()
    first, second = robot_shape(geometry, [0.0, 0.0, 0.0, *kappa], 2).ends.tolist()
    placed = [("world", "b0", (x, y, phi)), ("b0", "b1", first), ("b0", "b2", second)]
    return messages.FrameTransforms(
        transforms=[
            messages.FrameTransform(
                timestamp=_clock(time_s),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=messages.Vector3(x=x, y=y, z=0.0),
                rotation=_turned(heading),
            )
            for parent, child, (x, y, heading) in placed
        ]
    )


def nanoseconds(time_s: float) -> int:
    """Time in whole nanoseconds."""
    return round(time_s * 1e9)


def _cube(corners: Array, height_m: float, colour: str) -> messages.CubePrimitive:
    """Block on the floor over a rectangle, (4, 2)."""
    along, across = corners[1] - corners[0], corners[3] - corners[0]
    x, y = corners.mean(axis=0).tolist()
    return messages.CubePrimitive(
        pose=_pose(x, y, height_m / 2, math.atan2(along[1], along[0])),
        size=messages.Vector3(x=math.hypot(*along), y=math.hypot(*across), z=height_m),
        color=_rgba(colour),
    )


def _line(points: Array, thickness_m: float, colour: str) -> messages.LinePrimitive:
    return messages.LinePrimitive(
        pose=_pose(0.0, 0.0, FIBRE_HEIGHT_M, 0.0),
        thickness=thickness_m,
        points=[messages.Point3(x=x, y=y, z=0.0) for x, y in points.tolist()],
        color=_rgba(colour),
    )


def _pose(x: float, y: float, z: float, heading: float) -> messages.Pose:
    return messages.Pose(position=messages.Vector3(x=x, y=y, z=z), orientation=_turned(heading))


def _turned(heading: float) -> messages.Quaternion:
    """A turn about z [rad]."""
    return messages.Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))


def _rgba(colour: str) -> messages.Color:
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return messages.Color(r=red, g=green, b=blue, a=1.0)


def _clock(time_s: float) -> messages.Timestamp:
    return messages.Timestamp(*divmod(nanoseconds(time_s), 1_000_000_000))
