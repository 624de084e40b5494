"""Terminal correction: close the small error that the transcription's steps leave at the goal.

Simplified Newton: the residual comes from the fine roll-out, the derivative from the coarse flow of
the transcription, and among all corrections the least one, in each interval's own scale, is taken.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.linalg import norm

from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import Motion, interval_flow, roll_out
from twosra_mpc.planning.solver.multiple_shooting import INPUT_SCALE, state_scale
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.description import Body
from twosra_mpc.robot.modes import ModeSequence

TERMINAL_TOLERANCE = 1e-3 * GOAL_TOLERANCE  # largest error at the goal that can be corrected
_ITERATIONS = 12
_COARSE_STEPS = 2
_REMOVED = 1e-6  # share of the error that a correction of whole phases may leave
_DEARER = 2.0  # times larger such a correction may be than one of single intervals


def correct_end(motion: Motion, goal: GoalSet) -> Motion | None:
    """Correct a motion until it ends in the goal to within 1e-9, or return None.

    Where that cannot be, because no phase of it can change what is missing, the goal is met to
    within `GOAL_TOLERANCE`.

    Raises nothing: a motion that cannot be corrected is an outcome, not an error.
    """
    start = motion.states[0, 0]
    for _ in range(_ITERATIONS):
        error = goal.error(motion.end.copy())
        if np.abs(error).max() <= TERMINAL_TOLERANCE:
            return motion
        if not np.isfinite(error).all():
            return None
        try:
            step = _least_correction(motion, error)
        except np.linalg.LinAlgError:  # LAPACK did not converge
            break
        if step is None:
            break
        motion = roll_out(motion.robot, start, motion.sequence, motion.inputs - step)
    return motion if goal.met_at(motion.end) else None


def _least_correction(motion: Motion, error: Array) -> Array | None:
    """Input change of least weighted norm that removes ``error`` to first order.

    None where it has run away: LAPACK does not come back from numbers that are not finite.

    All intervals of a phase change alike where that is enough: then a phase that goes straight
    still does, and nothing makes its wheel speeds jump.
    """
    phases, intervals, _ = motion.inputs.shape
    modes = np.repeat(np.array(motion.sequence, dtype=float), intervals, axis=0)
    flat = motion.inputs.reshape(-1, INPUTS).T
    derivative = _terminal_jacobian(motion.robot, phases * intervals)
    scale = state_scale(motion.robot)
    with np.errstate(over="ignore", invalid="ignore"):
        gradient = derivative(motion.states[0, 0], flat, modes.T).full() / scale[:, None]
    if not np.isfinite(gradient).all():
        return None
    size = np.abs(motion.inputs / INPUT_SCALE).sum(axis=2)
    resting = size.sum(axis=1) == 0.0  # used only as far as the moving phases cannot help
    size[resting] = 1e-9 * max(float(size.max()), 1e-6)
    weight = np.repeat(size.ravel(), INPUTS)
    weight *= np.tile(INPUT_SCALE, phases * intervals) * available_inputs(
        motion.sequence, intervals
    )
    weighted, wanted = gradient * weight, error / scale
    alike = weighted.reshape(-1, phases, intervals, INPUTS).sum(axis=2)
    joint, *_ = np.linalg.lstsq(alike.reshape(len(scale), -1), wanted, rcond=1e-12)
    step, *_ = np.linalg.lstsq(weighted, wanted, rcond=1e-12)
    uniform = np.repeat(joint.reshape(phases, 1, INPUTS), intervals, axis=1).ravel()
    left = np.abs(weighted @ uniform - wanted).max()
    if left <= _REMOVED * np.abs(wanted).max() and norm(uniform) <= _DEARER * norm(step):
        step = uniform
    return np.asarray(weight * step).reshape(motion.inputs.shape)


def available_inputs(sequence: ModeSequence, intervals: int) -> Array:
    """1 for every input a phase's mode has, 0 for the others, flat over (phases, intervals, 5)."""
    soft = np.array([any(mode) for mode in sequence])[:, None]
    mask = np.where(soft, [1.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0, 1.0])
    return np.repeat(mask, intervals, axis=0).ravel()


@per_body(8)
def _terminal_jacobian(body: Body, intervals: int) -> ca.Function:
    """(q0, s and sigma of all intervals) -> d q_end / d s, (3 + n) x (5 intervals)."""
    segments = body.geometry.segments
    q, s = ca.MX.sym("q", POSE + segments), ca.MX.sym("s", INPUTS, intervals)
    sigma = ca.MX.sym("sigma", segments, intervals)
    end = interval_flow(body, _COARSE_STEPS).fold(intervals)(q, s, sigma)
    return ca.Function("terminal_jacobian", [q, s, sigma], [ca.jacobian(end, s)])
