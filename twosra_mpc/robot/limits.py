"""Limits of motion and of shape, as numbers of the robot file."""

from __future__ import annotations

from twosra_mpc.validation import NonNegative, Positive, Value


class MotionLimits(Value):
    """Limits of motion and of shape.

    ``unit_gap_m`` is the least distance between the two square locomotion units.
    ``wheel_independence`` is the least singular value of the rigid wheel matrix with which the
    robot may drive, wheel radius divided out and turning measured at 0.1 m; at zero some motion
    needs no wheel to turn, and nothing would stop it.
    """

    wheel_speed_rad_s: Positive
    unit_speed_m_s: Positive
    curvature_per_m: Positive
    unit_gap_m: NonNegative = 0.0
    wheel_independence: NonNegative = 0.05
