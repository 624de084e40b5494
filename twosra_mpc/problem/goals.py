"""Goals as sets of configurations: a box is the first kind.

Everything that plans asks a goal set four things: how far a configuration is from it, a box that
holds it (of bends and of poses: what bounds rest on), which member to aim at, and the equations
that its members fulfil within the box (what the NLP's terminal constraint is made of).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import BeforeValidator, field_validator, model_serializer, model_validator

from twosra_mpc.arguments import check_size
from twosra_mpc.errors import InputError
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import RIGID, rigid_mode
from twosra_mpc.validation import (
    EachOf,
    Metres,
    ModeField,
    NonNegative,
    Number,
    Numbers,
    Radians,
    Value,
    plain,
)

if TYPE_CHECKING:  # scenarios are listed without it
    import casadi as ca

    from twosra_mpc.robot.description import Robot


class GoalSet(Value, ABC):
    """A set of configurations to end in, with the stiffness of the segments there.

    A further kind says what `box`, `aim` and `of_robot` are, and `residual` unless it is a box.
    Headings that differ by full turns are the same where ``phi_modulo`` is true.
    """

    mode: ModeField = RIGID
    phi_modulo: bool = True

    @abstractmethod
    def of_robot(self, robot: Robot) -> Self:
        """Return the set with what was left out filled in for a robot."""

    @abstractmethod
    def box(self, near: Array) -> tuple[Array, Array]:
        """(low, high) of a box that holds every member next to ``near``, each (3 + n,).

        What is proved of plans rests on it. Infinite where a coordinate is free; a coordinate is
        exact where both ends are the same.
        """

    @abstractmethod
    def aim(self, q: Array) -> Array:
        """The member to aim at from ``q``, (3 + n,)."""

    def residual(self, q: ca.SX) -> ca.SX:
        """Equality constraints of the goal set within its box, symbolically, (m,)."""
        return q[:0]

    @property
    def is_box(self) -> bool:
        """True if every configuration in its box is a member."""
        return type(self).residual is GoalSet.residual

    def error(self, q: Array) -> Array:
        """Signed distance of ``q`` to the set by coordinate, (3 + n,); zero in it."""
        return q - self.aim(q)

    def met_at(self, q: Array) -> bool:
        """True if ``q`` (3 + n,) is in the set, to within `GOAL_TOLERANCE`."""
        return bool(np.abs(self.error(q.copy())).max() <= GOAL_TOLERANCE)

    def box_met(self, near: Array) -> tuple[Array, Array]:
        """`box`, with everything around it that is in the set to within `GOAL_TOLERANCE`."""
        low, high = self.box(near)
        return low - GOAL_TOLERANCE, high + GOAL_TOLERANCE

    def loosened(self, widths: Array) -> GoalSet:
        """Return the set that may be missed by ``widths`` (3 + n,) more, if it can say so."""
        del widths
        return self

    def shaped(self, kappa: Array, within_per_m: float) -> GoalSet:
        """Return the set with shapes near ``kappa`` (n,) only, if it can say so."""
        del kappa, within_per_m
        return self

    @property
    def configuration(self) -> Array:
        """The middle of its box, (3 + n,), read-only; NaN where it is free."""
        low, high = self.box(np.zeros(POSE + len(self.mode)))
        ends = zip(low.tolist(), high.tolist(), strict=True)
        return read_only([(a + b) / 2 if math.isfinite(b - a) else math.nan for a, b in ends])

    @property
    def half_width(self) -> Array:
        """Half of the width of its box, (3 + n,), read-only; zero where it is free."""
        low, high = self.box(np.zeros(POSE + len(self.mode)))
        return read_only([w / 2 if math.isfinite(w) else 0.0 for w in (high - low).tolist()])


class Anywhere(GoalSet):
    """Every configuration: the goal of a problem whose last task says where it ends."""

    def of_robot(self, robot: Robot) -> Anywhere:
        """Return it with a stiffness for each segment."""
        return Anywhere(mode=rigid_mode(robot.coordinates.segments))

    def box(self, near: Array) -> tuple[Array, Array]:
        """All of the space."""
        return np.full(len(near), -math.inf), np.full(len(near), math.inf)

    def aim(self, q: Array) -> Array:
        """``q`` itself."""
        return q

    @model_serializer
    def _nothing(self) -> None:
        return None


def _free_to_none(value: object) -> object:
    """Read the word "free" in a list of curvatures as a free coordinate."""
    value = plain(value)
    if isinstance(value, tuple):
        return tuple(None if item == "free" else item for item in value)
    return value


FreeNumbers = Annotated[EachOf[Number | None], BeforeValidator(_free_to_none)]


class Tolerance(Value):
    """Half-widths of the goal box; zero, as where left out, means that the goal is met exactly."""

    x_m: NonNegative = 0.0
    y_m: NonNegative = 0.0
    phi_rad: NonNegative = 0.0
    kappa_per_m: Numbers = ()

    @field_validator("kappa_per_m")
    @classmethod
    def _not_negative(cls, widths: tuple[float, ...]) -> tuple[float, ...]:
        if min(widths, default=0.0) < 0:
            raise ValueError("numbers greater than or equal to 0")
        return widths

    @classmethod
    def of(cls, widths: Array) -> Tolerance:
        """The tolerance with these half-widths, (3 + n,)."""
        numbers = check_size("widths", widths, max(np.size(widths), POSE + 1))
        x_m, y_m, phi_rad, *kappa_per_m = numbers.tolist()
        return cls(x_m=x_m, y_m=y_m, phi_rad=phi_rad, kappa_per_m=tuple(kappa_per_m))


def _exact_to_zero(value: object) -> object:
    if value == "exact":
        return Tolerance()
    if isinstance(value, str | int | float):
        allowed = '"exact", or a table of half-widths x_m, y_m, phi_rad, kappa_per_m'
        hint = 'did you mean "exact"?' if isinstance(value, str) or value == 0 else ""
        raise InputError("", value, allowed, hint=hint)
    return value


class Goal(GoalSet):
    """A box: where the robot should be, to within a tolerance; ``None`` or "free" marks a free one.

    ``tolerance`` is "exact" or a table; left out, what plans use of the robot's accuracy.
    ``phi_modulo`` accepts headings that differ by full turns. ``mode`` is the stiffness of the
    segments at the end, rigid unless told otherwise. What is left out of a goal by itself is filled
    in by a `Problem`, which knows its robot.
    """

    x_m: Metres | None = None
    y_m: Metres | None = None
    phi_rad: Radians | None = None
    kappa_per_m: FreeNumbers = (None, None)
    tolerance: Annotated[Tolerance | None, BeforeValidator(_exact_to_zero)] = None
    phi_modulo: bool = True

    @field_validator("kappa_per_m", mode="before")
    @classmethod
    def _nothing_is_free(cls, value: object) -> object:
        return (None, None) if value is None else value

    @model_validator(mode="after")
    def _something_asked(self) -> Goal:
        if np.isnan(self.configuration).all():
            raise InputError("", {}, "at least one of x_m, y_m, phi_rad, kappa_per_m")
        return self

    @property
    def configuration(self) -> Array:
        """Goal q, shape (3 + n,), read-only; NaN marks a free coordinate."""
        values = [self.x_m, self.y_m, self.phi_rad, *self.kappa_per_m]
        return read_only([math.nan if value is None else value for value in values])

    @property
    def half_width(self) -> Array:
        """Tolerance of each coordinate, shape (3 + n,), read-only."""
        box = self.tolerance or Tolerance()
        bends = box.kappa_per_m or (0.0,) * len(self.kappa_per_m)
        return read_only([box.x_m, box.y_m, box.phi_rad, *bends])

    def shaped(self, kappa: Array, within_per_m: float) -> Goal:
        """Return the goal with shapes near ``kappa`` (n,) only, where it leaves a choice."""
        kappa = check_size("kappa", kappa, len(self.kappa_per_m))
        middle, width = self.configuration[POSE:], self.half_width[POSE:]
        free = np.isnan(middle) | (width > within_per_m)
        tolerance = (self.tolerance or Tolerance()).with_values(
            kappa_per_m=tuple(np.where(free, within_per_m, width).tolist())
        )
        shape = tuple(np.where(free, kappa, middle).tolist())
        return self.with_values(kappa_per_m=shape, tolerance=tolerance)

    def of_robot(self, robot: Robot) -> Goal:
        """Return this goal with what was left out filled in for a robot."""
        values = {name: getattr(self, name) for name in self.model_fields_set}
        segments = robot.coordinates.segments
        values.setdefault("kappa_per_m", (None,) * segments)
        values.setdefault("mode", rigid_mode(segments))
        tolerance = self.tolerance
        if tolerance is None and robot.accuracy is not None:
            values["tolerance"] = Tolerance.of(robot.accuracy.planned(robot.coordinates))
        elif tolerance is None or not tolerance.kappa_per_m:
            exact = tolerance or Tolerance()
            values["tolerance"] = exact.with_values(kappa_per_m=(0.0,) * segments)
        return Goal(**values)

    def aim(self, q: Array) -> Array:
        """The middle of the box, free coordinates as in ``q``, shape (3 + n,)."""
        middle = self._turned_to("q", q)
        return np.where(np.isnan(middle), q, middle)

    def box(self, near: Array) -> tuple[Array, Array]:
        """Ends of the box, infinite where free, headings turned next to that of ``near``."""
        middle = self._turned_to("near", near)
        free = np.isnan(middle)
        width = np.where(free, np.inf, self.half_width)
        middle[free] = 0.0
        return middle - width, middle + width

    def _turned_to(self, name: str, q: Array) -> Array:
        """The middle of the box with its heading within half a turn of that of ``q``."""
        q, middle = (
            check_size(name, q, len(self.configuration), "q", True),
            self.configuration.copy(),
        )
        if self.phi_modulo and math.isfinite(q[2] - middle[2]):
            middle[2] = q[2] + math.remainder(middle[2] - q[2], math.tau)
        return middle

    def loosened(self, widths: Array) -> Goal:
        """Return the goal with tolerances wider by ``widths`` (3 + n,), or narrower, down to 0."""
        more = check_size("widths", widths, POSE + len(self.kappa_per_m))
        return self.with_values(tolerance=Tolerance.of(np.maximum(self.half_width + more, 0.0)))

    def error(self, q: Array) -> Array:
        """Signed distance of ``q`` to the goal box, shape (3 + n,); 0 inside and where free.

        Not a number where ``q`` is not finite.
        """
        middle = self.configuration
        difference = check_size("q", q, len(middle), "q", True) - middle
        if self.phi_modulo and math.isfinite(difference[2]):
            difference[2] = math.remainder(difference[2], math.tau)
        outside = np.sign(difference) * np.maximum(np.abs(difference) - self.half_width, 0.0)
        return np.where(np.isnan(middle), 0.0, outside)


def inner_goal(robot: Robot, goal: GoalSet) -> GoalSet:
    """Part of a goal where plans should end, for the sake of their runs."""
    accuracy = robot.accuracy
    return goal.loosened(-accuracy.planned(robot.coordinates)) if accuracy else goal


def read_only(values: list[float]) -> Array:
    """An array of these values that cannot be written to."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
