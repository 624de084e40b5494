"""What is around the robot: obstacles, and how far to keep from them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from twosra_mpc.errors import MISSING, InputError
from twosra_mpc.problem.workspace import Workspace
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import (
    Metres,
    MetresPair,
    NonNegative,
    Positive,
    Several,
    Value,
)

_SIDES = 16  # of the polygons that stand for a disc
_FLAT_M = 1e-6
MOST_CORNERS, MOST_OBSTACLES = 20_000, 1_000  # more take minutes to plan around, and gigabytes
_AT_ONCE = 200_000  # pairs of sides, to spare memory


class Box(Value):
    """A box along the axes of the plane."""

    x_m: MetresPair
    y_m: MetresPair

    @model_validator(mode="after")
    def _low_below_high(self) -> Box:
        for name, pair in (("x_m", self.x_m), ("y_m", self.y_m)):
            if not pair[0] < pair[1]:
                raise InputError(name, pair, "two numbers, the lower one first")
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

    def polygon(self, scale: float) -> Array:
        """A regular polygon whose corners are at ``scale`` times the radius, (16, 2)."""
        angles = (np.arange(_SIDES) + 0.5) * math.tau / _SIDES
        corners = self.radius_m * scale * np.column_stack([np.cos(angles), np.sin(angles)])
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
        given = [name for name in ("polygon_m", "box", "disc") if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError("", given or MISSING, "one of polygon_m, box, disc")
        if self.polygon_m is not None:
            check_polygon(np.array(self.polygon_m).reshape(-1, 2))
        return self

    @property
    def corners_m(self) -> Array:
        """Corners of a polygon that holds it, counter-clockwise, (m, 2); a disc's has 16."""
        if self.disc is not None:
            return self.disc.polygon(1 / math.cos(math.pi / _SIDES))
        return self._exact

    @property
    def inner_corners_m(self) -> Array:
        """Corners of a polygon within it, counter-clockwise, (m, 2)."""
        return self.disc.polygon(1.0) if self.disc is not None else self._exact

    @property
    def _exact(self) -> Array:
        if self.box is not None:
            return self.box.corners_m
        corners = np.array(self.polygon_m)
        return corners if area_m2(corners) > 0 else corners[::-1]


Obstacles = Several[Obstacle]


class World(Value):
    """What is around the robot. ``Problem(**dict(world), ...)`` plans in it.

    ``clearance_m`` is kept to all obstacles, by the whole sweep of a plan. A curvature known to
    within ``curvature_uncertainty_per_m`` widens the robot by what it moves its far end.
    """

    workspace: Workspace | None = None
    obstacles: Obstacles = ()
    clearance_m: NonNegative = 0.002
    curvature_uncertainty_per_m: NonNegative = 0.0

    @model_validator(mode="after")
    def _not_too_many(self) -> Self:
        if len(self.obstacles) > MOST_OBSTACLES:
            allowed = (
                f"at most {MOST_OBSTACLES:,} obstacles: join those that touch, for example by"
                " shapely's union_all, or leave out what is out of reach"
            )
            raise InputError("obstacles", len(self.obstacles), allowed)
        return self

    @model_validator(mode="after")
    def _each_name_once(self) -> Self:
        found = list(names_twice([item.name for item in self.obstacles]))
        if found:
            raise found[0].among(found[1:])
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each obstacle; of one without, its number from 1."""
        return tuple(item.name or f"obstacle {i}" for i, item in enumerate(self.obstacles, start=1))


def names_twice(obstacles: Sequence[str], objects: Sequence[str] = ()) -> Iterator[InputError]:
    """Yield every name of an obstacle or object that one before it has."""
    names, split = [*obstacles, *objects], len(obstacles)
    for i, name in enumerate(names):
        if name and name in names[:i]:
            field = f"obstacles.{i}.name" if i < split else f"objects.{i - split}.name"
            yield InputError(field, name, "a name that nothing else has")


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
        raise InputError("polygon_m", len(corners), allowed)
    if len(corners) < 3:
        raise InputError("polygon_m", len(corners), "at least three corners")
    if np.linalg.matrix_rank(corners - corners[0], tol=_FLAT_M) < 2:
        raise InputError("polygon_m", corners.tolist(), "corners that do not lie on one line")
    again = np.flatnonzero((corners == np.roll(corners, 1, axis=0)).all(axis=1))
    if len(again):
        at, before = int(again[0]), (int(again[0]) - 1) % len(corners)
        twice, first = (before, at) if at == 0 else (at, before)
        allowed = f"each corner once; corner {twice + 1} is corner {first + 1} again"
        raise InputError("polygon_m", tuple(corners[twice].tolist()), allowed)
    if (pair := _crossing(corners)) is not None:
        i, j = pair
        given = [tuple(corners[k].tolist()) for k in pair]
        allowed = f"a polygon that does not cross itself; its sides {i + 1} and {j + 1} do"
        raise InputError("polygon_m", given, allowed)


def area_m2(corners: Array) -> float:
    """Area, positive where the corners go counter-clockwise."""
    x, y = corners.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _crossing(corners: Array) -> tuple[int, int] | None:
    """Two sides that meet although they are no neighbours, or fold back on each other."""
    a, b = corners, np.roll(corners, -1, axis=0)
    ahead = b - a
    turn = ahead[:, 0] * np.roll(ahead[:, 1], -1) - ahead[:, 1] * np.roll(ahead[:, 0], -1)
    back = (turn == 0) & ((ahead * np.roll(ahead, -1, axis=0)).sum(axis=1) <= 0)
    if back.any():
        k = int(np.flatnonzero(back)[0])
        return k, (k + 1) % len(corners)

    def side(p: Array, q: Array, r: Array) -> Array:
        along, to = q - p, r - p
        return np.sign(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0])

    found = list[tuple[int, int]]()
    for first, second in _pairs(np.minimum(a, b), np.maximum(a, b)):
        apart = (second - first > 1) & (second - first < len(corners) - 1)
        p, q, r, s = a[first], b[first], a[second], b[second]
        meet = apart & (side(p, q, r) * side(p, q, s) <= 0) & (side(r, s, p) * side(r, s, q) <= 0)
        found += zip(first[meet].tolist(), second[meet].tolist(), strict=True)
    return min(found, default=None)


def _pairs(low: Array, high: Array) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Numbers of boxes that overlap, the lesser one first: by a sweep along one axis, in parts."""
    sweeps = []
    for axis in (0, 1):
        order = np.argsort(low[:, axis], kind="stable")
        until = np.searchsorted(low[order, axis], high[order, axis], side="right")
        sweeps.append((order, until - np.arange(1, len(low) + 1)))
    order, counts = min(sweeps, key=lambda sweep: int(sweep[1].sum()))
    ends = np.cumsum(counts)
    parts = np.unique(np.searchsorted(ends, np.arange(0, ends[-1], _AT_ONCE), side="right"))
    for begin, end in itertools.pairwise([*parts.tolist(), len(low)]):
        rows = np.repeat(np.arange(begin, end), counts[begin:end])
        passed = ends[begin:end] - counts[begin:end]
        nth = passed[0] + np.arange(len(rows)) - np.repeat(passed, counts[begin:end])
        one, two = order[rows], order[rows + 1 + nth]
        overlap = ((low[one] <= high[two]) & (low[two] <= high[one])).all(axis=1)
        one, two = one[overlap], two[overlap]
        yield np.minimum(one, two), np.maximum(one, two)
