"""What is held, made to fit: proved to be caged as it is seen, and planned where it has room."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, Array

if TYPE_CHECKING:  # loaded where something is grasped
    from twosra_mpc.contact.grip import Cage
    from twosra_mpc.space.penetration import Thing

_OVERLAP_M = 5e-5  # of an object and the robot that is none
_SAGITTA_M = 5e-5
_LEAST_BENT = 0.9  # of the curvatures seen, for a robot that seems to overlap what it holds
_TRIES = 20  # to move an object out of the robot


def cage_of(problem: Problem, q: Array, number: int, in_b0: Array) -> Cage | None:
    """Whether an object is caged where it is seen; None if it seems to overlap the robot."""
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
    from twosra_mpc.space.separation import placed

    pieces = footprint(problem.robot.geometry, q[POSE:], _SAGITTA_M).outer
    around = placed(pieces, q[None, :POSE])[0]
    for _ in range(_TRIES):
        contact = thing.deepest(pose, around)
        if contact is None or contact.depth_m <= _OVERLAP_M:
            return True
        pose[:2] += contact.depth_m * contact.way
    return False
