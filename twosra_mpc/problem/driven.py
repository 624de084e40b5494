"""Shares of the limits used at a plan's samples and midway: every model is evaluated once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.rows import by_modes
from twosra_mpc.problem import limits
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot

_SAME_INPUT = 1e-12  # m/s or rad/s: rounding of what an input grows to until the next sample


class Driven(NamedTuple):
    """Samples of a plan from which on the robot moves, m of them.

    Leading axes of the others: as each begins, midway to the next one, and there.

    Attributes:
        rows: Which they are, (m,).
        shares: Of each speed limit, signed, (3, m, k) each.
        wheel_rad_s: Wheel speeds, (3, m, 4).
        wheel_rad_s2: Wheel accelerations, (3, m, 4).
    """

    rows: NDArray[np.intp]
    shares: list[Array]
    wheel_rad_s: Array
    wheel_rad_s2: Array


def driven(
    robot: Robot, q: Array, v: Array, a: Array, dt_s: Array, mode: NDArray[np.int64]
) -> Driven:
    """Speeds and accelerations of a plan by its samples, (m, ...).

    Args:
        robot: The robot.
        q: Configurations, (m, 3 + n).
        v: Inputs at each, (m, 5).
        a: Their rate of change until the next one, (m, 5) [per s].
        dt_s: Time until the next one, 0 at the last, (m,).
        mode: Stiffness until then, (m, n).
    """
    rows = np.flatnonzero(v.any(axis=1) | a.any(axis=1))
    modes, begin, rate, dt = mode[rows], v[rows], a[rows], dt_s[rows, None]
    after = begin + rate * dt
    goes_on = np.zeros(len(rows), dtype=bool)  # the next row begins as this one ends
    goes_on[:-1] = (np.diff(rows) == 1) & (modes[1:] == modes[:-1]).all(axis=1)
    goes_on[:-1] &= (np.abs(begin[1:] - after[:-1]) <= _SAME_INPUT).all(axis=1)
    stops, next_to = np.flatnonzero(~goes_on), np.arange(1, len(rows) + 1)
    next_to[stops] = len(rows) + np.arange(len(stops))
    ends = rows[stops] + 1
    *shares, turning, ended, moved = by_modes(
        limits.motion_function(robot),
        np.concatenate([q[rows], q[np.minimum(ends, len(q) - 1)]]),
        np.concatenate([begin, after[stops]]),
        np.concatenate([rate, rate[stops]]),
        np.concatenate([rate[:1], rate[:-1], rate[stops]]),
        np.concatenate([modes, modes[stops]]),
    )
    first, last = q[rows], q[np.minimum(rows + 1, len(q) - 1)]
    bent = dt / 8 * (moved[: len(rows)] - moved[next_to])  # Hermite's cubic in between
    at = (first + last) / 2 + bent, (begin + after) / 2, rate, rate, modes
    *midway, middle, _, _ = by_modes(limits.motion_function(robot), *at)
    shown = [np.stack([x[: len(rows)], y, x[next_to]]) for x, y in zip(shares, midway, strict=True)]
    turned = shown[limits.speed_limits(robot).index(limits.WHEEL_SPEED)]
    wheels = turned * limits.WHEEL_SPEED.most(robot)
    return Driven(rows, shown, wheels, np.stack([turning[: len(rows)], middle, ended[next_to]]))


def margins(
    robot: Robot, q: Array, v: Array, a: Array, found: Driven
) -> Iterator[tuple[str, float]]:
    """Yield (name, least margin) of every limit that a robot has; inf where nothing is limited."""
    for limit, shares in zip(limits.speed_limits(robot), found.shares, strict=True):
        most = limit.most(robot)
        yield limit.name, limits.settled(most * (1 - float(np.abs(shares).max(initial=0.0))), most)
    if (most_rad_s2 := robot.limits.wheel_acceleration_rad_s2) is not None:
        fastest = float(np.abs(found.wheel_rad_s2).max(initial=0.0))
        yield limits.WHEEL_ACCELERATION.name, limits.settled(most_rad_s2 - fastest, most_rad_s2)
    kappa = q[:, POSE:]
    changes = (kappa[1:] != kappa[:-1]).any(axis=1)
    shapes = np.concatenate([kappa[:1], kappa[1:][changes]])
    margin = limits.shape_margins(robot, np.concatenate([shapes, (shapes[1:] + shapes[:-1]) / 2]))
    driving = v[:, 2:].any(axis=1) | a[:, 2:].any(axis=1)
    driven_in = np.append(0, np.cumsum(changes))[driving]
    for shape in limits.SHAPE_LIMITS:
        found_here = margin[shape.name]
        counted = found_here[driven_in] if shape.driving else found_here
        yield shape.name, float(counted.min(initial=np.inf))
