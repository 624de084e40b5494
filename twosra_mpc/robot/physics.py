"""Masses, stiffness and friction of a robot, for simulation in a rigid-body engine."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.robot.geometry import Geometry
from twosra_mpc.validation import FrozenDict, NonNegative, Pair, Positive, Value

SLIDING = 0.3  # coefficient of friction of objects on the ground
_GRAVITY_M_S2 = 9.81
_RANGES = {
    "unit_mass_kg": (0.1, 0.4),
    "soft_stiffness_N_m2": (2e-5, 5e-4),
    "solid_stiffness_N_m2": (0.05, 0.8),
    "soft_friction_N_m": (0.0, 1e-3),
    "wheel_friction": (0.3, 0.7),
    "roller_damping_N_m_s": (1e-7, 1e-5),
    "wheel_torque_N_m": (0.006, 0.05),
    "object_mass_kg": (0.03, 0.3),
    "setting_exponent": (1.0, 3.0),
}


class Physics(Value):
    """Physics beyond kinematics; nobody has measured any of it, so all defaults are guesses.

    ``unit_mass_kg`` is that of a locomotion unit with its wheels. ``soft_stiffness_N_m2`` and
    ``solid_stiffness_N_m2`` are the bending stiffness EI of a segment with liquid and with solid
    metal; ``relaxation_s`` is the time in which a bent segment comes to rest (damping over
    stiffness). ``soft_friction_N_m`` is the moment that dry friction in a soft segment resists
    with. ``wheel_friction`` is that of rollers on the ground, ``roller_damping_N_m_s`` of a roller
    about its own axis. ``wheel_torque_N_m`` is what a wheel's motor gives at most.
    ``object_mass_kg`` is that of each object. Metal of solid share s is as stiff as solid metal
    times s to the power of ``setting_exponent``: 1 if it stiffens evenly, 3 if crystals must first
    meet.

    ``ranges`` are the least and largest values that robots are drawn from, evenly on a logarithmic
    scale where both are positive; what is not listed has its value.
    """

    unit_mass_kg: Positive = 0.2
    fibre_kg_per_m: Positive = 0.2
    soft_stiffness_N_m2: Positive = 1.1e-4
    solid_stiffness_N_m2: Positive = 0.2
    relaxation_s: Positive = 0.05
    soft_friction_N_m: NonNegative = 0.0
    wheel_friction: Positive = 0.5
    roller_damping_N_m_s: NonNegative = 1e-6
    wheel_torque_N_m: Positive = 0.02
    object_mass_kg: Positive = 0.1
    setting_exponent: Positive = 1.0
    ranges: Annotated[dict[str, Pair], AfterValidator(FrozenDict)] = FrozenDict(_RANGES)

    @model_validator(mode="after")
    def _possible(self) -> Physics:
        self.check_growing("soft_stiffness_N_m2", "solid_stiffness_N_m2")
        for name, (low, high) in self.ranges.items():
            known = [key for key in type(self).model_fields if key != "ranges"]
            if name not in known:
                raise InputError(f"ranges.{name}", (low, high), f"one of {', '.join(known)}")
            if not 0 <= low <= getattr(self, name) <= high:
                allowed = f"two numbers >= 0, low then high, with {name} between them"
                raise InputError(f"ranges.{name}", (low, high), allowed)
        return self

    @property
    def drag_N(self) -> float:
        """Friction of an object that slides on the ground."""
        return SLIDING * _GRAVITY_M_S2 * self.object_mass_kg

    def pull_N(self, geometry: Geometry) -> float:
        """Most that a wheel pulls along its rim: by its motor, and by a quarter of the weight."""
        fibre_m = sum(geometry.lengths_m) + geometry.middle_link_m + 2 * geometry.end_link_m
        mass_kg = 2 * self.unit_mass_kg + fibre_m * self.fibre_kg_per_m
        grip_N = self.wheel_friction * _GRAVITY_M_S2 * mass_kg / 4
        return min(grip_N, self.wheel_torque_N_m / geometry.wheel_radius_m)

    def drawn(self, width: float, rng: np.random.Generator) -> Physics:
        """Draw the physics of a robot from the ranges, made narrower by ``width`` (0: as is).

        Args:
            width: Share of the way from the values to the ends of their ranges, 0 to 1.
            rng: Advanced by one number for each range.
        """
        values: dict[str, float] = {}
        for name, (low, high) in self.ranges.items():
            middle, share = getattr(self, name), rng.random()
            if low > 0:
                ends = middle * (np.array([low, high]) / middle) ** width
                values[name] = float(ends[0] * (ends[1] / ends[0]) ** share)
            else:
                ends = middle + width * (np.array([low, high]) - middle)
                values[name] = float(ends[0] + share * (ends[1] - ends[0]))
        return self.with_values(**values)
