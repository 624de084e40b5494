r"""Motors of the wheels: each goes to its command with a lag of first order.

.. math:: \tau\,\dot\omega = \omega_c - \omega

So what is left to turn once it is told to stand is :math:`\tau\,\omega`.
"""

from __future__ import annotations

import math

import numpy as np

from twosra_mpc.robot.coordinates import WHEELS, Array

_AT_REST_RAD_S = 1e-3  # a motor that runs down to this stands


class Motors:
    """The motors of the four wheels.

    Attributes:
        lag_s: Their time constant; 0: they turn as they are told.
        rad_s: How fast they turn now, (4,).
    """

    def __init__(self, lag_s: float) -> None:
        """They stand."""
        self.lag_s, self.rad_s = lag_s, np.zeros(WHEELS)

    def turned(self, told_rad_s: Array, period_s: float) -> Array:
        """Turns in a period in which they are told to turn at these speeds (4,), (4,) [rad]."""
        behind = self.rad_s - told_rad_s
        left = behind * math.exp(-period_s / self.lag_s) if self.lag_s > 0 else np.zeros(WHEELS)
        now = told_rad_s + left
        self.rad_s = np.where(np.abs(now) < _AT_REST_RAD_S, 0.0, now)
        return told_rad_s * period_s + self.lag_s * (behind - left)
