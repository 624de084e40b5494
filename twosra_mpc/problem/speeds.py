"""Motions within the limits: how fast they may be travelled, and what plans use of the limits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import Motion
from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.rows import by_modes, by_rows
from twosra_mpc.problem import limits
from twosra_mpc.problem.limits import (
    SPEED_LIMITS,
    WHEEL_ACCELERATION,
    WHEEL_SPEED,
    SpeedLimit,
    broken_by_shapes,
    levers_kept,
    may_drive_in,
    settled,
    shape_margins,
)
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import is_rigid

_SAME_INPUT = 1e-12  # m/s or rad/s: rounding of what an input grows to until the next sample


@per_body()
def speed_limits(body: Body) -> tuple[SpeedLimit, ...]:
    """The speed limits that a robot has."""
    return tuple(limit for limit in SPEED_LIMITS if getattr(body.limits, limit.name) is not None)


@per_body()
def speed_function(body: Body) -> ca.Function:
    """(q, s, sigma) -> for each speed limit the least time [s] that it leaves to a displacement.

    Each is a vector of signed times, of which the largest absolute value counts.
    """
    segments = body.geometry.segments
    q, s = ca.SX.sym("q", POSE + segments), ca.SX.sym("s", INPUTS)
    sigma = ca.SX.sym("sigma", segments)
    jacobian, wheels = kinematics(body).shared(q, sigma)
    times = _shares(body, s, jacobian @ s, wheels @ s)
    return ca.Function("least_times", [q, s, sigma], times)


@per_body()
def motion_function(body: Body) -> ca.Function:
    """(q, v, a, b, sigma) -> shares of each speed limit, signed, d/dt V v [rad/s2] twice, and q'.

    Of v' = a, and of v' = b.
    """
    segments = body.geometry.segments
    q, v, sigma = ca.SX.sym("q", POSE + segments), ca.SX.sym("v", INPUTS), ca.SX.sym("s", segments)
    rates = [ca.SX.sym(name, INPUTS) for name in ("a", "b")]
    jacobian, wheels = kinematics(body).shared(q, sigma)  # once: what all share is written once
    moved, turned = jacobian @ v, wheels @ v
    bending = ca.jtimes(turned, q, moved)
    turning = [ca.densify(wheels @ rate + bending) for rate in rates]
    told = [*_shares(body, v, moved, turned), *turning, ca.densify(moved)]
    return ca.Function("motion", [q, v, *rates, sigma], told)


def _shares(body: Body, s: ca.SX, moved: ca.SX, turned: ca.SX) -> list[ca.SX]:
    """Shares of the speed limits that an input displacement takes, signed; ``moved`` is J s."""
    limits = speed_limits(body)
    return [ca.densify(each.travel(body, s, moved, turned) / each.most(body)) for each in limits]


def least_times_and_turns(
    robot: Robot, q: Array, s: Array, mode: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Least times of input displacements within the speed limits, row by row at q, (m,) [s].

    And how far each wheel turns, (m, 4) [rad].
    """
    signed = by_modes(speed_function(robot), q, s, mode)
    turns = signed[speed_limits(robot).index(WHEEL_SPEED)] * WHEEL_SPEED.most(robot)
    return np.abs(np.hstack(signed)).max(axis=1), turns


def interval_durations(motion: Motion) -> Array:
    """Least time of each interval within the speed limits, (phases, intervals) [s].

    Speeds are taken at the start, in the middle and at the end of an interval.
    """
    phases, intervals, _ = motion.inputs.shape
    size = motion.states.shape[2]
    before = motion.states[:, :-1].reshape(-1, size)
    after = motion.states[:, 1:].reshape(-1, size)
    s = motion.inputs.reshape(-1, INPUTS)
    modes = np.repeat(np.array(motion.sequence), intervals, axis=0)
    places = (before, (before + after) / 2, after)
    given = np.concatenate(places), np.tile(s, (3, 1)), np.tile(modes, (3, 1))
    times, _ = least_times_and_turns(motion.robot, *given)
    return times.reshape(3, phases, intervals).max(axis=0)


def shapes_allowed(motion: Motion, still: float) -> bool:
    """True if a motion takes no forbidden shape, and drives in none that is forbidden to drive in.

    Rigid phases that move less than ``still`` [m or rad] in every interval do not drive.
    """
    kappa = motion.states[:, :, POSE:]
    between = (kappa[:, 1:] + kappa[:, :-1]) / 2
    bends = ~np.array([is_rigid(mode) for mode in motion.sequence])
    visited = [shapes.reshape(-1, kappa.shape[2]) for shapes in (kappa[bends], between[bends])]
    moved = np.abs(motion.inputs).max(axis=(1, 2)) > still
    drives = [is_rigid(mode) and far for mode, far in zip(motion.sequence, moved, strict=True)]
    if broken_by_shapes(motion.robot, np.concatenate([kappa[:, 0], *visited])) is not None:
        return False
    if not levers_kept(motion.robot, motion.sequence, kappa):
        return False
    return bool(may_drive_in(motion.robot, kappa[drives, 0]).all()) if any(drives) else True


def rigid_rows(robot: Robot, kappa: ArrayLike) -> Array:
    """Rows M (m, 3): abs(M xi) <= 1 for every body twist xi = (u, v, r) within the speed limits.

    What a limit overstates is taken off, so that bounds hold for the limit itself.

    Args:
        robot: The robot.
        kappa: The shape it drives in, (n,) [1/m].
    """
    return rigid_rows_between(robot, kappa, kappa)[0]


def drive_rows(robot: Robot, kappa: ArrayLike) -> tuple[Array, Array]:
    """Rows M (m, 3) and V (4, 3) of what a rigid drive takes in a plan, for a body twist xi.

    At full speed it takes max(abs(M xi)) [s], and the wheels turn by V xi [rad].

    Args:
        robot: The robot.
        kappa: The shape it drives in, (n,) [1/m].
    """
    q = np.tile(np.concatenate([np.zeros(POSE), np.asarray(kappa, dtype=float)]), (3, 1))
    signed = by_rows(speed_function(robot), q, np.eye(INPUTS)[2:], np.zeros_like(q[:, POSE:]))
    wheels = signed[speed_limits(robot).index(WHEEL_SPEED)] * WHEEL_SPEED.most(robot)
    return np.hstack(signed).T, wheels.T


def rigid_rows_between(robot: Robot, least: ArrayLike, most: ArrayLike) -> tuple[Array, Array]:
    """Rows as of ``rigid_rows`` in the middle of a box of shapes, and how far off they are in it.

    Args:
        robot: The robot.
        least: Least curvatures of the box, (n,) [1/m].
        most: Largest.
    """
    corners = np.array([least, most], dtype=float)
    rows = _rigid_rows(robot)(np.pad(corners.mean(axis=0), (POSE, 0))).full()
    off = np.zeros_like(rows)
    if (corners[0] < corners[1]).any():
        ends = enclose(_rigid_rows(robot), *np.pad(corners, ((0, 0), (POSE, 0)))[:, :, None])
        off = np.max([np.abs(e.reshape(rows.shape, order="F") - rows) for e in ends], axis=0)
    kept = np.abs(rows).max(axis=1) > 0
    return rows[kept], off[kept]


@per_body()
def _rigid_rows(body: Body) -> ca.Function:
    q, twist = ca.SX.sym("q", POSE + body.geometry.segments), ca.SX.sym("twist", 3)
    rigid = ca.DM.zeros(body.geometry.segments)
    stated = speed_function(body)(q, ca.vertcat(0, 0, twist), rigid)
    limits = speed_limits(body)
    times = ca.vertcat(*(t / b.overstated for t, b in zip(stated, limits, strict=True)))
    return ca.Function("rigid_rows", [q], [ca.densify(ca.jacobian(times, twist))])


def shares_used(robot: Robot, q: Array, v: Array, mode: NDArray[np.int64]) -> list[Array]:
    """Share of each speed limit that inputs (m, 5) use at configurations (m, 3 + n), each (k, m).

    A limit may be one of several things: its share is then the largest of them.
    """
    return [np.abs(share.T) for share in by_rows(speed_function(robot), q, v, mode)]


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
        motion_function(robot),
        np.concatenate([q[rows], q[np.minimum(ends, len(q) - 1)]]),
        np.concatenate([begin, after[stops]]),
        np.concatenate([rate, rate[stops]]),
        np.concatenate([rate[:1], rate[:-1], rate[stops]]),
        np.concatenate([modes, modes[stops]]),
    )
    first, last = q[rows], q[np.minimum(rows + 1, len(q) - 1)]
    bent = dt / 8 * (moved[: len(rows)] - moved[next_to])  # Hermite's cubic in between
    at = (first + last) / 2 + bent, (begin + after) / 2, rate, rate, modes
    *midway, middle, _, _ = by_modes(motion_function(robot), *at)
    shown = [np.stack([x[: len(rows)], y, x[next_to]]) for x, y in zip(shares, midway, strict=True)]
    turned = shown[speed_limits(robot).index(WHEEL_SPEED)]
    wheels = turned * WHEEL_SPEED.most(robot)
    return Driven(rows, shown, wheels, np.stack([turning[: len(rows)], middle, ended[next_to]]))


def margins(
    robot: Robot, q: Array, v: Array, a: Array, found: Driven
) -> Iterator[tuple[str, float]]:
    """Yield (name, least margin) of every limit that a robot has; inf where nothing is limited."""
    for limit, shares in zip(speed_limits(robot), found.shares, strict=True):
        most = limit.most(robot)
        yield limit.name, settled(most * (1 - float(np.abs(shares).max(initial=0.0))), most)
    if (most_rad_s2 := robot.limits.wheel_acceleration_rad_s2) is not None:
        fastest = float(np.abs(found.wheel_rad_s2).max(initial=0.0))
        yield WHEEL_ACCELERATION.name, settled(most_rad_s2 - fastest, most_rad_s2)
    kappa = q[:, POSE:]
    changes = (kappa[1:] != kappa[:-1]).any(axis=1)
    shapes = np.concatenate([kappa[:1], kappa[1:][changes]])
    margin = shape_margins(robot, np.concatenate([shapes, (shapes[1:] + shapes[:-1]) / 2]))
    driving = v[:, 2:].any(axis=1) | a[:, 2:].any(axis=1)
    driven_in = np.append(0, np.cumsum(changes))[driving]
    for shape in limits.SHAPE_LIMITS:
        found_here = margin[shape.name]
        counted = found_here[driven_in] if shape.driving else found_here
        yield shape.name, float(counted.min(initial=np.inf))
