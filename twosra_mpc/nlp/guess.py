"""First guess of a motion from the relaxation's own solution.

The lower bound of a sequence already says how far each soft phase must bend. Bend so far with both
locomotion units at equal speed (the fastest way), and make up for the pose with the first rigid
phase: soft displacements depend on shape only, so one rigid move, a screw motion, brings the end
of the chain to the goal. Where this fits the limits it is a plan already.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from twosra_mpc.model.flow import interval_flow
from twosra_mpc.modes import RIGID, Mode, ModeSequence
from twosra_mpc.motion import Motion, roll_out
from twosra_mpc.problem import Goal
from twosra_mpc.robot import Robot

Array = NDArray[np.float64]

_FLOW_STEPS = 64
_TRAVEL_LIMIT_M = 10.0


def guess_motion(
    robot: Robot,
    start: Array,
    goal: Goal,
    sequence: ModeSequence,
    bends: Array,
    coordinate: Callable[[float], float],
    intervals: int,
    may_drive: Sequence[bool] | None = None,
) -> Motion:
    """Build a motion whose phases bend as ``bends`` says and which heads for the goal pose.

    Args:
        robot: The robot.
        start: q at t = 0, shape (5,).
        goal: The goal.
        sequence: Mode of each phase.
        bends: Change of the bending coordinate W in each phase, shape (phases,).
        coordinate: kappa -> W of ``model.bending``.
        intervals: Intervals per phase.
        may_drive: Phases whose inputs may be used; all if left out.
    """
    travel = np.zeros((len(sequence), 5))
    q = start
    for i, mode in enumerate(sequence):
        if any(mode) and bends[i] != 0.0:
            travel[i, :2] = bending_travel(robot, q, mode, bends[i], coordinate)
            q = interval_flow(robot, _FLOW_STEPS)(q, travel[i], mode).full().ravel()
    inputs = np.repeat(travel[:, None, :] / intervals, intervals, axis=1)
    motion = roll_out(robot, start, sequence, inputs)
    usable = may_drive or [True] * len(sequence)
    rigid = [i for i, mode in enumerate(sequence) if mode == RIGID and usable[i]]
    if rigid:
        inputs[rigid[0]] = rigid_move(motion, rigid[0], goal) / intervals
        motion = roll_out(robot, start, sequence, inputs)
    return motion


def bending_travel(
    robot: Robot, q: Array, mode: Mode, bend: float, coordinate: Callable[[float], float]
) -> float:
    """Travel of each locomotion unit [m], both at equal speed, that changes W by ``bend``."""
    flow = interval_flow(robot, _FLOW_STEPS)
    segment = mode.index(1)
    beyond = 2 * robot.limits.curvature_per_m
    target = coordinate(q[3 + segment]) + bend

    def excess(travel: float) -> float:
        end = float(flow(q, [travel, travel, 0.0, 0.0, 0.0], mode).full()[3 + segment, 0])
        if not abs(end) <= beyond:  # spirals bend ever faster; also when not a number
            return math.copysign(1.0, travel)
        return coordinate(end) - target

    reach = math.copysign(0.01, bend)
    while abs(reach) < _TRAVEL_LIMIT_M and excess(reach) * bend < 0:
        reach *= 2
    if excess(0.0) * excess(reach) > 0:  # out of reach: a guess may be wrong
        return reach
    return float(brentq(excess, 0.0, reach, xtol=1e-12))


def rigid_move(motion: Motion, phase: int, goal: Goal) -> Array:
    """Input displacement (5,) of a rigid phase that brings the motion's end to the goal.

    Free coordinates of the goal keep the value they have without the move.
    """
    here, end = motion.states[phase, 0, :3], motion.end[:3]
    wanted = np.where(np.isnan(goal.configuration[:3]), end, goal.configuration[:3])
    if goal.phi_modulo:
        wanted[2] = end[2] + math.remainder(wanted[2] - end[2], math.tau)
    before, after = _matrix(here), np.linalg.solve(_matrix(here), _matrix(end))
    turn = float(wanted[2] - end[2])
    move = np.linalg.solve(before, _matrix(wanted)) @ np.linalg.inv(after)
    return np.array([0.0, 0.0, *_screw(float(move[0, 2]), float(move[1, 2]), turn)])


def _matrix(pose: Array) -> Array:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])


def _screw(x: float, y: float, turn: float) -> tuple[float, float, float]:
    """Logarithm on SE(2): the constant body twist displacement (su, sv, sr) of a pose change."""
    half = turn / 2
    along = half / math.tan(half) if abs(half) > 1e-8 else 1 - half**2 / 3
    return along * x + half * y, -half * x + along * y, turn
