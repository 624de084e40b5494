r"""Drives along a given path: the twist turns as the path does, within the speed limits.

What follows the path has a pose f in the frame of b0. Its poses are a uniform cubic B-spline p(u),
with points of the path as control points: that is twice differentiable, keeps to the path to within
h^2 / 6 times its curvature, h apart, and rounds its corners. So the body twist along u,

.. math:: w(u) = (R(-\phi) b', \phi'), \qquad b = p \circ f^{-1},

is smooth, and the quickest speed profile along it is that of ``plans.speed_profile``. Between grid
points the twist is taken to be linear in time: limits hold at every instant. What the path is
missed by adds up, so control points are moved by it until it is a fiftieth of the tolerance.

A time that no follower undercuts: what comes within r of points in turn, whose chords have the
directions d_i, advances along d_i by the chord and by what it is off at its ends. So it is no
shorter than the chords less :math:`r (2 + \sum |d_{i+1} - d_i|)`; and of all twists within the
limits none moves it, or gathers speed, faster than a vertex of their polytope.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.bending import from_rest_to_rest
from twosra_mpc.model.flow import Motion, drive
from twosra_mpc.planning.bounds.rigid_motion import twist_vertices
from twosra_mpc.plans.speed_profile import squared_speeds
from twosra_mpc.problem.polyline import Polyline
from twosra_mpc.problem.speeds import drive_rows, rigid_rows
from twosra_mpc.problem.tasks import Follow
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array, composed, wrapped
from twosra_mpc.robot.description import Robot

if TYPE_CHECKING:
    from twosra_mpc.contact.grip import Pulls

_SHARE = 0.2  # of the tolerance, by which the spline departs from the path; the rest is the run's
_GENTLY = 0.7  # of the wheels' acceleration: the rest is the run's, else it comes past the end
_MISSED, _MENDED = 0.02, 4  # of the tolerance, by which a drive may miss its spline; tries
_LONGEST_M, _LEAST, _MOST = 0.1, 8, 512  # control points apart, and how many
_PIECES, _FEW = 4, 96  # of the grid between control points, and of all of it at least
_TURNED = (0.0, 1.0, 0.5)  # of the path's turns, by headings that are free
_ALIKE_RAD = 1e-3  # headings that are the same
BEGUN_RAD = np.arange(72) * math.tau / 72  # headings with which paths may be begun
_ROUNDS, _IN_TIME_S = 40, 1e-9  # in which stretches between times come to last as long as asked
_CHORDS = (1, 2, 4, 8, 16, 32, 64, 128)


class Along(NamedTuple):
    """A drive along a path: its one phase."""

    motion: Motion

    @property
    def lasts_s(self) -> float:
        """How long it takes [s]."""
        return float(self.motion.lasting_s.sum())

    @property
    def poses(self) -> Array:
        """Poses of b0 on the way, (m, 3)."""
        return self.motion.states[0, :, :POSE]

    @property
    def twists(self) -> Array:
        """Twists of b0 that it has, to within those between them, (m, 3)."""
        inputs, changes = (each[0, :, 2:] for each in (self.motion.inputs, self.motion.changes))
        return np.concatenate([inputs - changes / 2, inputs + changes / 2])

    @property
    def length_m(self) -> float:
        """How far b0 comes [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())

    def begun_at(self, q: Array) -> Motion:
        """The same from a configuration (3 + n,), to rounding that where it begins."""
        inputs, changes = (each[0, :, 2:] for each in (self.motion.inputs, self.motion.changes))
        states = np.vstack([q, drive(q, inputs, changes)])
        return replace(self.motion, states=states[None])


def drives_along(
    robot: Robot, q: Array, task: Follow, in_b0: Array, room_m: float = 0.0
) -> list[Along]:
    """Drives along what is left of a path from a configuration (3 + n,), the quickest first.

    Args:
        robot: The robot.
        q: Where it begins.
        task: What is asked; where it begins it is within the tolerance.
        in_b0: Pose of what follows in the frame of b0, (3,).
        room_m: How far it may get from there, of the tolerance.
    """
    within = np.array([task.position_tolerance_m - room_m, task.heading_tolerance_rad])
    line, begin = task.left, composed(q[:POSE], in_b0)
    headings = [line.headings]
    if np.isnan(line.headings).any():
        turned = line.tangent.headings - line.tangents[0]
        headings = [begin[2] + share * turned for share in _TURNED]
        headings = headings if np.ptp(turned) > _ALIKE_RAD else headings[:1]
    asked = within, task.due, in_b0
    made = (_along(robot, q, line._replace(headings=each), *asked) for each in headings)
    return sorted(made, key=lambda drive: drive.lasts_s)


def easy_headings(line: Polyline, pulls: Pulls) -> Array:
    """Headings of b0 at which a path is begun with the least pull, one for each way to turn, (k,).

    Args:
        line: The path; headings along it are free.
        pulls: What wheels pull for what follows it.
    """
    turned, found = line.tangents - line.tangents[0], list[float]()
    x, y = pulls.pose_in_b0[:2].tolist()
    turns = np.gradient(turned) / np.diff(line.length_m) if len(turned) > 1 else 0.0 * turned
    for share in _TURNED:
        ahead = line.tangents - share * turned - BEGUN_RAD[:, None]
        r = np.broadcast_to(share * turns, ahead.shape)
        twist = np.stack([np.cos(ahead) + r * y, np.sin(ahead) - r * x, r], axis=-1)
        found.append(float(BEGUN_RAD[pulls(twist).max(axis=1).argmin()]))
    return np.array(found)


def _along(
    robot: Robot, q: Array, line: Polyline, within: Array, due: Array, in_b0: Array
) -> Along:
    """A drive along a path, made again from where it misses the path: what it misses adds up."""
    asked, pieces = _control(line, within)
    begin = composed(q[:POSE], in_b0)
    aside = begin - asked[0]
    aside[2] = wrapped(aside[2])
    asked[:, 2] += round((begin[2] - aside[2] - asked[0, 2]) / math.tau) * math.tau
    asked += aside * np.linspace(1.0, 0.0, len(asked))[:, None]
    wanted, _ = _spline(asked, pieces)
    due = due * [(len(asked) - 1) / line.length_m[-1], 1.0]
    for _ in range(_MENDED):
        made = _paced(robot, q, asked, pieces, due, in_b0)
        missed = wanted - composed(made.poses, in_b0)
        if (np.abs(missed).max(axis=0) <= _MISSED * within[[0, 0, 1]]).all():
            break
        asked += missed[::pieces]
    return made


def _control(line: Polyline, within: Array) -> tuple[Array, int]:
    """Control points of a spline within a share of the tolerance, and its pieces between them."""
    whole_m = float(line.length_m[-1])
    count = max(_LEAST, math.ceil(whole_m / _LONGEST_M))
    while True:
        at = np.linspace(0.0, whole_m, count + 1)
        asked = np.column_stack([line.at(at), np.interp(at, line.length_m, line.headings)])
        pieces = max(_PIECES, math.ceil(_FEW / count))
        poses, _ = _spline(asked, pieces)
        between = np.linspace(0.0, whole_m, len(poses))
        off_m = np.hypot(*(poses[:, :2] - line.at(between)).T).max()
        off_rad = np.abs(poses[:, 2] - np.interp(between, line.length_m, line.headings)).max()
        if (np.array([off_m, off_rad]) <= _SHARE * within).all() or count >= _MOST:
            return asked, pieces
        count *= 2


def _paced(robot: Robot, q: Array, control: Array, pieces: int, due: Array, in_b0: Array) -> Along:
    """The quickest drive along a spline."""
    poses, slopes = _spline(control, pieces)
    charge(Cost.PROFILE, len(poses))
    heading = poses[:, 2] - in_b0[2]
    c, s, (x, y) = np.cos(heading), np.sin(heading), in_b0[:2]
    twist = slopes.copy()
    twist[:, 0] = c * slopes[:, 0] + s * slopes[:, 1] + slopes[:, 2] * y
    twist[:, 1] = c * slopes[:, 1] - s * slopes[:, 0] - slopes[:, 2] * x
    rows, wheels = drive_rows(robot, q[POSE:])
    most = _GENTLY * (robot.limits.wheel_acceleration_rad_s2 or math.inf)
    u, r = np.arange(len(poses)) / pieces, np.abs(twist @ rows.T).max(axis=1)
    turn = twist @ wheels.T
    ends_s = float(due[-1, 1]) if len(due) else 0.0
    slow, own = np.zeros(len(due) + 1), np.searchsorted(due[:, 0], u)
    asked_s = np.diff(due[:, 1], prepend=0.0)
    for _ in range(_ROUNDS):
        speed = np.sqrt(squared_speeds(u, np.maximum(r, slow[own]), turn, most))
        time_s = 2 * np.diff(u) / (speed[1:] + speed[:-1])
        paced = twist * speed[:, None]
        gained = np.abs(np.diff(paced, axis=0) @ wheels.T / time_s[:, None]).max() / most
        used = float(np.abs(paced @ rows.T).max())
        least_s = max(robot.limits.phase_s, ends_s)
        slower = max(used, math.sqrt(gained), least_s / float(time_s.sum()), 1.0)
        took_s = np.diff(np.interp(due[:, 0], u, np.append(0.0, time_s.cumsum())), prepend=0.0)
        if np.abs(took_s - asked_s).max(initial=0.0) < _IN_TIME_S:
            break
        slow[:-1] = np.where(slow[:-1] > 0, slow[:-1], took_s / np.diff(due[:, 0], prepend=0.0))
        slow[:-1] *= asked_s / took_s
    twist, time_s = paced / slower, time_s * slower
    inputs, changes = np.zeros((2, len(time_s), INPUTS))
    inputs[:, 2:] = time_s[:, None] * (twist[1:] + twist[:-1]) / 2
    changes[:, 2:] = time_s[:, None] * np.diff(twist, axis=0)
    states = np.vstack([q, drive(q, inputs[:, 2:], changes[:, 2:])])
    alone = (each[None] for each in (inputs, states, changes, time_s))
    return Along(Motion(robot, (robot.rigid,), *alone))


def _spline(control: Array, pieces: int) -> tuple[Array, Array]:
    """Uniform cubic B-spline from the first of its control points (m, 3) to the last, and slopes.

    Both at so many places for each piece, and at the end, (pieces (m - 1) + 1, 3).
    """
    held = np.vstack([2 * control[0] - control[1], control, 2 * control[-1] - control[-2]])
    t = np.arange(pieces) / pieces
    value = (1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3
    slope = -3 * (1 - t) ** 2, 9 * t**2 - 12 * t, 3 + 6 * t - 9 * t**2, 3 * t**2
    near = np.stack([held[i : len(held) - 3 + i] for i in range(4)])
    both = (np.einsum("bk,bnd->nkd", np.array(each) / 6, near) for each in (value, slope))
    points, slopes = (each.reshape(-1, POSE) for each in both)
    end = (held[-1] - held[-3]) / 2
    return np.vstack([points, control[-1]]), np.vstack([slopes, end])


def least_time_s(robot: Robot, kappa: Array, task: Follow, in_b0: Array) -> float:
    """Proved lower bound on the time of a drive along what is left of a path, in a shape (n,) [s].

    Zero where speeds are not limited.
    """
    fast, most = _fastest(rigid_rows(robot, kappa), in_b0), robot.limits.wheel_acceleration_rad_s2
    gained = math.inf if most is None else _fastest(drive_rows(robot, kappa)[1] / most, in_b0)
    least_m = max(_shortest_m(task.left, task.position_tolerance_m))
    return from_rest_to_rest(least_m / fast, fast / gained) if math.isfinite(fast) else 0.0


def _fastest(rows: Array, in_b0: Array) -> float:
    """Top speed of what follows a path, of twists t with abs(rows @ t) of at most 1 [m/s]."""
    x, y = in_b0[:2].tolist()
    vertices = twist_vertices(rows)
    point = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
    return math.inf if vertices is None else float(np.hypot(*point @ vertices.T).max())


def late(robot: Robot, task: Follow, along: Along, in_b0: Array) -> tuple[str, bool] | None:
    """Reason why a drive is not where it is due, and whether none can be in this shape."""
    due, q = task.due, along.motion.states[0]
    when = np.append(0.0, along.motion.lasting_s[0].cumsum())
    at = composed(q[:, :POSE], in_b0)[:, :2]
    then = np.column_stack([np.interp(due[:, 1], when, xy) for xy in at.T])
    points = task.left.at(due[:, 0])
    off_m = np.hypot(*(then - points).T)
    if not (off_m > task.position_tolerance_m).any():
        return None
    fast = _fastest(rigid_rows(robot, q[0, POSE:]), in_b0)
    apart_m = np.hypot(*np.diff(points, axis=0, prepend=task.left.points[:1]).T)
    need_s = (apart_m - 2 * task.position_tolerance_m) / fast
    short = need_s > np.diff(due[:, 1], prepend=0.0)
    k = int(short.argmax() if short.any() else (off_m > task.position_tolerance_m).argmax())
    where = f"{due[k, 0]:z.2f} m along its path, where it is due after {due[k, 1]:z.4g} s"
    if short.any():
        return f"{where}: from the point before it takes {need_s[k]:z.2f} s at least", True
    return (
        f"{where}, it is {1e3 * off_m[k]:z.0f} mm away then: its wheels cannot be so quick",
        False,
    )


def _shortest_m(line: Polyline, within_m: float) -> Iterator[float]:
    """Lengths than which no path within a distance of a line is shorter [m]."""
    yield 0.0
    for count in _CHORDS:
        chords = np.diff(line.at(np.linspace(0.0, line.length_m[-1], count + 1)), axis=0)
        long_m = np.hypot(*chords.T)
        along = chords / np.maximum(long_m, 1e-12)[:, None]
        yield float(long_m.sum() - within_m * (2 + np.hypot(*np.diff(along, axis=0).T).sum()))
