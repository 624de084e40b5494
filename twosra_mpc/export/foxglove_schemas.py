"""JSON schemas of the Foxglove messages used here, with the official names of their fields.

Foxglove and rerun recognise a message by the name of its schema, the ``title`` here. Fields that
are not used are left out; readers take them as empty.
"""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]


def record(title: str, description: str, **fields: Schema) -> Schema:
    """Schema of an object in which every field is given, and no other."""
    return {
        "title": title,
        "description": description,
        "type": "object",
        "properties": fields,
        "required": list(fields),
        "additionalProperties": False,
    }


def number(description: str) -> Schema:
    """Schema of a number."""
    return {"type": "number", "description": description}


def _text(description: str) -> Schema:
    return {"type": "string", "description": description}


def _many(item: Schema, description: str) -> Schema:
    return {"type": "array", "items": item, "description": description}


def _seconds(title: str, description: str) -> Schema:
    nanoseconds = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
    return record(title, description, sec={"type": "integer", "minimum": 0}, nsec=nanoseconds)


_TIME = _seconds("time", "Time of the plan")
_DURATION = _seconds("duration", "Zero: until replaced")
_VECTOR3 = record("foxglove.Vector3", "m", x=number("x"), y=number("y"), z=number("z"))
_POINT3 = record("foxglove.Point3", "m", x=number("x"), y=number("y"), z=number("z"))
_QUATERNION = record(
    *("foxglove.Quaternion", "Orientation"),
    x=number("x"),
    y=number("y"),
    z=number("z"),
    w=number("w"),
)
_COLOR = record(
    *("foxglove.Color", "Each from 0 to 1"),
    r=number("red"),
    g=number("green"),
    b=number("blue"),
    a=number("opacity"),
)
_POSE = record("foxglove.Pose", "Of a body", position=_VECTOR3, orientation=_QUATERNION)
_LINE_TYPE: Schema = {
    "title": "foxglove.LineType",
    "oneOf": [{"title": "LINE_STRIP", "const": 0}],
}
_CUBE = record(
    *("foxglove.CubePrimitive", "A locomotion unit, or a wheel"),
    pose=_POSE,
    size=_VECTOR3,
    color=_COLOR,
)
_LINE = record(
    *("foxglove.LinePrimitive", "A segment of the fibre, or a link"),
    type=_LINE_TYPE,
    pose=_POSE,
    thickness=number("m"),
    scale_invariant={"type": "boolean", "description": "Whether thickness is in pixels"},
    points=_many(_POINT3, "Along the line"),
    color=_COLOR,
)
_ENTITY = record(
    *("foxglove.SceneEntity", "The robot"),
    timestamp=_TIME,
    frame_id=_text("Frame of reference"),
    id=_text("Replaces the entity of the same id"),
    lifetime=_DURATION,
    frame_locked={"type": "boolean", "description": "Whether it follows its frame"},
    cubes=_many(_CUBE, "Locomotion units and wheels"),
    lines=_many(_LINE, "Segments and links"),
)
_TRANSFORM = record(
    *("foxglove.FrameTransform", "Where a frame is in its parent"),
    timestamp=_TIME,
    parent_frame_id=_text("Parent"),
    child_frame_id=_text("Child"),
    translation=_VECTOR3,
    rotation=_QUATERNION,
)

SCENE_UPDATE = record(
    *("foxglove.SceneUpdate", "The robot to scale"),
    entities=_many(_ENTITY, "The robot"),
)
FRAME_TRANSFORMS = record(
    *("foxglove.FrameTransforms", "Middle link and fibre ends"),
    transforms=_many(_TRANSFORM, "One a frame"),
)
