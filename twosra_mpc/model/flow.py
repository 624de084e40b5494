"""Flow of the kinematics over intervals of constant input, and motions: paths of mode sequences.

The kinematics is driftless, so an interval is described by its input displacement s = v h alone
([s1, s2, su, sv, sr] in m, m, m, m, rad): q+ depends on s, not on how fast it is travelled.

So a motion has no clock. ``problem.limits.interval_durations`` gives the fastest way to travel it,
and the temporal network decides when.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from twosra_mpc.deadline import check_time
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import ModeSequence, is_rigid

FINE_STEPS = 64  # most Runge-Kutta steps per interval
STEP_TRAVEL_M = 1e-4  # of both locomotion units in a step; bends 155 1/m to within 5e-8 1/m


def runge_kutta(rate: Callable[[ca.SX], ca.SX], start: ca.SX) -> ca.SX:
    """State after a classical Runge-Kutta 4 step of length 1."""
    k1 = rate(start)
    k2 = rate(start + k1 / 2)
    k3 = rate(start + k2 / 2)
    k4 = rate(start + k3)
    return start + (k1 + 2 * k2 + 2 * k3 + k4) / 6


@per_body(64)
def interval_flow(body: Body, steps: int) -> ca.Function:
    """(q, s, sigma) -> q at the end of the interval, with ``steps`` Runge-Kutta 4 steps."""
    jacobian = kinematics(body).jacobian
    q, s, sigma = _arguments(ca.SX, body)

    after = runge_kutta(lambda at: jacobian(at, sigma) @ s / steps, q)
    step = ca.Function("step", [q, s, sigma], [after])
    if steps == 1:
        return step
    sym_q, sym_s, sym_sigma = _arguments(ca.MX, body)
    chain = step.fold(steps)
    end = chain(sym_q, ca.repmat(sym_s, 1, steps), ca.repmat(sym_sigma, 1, steps))
    return ca.Function("interval_flow", [sym_q, sym_s, sym_sigma], [end])


def _arguments(symbol: Any, body: Body) -> tuple[Any, Any, Any]:
    """Symbols of a kind: q (3 + n,), s (5,), sigma (n,)."""
    segments = body.geometry.segments
    return symbol.sym("q", POSE + segments), symbol.sym("s", INPUTS), symbol.sym("sigma", segments)


@per_body(64)
def interval_chain(body: Body, intervals: int, steps: int) -> ca.Function:
    """``interval_flow`` of intervals one after the other, all nodes returned."""
    return interval_flow(body, steps).mapaccum(intervals)


@per_body(64)
def bending_chain(body: Body, intervals: int, steps: int) -> ca.Function:
    """``bending_flow`` of intervals one after the other, all nodes returned."""
    return bending_flow(body, steps).mapaccum(intervals)


@per_body(64)
def bending_flow(body: Body, steps: int) -> ca.Function:
    """(q, dW, sigma, shares) -> (q, travel) after bending W of the soft segments by dW.

    Locomotion unit j travels ``shares[j]`` times ``travel`` [m]; equally far is the fastest way to
    bend. ``steps`` Runge-Kutta 4 steps in W itself, so that no travel has to be searched for.
    """
    jacobian, path, lengths = kinematics(body).jacobian, path_model(body), body.geometry.lengths_m
    q, _, sigma = _arguments(ca.SX, body)
    bend, stiffness, size = ca.SX.sym("dW"), ca.vertsplit(sigma), q.numel()
    shares = ca.SX.sym("shares", 2)
    travelled = ca.vertcat(q, ca.SX.sym("travelled"))

    def rate(at: ca.SX) -> ca.SX:
        matrix = jacobian(at[:size], sigma)
        first, second = path.bends(at[POSE:size] * ca.DM(lengths), stiffness)
        moved = ca.vertcat(matrix[:, :2] @ shares, 1)
        return moved / (shares[0] * first.pace + shares[1] * second.pace) * bend / steps

    after = runge_kutta(rate, travelled)
    step = ca.Function("step", [travelled, bend, sigma, shares], [after], {"cse": True})
    sym_q, _, sym_sigma = _arguments(ca.MX, body)
    sym_bend, sym_shares = ca.MX.sym("dW"), ca.MX.sym("shares", 2)
    chain = step.fold(steps) if steps > 1 else step
    given = sym_bend, sym_sigma, sym_shares
    end = chain(ca.vertcat(sym_q, 0), *(ca.repmat(each, 1, steps) for each in given))
    return ca.Function("bending_flow", [sym_q, *given], [end[:size], end[size]])


def drive(q: Array, s: Array) -> Array:
    """Where rigid input displacements lead: screw motions, q (3 + n,), s (m, 3) -> (m, 3 + n)."""
    headings = q[2] + np.cumsum(s[:, 2]) - s[:, 2]
    reached = np.tile(q, (len(s), 1)).astype(float)
    reached[:, :POSE] += np.cumsum(screws(headings, s), axis=0)
    return reached


def screws(headings: Array, s: Array) -> Array:
    """Changes of pose by rigid input displacements (m, 3) from these headings, (m, 3)."""
    half = s[:, 2] / 2
    chord, angle = np.sinc(half / np.pi), headings + half
    c, sine = chord * np.cos(angle), chord * np.sin(angle)
    return np.column_stack([c * s[:, 0] - sine * s[:, 1], sine * s[:, 0] + c * s[:, 1], s[:, 2]])


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
        check_time()
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
