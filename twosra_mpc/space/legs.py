"""Legs of rigid drives: screw motions between poses in the plane, and how long they take."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.problem.limits import rigid_ramp_s, rigid_rows
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot


def composed(poses: Array, by: Array) -> Array:
    """Poses (..., 3) moved on by poses given in their frames (..., 3) [m, m, rad]."""
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x = poses[..., 0] + c * by[..., 0] - s * by[..., 1]
    y = poses[..., 1] + s * by[..., 0] + c * by[..., 1]
    return np.stack(np.broadcast_arrays(x, y, poses[..., 2] + by[..., 2]), axis=-1)


def inverse(poses: Array) -> Array:
    """The way back of poses (..., 3): composed with it, they are the origin."""
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y = poses[..., 0], poses[..., 1]
    return np.stack([-c * x - s * y, s * x - c * y, -poses[..., 2]], axis=-1)


def turned_to(poses: Array, near: Array) -> Array:
    """Poses (..., 3) with headings within half a turn of those of ``near``."""
    turn = poses[..., 2] - near[..., 2]
    heading = near[..., 2] + turn - np.round(turn / (2 * np.pi)) * 2 * np.pi
    return np.stack(np.broadcast_arrays(poses[..., 0], poses[..., 1], heading), axis=-1)


def twists(start: Array, end: Array) -> Array:
    """Displacements (u, v, r) of the screw motions between poses (..., 3) [m, m, rad].

    The turn is the difference of the headings as they are, also beyond half a turn.
    """
    by = composed(inverse(start), end)
    half = by[..., 2] / 2
    small = np.abs(half) < 1e-6
    along = np.where(small, 1.0 - half**2 / 3, half / np.tan(np.where(small, 1.0, half)))
    u = along * by[..., 0] + half * by[..., 1]
    v = -half * by[..., 0] + along * by[..., 1]
    return np.stack([u, v, by[..., 2]], axis=-1)


class LegTimes:
    """How long a robot takes for legs in one shape.

    Args:
        robot: The robot.
        kappa: The shape it drives in, (n,) [1/m].
    """

    def __init__(self, robot: Robot, kappa: ArrayLike) -> None:
        self._rows, self._ramp_s = rigid_rows(robot, kappa), rigid_ramp_s(robot, kappa)

    def at_speed(self, twists: Array) -> Array:
        """Times of displacements (..., 3) at full speed, (...) [s]."""
        times: Array = np.abs(twists @ self._rows.T).max(axis=-1)
        return times

    def from_rest_to_rest(self, twists: Array) -> Array:
        """Times of displacements (..., 3) from rest to rest, (...) [s]."""
        fast, ramp = self.at_speed(twists), self._ramp_s
        times: Array = np.where(fast >= ramp, fast + ramp, 2 * np.sqrt(fast * ramp))
        return times
