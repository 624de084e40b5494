"""Lengths of the fibre and the locomotion units, where their wheels sit, and how far all may go."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Annotated

from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.validation import (
    MOST_SEGMENTS,
    Distance,
    Length,
    Metres,
    NonNegative,
    Positive,
    Radians,
    Rate,
    Several,
    Value,
    plain,
)

_LEAST_PERIODS = 3  # of the controller, in a phase that moves
_LISTED = {"minItems": 1, "maxItems": MOST_SEGMENTS}


class Wheel(Value):
    """A wheel in the frame of its fibre end: position, and direction it drives in."""

    x_m: Metres
    y_m: Metres
    angle_rad: Radians


class Geometry(Value):
    """Lengths of the fibre and the locomotion units, paper section II and eq. q_bC.

    The fibre is a chain from locomotion unit 1 (LU1) to LU2: an end link, ``segments`` segments
    with a middle link between neighbours, an end link. ``segment_length_m`` is one length for all
    of them, or a list.

    ``unit_side_m`` is the side of the square that wheels sit around; its middle is that of the
    unit. ``unit_frame_m`` is the side of the unit's outline, a square about the same middle.
    ``fibre_radius_m`` is that of segments and links (the tube of the paper's robot: 4 mm).
    ``unit_offset_m`` is how far the units' middles lie beside the fibre, in y of the fibre ends.
    ``wheels`` overrides where the four wheels sit and point (two of LU1, two of LU2); left out,
    they follow from the lengths, with the paper's beta = pi/2, 0, -pi/2, pi.
    """

    segments: Annotated[int, Field(ge=1, le=MOST_SEGMENTS), BeforeValidator(plain)] = 2
    segment_length_m: Length | Annotated[tuple[Length, ...], Field(json_schema_extra=_LISTED)]
    middle_link_m: Distance
    end_link_m: Length
    unit_side_m: Length
    unit_frame_m: Length
    wheel_thickness_m: Length
    wheel_radius_m: Length
    unit_offset_m: Metres = 0.0
    fibre_radius_m: Distance = 0.004
    wheels: Several[Wheel] | None = None

    @model_validator(mode="after")
    def _four_distinct_wheels(self) -> Geometry:
        if self.wheels is None:
            return self
        if len(self.wheels) != 4:
            raise InputError("wheels", len(self.wheels), "four wheels: two of LU1, then two of LU2")
        for first in (0, 2):
            a, b = self.wheels[first : first + 2]
            if math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < self.wheel_radius_m:
                allowed = f"at least wheel_radius_m from wheel {first + 1} of the same unit"
                raise InputError(f"wheels.{first + 1}", (b.x_m, b.y_m), allowed)
        return self

    @field_validator("segment_length_m", mode="wrap")
    @classmethod
    def _number_or_list(cls, value: object, valid: Callable[[object], object]) -> object:
        try:
            return valid(plain(value))
        except ValidationError:
            allowed = "a positive number, or a list of one for each segment"
            raise InputError("", value, allowed) from None

    @model_validator(mode="after")
    def _as_many_lengths_as_segments(self) -> Geometry:
        given = self.segment_length_m
        if isinstance(given, tuple) and len(given) != self.segments:
            allowed = f"one number, or one for each of {self.segments} segments"
            raise InputError("segment_length_m", given, allowed)
        return self

    @cached_property
    def lengths_m(self) -> tuple[float, ...]:
        """Length of each segment, from LU1 to LU2."""
        given = self.segment_length_m
        return given if isinstance(given, tuple) else (given,) * self.segments

    @property
    def inner_link_of_b0(self) -> int:
        """b0 is in the middle of this inner link, counted from 1; 0: at the fibre end of LU1."""
        return self.segments // 2

    @property
    def half_link_m(self) -> float:
        """Distance from b0 to the segments next to it."""
        return self.middle_link_m / 2 if self.segments > 1 else 0.0

    @property
    def unit_middle_m(self) -> tuple[float, float]:
        """(x, y) of the middle of LU2 in its fibre end; of LU1 in its own: (-x, y)."""
        return self.end_link_m + self.unit_side_m / 2, self.unit_offset_m

    @property
    def wheel_placement(self) -> tuple[tuple[float, float, float], ...]:
        """(x [m], y [m], drive direction [rad]) of each wheel in the frame of its fibre end."""
        if self.wheels is not None:
            return tuple((wheel.x_m, wheel.y_m, wheel.angle_rad) for wheel in self.wheels)
        h1, (h2, h3) = self.side_wheel_m, self.front_wheel_m
        quarter = math.pi / 2
        return (-h1, 0.0, quarter), (-h2, h3, 0.0), (h1, 0.0, -quarter), (h2, -h3, math.pi)

    @property
    def side_wheel_m(self) -> float:
        """h1: distance from a fibre end to the side wheel, along the link."""
        return self.end_link_m + self.unit_side_m + self.wheel_thickness_m / 2

    @property
    def front_wheel_m(self) -> tuple[float, float]:
        """(h2, h3): distance from a fibre end to the other wheel, along and across the link."""
        return self.unit_middle_m[0], (self.unit_side_m + self.wheel_thickness_m) / 2


class MotionLimits(Value):
    """Limits of motion and of shape; what is None does not limit.

    ``unit_gap_m`` is the least distance between the frames of the two locomotion units.
    ``wheel_independence`` is the least singular value of the rigid wheel matrix with which the
    robot may drive, wheel radius divided out and turning measured at 0.1 m; at zero some motion
    needs no wheel to turn, and nothing would stop it. ``bend_lever`` is the least lever with which
    wheels bend a segment that is soft alone against its spring, or hold it, in lengths of the
    segment and per angle by which it is bent; where they pull it is enough that there is one.

    ``speed_m_s`` and ``turn_rate_rad_s`` are of the middle link in rigid phases,
    ``bend_rate_rad_s`` of every segment (kappa' l). With ``wheel_acceleration_rad_s2`` every phase
    begins and ends at rest. A phase that moves lasts at least three times ``control_period_s``; a
    gentle one is no slower than that its fastest wheel reaches ``wheel_speed_min_rad_s``. Among
    obstacles the middle link moves by at most ``soft_travel_m`` from one drive to the next.
    """

    wheel_speed_rad_s: Rate
    unit_speed_m_s: Rate
    curvature_per_m: Positive
    unit_gap_m: Distance = 0.0
    wheel_independence: NonNegative = 0.05
    bend_lever: NonNegative | None = None
    wheel_acceleration_rad_s2: Rate | None = None
    bend_rate_rad_s: Rate | None = None
    speed_m_s: Rate | None = None
    turn_rate_rad_s: Rate | None = None
    wheel_speed_min_rad_s: NonNegative = 0.0
    control_period_s: Positive | None = None
    soft_travel_m: Length = 0.15

    @cached_property
    def phase_s(self) -> float:
        """Least duration of a phase that moves [s]; 0 for a robot whose wheels may jump."""
        jumps = self.wheel_acceleration_rad_s2 is None
        return 0.0 if jumps else _LEAST_PERIODS * (self.control_period_s or 0.0)
