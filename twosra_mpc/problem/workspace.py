"""Where the robot may be: a box in the plane that no point of its outline leaves at any time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.validation import MetresPair, Value

_AROUND_M = 1e-3


class Workspace(Value):
    """A box along the axes of the plane; an axis that is left out is free."""

    x_m: MetresPair | None = None
    y_m: MetresPair | None = None

    @model_validator(mode="after")
    def _low_below_high(self) -> Workspace:
        wrong = list(self._not_growing())
        if wrong:
            raise wrong[0].among(wrong[1:])
        return self

    def _not_growing(self) -> Iterator[InputError]:
        for name, pair in (("x_m", self.x_m), ("y_m", self.y_m)):
            if pair is not None and not pair[0] < pair[1]:
                yield InputError(name, pair, "two numbers, the lower one first")

    @property
    def corners_m(self) -> Array:
        """Least and largest x and y, (2, 2); infinite where free."""
        free = (-np.inf, np.inf)
        return np.array([self.x_m or free, self.y_m or free]).T

    def holding(self, points: Array) -> Workspace:
        """The box, no smaller than these points (..., 2) need with a millimetre around them."""
        flat, (low, high) = points.reshape(-1, 2), self.corners_m
        low = np.minimum(low, flat.min(axis=0) - _AROUND_M).tolist()
        high = np.maximum(high, flat.max(axis=0) + _AROUND_M).tolist()
        x_m, y_m = zip(low, high, strict=True)
        return Workspace(x_m=x_m if self.x_m else None, y_m=y_m if self.y_m else None)

    def margin_m(self, points: Array) -> Array:
        """How far points (..., 2) are within the box; negative outside, by the farther axis."""
        low, high = self.corners_m
        margin: Array = np.minimum(points - low, high - points).min(axis=-1)
        return margin
