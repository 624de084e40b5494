"""Surroundings of the robot: obstacles, the clearance to keep, and edges of the workspace."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Self

import numpy as np
from pydantic import model_validator

from twosra_mpc.arguments import check_size
from twosra_mpc.errors import MISSING, InputError
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import Metres, MetresPair, NonNegative, Positive, Several, Value

_SIDES = 16  # of the polygons that stand for a disc
_FLAT_M = 1e-6
_AROUND_M = 1e-3  # about points that a workspace is widened for
MOST_CORNERS, MOST_OBSTACLES = 20_000, 1_000  # more take minutes to plan around, and gigabytes


def check_growing(**pairs: tuple[float, float] | None) -> None:
    """Check intervals by their names; None is free.

    Raises:
        InputError: Naming those whose ends are not in order.
    """
    found = [
        InputError(name, pair, "two numbers, the lower one first")
        for name, pair in pairs.items()
        if pair is not None and not pair[0] < pair[1]
    ]
    if found:
        raise found[0].among(found[1:])


class Workspace(Value):
    """A box along the axes of the plane; an axis that is left out is free."""

    x_m: MetresPair | None = None
    y_m: MetresPair | None = None

    @model_validator(mode="after")
    def _low_below_high(self) -> Workspace:
        check_growing(x_m=self.x_m, y_m=self.y_m)
        return self

    @property
    def corners_m(self) -> Array:
        """Least and largest x and y, (2, 2); infinite where free."""
        free = (-np.inf, np.inf)
        return np.array([self.x_m or free, self.y_m or free]).T

    def holding(self, points: Array) -> Workspace:
        """The box, no smaller than these points (..., 2) need with a millimetre around them."""
        flat, (low, high) = (check_size("points", points, 2).reshape(-1, 2), self.corners_m)
        low = np.minimum(low, flat.min(axis=0) - _AROUND_M).tolist()
        high = np.maximum(high, flat.max(axis=0) + _AROUND_M).tolist()
        x_m, y_m = zip(low, high, strict=True)
        return Workspace(x_m=x_m if self.x_m else None, y_m=y_m if self.y_m else None)

    def margin_m(self, points: Array) -> Array:
        """Signed distance of points (..., 2) to the edges; negative outside, by the worse axis."""
        points, (low, high) = check_size("points", points, 2), self.corners_m
        found: Array = np.minimum(points - low, high - points).min(axis=-1)
        return found


class Box(Value):
    """A box along the axes of the plane."""

    x_m: MetresPair
    y_m: MetresPair

    @model_validator(mode="after")
    def _low_below_high(self) -> Box:
        check_growing(x_m=self.x_m, y_m=self.y_m)
        return self

    @property
    def corners_m(self) -> Array:
        """Its corners, counter-clockwise, (4, 2)."""
        (left, right), (low, high) = self.x_m, self.y_m
        return np.array([(left, low), (right, low), (right, high), (left, high)])


class Disc(Value):
    """A disc in the plane."""

    x_m: Metres
    y_m: Metres
    radius_m: Positive

    def polygon(self, sides: int = _SIDES, *, holds: bool) -> Array:
        """A regular polygon that holds it, or is within it, counter-clockwise, (sides, 2)."""
        angles = (np.arange(sides) + 0.5) * math.tau / sides
        radius_m = self.radius_m / (math.cos(math.pi / sides) if holds else 1.0)
        corners = radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.array([self.x_m, self.y_m]) + corners


class Obstacle(Value):
    """Something the robot must not touch: a polygon, a box or a disc.

    ``polygon_m`` lists corners in either direction, without the first one again; it need not be
    convex. Raises an `InputError` if it crosses itself, is flat, or has less than three corners.
    """

    name: str = ""
    polygon_m: Several[MetresPair] | None = None
    box: Box | None = None
    disc: Disc | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Obstacle:
        shapes = {"polygon_m": self.polygon_m, "box": self.box, "disc": self.disc}
        check_shape(shapes, "one of polygon_m, box, disc")
        return self

    @property
    def corners_m(self) -> Array:
        """Corners of a polygon that holds it, counter-clockwise, (m, 2); a disc's has 16."""
        return self.disc.polygon(holds=True) if self.disc is not None else self._exact

    @property
    def inner_corners_m(self) -> Array:
        """Corners of a polygon within it, counter-clockwise, (m, 2)."""
        return self.disc.polygon(holds=False) if self.disc is not None else self._exact

    @property
    def _exact(self) -> Array:
        if self.box is not None:
            return self.box.corners_m
        corners = np.array(self.polygon_m)
        return corners if area_m2(corners) > 0 else corners[::-1]


Obstacles = Several[Obstacle]


class World(Value):
    """Surroundings of the robot. ``Problem(**dict(world), ...)`` plans in it.

    ``clearance_m`` is kept to all obstacles, by the whole sweep of a plan. A curvature known to
    within ``curvature_uncertainty_per_m`` widens the robot by what it moves its far end.
    """

    workspace: Workspace | None = None
    obstacles: Obstacles = ()
    clearance_m: NonNegative = 0.002
    curvature_uncertainty_per_m: NonNegative = 0.0

    @model_validator(mode="after")
    def _few_with_names_of_their_own(self) -> Self:
        if len(self.obstacles) > MOST_OBSTACLES:
            allowed = (
                f"at most {MOST_OBSTACLES:,} obstacles: join those that touch, for example by"
                " shapely's union_all, or leave out what is out of reach"
            )
            raise InputError("obstacles", len(self.obstacles), allowed)
        found = list(names_twice([item.name for item in self.obstacles]))
        if found:
            raise found[0].among(found[1:])
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each obstacle; of one without, its number from 1."""
        return tuple(item.name or f"obstacle {i}" for i, item in enumerate(self.obstacles, start=1))

    def within(self, low: Array, high: Array) -> Iterator[tuple[str, Array, tuple[float, float]]]:
        """Yield of each obstacle that is in a box (2,) its name, and corners and middle there."""
        import shapely

        polygons = [shapely.Polygon(obstacle.inner_corners_m) for obstacle in self.obstacles]
        parts = shapely.clip_by_rect(polygons, *low, *high)
        for name, part in zip(self.names, parts, strict=True):
            if not part.is_empty:
                yield name, shapely.get_coordinates(part), (part.centroid.x, part.centroid.y)


def names_twice(obstacles: Sequence[str], objects: Sequence[str] = ()) -> Iterator[InputError]:
    """Yield every name of an obstacle or object that one before it has."""
    names, split = [*obstacles, *objects], len(obstacles)
    for i, name in enumerate(names):
        if name and name in names[:i]:
            field = f"obstacles.{i}.name" if i < split else f"objects.{i - split}.name"
            yield InputError(field, name, "a name that nothing else has")


def check_shape(shapes: Mapping[str, object], allowed: str) -> None:
    """Check that one of several shapes is given; corners of a polygon, too.

    Raises:
        InputError: If none is, or several are, or the polygon is not proper.
    """
    given = [name for name, shape in shapes.items() if shape is not None]
    if len(given) != 1:
        raise InputError("", given or MISSING, allowed)
    if (corners := shapes["polygon_m"]) is not None:
        check_polygon(np.array(corners).reshape(-1, 2))


def check_polygon(corners: Array) -> None:
    """Check the corners of a polygon, (m, 2).

    Raises:
        InputError: If it crosses itself, is flat, or has less than three corners, or too many.
    """
    if len(corners) > MOST_CORNERS:
        allowed = (
            f"at most {MOST_CORNERS:,} corners: simplify the outline, for example by shapely's"
            " simplify(0.001), which moves it by no more than a millimetre"
        )
        raise InputError("polygon_m", f"{len(corners)} corners", allowed)
    if len(corners) < 3:
        raise InputError("polygon_m", f"{len(corners)} corners", "at least three corners")
    if np.linalg.matrix_rank(corners - corners[0], tol=_FLAT_M) < 2:
        raise InputError("polygon_m", corners.tolist(), "corners that do not lie on one line")
    again = np.flatnonzero((corners == np.roll(corners, 1, axis=0)).all(axis=1))
    if len(again):
        at, before = int(again[0]), (int(again[0]) - 1) % len(corners)
        twice, first = (before, at) if at == 0 else (at, before)
        allowed = f"each corner once; corner {twice + 1} is corner {first + 1} again"
        raise InputError("polygon_m", tuple(corners[twice].tolist()), allowed)
    import shapely  # boxes and discs need none

    if not shapely.is_valid(polygon := shapely.Polygon(corners)):
        found = shapely.is_valid_reason(polygon)
        raise InputError("polygon_m", found, "a polygon that does not cross or touch itself")


def area_m2(corners: Array) -> float:
    """Area, positive where the corners go counter-clockwise."""
    x, y = corners.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
