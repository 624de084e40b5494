"""Replay of a log: where commands that were given lead by the model, and where the robot came.

Every phase is predicted from where it began: from its commands alone, and along the measured
history of curvatures, with the motion of b0 by which the wheels slip least. What is then still
missing is what no knowledge of the bend could have told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.rolling import dragged, rolled, travelled
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

LEAST_BEND_RAD = 0.2  # less is lost in the noise: two segments seen to 1/m are good to 0.06


@dataclass(frozen=True, eq=False)
class PhaseReplay:
    """One phase as it was and as the model has it; arrays have a row for each of the log's rows.

    Attributes:
        mode: Its mode.
        time_s: Times in the log, (rows,).
        measured: Configuration [m, m, rad, 1/m ...], (rows, 3 + n).
        predicted: The same by the commands, (rows, 3 + n); it stays where a curvature limit is
            reached.
        as_bent: The same along the measured history of curvatures, (rows, 3 + n): the curvatures
            measured, and where b0 is dragged to by wheels that slip least. None in a rigid phase,
            and where hardly anything was bent.
        bend_rad: Bend of all soft segments together in each row, since the first, (rows,).
        predicted_bend_rad: The same as predicted.
    """

    mode: Mode
    time_s: Array
    measured: Array
    predicted: Array
    as_bent: Array | None
    bend_rad: Array
    predicted_bend_rad: Array

    @property
    def error(self) -> Array:
        """Measured less predicted configuration at the end, (3 + n,)."""
        return _difference(self.measured[-1], self.predicted[-1])

    @property
    def moved(self) -> Array:
        """Change of the configuration measured, (3 + n,): the error of "nothing moves"."""
        return _difference(self.measured[-1], self.measured[0])

    @property
    def error_as_bent(self) -> Array | None:
        """Measured less predicted configuration at the end, given the curvatures, (3 + n,)."""
        return None if self.as_bent is None else _difference(self.measured[-1], self.as_bent[-1])

    @property
    def pivot_rad_per_rad(self) -> float:
        """Turn of b0 that the model does not know, per bend reached; NaN if that is small."""
        missed, bend = self.error_as_bent, self.bend_rad[-1]
        known = missed is not None and abs(bend) >= LEAST_BEND_RAD
        return float(missed[2] / bend) if missed is not None and known else math.nan

    @property
    def split(self) -> float:
        """Inequality of the bends of two soft segments: share of their mean that differs."""
        soft = [POSE + j for j in soft_segments(self.mode)]
        bent = self.moved[soft]
        if len(soft) < 2 or abs(self.bend_rad[-1]) < LEAST_BEND_RAD:
            return math.nan
        return float(np.abs(bent - bent.mean()).max() / abs(bent.mean()))

    @property
    def bend_rates_rad_s(self) -> tuple[float, float, float]:
        """Bending rate: predicted for the first second, measured in the best one and on the whole.

        NaN in a rigid phase.
        """
        if is_rigid(self.mode):
            return math.nan, math.nan, math.nan
        t = self.time_s - self.time_s[0]
        ahead = np.interp(t + 1.0, t, self.bend_rad) - self.bend_rad
        whole = t + 1.0 <= max(t[-1], 1.0)
        first = min(1.0, t[-1])
        predicted = float(np.interp(first, t, self.predicted_bend_rad)) / first
        best = float(ahead[whole][np.abs(ahead[whole]).argmax()]) / first
        return predicted, best, float(self.bend_rad[-1] / t[-1])

    @property
    def share(self) -> float:
        """Bend reached by the bend predicted, up to where the prediction ends at a limit."""
        reached = self.predicted_bend_rad
        last = int(np.flatnonzero(reached != reached[-1])[-1]) + 1 if reached.any() else -1
        if is_rigid(self.mode) or abs(reached[last]) < LEAST_BEND_RAD:
            return math.nan
        return float(self.bend_rad[last] / reached[last])


def replay(log: MotionLog, robot: Robot) -> list[PhaseReplay]:
    """Predict every phase of a log by the robot's path model.

    Args:
        log: The log.
        robot: The robot, with the path model asked for.
    """
    return [_phase(log, robot, rows) for rows in log.phases]


def _phase(log: MotionLog, robot: Robot, rows: slice) -> PhaseReplay:
    mode: Mode = tuple(log.mode[rows.start].tolist())
    time_s, measured = log.time_s[rows], log.q[rows]
    done = log.commands[rows][:-1] * np.diff(time_s)[:, None]
    lengths, soft = np.array(robot.geometry.lengths_m), list(soft_segments(mode))

    def bend(q: Array) -> Array:
        return (q[:, POSE:] - q[0, POSE:])[:, soft] @ lengths[soft]

    if log.by_wheels:
        states = rolled(robot.body, mode, measured[0], done)
    else:
        states = roll_out(robot, measured[0], (mode,), done[None]).states[0]
    predicted, bent = _within(robot, states), bend(measured)
    as_bent = None
    if soft and abs(bent[-1]) >= LEAST_BEND_RAD:
        as_bent = _dragged(robot, mode, measured, done, log.by_wheels)
    return PhaseReplay(mode, time_s, measured, predicted, as_bent, bent, bend(predicted))


def _dragged(robot: Robot, mode: Mode, measured: Array, done: Array, by_wheels: bool) -> Array:
    """Configurations with the curvatures measured, b0 where the wheels slip least."""
    states = measured.copy()
    for row, bent in enumerate(np.diff(measured[:, POSE:], axis=0)):
        here, turned = states[row], done[row]
        if not by_wheels:
            middle = here + np.concatenate([np.zeros(POSE), bent / 2])
            turned = travelled(robot, mode, middle, turned)
        states[row + 1, :POSE] = dragged(robot, here, bent, turned)
    return states


def _within(robot: Robot, states: Array) -> Array:
    """The states, held from where one is beyond the curvature limit: there no model holds."""
    limit = np.maximum(robot.limits.curvature_per_m, np.abs(states[0, POSE:]))
    beyond = ~(np.abs(states[:, POSE:]) <= limit).all(axis=1)  # also what is not a number
    if not beyond.any():
        return states
    held = states.copy()
    held[beyond.argmax() :] = states[beyond.argmax() - 1]
    return held


def _difference(measured: Array, predicted: Array) -> Array:
    difference = measured - predicted
    difference[2] = math.remainder(difference[2], math.tau)
    return difference
