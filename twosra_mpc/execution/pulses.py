"""Wheel commands below the dead zone, sent as pulses above it that are as long on average."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ABOVE = 1.5  # times the dead zone: so that the slower wheels of a motion turn as well


class Pulses:
    """Passes fast commands on, and adds slow ones up until they are worth a pulse."""

    def __init__(self, dead_zone_rad_s: float) -> None:
        """Start with nothing left over from before."""
        self._least, self._owed = _ABOVE * dead_zone_rad_s, 0.0

    def shape(self, wheel_rad_s: Array) -> Array:
        """Return what to send for a command of the wheels (4,) in this period."""
        fastest = float(np.abs(wheel_rad_s).max())
        if fastest >= self._least or fastest == 0.0:
            self._owed = 0.0
            return wheel_rad_s
        self._owed += fastest / self._least
        if self._owed < 1.0:
            return np.zeros(4)
        self._owed -= 1.0
        return wheel_rad_s * (self._least / fastest)
