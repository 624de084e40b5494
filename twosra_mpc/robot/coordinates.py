"""Coordinates of a configuration, and poses in the plane, one after the other.

This is the one place that knows how many segments there are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

POSE = 3  # coordinates of b0 in the plane: x [m], y [m], phi [rad]
INPUTS = 5  # v1, v2 [m/s] of the two locomotion units, u0, v0 [m/s], r0 [rad/s] of the rigid body
WHEELS = 4  # two on each of the two locomotion units


@dataclass(frozen=True)
class Coordinates:
    """The configuration q = [x, y, phi, kappa1 ... kappan] of a robot of ``segments`` segments.

    Attributes:
        segments: Number of segments n, 1 to 4, counted from locomotion unit 1 to unit 2.
    """

    segments: int

    @property
    def size(self) -> int:
        """Length of q."""
        return POSE + self.segments

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates, as they are written in files."""
        return ("x_m", "y_m", "phi_rad", *(f"kappa_per_m.{j}" for j in range(self.segments)))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates."""
        return ("m", "m", "rad", *["1/m"] * self.segments)

    def each(self, position: float, heading: float, curvature: float) -> Array:
        """One value per coordinate: of x and y, of phi, of every curvature, (size,)."""
        return np.array([position, position, heading, *[curvature] * self.segments])


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


def rotation(angle_rad: ArrayLike) -> Array:
    """Matrices that turn row vectors by angles (...,), (..., 2, 2)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)


def wrapped(angle_rad: Array) -> Array:
    """Angles within half a turn of zero [rad]."""
    return np.mod(angle_rad + np.pi, 2 * np.pi) - np.pi
