"""One segment as data: what it is made of, or what was identified from its heating log."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.validation import FrozenDict, NonNegative, Number, Pair, Positive, Value

Ranges = Annotated[dict[str, Pair], AfterValidator(FrozenDict)]

_COPPER_DENSITY_KG_PER_M3 = 8960.0
_COPPER_HEAT_J_PER_KG_K = 385.0


class Coil(Value):
    """The heating wire wound on the core."""

    turns: Positive
    wire_diameter_m: Positive
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


class LumpedSegment(Value):
    """A segment by geometry and materials: one temperature, one melting plateau.

    ``ranges`` gives the 5 % and 95 % values of derived parameters, which are fields of
    ``thermal.lumped.Lumped``.
    """

    model: Literal["lumped"]
    core_diameter_m: Positive
    tube_inner_diameter_m: Positive
    tube_outer_diameter_m: Positive
    convection_W_per_m2_K: Positive
    end_loss_W_per_K: NonNegative
    metal: Metal
    rubber: Rubber
    coil: Coil
    ranges: Ranges = FrozenDict()

    @model_validator(mode="after")
    def _nested(self) -> LumpedSegment:
        inner = self.core_diameter_m + 2 * self.coil.wire_diameter_m
        if not inner < self.tube_inner_diameter_m:
            allowed = f"more than core and coil, {inner:g} m"
            raise InputError("tube_inner_diameter_m", self.tube_inner_diameter_m, allowed)
        if not self.tube_inner_diameter_m < self.tube_outer_diameter_m:
            allowed = f"more than tube_inner_diameter_m ({self.tube_inner_diameter_m:g} m)"
            raise InputError("tube_outer_diameter_m", self.tube_outer_diameter_m, allowed)
        check_ranges(self.ranges, LUMPED_RANGES)
        return self

    @property
    def resistance_ohm(self) -> float:
        """Resistance of the coil at 25 C."""
        return self.coil.resistance_ohm(self.core_diameter_m)


class TwoNodeSegment(Value):
    """A segment by fitted parameters: a heated core, a body around it, a lagging sensor.

    With core temperature T_c, body temperature T_b, ambient T_a and heater duty u (share of full
    power), ``dT_c/dt = power u - coupling (T_c - T_b)`` and
    ``dT_b/dt = coupling / body_ratio (T_c - T_b) - body_loss (T_b - T_a)``.
    ``solid_below_C`` and ``liquid_above_C`` are the two thresholds of the stiffness.
    ``core_heat_J_per_K`` turns rates of temperature into power.
    """

    model: Literal["two_node"]
    power_K_per_s: Positive
    coupling_per_s: Positive
    body_ratio: Positive
    body_loss_per_s: Positive
    core_heat_J_per_K: Positive
    solid_below_C: Number
    liquid_above_C: Number
    sensor_gain: Positive
    sensor_lag_s: NonNegative
    ranges: Ranges = FrozenDict()

    @model_validator(mode="after")
    def _two_thresholds(self) -> TwoNodeSegment:
        if not self.solid_below_C < self.liquid_above_C:
            allowed = f"more than solid_below_C ({self.solid_below_C:g} C)"
            raise InputError("liquid_above_C", self.liquid_above_C, allowed)
        check_ranges(self.ranges, TWO_NODE_RANGES)
        return self


LUMPED_RANGES = (
    "heat_solid_J_per_K",
    "heat_liquid_J_per_K",
    "latent_J",
    "loss_W_per_K",
    "resistance_ohm",
    "melting_point_C",
)
TWO_NODE_RANGES = (
    "power_K_per_s",
    "coupling_per_s",
    "body_ratio",
    "body_loss_per_s",
    "sensor_gain",
    "sensor_lag_s",
)

Segment = Annotated[LumpedSegment | TwoNodeSegment, Field(discriminator="model")]


def check_ranges(ranges: dict[str, tuple[float, float]], known: tuple[str, ...]) -> None:
    """Refuse a range of something that is not a parameter, or that is empty or not positive.

    Raises:
        InputError: Naming the range.
    """
    for name, (low, high) in ranges.items():
        if name not in known:
            raise InputError(f"ranges.{name}", [low, high], f"one of {', '.join(known)}")
        if not 0 < low <= high:
            raise InputError(f"ranges.{name}", [low, high], "two positive numbers, low then high")
