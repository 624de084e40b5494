"""What every segment model offers, and the model of a robot's segments at a given ambient."""

from __future__ import annotations

import math
from typing import Protocol

from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.segment import LumpedSegment, TwoNodeSegment
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.two_node import TwoNode

State = tuple[float, ...]


class SegmentModel(Protocol):
    """A segment with its heater: exact propagation at constant current, and times to thresholds.

    A segment is solid while ``level(state) <= solid_level``, liquid from ``liquid_level`` on, and
    changing in between. At constant current the level rises or falls, and warmer stays warmer:
    of two states the one that is nowhere colder never becomes colder anywhere.
    """

    @property
    def solid_level(self) -> float:
        """Level up to which the segment is solid."""

    @property
    def liquid_level(self) -> float:
        """Level from which on it is liquid."""

    @property
    def ambient_C(self) -> float:
        """Temperature of the air."""

    def initial(self, temperature_C: float) -> State:
        """State of a segment that has this temperature throughout."""

    def level(self, state: State) -> float:
        """What rises and falls through the thresholds, in the model's own unit."""

    def level_at(self, temperature_C: float) -> float:
        """Level at a temperature; where the metal melts, of the solid."""

    def at_level(self, state: State, level: float) -> State:
        """State whose level is this, the rest of the segment being as in ``state``."""

    def temperature_C(self, state: State) -> float:
        """Temperature of the metal."""

    def melt_fraction(self, state: State) -> float:
        """From 0 (solid) to 1 (liquid)."""

    def propagate(self, state: State, current_A: float, duration_s: float) -> State:
        """State after a constant current."""

    def hold(self, state: State, duration_s: float) -> State:
        """State after an ideal controller has kept the temperature."""

    def time_until(self, state: State, current_A: float, level: float) -> float:
        """Time at constant current until the level is first reached [s]; inf if never."""

    def power_W(self, current_A: float, temperature_C: float) -> float:
        """Heater power."""

    def energy_J(self, state: State, current_A: float, duration_s: float) -> float:
        """Heater energy at constant current."""

    def holding_current_A(self, state: State) -> float:
        """Current that keeps the temperature now."""

    def holding_energy_J(self, state: State, duration_s: float) -> float:
        """Heater energy of keeping the temperature."""

    def least_power_while_liquid_W(self, hottest_C: float) -> float:
        """Proved least mean heater power from liquid level to liquid level, never above this."""


def segment_model(robot: Robot, ambient_C: float, segment: int = 0) -> SegmentModel:
    """Build the thermal model of a segment (from 0) of a robot.

    Raises:
        InputError: If the robot file has no ``[segment]``.
    """
    match robot.thermal_segment(segment):
        case LumpedSegment() as made:
            return lumped(made, robot.geometry.lengths_m[segment], robot, ambient_C)
        case TwoNodeSegment() as made:
            return two_node(made, robot, ambient_C)
        case None:
            raise InputError("segment", None, f"a thermal description in robot {robot.name}")


def lumped(made: LumpedSegment, length: float, robot: Robot, ambient_C: float) -> Lumped:
    """Derive the lumped model's parameters from geometry and materials; ``length`` in m."""
    annulus = _disc(made.tube_inner_diameter_m) - _disc(made.core_diameter_m)
    tube = _disc(made.tube_outer_diameter_m) - _disc(made.tube_inner_diameter_m)
    metal_kg = made.metal.density_kg_per_m3 * made.metal.fill * annulus * length
    rubber_kg = made.rubber.density_kg_per_m3 * (_disc(made.core_diameter_m) + tube) * length
    other = rubber_kg * made.rubber.heat_J_per_kg_K
    other += made.coil.heat_capacity_J_per_K(made.core_diameter_m)
    surface = math.pi * made.tube_outer_diameter_m * length
    return Lumped(
        heat_solid_J_per_K=metal_kg * made.metal.heat_solid_J_per_kg_K + other,
        heat_liquid_J_per_K=metal_kg * made.metal.heat_liquid_J_per_kg_K + other,
        latent_J=metal_kg * made.metal.latent_heat_J_per_kg,
        loss_W_per_K=made.convection_W_per_m2_K * surface + made.end_loss_W_per_K,
        resistance_ohm=made.resistance_ohm,
        temperature_coefficient_per_K=made.coil.temperature_coefficient_per_K,
        melting_point_C=robot.heater.melting_point_C,
        ambient_C=ambient_C,
    )


def two_node(made: TwoNodeSegment, robot: Robot, ambient_C: float) -> TwoNode:
    """Take the fitted parameters as they are; full power is at ``heater.melt_current_A``."""
    return TwoNode(
        power_K_per_s=made.power_K_per_s,
        coupling_per_s=made.coupling_per_s,
        body_ratio=made.body_ratio,
        body_loss_per_s=made.body_loss_per_s,
        core_heat_J_per_K=made.core_heat_J_per_K,
        full_current_A=robot.heater.melt_current_A,
        solid_level=made.solid_below_C,
        liquid_level=made.liquid_above_C,
        ambient_C=ambient_C,
    )


def _disc(diameter_m: float) -> float:
    return math.pi / 4 * diameter_m**2
