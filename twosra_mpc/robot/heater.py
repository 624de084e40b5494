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

    def power_W(self, current_A: float) -> float:
        """Heat of a coil whose resistance is kept."""
        return current_A**2 * self.resistance_ohm
