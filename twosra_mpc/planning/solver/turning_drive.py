r"""The quickest drive from rest to rest: a nonlinear program in which the twist turns on the way.

A drive by screws stops at every corner. Here the body twist is linear in time on N intervals of
lengths h d_k. With w_k its values at the nodes times h, q_k the poses there and G the change of
pose in an interval, by Gauss's quadrature,

.. math::
    \min\; g = h^2 \quad\text{s.t.}\quad q_{k+1} = q_k + G(\phi_k, w_k, w_{k+1}, d_k), \quad
    |M w_k| \le \sqrt g, \quad |V (w_{k+1} - w_k)| \le a g\, d_k, \quad w_0 = w_N = 0

for the rows M of the speed limits and V of the wheels (``problem.speeds.drive_rows``): convex but
for the headings. Without a limit of acceleration wheels need not begin and end at rest. The rows
are parameters and the ends bounds, so it is built once for all shapes. Speeds are linear and
accelerations constant in an interval: limits hold at every instant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from functools import lru_cache
from itertools import islice
from typing import NamedTuple

import casadi as ca
import numpy as np

from twosra_mpc.effort import Cost, out_of_effort
from twosra_mpc.model.flow import Motion, drive, joined, roll_out
from twosra_mpc.planning.bounds.rigid_motion import twist_vertices
from twosra_mpc.planning.solver.fixed_sequence import ALONE, SolveStatus, solve_status
from twosra_mpc.planning.solver.multiple_shooting import Stopping, solver_of
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.problem.goals import Goal, GoalSet, Tolerance
from twosra_mpc.problem.speeds import drive_rows, rigid_rows
from twosra_mpc.robot.coordinates import INPUTS, POSE, WHEELS, Array
from twosra_mpc.robot.description import Robot

_INTERVALS = 24
_ASIDE_RAD = (0.4, -0.4)  # of the headings half way, in starts: ahead may be a saddle
_PARTS = 2.0  # of a ramp, or of a turn by 1 rad where there is none: intervals at the ends
_LEAST = 1e-4  # share of the time at full speed that a drive takes at least
_NEAR_M = 0.1
_CORNER = 1e-9  # m or rad: intervals that differ by more are different legs
_MAX_ITERATIONS = 100
_POINTS, _WEIGHTS = (np.polynomial.legendre.leggauss(4) + np.array([[1.0], [0.0]])) / 2


Clear = Callable[[int, Array], bool]


class TurningDrive(NamedTuple):
    """A drive that was found: its one phase, and the iterations of the program."""

    motion: Motion
    iterations: int


def turning_drives(robot: Robot, goal: GoalSet, begin: Array, end: Array) -> Iterator[TurningDrive]:
    """Yield drives to a goal, each the quickest next to where it starts.

    Args:
        robot: The robot.
        goal: What they end in.
        begin: Configuration in which they begin, (3 + n,).
        end: One in which they might end, (3 + n,).
    """
    turn, end = float(end[2] - begin[2]), end.copy()
    vertices, quickest_s = twist_vertices(rigid_rows(robot, begin[POSE:])), math.inf
    fastest = math.inf if vertices is None else float(vertices[:, 2].max())
    around = (turn, turn - math.copysign(math.tau, turn))
    for turned in around if goal.phi_modulo else around[:1]:
        end[2] = begin[2] + turned
        for aside in _ASIDE_RAD:
            if abs(turned) > fastest * quickest_s:
                return
            if (found := _solved(robot, goal, begin, end, aside)) is not None:
                quickest_s = min(quickest_s, float(found.motion.lasting_s.sum()))
                yield found
            if out_of_effort():
                return


def turned(
    motion: Motion, goal: GoalSet, phases: Collection[int], most: int, clear: Clear
) -> tuple[Motion, int]:
    """The motion of a stage with quicker drives that turn, and the iterations that took.

    Where a whole drive is not clear of what is in the way, its halves are tried, and stops between
    legs are left where they are.

    Args:
        motion: The motion; what follows a drive moves on from where that ends.
        goal: What it ends in; drives end in any of it where nothing moves after them.
        phases: Which drives.
        most: Of how many that are found for the same ends the quickest is taken.
        clear: (phase, configurations on the way) -> whether nothing is in the way.
    """
    robot, iterations, profiles = motion.robot, 0, fastest(motion)

    def pieces(i: int, stops: list[int], begin: Array, ends: GoalSet | None) -> Iterator[Motion]:
        nonlocal iterations
        since, until = stops[0], stops[-1]
        end, at_s = motion.states[i, until], np.interp([since, until], profile.x, profile.time_s)
        quickest, least_s = None, float(np.diff(at_s)[0])
        for found, count in islice(turning_drives(robot, ends or there(end), begin, end), most):
            iterations += count
            if (lasts_s := float(found.lasting_s.sum())) < least_s and clear(i, found.states[0]):
                quickest, least_s = found, lasts_s
        if quickest is not None:
            yield quickest
        elif len(stops) == 2:
            yield roll_out(robot, begin, (robot.rigid,), motion.inputs[i : i + 1, since:until])
        else:
            middle = len(stops) // 2
            first = list(pieces(i, stops[: middle + 1], begin, None))
            yield from (*first, *pieces(i, stops[middle:], first[-1].end, ends))

    for i in phases:
        profile, used = profiles[i], motion.inputs[i]
        corners = 1 + np.flatnonzero(np.abs(np.diff(used, axis=0)).max(axis=1) > _CORNER)
        ends = None if motion.inputs[i + 1 :].any() else goal
        found = [*pieces(i, [0, *corners.tolist(), len(used)], motion.states[i, 0], ends)]
        states = [found[0].states[:, :1], *(each.states[:, 1:] for each in found)]
        inputs = np.concatenate([each.inputs for each in found], axis=1)
        changes = np.concatenate([each.changes for each in found], axis=1)
        lasting_s = np.concatenate([each.lasting_s for each in found], axis=1)
        nodes = np.concatenate(states, axis=1)
        whole = Motion(robot, (robot.rigid,), inputs, nodes, changes, lasting_s)
        motion = _replaced(motion, i, whole)
    return motion, iterations


def _replaced(motion: Motion, phase: int, by: Motion) -> Motion:
    """The motion with another drive in a phase."""
    parts = [by]
    if phase:
        told = motion.inputs, motion.states, motion.changes, motion.lasting_s
        first = (each[:phase] for each in told)
        parts.insert(0, Motion(motion.robot, motion.sequence[:phase], *first))
    if after := motion.sequence[phase + 1 :]:
        parts.append(roll_out(motion.robot, by.end, after, motion.inputs[phase + 1 :]))
    return joined(parts)


def there(q: Array) -> Goal:
    """The goal of a configuration, at this heading."""
    x_m, y_m, phi_rad, *kappa = q.tolist()
    there = {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": tuple(kappa)}
    return Goal(**there, tolerance=Tolerance(kappa_per_m=(0.0,) * len(kappa)), phi_modulo=False)


def _solved(
    robot: Robot, goal: GoalSet, begin: Array, end: Array, aside: float
) -> TurningDrive | None:
    """The drive that the program finds from a straight way with headings that go aside, or None."""
    n = _INTERVALS
    speeds, wheels = drive_rows(robot, begin[POSE:])
    far, most = (end - begin)[:POSE], robot.limits.wheel_acceleration_rad_s2
    swift_s = robot.limits.wheel_speed_rad_s / most if most else float(np.abs(speeds[:, 2]).max())
    at_speed_s = float(np.abs(speeds).max(axis=0) @ np.abs(far)) + 1e-9
    d = _lengths(n * swift_s / _PARTS / at_speed_s)
    share = np.append(0.0, np.cumsum(d)) / n
    poses = begin[:POSE] + share[:, None] * far
    poses[:, 2] += aside * np.sin(np.pi * share)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, turn = np.gradient(poses, n * share, axis=0).T
    nodes = np.column_stack([c * x + s * y, c * y - s * x, turn])
    h_s, origin = at_speed_s / n, begin[:POSE] * [1, 1, 0]
    unit = np.array([*[max(float(np.abs(far[:2]).max()), _NEAR_M)] * 2, 1.0])  # of displacements
    rows, gains = speeds * unit / h_s, wheels * unit / (h_s**2 * (most or math.inf))
    low, high = np.full((2, n + 1, 2 * POSE), [[[-np.inf]], [[np.inf]]])
    if most:
        nodes[[0, -1]] = low[[0, -1], :POSE] = high[[0, -1], :POSE] = 0.0
    low[0, POSE:] = high[0, POSE:] = begin[:POSE] - origin
    box = goal.box(end)
    low[-1, POSE:], high[-1, POSE:] = ((edge[:POSE] - origin) / unit for edge in box)
    solver, (equations, limits), _ = _program(len(speeds))
    with ALONE:
        solution = solver(
            x0=np.append(np.hstack([nodes, poses - origin]) / [*unit, *unit], 1.0),
            p=np.concatenate([rows.ravel(), gains.ravel(), d]),
            lbx=np.append(low, max(robot.limits.phase_s / n / h_s, _LEAST) ** 2),
            ubx=np.append(high, np.inf),
            lbg=np.append(np.zeros(equations), np.full(limits, -np.inf)),
            ubg=np.zeros(equations + limits),
        )
        stats = solver.stats()
    if solve_status(stats["return_status"]) not in (SolveStatus.SOLVED, SolveStatus.ACCEPTABLE):
        return None
    *found, g = ca.DM(solution["x"]).full().ravel()
    w = np.zeros((n + 1, INPUTS))
    w[:, 2:] = np.reshape(found, (n + 1, -1))[:, :POSE] * unit
    inputs, changes = d[:, None] * (w[1:] + w[:-1]) / 2, d[:, None] * np.diff(w, axis=0)
    states = np.vstack([begin, drive(begin, inputs[:, 2:], changes[:, 2:])])
    told = inputs[None], states[None], changes[None], (d * math.sqrt(g) * h_s)[None]
    motion = Motion(robot, (robot.rigid,), *told)
    return TurningDrive(motion, stats["iter_count"]) if goal.met_at(motion.end) else None


def _lengths(first: float) -> Array:
    """Lengths of the intervals, (n,), of mean 1: even, or growing from such a first one on."""
    from_end = np.minimum(np.arange(_INTERVALS), np.arange(_INTERVALS)[::-1])
    growth = max(0.0, 1 - first) * _INTERVALS / (from_end**2).sum()
    return min(1.0, first) + growth * from_end**2


@lru_cache(4)
def _program(speeds: int) -> tuple[ca.Function, tuple[int, int], Stopping]:
    """The program for so many rows of speed limits, its numbers of equations and of limits."""
    n = _INTERVALS
    x, g, d = ca.SX.sym("x", 2 * POSE, n + 1), ca.SX.sym("g"), ca.SX.sym("d", 1, n)
    rows, wheels = ca.SX.sym("M", POSE, speeds), ca.SX.sym("V", POSE, WHEELS)
    w, q = x[:POSE, :], x[POSE:, :]
    mean, change = (w[:, 1:] + w[:, :-1]) / 2, w[:, 1:] - w[:, :-1]
    shift = ca.SX.zeros(2, n)
    for share, weight in zip(_POINTS, _WEIGHTS, strict=True):
        at = mean + change * (share - 1 / 2)
        turned = mean[2, :] * share + change[2, :] * (share * (share - 1) / 2)
        c, s = ca.cos(q[2, :-1] + d * turned), ca.sin(q[2, :-1] + d * turned)
        shift += weight * ca.vertcat(c * at[0, :] - s * at[1, :], s * at[0, :] + c * at[1, :])
    moved = ca.vertcat(d * shift[0, :], d * shift[1, :], d * mean[2, :])
    equations = ca.vec(q[:, 1:] - q[:, :-1] - moved)
    fast, gains = ca.vec(rows.T @ w), wheels.T @ change
    most = g * ca.vec(ca.repmat(d, WHEELS, 1))
    limits = [sign * fast - ca.sqrt(g) for sign in (1, -1)]
    limits += [sign * ca.vec(gains) - most for sign in (1, -1)]
    limit = ca.vertcat(*limits)
    nlp = {
        "x": ca.vertcat(ca.vec(x), g),
        "p": ca.vertcat(ca.vec(rows), ca.vec(wheels), d.T),
        "f": g,
        "g": ca.vertcat(equations, limit),
    }
    solver, stopping = solver_of(nlp, _MAX_ITERATIONS, Cost.DRIVE_STEP)
    return solver, (equations.numel(), limit.numel()), stopping
