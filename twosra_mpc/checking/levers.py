"""Levers of the wheels on a segment that is soft alone: a second account of `problem.limits`.

Seen from the first unit, rigid motions move all four wheels, and a bend those of the second unit.
What a bend rolls beyond every rigid motion is the distance of its column from theirs.
"""

from __future__ import annotations

import itertools

import numpy as np

from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.tolerances import LEVER_TOLERANCE, STILL_RAD, TIME_TOLERANCE_S
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.geometry import Geometry

_STEP_PER_M = 0.1  # between shapes that are looked at
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_ALONG, _WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2  # of an arc


def lever_margin(trajectory: Trajectory) -> float:
    """Least margin to ``bend_lever`` of all phases with one soft segment; inf without any.

    From sample to sample the bend of such a segment changes one way only, and nothing else bends.
    """
    robot, samples, margin = trajectory.problem.robot, trajectory.samples, np.inf
    for phase in trajectory.phases:
        if robot.limits.bend_lever is None or sum(phase.mode) != 1:
            continue
        j, ends = phase.mode.index(1), np.array([phase.start_s, phase.end_s])
        first, last = np.searchsorted(samples.t_s + TIME_TOLERANCE_S, ends)
        shapes = samples.q[first : last + 1, POSE:]
        bent, length = shapes[:, j], robot.geometry.lengths_m[j]
        if len(bent) < 2 or np.ptp(bent) * length <= STILL_RAD:
            continue
        cuts = [
            np.linspace(*ab, 2 + int(abs(ab[1] - ab[0]) / _STEP_PER_M))
            for ab in itertools.pairwise(bent)
        ]
        way = np.concatenate(cuts)
        turned = np.flatnonzero(way[1:] * way[:-1] < 0) + 1
        way = np.insert(way, turned, 0.0)
        passed = np.repeat(shapes[:1], len(way), axis=0)
        passed[:, j] = way
        levers = bend_levers(robot.geometry, passed, j)
        left = np.abs(levers) - robot.limits.bend_lever * length * np.abs(way)
        least = np.minimum(left[1:], left[:-1])
        lost = levers[1:] * levers[:-1] < 0
        least[lost] = -np.abs(levers).max()
        against = np.diff(np.abs(way)) > 0
        margin = min(margin, float(left[-1]), float(least[against].min(initial=np.inf)))
    return 0.0 if abs(margin) <= LEVER_TOLERANCE else margin


def bend_levers(geometry: Geometry, kappa: Array, segment: int) -> Array:
    """Lever on a segment in shapes (m, n), signed, in its lengths and per angle, (m,)."""
    at, turn = np.zeros(len(kappa), complex), np.zeros(len(kappa))
    for j, length in enumerate(geometry.lengths_m):
        if j:
            at = at + geometry.middle_link_m * np.exp(1j * turn)
        arc = length * np.exp(1j * np.outer(kappa[:, j] * length, _ALONG))
        if j == segment:  # at and of the end of the arc, and how its end moves
            moved = np.exp(1j * turn) * ((1j * _ALONG * arc) @ _WEIGHTS)
        at, turn = at + np.exp(1j * turn) * (arc @ _WEIGHTS), turn + kappa[:, j] * length
        if j == segment:
            pivot = at
    rows = list[Array]()
    for number, (x, y, angle) in enumerate(geometry.wheel_placement):
        far = number >= 2
        place = at + (x + 1j * y) * np.exp(1j * turn) if far else np.full_like(at, x + 1j * y)
        along = np.exp(1j * (turn * far + angle))
        moves = [np.ones_like(at), np.full_like(at, 1j), 1j * place]
        moves.append(far * (moved + 1j * (place - pivot)))
        rows.append(np.stack([(along.conj() * each).real for each in moves], axis=-1))
    matrix = np.stack(rows, axis=1)
    rigid = matrix[:, :, :POSE]
    spanned = np.linalg.det(rigid.swapaxes(1, 2) @ rigid)
    return np.linalg.det(matrix) / np.sqrt(spanned + 1e-12) / geometry.lengths_m[segment]
