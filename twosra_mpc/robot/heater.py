"""Temperatures, currents and coil of a segment's heater."""

from __future__ import annotations

import itertools
from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.validation import Celsius, Positive, Value, plain


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
        names = (
            *("temperature_min_C", "ambient_C", "melting_point_C"),
            *("soft_setpoint_C", "temperature_max_C"),
        )
        for least, name in itertools.pairwise(names):
            low, value = getattr(self, least), getattr(self, name)
            if not low < value:
                raise InputError(name, value, f"more than {least} ({low:zg} C)")
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
