"""Levers of the wheels on segments that bend alone: a second account of ``model.kinematics``."""

from __future__ import annotations

import math

import numpy as np

from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.tolerances import (
    LEVER_TOLERANCE,
    STILL_RAD,
    STRAIGHT_RAD,
    TIME_TOLERANCE_S,
)
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot

_NODES, _TWICE = np.polynomial.legendre.leggauss(8)
_SHARES, _WEIGHTS = (_NODES + 1) / 2, _TWICE / 2  # of an arc, for its integrals
_STEP_PER_M = 0.1  # between shapes of a bend that are looked at


def bend_levers(robot: Robot, kappa: Array, segment: int) -> Array:
    """Lever of the wheels on a segment in shapes (m, n), signed, in its lengths, (m,).

    The points about which units turn when their wheels stand are pins of the fibre. A force along
    the line through both bends a segment by the distance of its middle, the mean of its points.
    """
    geometry, at = robot.geometry, np.zeros(len(kappa), dtype=complex)
    turn, middle, pins = np.zeros(len(kappa)), at, list[complex]()
    for first in (0, 2):
        (x, y, psi), (x2, y2, psi2) = geometry.wheel_placement[first : first + 2]
        ways = np.array([[math.cos(psi), -math.cos(psi2)], [math.sin(psi), -math.sin(psi2)]])
        pins.append(complex(x, y) + np.linalg.solve(ways, [x2 - x, y2 - y])[0] * np.exp(1j * psi))
    for j, length in enumerate(geometry.lengths_m):
        at = at + (geometry.middle_link_m if j else 0.0) * np.exp(1j * turn)
        bent = kappa[:, j] * length
        if j == segment:  # what is at a share of an arc counts as often as what follows it
            arc = np.exp(1j * bent[:, None] * _SHARES) @ ((1 - _SHARES) * _WEIGHTS)
            middle = at + length * np.exp(1j * turn) * arc
        at = at + length * np.exp(1j * (turn + bent / 2)) * np.sinc(bent / math.tau)
        turn = turn + bent
    end = at + np.exp(1j * turn) * pins[1]
    line = (end - pins[0]) / np.abs(end - pins[0])
    return np.asarray((line.conj() * 1j * (middle - end)).real / geometry.lengths_m[segment])


def lever_margin(trajectory: Trajectory) -> float:
    """Least margin to `BEND_LEVER` where one segment alone is soft; inf where none is.

    From sample to sample its bend changes one way only, and nothing else bends.
    """
    robot, samples, margins = trajectory.problem.robot, trajectory.samples, [np.inf]
    for phase in trajectory.phases:
        if robot.limits.bend_lever is None or sum(phase.mode) != 1:
            continue
        j, ends = phase.mode.index(1), (phase.start_s, phase.end_s)
        first, last = np.searchsorted(samples.t_s + TIME_TOLERANCE_S, ends).tolist()
        bends, length = samples.q[first : last + 1, POSE + j], robot.geometry.lengths_m[j]
        if np.ptp(bends) * length <= STILL_RAD:
            continue
        at = np.append(0.0, np.abs(np.diff(bends)).cumsum())
        way = np.interp(np.sort([*at, *np.arange(0.0, at[-1], _STEP_PER_M)]), at, bends)
        shapes = np.tile(samples.q[first, POSE:], (len(way), 1))
        shapes[:, j] = way
        lever = bend_levers(robot, shapes, j)
        pushing, bent = lever * np.where(way < 0, -1.0, 1.0), length * np.abs(way) - STRAIGHT_RAD
        left = np.maximum(-pushing, pushing - robot.limits.bend_lever * np.maximum(bent, 0.0))
        both = np.sort(np.abs([lever[1:], lever[:-1]]), axis=0)
        crosses = (lever[1:] * lever[:-1] < 0) & (both[0] > LEVER_TOLERANCE)
        steps = np.where(crosses, -both[1], np.minimum(left[1:], left[:-1]))
        against = (way[:-1] * np.diff(way) > 0) & (bent[:-1] > 0)
        margins += [float(left[-1]), float(steps[against].min(initial=np.inf))]
    return 0.0 if abs(min(margins)) <= LEVER_TOLERANCE else min(margins)
