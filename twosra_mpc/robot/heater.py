"""Temperatures, currents and coil of a segment's heater."""

from __future__ import annotations

import itertools

from pydantic import model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.validation import Number, Positive, Value


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
        names = (
            *("temperature_min_C", "ambient_C", "melting_point_C"),
            *("soft_setpoint_C", "temperature_max_C"),
        )
        for least, name in itertools.pairwise(names):
            low, value = getattr(self, least), getattr(self, name)
            if not low < value:
                raise InputError(name, value, f"more than {least} ({low:g} C)")
        if not self.temperature_min_C <= self.rigid_setpoint_C < self.melting_point_C:
            allowed = f"from {self.temperature_min_C:g} to below {self.melting_point_C:g} C"
            raise InputError("rigid_setpoint_C", self.rigid_setpoint_C, allowed)
        for name, most in (
            ("melt_current_A", "current_max_A"),
            ("hold_current_A", "current_max_A"),
            ("hold_current_A", "melt_current_A"),
        ):
            current, limit = getattr(self, name), getattr(self, most)
            if current > limit:
                raise InputError(name, current, f"at most {most} ({limit:g} A)")
        return self

    def power_W(self, current_A: float) -> float:
        """Heat of a coil whose resistance is kept."""
        return current_A**2 * self.resistance_ohm
