"""Boxes of shapes: one that is allowed, or the proof that none is.

No shape of a box is allowed where its middle misses a limit by more than the margin can change
within the box. Other boxes are halved, until the middle of one is allowed or none is left. As
margins count as zero within rounding, that always ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.problem import limits
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Body, Robot

_MOST = 4096  # boxes of a size; where more are left, nothing is proved


class Looked(NamedTuple):
    """What is known of a box of shapes.

    Attributes:
        shape: Of those that were looked at the one that misses limits least, (n,) [1/m].
        allowed: Whether it misses none.
        forbidden: Whether every shape of the box is proved to miss one.
    """

    shape: Array
    allowed: bool
    forbidden: bool


def look_for_shape(robot: Robot | Body, low: ArrayLike, high: ArrayLike) -> Looked:
    """Look for a shape in a box that no limit forbids, whether the robot drives in it or not.

    Args:
        robot: The robot.
        low: Least curvatures, (n,) [1/m]; -inf where they are free.
        high: Largest.
    """
    body, best, least = robot.body, np.zeros(0), -np.inf
    most, sides = body.limits.curvature_per_m, np.array([[-1.0], [1.0]])
    lower, upper = np.clip([low, high], -most, most)
    middles, half = (lower + upper)[None] / 2, (upper - lower) / 2
    while 0 < len(middles) <= _MOST:
        left_per_m, possible = _left(body, middles, half)
        at = int(left_per_m.argmax())
        if left_per_m[at] > least:
            best, least = middles[at], left_per_m[at]
        if least >= 0:
            break
        widest = np.eye(len(half))[(half * body.geometry.lengths_m).argmax()]
        half = half * (1 - widest / 2)
        aside = sides[:, None] * half * widest
        middles = (middles[possible] + aside).reshape(-1, len(half))
    return Looked(best, bool(least >= 0), not len(middles))


def _left(body: Body, middles: Array, half: Array) -> tuple[Array, NDArray[np.bool_]]:
    """By how much shapes (m, n) may bend within all limits, and which of their boxes may hold one.

    Boxes reach ``half`` (n,) to each side of them.
    """
    margins = shape_margins(body, middles)
    forbids = [limit for limit in limits.SHAPE_LIMITS if not limit.driving]
    if half.any():  # of single shapes it is known how steep a limit is, or not
        forbids = [limit for limit in forbids if limit.steep is not None]
    steep = np.array(
        [limit.steep(body) if limit.steep else np.ones(len(half)) for limit in forbids]
    )
    margin = np.array([margins[limit.name] for limit in forbids])
    left: Array = (margin / steep.max(axis=1)[:, None]).min(axis=0)
    return left, np.all(margin + (steep @ half)[:, None] >= 0, axis=0)
