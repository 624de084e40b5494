"""A motion: the path of one mode sequence, and the least time each piece of it takes.

A motion has no clock. Because the kinematics is driftless, a path may be travelled at any speed;
``interval_durations`` gives the fastest one, and the temporal network decides when.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.flow import interval_flow
from twosra_mpc.model.kinematics import wheel_travel
from twosra_mpc.modes import ModeSequence
from twosra_mpc.robot import Robot

Array = NDArray[np.float64]

FINE_STEPS = 64  # Runge-Kutta steps per interval; 10 intervals bend 155 1/m to within 5e-8 1/m


@dataclass(frozen=True, eq=False)
class Motion:
    """The path of a mode sequence, rolled out with fine steps; arrays are read-only.

    Attributes:
        robot: The robot that moves.
        sequence: Mode of each phase.
        inputs: Input displacements s = v h per interval [m, m, m, m, rad], (phases, intervals, 5).
        states: q at the nodes, (phases, intervals + 1, 5).
    """

    robot: Robot
    sequence: ModeSequence
    inputs: Array
    states: Array

    @property
    def end(self) -> Array:
        """Q after the last phase, shape (5,)."""
        final: Array = self.states[-1, -1]
        return final


def roll_out(robot: Robot, start: Array, sequence: ModeSequence, inputs: Array) -> Motion:
    """Follow input displacements (phases, intervals, 5) from ``start`` with fine steps."""
    phases, intervals, _ = inputs.shape
    modes = np.repeat(np.array(sequence, dtype=float), intervals, axis=0)
    chain = _chain(robot, phases * intervals)
    reached: Array = chain(start, inputs.reshape(-1, 5).T, modes.T).full().T
    nodes = np.vstack([start, reached])
    index = np.arange(phases)[:, None] * intervals + np.arange(intervals + 1)
    states = nodes[index]
    fixed = inputs.copy()
    states.setflags(write=False)
    fixed.setflags(write=False)
    return Motion(robot, sequence, fixed, states)


@lru_cache(maxsize=64)
def _chain(robot: Robot, intervals: int) -> ca.Function:
    return interval_flow(robot, FINE_STEPS).mapaccum(intervals)


def interval_durations(motion: Motion) -> Array:
    """Least time of each interval within wheel and locomotion unit speeds, (phases, intervals) [s].

    Wheel speeds are taken at the start, in the middle and at the end of an interval.
    """
    limits = motion.robot.limits
    phases, intervals, _ = motion.inputs.shape
    before = motion.states[:, :-1].reshape(-1, 5).T
    after = motion.states[:, 1:].reshape(-1, 5).T
    s = motion.inputs.reshape(-1, 5).T
    modes = np.repeat(np.array(motion.sequence, dtype=float), intervals, axis=0).T
    travel = wheel_travel(motion.robot).map(phases * intervals)
    places = (before, (before + after) / 2, after)
    rolled = np.array([np.abs(travel(q, s, modes).full()).max(axis=0) for q in places])
    by_wheel = rolled.max(axis=0) / limits.wheel_speed_rad_s
    by_unit = np.abs(s[:2]).max(axis=0) / limits.unit_speed_m_s
    durations: Array = np.maximum(by_wheel, by_unit).reshape(phases, intervals)
    return durations
