"""A motion: the path of one mode sequence.

A motion has no clock. Because the kinematics is driftless, a path may be travelled at any speed;
``problem.limits.interval_durations`` gives the fastest one, and the temporal network decides when.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.flow import drive, interval_chain
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import ModeSequence, is_rigid

Array = NDArray[np.float64]

FINE_STEPS = 64  # most Runge-Kutta steps per interval
STEP_TRAVEL_M = 1e-4  # of both locomotion units in a step; bends 155 1/m to within 5e-8 1/m


@dataclass(frozen=True, eq=False)
class Motion:
    """The path of a mode sequence, rolled out with fine steps; arrays are read-only.

    Attributes:
        robot: The robot that moves.
        sequence: Mode of each phase.
        inputs: Input displacements s = v h per interval [m, m, m, m, rad], (phases, intervals, 5).
        states: q at the nodes, (phases, intervals + 1, 3 + n).
    """

    robot: Robot
    sequence: ModeSequence
    inputs: Array
    states: Array

    @property
    def end(self) -> Array:
        """Q after the last phase, shape (3 + n,)."""
        final: Array = self.states[-1, -1]
        return final


def roll_out(robot: Robot, start: Array, sequence: ModeSequence, inputs: Array) -> Motion:
    """Follow input displacements (phases, intervals, 5) from ``start`` with fine steps."""
    phases, intervals, _ = inputs.shape
    here = np.asarray(start, dtype=float)
    states = np.empty((phases, intervals + 1, len(here)))
    for i, mode in enumerate(sequence):
        states[i, 0] = here
        if not inputs[i].any():
            states[i, 1:] = here
        elif is_rigid(mode):
            states[i, 1:] = drive(here, inputs[i, :, 2:])
        else:
            chain = interval_chain(robot, intervals, steps_for(inputs[i]))
            modes = np.repeat(np.array([mode], dtype=float), intervals, axis=0)
            states[i, 1:] = chain(here, inputs[i].T, modes.T).full().T
        here = states[i, -1]
    fixed = inputs.copy()
    states.setflags(write=False)
    fixed.setflags(write=False)
    return Motion(robot, sequence, fixed, states)


def steps_for(s: Array) -> int:
    """Runge-Kutta steps per interval for input displacements (n, 5): a power of two."""
    travel = float(np.abs(s[:, :2]).sum(axis=1).max())
    doublings = max(1, math.ceil(math.log2(max(travel / STEP_TRAVEL_M, 1.0))))
    return min(FINE_STEPS, int(2**doublings))
