"""Limits of motion and of shape, as numbers of the robot file."""

from __future__ import annotations

from twosra_mpc.validation import NonNegative, Positive, Value


class MotionLimits(Value):
    """Limits of motion and of shape; what is None does not limit.

    ``unit_gap_m`` is the least distance between the two square locomotion units.
    ``wheel_independence`` is the least singular value of the rigid wheel matrix with which the
    robot may drive, wheel radius divided out and turning measured at 0.1 m; at zero some motion
    needs no wheel to turn, and nothing would stop it.

    ``speed_m_s`` and ``turn_rate_rad_s`` are of the middle link in rigid phases,
    ``bend_rate_rad_s`` of every segment (kappa' l). With ``wheel_acceleration_rad_s2`` every phase
    begins and ends at rest. In gentle motion a wheel that turns reaches at least
    ``wheel_speed_min_rad_s`` in a phase, and a phase that moves lasts at least three times
    ``control_period_s``.
    """

    wheel_speed_rad_s: Positive
    unit_speed_m_s: Positive
    curvature_per_m: Positive
    unit_gap_m: NonNegative = 0.0
    wheel_independence: NonNegative = 0.05
    wheel_acceleration_rad_s2: Positive | None = None
    bend_rate_rad_s: Positive | None = None
    speed_m_s: Positive | None = None
    turn_rate_rad_s: Positive | None = None
    wheel_speed_min_rad_s: NonNegative = 0.0
    control_period_s: Positive | None = None
