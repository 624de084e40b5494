"""Command of a controller: wheels and heaters, and how long they may stand."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twosra_mpc.robot.coordinates import WHEELS, Array
from twosra_mpc.robot.modes import Mode
from twosra_mpc.validation import ArrayValue


def still() -> Array:
    """Wheel speeds of a robot that stands, (4,) [rad/s]."""
    return np.zeros(WHEELS)


@dataclass(frozen=True, eq=False)
class Command(ArrayValue):
    """Command: what a robot is to be told, until its controller has the next reading.

    Attributes:
        heater_setpoint_C: Temperature set-points of the segments, (n,).
        at_most_s: Time after which the next reading is due; at rest it may come earlier.
        wheel_rad_s: Wheel speeds, (4,).
        mode: Mode in which the wheels are driven; None while they stand.
        planned: Where the plan is now, (3 + n,); empty without one.
    """

    heater_setpoint_C: Array
    at_most_s: float
    wheel_rad_s: Array = field(default_factory=still)
    mode: Mode | None = None
    planned: Array = field(default_factory=lambda: np.empty(0))
