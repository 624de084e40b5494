"""Poses in the plane, (..., 3) [m, m, rad]: one after the other, and the way back."""

from __future__ import annotations

import numpy as np

from twosra_mpc.robot.coordinates import Array


def composed(poses: Array, by: Array) -> Array:
    """Poses (..., 3) moved on by poses given in their frames (..., 3)."""
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x = poses[..., 0] + c * by[..., 0] - s * by[..., 1]
    y = poses[..., 1] + s * by[..., 0] + c * by[..., 1]
    return np.stack(np.broadcast_arrays(x, y, poses[..., 2] + by[..., 2]), axis=-1)


def inverse(poses: Array) -> Array:
    """The way back of poses (..., 3): composed with it, they are the origin."""
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y = poses[..., 0], poses[..., 1]
    return np.stack([-c * x - s * y, s * x - c * y, -poses[..., 2]], axis=-1)


def wrapped(angle_rad: Array) -> Array:
    """Angles within half a turn of zero [rad]."""
    found: Array = np.mod(angle_rad + np.pi, 2 * np.pi) - np.pi
    return found
