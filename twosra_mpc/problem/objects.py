"""Things that can be held, carried and put down: outlines in frames of their own, and poses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pydantic import field_validator, model_validator

from twosra_mpc.arguments import check_size, public
from twosra_mpc.errors import InputError
from twosra_mpc.files import read_text
from twosra_mpc.problem.goals import read_only
from twosra_mpc.problem.world import Box, Disc, Obstacle, check_shape
from twosra_mpc.robot.coordinates import POSE, Array, rotation
from twosra_mpc.validation import Metres, MetresPair, NonNegative, Positive, Radians, Several, Value

ACCURACY = (0.005, 0.005, math.radians(3.0))  # m, m, rad: an object this near is where it should be


class Pose(Value):
    """A pose in the plane."""

    x_m: Metres
    y_m: Metres
    phi_rad: Radians = 0.0

    @property
    def pose(self) -> Array:
        """(x, y, phi), (3,), read-only."""
        return read_only([self.x_m, self.y_m, self.phi_rad])


class Round(Value):
    """A disc about the origin of an object's frame."""

    radius_m: Positive


class Object(Value):
    """A thing that the robot may touch, hold and carry; to all other tasks it is an obstacle.

    One of ``disc``, ``box``, ``polygon_m`` and ``outline`` gives its shape, in its own frame;
    ``outline`` is a CSV file of points x, y [m] of a closed curve, read when the problem is.
    ``pose`` is where it is at t = 0. ``friction`` is its coefficient against the robot; only what
    is pushed needs one.

    Raises:
        InputError: If it has no or several shapes, or its polygon crosses itself or is flat.
    """

    name: str
    pose: Pose
    disc: Round | None = None
    box: Box | None = None
    polygon_m: Several[MetresPair] | None = None
    friction: NonNegative | None = None

    @model_validator(mode="before")
    @classmethod
    def _read_outline(cls, data: object) -> object:
        if not isinstance(data, dict) or "outline" not in data:
            return data
        if "polygon_m" in data:
            raise InputError("outline", str(data["outline"]), "either an outline or polygon_m")
        rest = {key: value for key, value in data.items() if key != "outline"}
        return {**rest, "polygon_m": read_outline(data["outline"])}

    @field_validator("name")
    @classmethod
    def _said(cls, name: str) -> str:
        if not name:
            raise ValueError("a name: tasks call it by that")
        return name

    @model_validator(mode="after")
    def _one_shape(self) -> Object:
        shapes = {"disc": self.disc, "box": self.box, "polygon_m": self.polygon_m}
        check_shape(shapes, "one of disc, box, polygon_m, outline")
        return self

    def at(self, pose: Array) -> Obstacle:
        """The obstacle that it is at a pose (3,)."""
        x, y, phi = check_size("pose", pose, POSE).tolist()
        if self.disc is not None:
            return Obstacle(name=self.name, disc=Disc(x_m=x, y_m=y, radius_m=self.disc.radius_m))
        corners = self.box.corners_m if self.box is not None else np.array(self.polygon_m)
        placed = corners @ rotation(phi) + [x, y]
        return Obstacle(name=self.name, polygon_m=tuple(map(tuple, placed.tolist())))

    @property
    def own(self) -> Obstacle:
        """The obstacle that it is in its own frame."""
        return self.at(np.zeros(POSE))


@public
def read_outline(path: str | Path) -> tuple[tuple[float, float], ...]:
    """Corners of a closed curve from a CSV file of x, y [m]; a head line and the first point again.

    Both may be left out.

    Raises:
        InputError: If the file cannot be read, or a line is not two numbers.
    """
    source = str(path)
    found: list[tuple[float, float]] = []
    for number, line in enumerate(read_text(Path(source), source).splitlines(), start=1):
        if not line.strip():
            continue
        try:
            x, y = (float(part) for part in line.split(","))
        except ValueError:
            if not found and number == 1:
                continue  # a head line
            allowed = "two numbers, x and y in m, separated by a comma"
            raise InputError(f"line {number}", line, allowed, source) from None
        if not math.isfinite(x + y):
            raise InputError(f"line {number}", line, "finite numbers", source)
        found.append((x, y))
    return tuple(found[:-1] if len(found) > 1 and found[0] == found[-1] else found)
