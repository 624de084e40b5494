"""Poses of objects as they are believed: means of what the camera has seen, made to fit the robot.

What is held is proved to be caged as it is seen, and planned where it has room.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse, wrapped

if TYPE_CHECKING:
    from twosra_mpc.space.penetration import Thing
    from twosra_mpc.space.possible import Enclosure

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


_OVERLAP_M = 5e-5  # of an object and the robot that is none
_SAGITTA_M = 5e-5
_LEAST_BENT = 0.9  # of the curvatures seen, for a robot that seems to overlap what it holds
_TRIES = 20  # to move an object out of the robot


def cage_of(problem: Problem, q: Array, number: int, in_b0: Array) -> Enclosure | None:
    """True if an object is caged where it is seen; None if it seems to overlap the robot."""
    from twosra_mpc.contact.grip import caged

    try:
        return caged(problem.robot.geometry, q[POSE:], problem.objects[number], in_b0)
    except InputError:
        return None


def fitted(problem: Problem, q: Array, poses: Array, held: list[int]) -> Array:
    """Where the robot may be, given that it overlaps no object; its curvatures alone are changed.

    Objects that seem to overlap it are moved out of it, the shortest way: poses (objects, 3) are
    changed. Where one that is held has no room, the robot cannot be bent as far as it seems.
    """
    from twosra_mpc.space.penetration import Thing

    things = [Thing(item) for item in problem.objects]
    for share in np.linspace(1.0, _LEAST_BENT, _TRIES):
        made = np.concatenate([q[:POSE], share * q[POSE:]])
        if all(_moved_out(problem, made, poses[i], things[i]) for i in held):
            break
    for i in set(range(len(things))) - set(held):
        _moved_out(problem, made, poses[i], things[i])
    return made


def _moved_out(problem: Problem, q: Array, pose: Array, thing: Thing) -> bool:
    """Move an object out of the robot, and return whether that could be done; pose is changed."""
    from twosra_mpc.space.footprint import footprint
    from twosra_mpc.space.penetration import Pieces
    from twosra_mpc.space.separation import placed

    pieces = footprint(problem.robot.geometry, q[POSE:], _SAGITTA_M).outer
    around = Pieces(placed(pieces, q[None, :POSE])[0])
    for _ in range(_TRIES):
        contact = thing.deepest(pose, around)
        if contact is None or contact.depth_m <= _OVERLAP_M:
            return True
        pose[:2] += contact.depth_m * contact.way
    return False
