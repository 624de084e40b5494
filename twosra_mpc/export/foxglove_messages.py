"""The robot as Foxglove messages: a scene to scale, and the frames of its parts.

Frames: ``world``; ``b0`` in the middle link, x from locomotion unit 1 to unit 2; ``b1`` and ``b2``
at the ends of the fibre, x along it in the same direction. z is up, the floor is at zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.model.outline import RobotShape, robot_shape
from twosra_mpc.robot.geometry import Geometry

Array = NDArray[np.float64]
Message = dict[str, Any]

# As in the figures.
STIFFNESS_COLOURS = {"rigid": "#2a6fbb", "soft": "#c8202f", "changing": "#f6b04e"}
UNIT_COLOUR, METAL_COLOUR = "#eceff1", "#455a64"

UNIT_HEIGHT_M = 0.078  # of the authors' locomotion units
FIBRE_HEIGHT_M = 0.03  # for the picture: not published
SEGMENT_THICKNESS_M, LINK_THICKNESS_M = 0.008, 0.005
ARC_POINTS = 24

_STRIP = 0  # foxglove.LineType


def scene(geometry: Geometry, time_s: float, q: ArrayLike, stiffness: Sequence[str]) -> Message:
    """``foxglove.SceneUpdate`` of the robot.

    Args:
        geometry: Lengths of the robot.
        time_s: Time of the plan.
        q: Configuration [m, m, rad, 1/m, 1/m], (5,).
        stiffness: "rigid", "soft" or "changing" for each segment.
    """
    shape = robot_shape(geometry, q, ARC_POINTS)
    height_m = 2 * geometry.wheel_radius_m
    cubes = [_cube(unit, UNIT_HEIGHT_M, UNIT_COLOUR) for unit in shape.units]
    cubes += [_cube(wheel, height_m, METAL_COLOUR) for wheel in shape.wheels]
    lines = [_line(link, LINK_THICKNESS_M, METAL_COLOUR) for link in shape.links]
    lines += [
        _line(arc, SEGMENT_THICKNESS_M, STIFFNESS_COLOURS[state])
        for arc, state in zip(shape.segments, stiffness, strict=True)
    ]
    entity = {
        "timestamp": _clock(time_s),
        "frame_id": "world",
        "id": "robot",
        "lifetime": _clock(0.0),
        "frame_locked": False,
        "cubes": cubes,
        "lines": lines,
    }
    return {"entities": [entity]}


def frames(geometry: Geometry, time_s: float, q: ArrayLike) -> Message:
    """``foxglove.FrameTransforms`` of middle link and fibre ends; arguments as for ``scene``."""
    x, y, phi, *kappa = np.asarray(q, dtype=float).tolist()
    straight = robot_shape(geometry, [0.0, 0.0, 0.0, *kappa], 2)
    transforms = [_transform(time_s, "world", "b0", (x, y), phi)]
    headings = _end_headings(straight).tolist()
    for name, arc, heading in zip(("b1", "b2"), straight.segments, headings, strict=True):
        transforms.append(_transform(time_s, "b0", name, arc[-1].tolist(), heading))
    return {"transforms": transforms}


def _end_headings(shape: RobotShape) -> Array:
    """Heading of the fibre at its two ends [rad], (2,), in the direction from unit 1 to unit 2."""
    along = shape.links[1:, 1] - shape.links[1:, 0]
    along[0] *= -1
    headings: Array = np.arctan2(along[:, 1], along[:, 0])
    return headings


def _transform(
    time_s: float, parent: str, child: str, at: Sequence[float], heading: float
) -> Message:
    return {
        "timestamp": _clock(time_s),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": _vector(at[0], at[1], 0.0),
        "rotation": _turned(heading),
    }


def _cube(corners: Array, height_m: float, colour: str) -> Message:
    """Block on the floor over a rectangle, (4, 2)."""
    along, across = corners[1] - corners[0], corners[3] - corners[0]
    x, y = corners.mean(axis=0).tolist()
    return {
        "pose": {
            "position": _vector(x, y, height_m / 2),
            "orientation": _turned(math.atan2(along[1], along[0])),
        },
        "size": _vector(math.hypot(*along), math.hypot(*across), height_m),
        "color": _rgba(colour),
    }


def _line(points: Array, thickness_m: float, colour: str) -> Message:
    return {
        "type": _STRIP,
        "pose": {"position": _vector(0.0, 0.0, FIBRE_HEIGHT_M), "orientation": _turned(0.0)},
        "thickness": thickness_m,
        "scale_invariant": False,
        "points": [_vector(x, y, 0.0) for x, y in points.tolist()],
        "color": _rgba(colour),
    }


def _vector(x: float, y: float, z: float) -> Message:
    return {"x": x, "y": y, "z": z}


def _turned(heading: float) -> Message:
    """Quaternion of a turn about z [rad]."""
    return {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}


def _rgba(colour: str) -> Message:
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return {"r": red, "g": green, "b": blue, "a": 1.0}


def _clock(time_s: float) -> Message:
    sec, nsec = divmod(nanoseconds(time_s), 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def nanoseconds(time_s: float) -> int:
    """Time in whole nanoseconds."""
    return round(time_s * 1e9)
