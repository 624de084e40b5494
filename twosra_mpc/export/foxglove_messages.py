"""The robot as Foxglove's own messages: a scene to scale, and the frames of its parts.

Frames: ``world``; ``b0`` in the middle link, x from locomotion unit 1 to unit 2; ``b1`` and ``b2``
at the ends of the fibre, x along it in the same direction. z is up, the floor is at zero.
Needs the package foxglove-sdk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    Duration,
    FrameTransform,
    FrameTransforms,
    LinePrimitive,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    Timestamp,
    Vector3,
)
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.model.outline import robot_shape
from twosra_mpc.plans.stiffness import State
from twosra_mpc.robot.geometry import Geometry

Array = NDArray[np.float64]

# As in the figures.
STIFFNESS_COLOURS: dict[State, str] = {
    "rigid": "#2a6fbb",
    "soft": "#c8202f",
    "melting": "#f6b04e",
    "freezing": "#f6b04e",
}
UNIT_COLOUR, METAL_COLOUR = "#eceff1", "#455a64"

UNIT_HEIGHT_M = 0.078  # of the authors' locomotion units
FIBRE_HEIGHT_M = 0.03  # for the picture: not published
SEGMENT_THICKNESS_M, LINK_THICKNESS_M = 0.008, 0.005
ARC_POINTS = 24


def scene(geometry: Geometry, time_s: float, q: ArrayLike, states: Sequence[State]) -> SceneUpdate:
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
    robot = SceneEntity(
        timestamp=_clock(time_s),
        frame_id="world",
        id="robot",
        lifetime=Duration(0),  # until replaced
        cubes=cubes,
        lines=lines,
    )
    return SceneUpdate(entities=[robot])


def frames(geometry: Geometry, time_s: float, q: ArrayLike) -> FrameTransforms:
    """The middle link in the world, and the fibre ends in it, at ``q``."""
    pose, at_rest = np.array(q, dtype=float), np.array(q, dtype=float)
    at_rest[:3] = 0.0
    placed = [("world", "b0", pose[:3])]
    placed += [
        ("b0", name, end)
        for name, end in zip(("b1", "b2"), robot_shape(geometry, at_rest, 2).ends, strict=True)
    ]
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=_clock(time_s),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=Vector3(x=x, y=y, z=0.0),
                rotation=_turned(heading),
            )
            for parent, child, (x, y, heading) in placed
        ]
    )


def nanoseconds(time_s: float) -> int:
    """Time in whole nanoseconds."""
    return round(time_s * 1e9)


def _cube(corners: Array, height_m: float, colour: str) -> CubePrimitive:
    """Block on the floor over a rectangle, (4, 2)."""
    along, across = corners[1] - corners[0], corners[3] - corners[0]
    x, y = corners.mean(axis=0).tolist()
    return CubePrimitive(
        pose=_pose(x, y, height_m / 2, math.atan2(along[1], along[0])),
        size=Vector3(x=math.hypot(*along), y=math.hypot(*across), z=height_m),
        color=_rgba(colour),
    )


def _line(points: Array, thickness_m: float, colour: str) -> LinePrimitive:
    return LinePrimitive(
        pose=_pose(0.0, 0.0, FIBRE_HEIGHT_M, 0.0),
        thickness=thickness_m,
        points=[Point3(x=x, y=y, z=0.0) for x, y in points.tolist()],
        color=_rgba(colour),
    )


def _pose(x: float, y: float, z: float, heading: float) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=_turned(heading))


def _turned(heading: float) -> Quaternion:
    """A turn about z [rad]."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))


def _rgba(colour: str) -> Color:
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return Color(r=red, g=green, b=blue, a=1.0)


def _clock(time_s: float) -> Timestamp:
    return Timestamp(*divmod(nanoseconds(time_s), 1_000_000_000))
