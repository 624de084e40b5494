"""Segments that close until something touches: the first touch, by steps and halving."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.space.contour import Contour, apart_m, parts
from twosra_mpc.space.footprint import reach_per_curvature_m2

Rows = NDArray[np.intp]
Place = Callable[[Array, Rows], Array]  # curvatures (k,), rows (k,) -> configurations (k, 3 + n)

TOUCHES_M = 5e-6  # what chords miss: as near counts as touching, as deep as not overlapping
_STEP_PER_M, _OPENING_PER_M = 0.5, 2.0
_HALVINGS = 16


class Closed(NamedTuple):
    """How far configurations close.

    Attributes:
        curvature: Towards the thing, (m,) [1/m].
        touches: Whether something touches there, (m,).
        fits: Whether nothing overlaps there, (m,).
    """

    curvature: Array
    touches: NDArray[np.bool_]
    fits: NDArray[np.bool_]


def close(
    robot: Robot,
    contour: Contour,
    place: Place,
    start: Array,
    segments: tuple[int, ...],
    gap_m: float,
) -> Closed:
    """Close until the parts that segments move are nearer to a contour than a gap.

    Where they overlap at once they open first, until nothing does.

    Args:
        robot: The robot.
        contour: What they close on.
        place: Configurations of common curvatures.
        start: Curvatures to start from, (m,) [1/m].
        segments: Segments that move, from 0.
        gap_m: What is left between them and the contour.
    """
    most, geometry = robot.limits.curvature_per_m, robot.geometry
    reach = float(reach_per_curvature_m2(geometry)[list(segments)].sum())

    def room(curvature: Array, rows: Rows) -> Array:
        q = place(curvature, rows)
        return room_m(robot, contour, q, segments, gap_m)

    everything = np.arange(len(start))
    low, high = np.array(start), np.full(len(start), np.nan)
    left = room(low, everything)
    opening = everything[left < 0]
    while len(opening):
        high[opening] = low[opening]
        low[opening] -= _OPENING_PER_M
        opening = opening[low[opening] >= -most]
        opening = opening[room(low[opening], opening) < 0]
    fits = low >= -most
    closing = everything[left >= 0]
    left = left[closing]
    while len(closing):
        ahead = np.minimum(low[closing] + np.maximum(left / reach, _STEP_PER_M), most)
        left = room(ahead, closing)
        met = left < 0
        high[closing[met]], low[closing[~met]] = ahead[met], ahead[~met]
        further = ~met & (ahead < most)
        closing, left = closing[further], left[further]
    touches = np.isfinite(high)
    between = everything[touches & fits]
    for _ in range(_HALVINGS):
        middle = (low[between] + high[between]) / 2
        met = room(middle, between) < 0
        high[between[met]], low[between[~met]] = middle[met], middle[~met]
    return Closed(low, touches, fits)


def room_m(
    robot: Robot, contour: Contour, q: Array, segments: tuple[int | None, ...], gap_m: float
) -> Array:
    """How much farther than a gap the parts of configurations (m, 3 + n) are, (m,) [m]."""
    if not len(q):
        return np.zeros(0)
    geometry = robot.geometry
    each = [np.min(apart_m(geometry, contour, parts(geometry, q, j)), axis=0) for j in segments]
    found: Array = np.min(each, axis=0) - gap_m + TOUCHES_M
    return found
