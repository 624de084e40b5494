"""Poses of b0 where the stages of a mission may end, at what is touched."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twosra_mpc.contact.touch import Touch
from twosra_mpc.problem.world import Object, Obstacle
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse

HEADINGS = 24  # of the robot around a disc


class Ends(NamedTuple):
    """Poses of b0 to end in, (m, 3), and how far from one of them any other that may be used is."""

    poses: Array
    within_m: float


def spread(range_rad: tuple[float, float], count: int) -> tuple[Array, float]:
    """Headings of a range, evenly, and how far any other of it is from the nearest, at most."""
    low, high = range_rad
    around = high - low >= math.tau
    headings = np.linspace(low, low + math.tau if around else high, count, endpoint=not around)
    return headings, min(high - low, math.tau) / (count - 1)


def placed(
    touch: Touch, pose: Array, thing: Object | Obstacle, directions_rad: tuple[float, float]
) -> Ends:
    """Poses of b0 at a thing in the world with a heading that may be used."""
    ends = composed(pose[None], touch.configuration[:POSE])
    low, high = directions_rad
    if thing.disc is None:
        return Ends(ends[np.mod(ends[:, 2] - low, math.tau) <= high - low], 0.0)
    headings, step_rad = spread(directions_rad, HEADINGS)
    own = [thing.disc.x_m, thing.disc.y_m, 0.0] if isinstance(thing, Obstacle) else [0.0] * POSE
    middle = composed(pose[None], np.array(own))
    from_b0 = composed(inverse(ends), middle)
    from_b0[:, 2] = 0.0
    turned = np.repeat(middle, len(headings), axis=0)
    turned[:, 2] = headings
    poses = composed(turned, inverse(from_b0))
    return Ends(poses, step_rad * float(np.hypot(*from_b0[0, :2])))
