"""Where objects are believed to be: means of what the camera has seen lately."""

from __future__ import annotations

import numpy as np

from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.poses import composed, inverse, wrapped

_LEAST_GAIN = 0.1  # at 15 Hz what has moved is noticed within a second; 0.23 of a frame's noise


class ObjectsSeen:
    """Poses of objects in the plane, and as seen from b0 by frames that show both.

    Those from b0 do not lag while the robot carries an object, however late the frames are.

    Attributes:
        seen: Whether any frame has shown them.
        poses: In the plane, (objects, 3) [m, m, rad].
        in_b0: As seen from b0, (objects, 3).
    """

    def __init__(self, problem: Problem) -> None:
        """Believe that they are where the problem says."""
        self.poses = np.array([item.pose.pose for item in problem.objects])
        self.in_b0 = composed(inverse(problem.start.configuration[:POSE]), self.poses)
        self.seen, self._count = False, 0

    def forget(self) -> None:
        """Believe the next frames alone."""
        self._count = 0

    def take(self, frames: Array, objects: Array | None) -> None:
        """Take in frames: of the robot, (k, 3 + n), and of the objects, (k, objects, 3)."""
        if objects is None:
            return
        for frame, poses in zip(frames, objects, strict=True):
            self._count, self.seen = self._count + 1, True
            gain = max(1.0 / self._count, _LEAST_GAIN)
            self.poses = _towards(self.poses, poses, gain)
            self.in_b0 = _towards(self.in_b0, composed(inverse(frame[:POSE]), poses), gain)


def _towards(poses: Array, seen: Array, gain: float) -> Array:
    away = seen - poses
    away[..., 2] = wrapped(away[..., 2])
    return poses + gain * np.where(np.isfinite(away).all(axis=-1, keepdims=True), away, 0.0)
