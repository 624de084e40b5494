"""Segments as data: materials, or what was identified from melts and freezes; the heater.

Every kind builds the thermal model of such a segment, and says how its sensor and heater work.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, SerializeAsAny, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.model import SegmentModel
from twosra_mpc.thermal.two_node import TwoNode
from twosra_mpc.validation import (
    Celsius,
    FrozenDict,
    Length,
    NonNegative,
    Pair,
    Positive,
    Tagged,
    Value,
    plain,
)


class Heater(Value):
    """Temperatures, currents and coil of one segment's heater.

    ``hold_duty`` is the share of the time for which ``melt_current_A`` is on while a robot that
    reports nothing is held soft; left out, the share that heats as ``hold_current_A`` does. It is 1
    only for firmware that is known to regulate: then the host never switches off to hold.
    """

    melting_point_C: Celsius
    soft_setpoint_C: Celsius
    rigid_setpoint_C: Celsius
    temperature_max_C: Celsius
    temperature_min_C: Celsius
    ambient_C: Celsius
    current_max_A: Positive
    melt_current_A: Positive
    hold_current_A: Positive
    hold_duty: Annotated[float, Field(gt=0.0, le=1.0), BeforeValidator(plain)] | None = None
    resistance_ohm: Positive
    cooling_time_constant_s: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Heater:
        self.check_growing("temperature_min_C", "ambient_C", "melting_point_C")
        self.check_growing("melting_point_C", "soft_setpoint_C", "temperature_max_C")
        if not self.temperature_min_C <= self.rigid_setpoint_C < self.melting_point_C:
            allowed = f"from {self.temperature_min_C:zg} to below {self.melting_point_C:zg} C"
            raise InputError("rigid_setpoint_C", self.rigid_setpoint_C, allowed)
        for name, most in (
            ("melt_current_A", "current_max_A"),
            ("hold_current_A", "current_max_A"),
            ("hold_current_A", "melt_current_A"),
        ):
            current, limit = getattr(self, name), getattr(self, most)
            if current > limit:
                raise InputError(name, current, f"at most {most} ({limit:zg} A)")
        return self

    def power_W(self, current_A: float) -> float:
        """Heat of a coil whose resistance is kept."""
        return current_A**2 * self.resistance_ohm

    @property
    def duty_of_hold(self) -> float:
        """Share of the time for which ``melt_current_A`` is on to hold a segment soft."""
        return self.hold_duty or (self.hold_current_A / self.melt_current_A) ** 2


Ranges = Annotated[dict[str, Pair], AfterValidator(FrozenDict)]

_COPPER_DENSITY_KG_PER_M3 = 8960.0  # at 20 degrees C
_COPPER_HEAT_J_PER_KG_K = 385.0  # at 25 degrees C


class Segment(Tagged):
    """Description of a segment, of whatever kind.

    ``ranges`` gives the 5 % and 95 % values of parameters: fields of the thermal model, or of the
    sensor.

    Attributes:
        uncertain: Parameters that may have a range.
        heat_follows: What the heat is described by: the current, or the share of full power, which
            is that at ``heater.melt_current_A``.
    """

    tag_key = "model"
    uncertain: ClassVar[tuple[str, ...]]
    heat_follows: ClassVar[Literal["current", "power"]]

    model: str
    ranges: Ranges = FrozenDict()

    @abstractmethod
    def thermal_model(self, length_m: float, heater: Heater, ambient_C: float) -> SegmentModel:
        """Thermal model of a segment of this length."""

    @property
    def sensor_gain_and_lags_s(self) -> tuple[float, tuple[float, float]]:
        """Reading above the air per degree of the metal, and the two time constants behind it."""
        return 1.0, (4.0, 4.0)  # 2 to 8 s in all: how the sensor is embedded is not published

    @property
    def thresholds_C(self) -> tuple[float, float] | None:
        """Temperatures by the sensor of solid and of liquid; None: those of its model."""
        return None

    @model_validator(mode="after")
    def _ranges_of_parameters(self) -> Self:
        for name, (low, high) in self.ranges.items():
            if name not in self.uncertain:
                known = f"one of {', '.join(self.uncertain)}"
                raise InputError(f"ranges.{name}", [low, high], known)
            if not 0 < low <= high:
                allowed = "two positive numbers, low then high"
                raise InputError(f"ranges.{name}", [low, high], allowed)
        return self


class Coil(Value):
    """The heating wire wound on the core."""

    turns: Positive
    wire_diameter_m: Length
    resistivity_ohm_m: Positive  # at 20 C
    temperature_coefficient_per_K: NonNegative

    def wire_length_m(self, core_diameter_m: float) -> float:
        """Length of wire around a core of this diameter."""
        return self.turns * math.pi * (core_diameter_m + self.wire_diameter_m)

    def resistance_ohm(self, core_diameter_m: float) -> float:
        """Resistance at 25 C."""
        area = math.pi / 4 * self.wire_diameter_m**2
        at_20 = self.resistivity_ohm_m * self.wire_length_m(core_diameter_m) / area
        return at_20 * (1 + 5.0 * self.temperature_coefficient_per_K)

    def heat_capacity_J_per_K(self, core_diameter_m: float) -> float:
        """Heat capacity of the wire."""
        volume = math.pi / 4 * self.wire_diameter_m**2 * self.wire_length_m(core_diameter_m)
        return volume * _COPPER_DENSITY_KG_PER_M3 * _COPPER_HEAT_J_PER_KG_K


class Metal(Value):
    """The low-melting metal in the annulus between core and tube."""

    density_kg_per_m3: Positive
    latent_heat_J_per_kg: Positive
    heat_solid_J_per_kg_K: Positive
    heat_liquid_J_per_kg_K: Positive
    fill: Annotated[float, Field(gt=0.0, le=1.0)]


class Rubber(Value):
    """The silicone of core and tube."""

    density_kg_per_m3: Positive
    heat_J_per_kg_K: Positive


class LumpedSegment(Segment):
    """A segment by geometry and materials: one temperature, one melting plateau.

    ``ranges`` are of derived parameters, which are fields of ``thermal.lumped.Lumped``.
    """

    uncertain = (
        *("heat_solid_J_per_K", "heat_liquid_J_per_K", "latent_J"),
        *("loss_W_per_K", "resistance_ohm", "melting_point_C"),
    )
    heat_follows = "current"

    model: Literal["lumped"]
    core_diameter_m: Length
    tube_inner_diameter_m: Length
    tube_outer_diameter_m: Length
    convection_W_per_m2_K: Positive
    end_loss_W_per_K: NonNegative
    metal: Metal
    rubber: Rubber
    coil: Coil

    @model_validator(mode="after")
    def _nested(self) -> LumpedSegment:
        inner = self.core_diameter_m + 2 * self.coil.wire_diameter_m
        if not inner < self.tube_inner_diameter_m:
            allowed = f"more than core and coil, {inner:zg} m"
            raise InputError("tube_inner_diameter_m", self.tube_inner_diameter_m, allowed)
        self.check_growing("tube_inner_diameter_m", "tube_outer_diameter_m")
        return self

    def thermal_model(self, length_m: float, heater: Heater, ambient_C: float) -> Lumped:
        """Derive the lumped model's parameters from geometry and materials."""
        core, tube_outside = _disc(self.core_diameter_m), _disc(self.tube_outer_diameter_m)
        tube_inside = _disc(self.tube_inner_diameter_m)
        annulus, tube = tube_inside - core, tube_outside - tube_inside
        metal_kg = self.metal.density_kg_per_m3 * self.metal.fill * annulus * length_m
        rubber_kg = self.rubber.density_kg_per_m3 * (core + tube) * length_m
        other = rubber_kg * self.rubber.heat_J_per_kg_K
        other += self.coil.heat_capacity_J_per_K(self.core_diameter_m)
        surface = math.pi * self.tube_outer_diameter_m * length_m
        return Lumped(
            heat_solid_J_per_K=metal_kg * self.metal.heat_solid_J_per_kg_K + other,
            heat_liquid_J_per_K=metal_kg * self.metal.heat_liquid_J_per_kg_K + other,
            latent_J=metal_kg * self.metal.latent_heat_J_per_kg,
            loss_W_per_K=self.convection_W_per_m2_K * surface + self.end_loss_W_per_K,
            resistance_ohm=self.coil.resistance_ohm(self.core_diameter_m),
            temperature_coefficient_per_K=self.coil.temperature_coefficient_per_K,
            melting_point_C=heater.melting_point_C,
            ambient_C=ambient_C,
        )


class TwoNodeSegment(Segment):
    """A segment by fitted parameters: a heated core, a body around it, a lagging sensor.

    With core temperature T_c, body temperature T_b, ambient T_a and heater duty u (share of full
    power), ``dT_c/dt = power u - coupling (T_c - T_b)`` and
    ``dT_b/dt = coupling / body_ratio (T_c - T_b) - body_loss (T_b - T_a)``.
    ``solid_below_C`` and ``liquid_above_C`` are the two thresholds of the stiffness, on what the
    sensor shows (over its gain). A sensor lags, so a melt lasts until the core is as far above
    ``liquid_above_C`` as it leads the sensor by; a freeze, slow in the end, until the core is at
    ``solid_below_C``.
    ``core_heat_J_per_K`` turns rates of temperature into power.
    """

    uncertain = (
        *("power_K_per_s", "coupling_per_s", "body_ratio", "body_loss_per_s"),
        *("sensor_gain", "sensor_lag_s"),
    )
    heat_follows = "power"

    model: Literal["two_node"]
    power_K_per_s: Positive
    coupling_per_s: Positive
    body_ratio: Positive
    body_loss_per_s: Positive
    core_heat_J_per_K: Positive
    solid_below_C: Celsius
    liquid_above_C: Celsius
    sensor_gain: Positive
    sensor_lag_s: NonNegative

    @model_validator(mode="after")
    def _two_thresholds(self) -> TwoNodeSegment:
        self.check_growing("solid_below_C", "liquid_above_C")
        return self

    def thermal_model(self, length_m: float, heater: Heater, ambient_C: float) -> TwoNode:
        """Take the fitted parameters as they are: they are of the segment that was logged."""
        del length_m
        return TwoNode(
            power_K_per_s=self.power_K_per_s,
            coupling_per_s=self.coupling_per_s,
            body_ratio=self.body_ratio,
            body_loss_per_s=self.body_loss_per_s,
            core_heat_J_per_K=self.core_heat_J_per_K,
            full_current_A=heater.melt_current_A,
            solid_level=self.solid_below_C,
            liquid_level=self._evidently_liquid_C(heater),
            ambient_C=ambient_C,
        )

    def _evidently_liquid_C(self, heater: Heater) -> float:
        """Core at which the sensor shows a melt from cold as done; at most halfway to set-point.

        The core rises at p - a (T_c - T_a) at least, and leads a sensor of two lags by twice the
        lag times that.
        """
        above_K = self.liquid_above_C - heater.ambient_C
        rate = self.power_K_per_s - self.coupling_per_s * above_K
        evident = self.liquid_above_C + 2 * self.sensor_lag_s * max(0.0, rate)
        halfway = (self.liquid_above_C + heater.soft_setpoint_C) / 2
        return max(self.liquid_above_C, min(evident, halfway))

    @property
    def thresholds_C(self) -> tuple[float, float]:
        """Those of its authors."""
        return self.solid_below_C, self.liquid_above_C

    @property
    def sensor_gain_and_lags_s(self) -> tuple[float, tuple[float, float]]:
        """As fitted."""
        return self.sensor_gain, (self.sensor_lag_s, self.sensor_lag_s)


AnySegment = Annotated[SerializeAsAny[Segment], BeforeValidator(Segment.of_kind)]


def _disc(diameter_m: float) -> float:
    return math.pi / 4 * diameter_m**2
