"""The robot as data: geometry, path model, limits, heater and transition times, all SI.

A robot is described by a TOML file; ``2sra-v1`` is built in. Units are in the key names:
m, rad, s, A, ohm, C (degrees Celsius), per_m (1/m).
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.files import built_in_names, locate, read_document
from twosra_mpc.robot.segment import Segment
from twosra_mpc.validation import FrozenDict, NonNegative, Number, Positive, Triple, Value, plain


class Wheel(Value):
    """A wheel in the frame of its fibre end: position, and direction it drives in."""

    x_m: Number
    y_m: Number
    angle_rad: Number


class Geometry(Value):
    """Lengths of the fibre and the locomotion units, paper section II and eq. q_bC.

    ``wheels`` overrides where the four wheels sit and point (two of LU1, two of LU2); left out,
    they follow from the lengths, with the paper's beta = pi/2, 0, -pi/2, pi.
    """

    segment_length_m: Positive
    middle_link_m: NonNegative
    end_link_m: Positive
    unit_side_m: Positive
    wheel_thickness_m: Positive
    wheel_radius_m: Positive
    wheels: Annotated[tuple[Wheel, ...], BeforeValidator(plain)] | None = None

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
        return (
            self.end_link_m + self.unit_side_m / 2,
            (self.unit_side_m + self.wheel_thickness_m) / 2,
        )


class LogSpiralPath(Value):
    """The paper's path model: locomotion units trace logarithmic spirals I, II, III (Table I).

    ``log_spiral_corrected`` takes row III at the spiral angle it was fitted for (erratum 1).
    """

    model: Literal["log_spiral", "log_spiral_corrected"]
    scale: Triple
    growth: Triple
    angle_ratio: Triple
    smoothing_rad: Positive

    @property
    def largest_bend_rad(self) -> float:
        """Spiral III is defined up to half a circle per segment (eq. kappa_fit3)."""
        return math.pi


class ArcPath(Value):
    """Exact constant-curvature arcs; ``speed_reference`` says which point's speed v_j is."""

    model: Literal["arc"]
    speed_reference: Literal["fibre_end", "side_wheel"]

    @property
    def largest_bend_rad(self) -> float:
        """A full circle: the series of ``model.series`` are accurate so far."""
        return math.tau


class CardioidPath(Value):
    """The follow-up robot's path model: cardioids r = 2 a (1 - cos phi) for cases I, II, III.

    The polar angle is phi = pi + ``phi_per_alpha`` * bending angle, a = ``radius_m``.
    """

    model: Literal["cardioid"]
    radius_m: Triple
    phi_per_alpha: Triple

    @property
    def largest_bend_rad(self) -> float:
        """Where the first of the cardioids comes within half a radian of its cusp."""
        return (math.pi - 0.5) / max(self.phi_per_alpha)


class MotionLimits(Value):
    """Limits of motion and of shape.

    ``unit_gap_m`` is the least distance between the two square locomotion units.
    ``wheel_independence`` is the least singular value of the rigid wheel matrix with which the
    robot may drive, wheel radius divided out and turning measured at 0.1 m; at zero some motion
    needs no wheel to turn, and nothing would stop it.
    """

    wheel_speed_rad_s: Positive
    unit_speed_m_s: Positive
    curvature_per_m: Positive
    unit_gap_m: NonNegative = 0.0
    wheel_independence: NonNegative = 0.05


class Heater(Value):
    """Temperatures, currents and coil of one segment's heater."""

    melting_point_C: Number
    soft_setpoint_C: Number
    rigid_setpoint_C: Number
    temperature_max_C: Number
    temperature_min_C: Number
    ambient_C: Number
    current_max_A: Positive
    melt_current_A: Positive
    hold_current_A: Positive
    resistance_ohm: Positive
    cooling_time_constant_s: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Heater:
        ordered = [
            ("temperature_min_C", self.temperature_min_C),
            ("ambient_C", self.ambient_C),
            ("melting_point_C", self.melting_point_C),
            ("soft_setpoint_C", self.soft_setpoint_C),
            ("temperature_max_C", self.temperature_max_C),
        ]
        for (low_name, low), (name, value) in itertools.pairwise(ordered):
            if not low < value:
                raise InputError(name, value, f"more than {low_name} ({low:g} C)")
        if not self.temperature_min_C <= self.rigid_setpoint_C < self.melting_point_C:
            allowed = f"from {self.temperature_min_C:g} to below {self.melting_point_C:g} C"
            raise InputError("rigid_setpoint_C", self.rigid_setpoint_C, allowed)
        for name in ("melt_current_A", "hold_current_A"):
            current = float(getattr(self, name))
            if current > self.current_max_A:
                raise InputError(name, current, f"at most current_max_A ({self.current_max_A:g} A)")
        if self.hold_current_A > self.melt_current_A:
            allowed = f"at most melt_current_A ({self.melt_current_A:g} A)"
            raise InputError("hold_current_A", self.hold_current_A, allowed)
        return self


class OverlappedTiming(Value):
    """Constant melt and freeze times; transitions may overlap each other and the motion.

    Only the last ``*_changing_s`` of a transition are spent on the plateau, where nothing may move.
    Heating a molten segment for ``superheat_s`` more brings it to the set-point, from where cooling
    to the plateau takes freeze_s - freeze_changing_s; a shorter heating, as much less.
    """

    overlap: Literal["full"]
    melt_s: Positive
    melt_changing_s: Positive
    freeze_s: Positive
    freeze_changing_s: Positive
    superheat_s: Positive

    @property
    def superheat_share(self) -> float:
        """Share of a short liquid period during which the heater must stay on."""
        return self.superheat_s / (self.superheat_s + self.freeze_s - self.freeze_changing_s)

    @model_validator(mode="after")
    def _plateau_within(self) -> OverlappedTiming:
        for kind in ("melt", "freeze"):
            whole = float(getattr(self, f"{kind}_s"))
            changing = float(getattr(self, f"{kind}_changing_s"))
            if changing > whole:
                name = f"{kind}_changing_s"
                raise InputError(name, changing, f"at most {kind}_s ({whole:g} s)")
        return self


class SequentialTiming(Value):
    """The authors' practice: the robot waits a fixed time through every change of mode."""

    overlap: Literal["none"]
    heat_s: Positive
    freeze_s: Positive
    reconfigure_s: Positive
    reconfigure_cool_s: Positive

    @model_validator(mode="after")
    def _cooling_within(self) -> SequentialTiming:
        if self.reconfigure_cool_s >= self.reconfigure_s:
            allowed = f"less than reconfigure_s ({self.reconfigure_s:g} s)"
            raise InputError("reconfigure_cool_s", self.reconfigure_cool_s, allowed)
        return self


class ThermalTiming(Value):
    """Times from the thermal model of the segments; transitions may overlap, as in "full"."""

    overlap: Literal["thermal"]


Timing = Annotated[
    OverlappedTiming | SequentialTiming | ThermalTiming, Field(discriminator="overlap")
]


class Robot(Value):
    """A complete robot description. ``timing`` maps a name to a set of transition times.

    ``segment`` describes how both segments warm and cool; timing "thermal" needs it.
    """

    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    geometry: Geometry
    path: Annotated[LogSpiralPath | ArcPath | CardioidPath, Field(discriminator="model")]
    limits: MotionLimits
    heater: Heater
    segment: Segment | None = None
    timing: Annotated[dict[str, Timing], Field(min_length=1), AfterValidator(FrozenDict)]

    @model_validator(mode="after")
    def _curvature_within_the_path_model(self) -> Robot:
        most = self.path.largest_bend_rad
        bend = self.limits.curvature_per_m * self.geometry.segment_length_m
        if bend > most:
            allowed = (
                f"at most {most / self.geometry.segment_length_m:.2f} 1/m, where path model "
                f"{self.path.model} ends (a bending angle of {most:.3f} rad)"
            )
            raise InputError("limits.curvature_per_m", self.limits.curvature_per_m, allowed)
        return self

    @model_validator(mode="after")
    def _thermal_timing_has_a_segment(self) -> Robot:
        thermal = [name for name, t in self.timing.items() if isinstance(t, ThermalTiming)]
        if thermal and self.segment is None:
            needed = f"a table of keys: timing {thermal[0]} takes its times from it"
            raise InputError("segment", "missing", needed)
        return self

    def __hash__(self) -> int:
        return hash((self.name, self.geometry.segment_length_m, self.path.model))


def load_robot(source: str | Path) -> Robot:
    """Load a built-in robot by name, or a robot TOML/JSON file by path.

    Raises:
        InputError: If there is no such robot, or the file describes it wrongly.
    """
    return Robot.parse(read_document(locate(source, "robots", "robot"), str(source)), str(source))


def robot_names() -> list[str]:
    """Names of the built-in robots."""
    return built_in_names("robots")
