"""First guess of a motion from the relaxation's own solution.

The lower bound of a sequence already says how far each soft phase must bend. Bend so far with both
locomotion units at equal speed (the fastest way), and make up for the pose with the first rigid
phase: soft displacements depend on shape only, so one rigid move, a screw motion, brings the end
of the chain to the goal. Where this fits the limits it is a plan already.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.linalg import norm

from twosra_mpc.effort import Cost, charge
from twosra_mpc.model.bending import bending
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import (
    Motion,
    bending_step,
    drive,
    interval_flow,
    passed,
    roll_out,
    twists,
)
from twosra_mpc.model.outline import outline_points, outline_radii_m
from twosra_mpc.model.rows import in_mode
from twosra_mpc.planning.solver.multiple_shooting import INPUT_SCALE, state_scale
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.limits import broken_by_shapes, levers_kept, workspace_margins
from twosra_mpc.problem.problem import Alone, Problem
from twosra_mpc.problem.tolerances import GOAL_TOLERANCE
from twosra_mpc.problem.world import Workspace
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array, rotation
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid

_STRAYING_M = 2e-3  # out of a workspace between nodes
_NO_CHOICE = 1e-9  # of W: boxes as narrow as that are numbers
_TRIED, _LOOKS = 41, 41  # amounts of bending to and fro, and shapes on the way of each bend
_INSIDE = 0.9999  # of the curvature limits
_EXACTLY = 1e6  # times as much as others count the segments whose bend leaves no choice


def guess_motion(
    robot: Robot,
    start: Array,
    goal: GoalSet,
    sequence: ModeSequence,
    bends: Array,
    intervals: int,
    may_drive: Sequence[bool] | None = None,
) -> Motion:
    """Build a motion whose phases bend as ``bends`` says and which heads for the goal pose.

    Args:
        robot: The robot.
        start: q at t = 0, shape (3 + n,).
        goal: The goal.
        sequence: Mode of each phase.
        bends: Change of the bending coordinate W in each phase, shape (phases,).
        intervals: Intervals per phase.
        may_drive: Phases whose inputs may be used; all if left out.
    """
    charge(Cost.INTERVAL, intervals * len(sequence))
    inputs, states = np.zeros((len(sequence), intervals, INPUTS)), list[Array]()
    q = np.asarray(start, dtype=float)
    for i, mode in enumerate(sequence):
        nodes = np.tile(q, (intervals + 1, 1))
        if any(mode) and bends[i] != 0.0:
            nodes, inputs[i, :, :2] = bent(robot, q, mode, float(bends[i]), intervals)
            lost = ~np.all(np.isfinite(nodes), axis=1)  # farther than anything bends
            nodes[lost], inputs[i, lost[1:]] = nodes[lost.argmax() - 1], 0.0
        states.append(nodes)
        q = nodes[-1]
    usable = may_drive or [True] * len(sequence)
    first = next((i for i, mode in enumerate(sequence) if is_rigid(mode) and usable[i]), None)
    if first is not None:
        begin = states[first][0]
        inputs[first] = rigid_move(begin, q, goal) / intervals
        states[first][1:] = drive(begin, inputs[first, :, 2:])
        end = states[first][-1]
        turn = end[2] - begin[2]
        for later in states[first + 1 :]:  # what is seen from there stays as it is
            later[:, :2] = end[:2] + (later[:, :2] - begin[:2]) @ rotation(turn)
            later[:, 2] += turn
    return Motion(robot, sequence, inputs, np.array(states))


def moved_inside(motion: Motion, problem: Problem | Alone) -> Motion:
    """Return the motion with all after its first drive shifted into the workspace.

    What is between that and the last one by itself; the end no farther than the goal allows. As it
    is where there is no workspace, no drive, or nothing leaves.
    """
    drives = [i for i, mode in enumerate(motion.sequence) if is_rigid(mode)]
    if problem.workspace is None or not drives:
        return motion
    first, last = drives[0], drives[-1]
    states, inputs, edges = motion.states, motion.inputs.copy(), problem.workspace
    low, high = (end[:2] - motion.end[:2] for end in problem.goal.box(motion.end))
    tail = np.concatenate([states[last, -1:], *states[last + 1 :]])
    end_by = np.clip(_inward(tail, problem, edges), np.minimum(low, 0.0), np.maximum(high, 0.0))
    visited = states[first + 1 : last].reshape(-1, states.shape[-1])
    by = _inward(visited, problem, edges) if len(visited) else end_by
    if not by.any() and not end_by.any():
        return motion
    begins, ends = states[:, 0, :POSE].copy(), states[:, -1, :POSE].copy()
    ends[first, :2] += by
    begins[last, :2] += by if last > first else 0.0
    ends[last, :2] = states[last, -1, :2] + end_by
    for i in {first, last}:
        inputs[i, :, 2:] = twists(begins[i], ends[i], ends[i, 2] - begins[i, 2]) / inputs.shape[1]
    return roll_out(motion.robot, states[0, 0], motion.sequence, inputs)


def _inward(visited: Array, problem: Problem | Alone, workspace: Workspace) -> Array:
    """Shift of configurations (m, 3 + n) that brings them into the workspace, (2,) [m]."""
    points = outline_points(problem.robot.geometry)(visited.T).full().T.reshape(len(visited), -1, 2)
    low, high = spared_corners(problem, workspace)
    beyond = [np.maximum(off, 0.0).max(axis=(0, 1)) for off in (low - points, points - high)]
    inward: Array = beyond[0] - beyond[1]
    return inward


def spared_corners(problem: Problem | Alone, workspace: Workspace) -> Array:
    """Corners of the workspace for each of the ``outline_points``, (2, m, 2) [m].

    Less their radii and what the robot may stray between nodes. It keeps no farther away than it
    is at the start and at the goal.
    """
    goal = problem.goal.aim(problem.start.configuration)
    ends = workspace_margins(problem, np.array([problem.start.configuration, goal]))
    spared = min(_STRAYING_M, max(0.0, float(ends.min())))
    inward = spared + outline_radii_m(problem.robot.geometry)[:, None]
    low, high = workspace.corners_m
    return np.array([low + inward, high - inward])


def clipped_w(problem: Problem | Alone, *ends: Array) -> Array:
    """W of the shapes of configurations (3 + n,), clipped to the limits, (ends, n)."""
    limit = problem.robot.limits.curvature_per_m
    return bending(problem.robot).coordinates(np.clip(ends, -limit, limit)[:, POSE:])


def inner_bends(sequence: ModeSequence, bends: Array, box: Array, inner: Array) -> Array:
    """Bends that end in the inner one of two boxes, or as near to it as the sequence can.

    Least squares, from bends that end somewhere in the outer one, and never out of it.

    Args:
        sequence: Mode of each phase.
        bends: Change of the bending coordinate W in each phase, (phases,).
        box: Least and largest change of W of each segment, (2, n).
        inner: The same of the inner box.
    """
    incidence = np.array(sequence, dtype=float).T
    reached = incidence @ bends
    missed = np.clip(reached, *inner) - reached
    if not missed.any():
        return bends
    weight = np.where(box[1] - box[0] <= _NO_CHOICE, _EXACTLY, 1.0)
    step, *_ = np.linalg.lstsq(weight[:, None] * incidence, missed, rcond=1e-12)
    moved = incidence @ step
    moving = np.abs(moved) > _NO_CHOICE
    room = np.where(moved > 0, box[1] - reached, reached - box[0])[moving]
    share = np.min(room / np.abs(moved[moving]), initial=1.0)
    return bends + max(0.0, float(share)) * step


def bends_around(problem: Problem | Alone, sequence: ModeSequence, bends: Array) -> Array | None:
    """Other bends to the same shape, on whose way no shape is forbidden; None if none are found.

    Looked for along the directions in which the sequence may bend to and fro, the least of them.
    """
    facts, limits = bending(problem.robot), problem.robot.limits
    modes = np.array(sequence, dtype=float)
    _, singular, right = np.linalg.svd(modes.T)
    free = right[int((singular > _NO_CHOICE).sum()) :][:, modes.any(axis=1)]
    most = np.array([facts.coordinate(limits.curvature_per_m, j) for j in range(modes.shape[1])])
    here = facts.coordinates(problem.start.kappa_per_m)
    share = np.linspace(0.0, 1.0, _LOOKS)[:, None]
    found = []
    for direction in np.unique(free[np.abs(free).max(axis=1, initial=0.0) > _NO_CHOICE], axis=0):
        along = np.zeros(len(bends))
        along[modes.any(axis=1)] = direction / np.abs(direction).max()
        grows, at = (np.cumsum(each[:, None] * modes, axis=0) for each in (along, bends))
        with np.errstate(divide="ignore", invalid="ignore"):  # where it would reach the limits
            edges = [(_INSIDE * sign * most - here - at) / grows for sign in (-1.0, 1.0)]
            rests = -bends / along  # where a phase does
        steps = np.append(most.max() * np.linspace(-2.0, 2.0, _TRIED), [*np.ravel(edges), *rests])
        several = bends + steps[np.isfinite(steps), None] * along
        for tried in several[np.abs(several).sum(axis=1).argsort(kind="stable")]:
            ends = here + np.cumsum(tried[:, None] * modes, axis=0)
            begins = np.vstack([here, ends[:-1]])
            passed = begins[:, None] + share * (ends - begins)[:, None]
            if (np.abs(passed) > most + _NO_CHOICE).any():
                continue
            shapes = np.stack(
                [facts.curvature(passed[:, :, j], j) for j in range(modes.shape[1])], axis=-1
            )
            if levers_kept(problem.robot, sequence, shapes) and (
                broken_by_shapes(problem.robot, np.concatenate(shapes)) is None
            ):
                found.append(tried)
                break
    return min(found, key=lambda each: float(np.abs(each).sum()), default=None)


def bent(
    robot: Robot,
    q: Array,
    mode: Mode,
    bend: float,
    intervals: int,
    shares: tuple[float, float] = (1.0, 1.0),
) -> tuple[Array, Array]:
    """Bend W of the soft segments by ``bend`` in equal intervals, the units travelling by shares.

    Returns:
        q at the nodes, (intervals + 1, 3 + n), and the travel of each locomotion unit in each
        interval, (intervals, 2) [m].
    """
    step, changes = in_mode(bending_step(robot), mode), np.full((intervals, 1), bend / intervals)
    states = passed(step, np.append(q, 0.0), changes, np.array(shares))
    with np.errstate(invalid="ignore"):  # where it bends farther than anything can
        travel = np.diff(states[:, -1])[:, None] * shares
    return states[:, :-1], travel


def rigid_move(before: Array, after: Array, goal: GoalSet) -> Array:
    """Input displacement (5,) of a rigid phase that brings the motion's end to the goal.

    ``before`` is q at the phase, ``after`` q at the end of the motion without the move. Free
    coordinates of the goal keep the value they have without it.
    """
    here, wanted = before[:POSE], goal.aim(after)[:POSE]
    turn = wanted[2] - after[2]
    there = wanted + np.append((here - after[:POSE])[:2] @ rotation(turn), 0.0)
    return np.array([0.0, 0.0, *twists(here, there, turn)])


TERMINAL_TOLERANCE = 1e-3 * GOAL_TOLERANCE  # largest error at the goal that can be corrected
_ITERATIONS = 12
_COARSE_STEPS = 2
_REMOVED = 1e-6  # share of the error that a correction of whole phases may leave
_DEARER = 2.0  # times larger such a correction may be than one of single intervals


def correct_end(motion: Motion, goal: GoalSet) -> Motion | None:
    """Correct a motion until it ends in the goal to within 1e-9, or return None.

    Simplified Newton: the residual comes from the fine roll-out, the derivative from the coarse
    flow of the transcription, and of all corrections the least one, in each interval's own scale,
    is taken.

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
