"""Drives made shorter: fewer legs, better poses between them, or one pose guessed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.robot.coordinates import Array, wrapped
from twosra_mpc.space.screws import moved, twists

Bools = NDArray[np.bool_]
Times = Callable[[Array, Array], Array]  # of legs between poses (m, 3) each, (m,) [s]
Proof = Callable[[Array, Array], Bools]  # which of them are clear, (m,)

_WINDOW = 20  # poses of which every pair is tried at once
_STEPS = (0.04, 0.02, 0.01, 0.005)  # m, by which poses between legs are moved
_PER_STEP_RAD = 5.0  # turns go with them, per metre
_WORTH_S = 1e-3  # a shorter way by less is rounding
_TRIED = 4  # of the moves that save most
_GUESSES = 16  # poses tried between two legs, the quickest first
_SIGNS = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
_MOVES = _SIGNS[_SIGNS.any(axis=1)] * np.array([1.0, 1.0, _PER_STEP_RAD])  # of poses, per metre


def shortest(poses: Array, times: Times, proof: Proof) -> Array:
    """The fastest of the drives that leave out poses (m, 3) and are proved clear."""
    while len(poses) > 2:
        windows = [poses[i : i + _WINDOW + 1] for i in range(0, len(poses) - 1, _WINDOW)]
        found = [_fastest(window, times, proof) for window in windows]
        shorter = np.concatenate([*(part[:-1] for part in found), poses[-1:]])
        if len(shorter) == len(poses) or len(windows) == 1:
            return shorter
        poses = shorter
    return poses


def _fastest(poses: Array, times: Times, proof: Proof) -> Array:
    """The fastest way through some of a few poses, neighbours among them taken as clear."""
    one, other = np.triu_indices(len(poses), k=1)
    taken = times(poses[one], poses[other])
    own = np.concatenate([[0.0], np.cumsum(taken[other - one == 1])])
    known = other - one == 1
    asked = np.flatnonzero(~known & (taken < own[other] - own[one]))
    known[asked] = proof(poses[one[asked]], poses[other[asked]])
    least, before = np.full(len(poses), np.inf), np.zeros(len(poses), dtype=int)
    least[0] = 0.0
    for i, j, leg in zip(one[known], other[known], taken[known], strict=True):  # i grows
        if least[i] + leg < least[j]:
            least[j], before[j] = least[i] + leg, i
    chain = [len(poses) - 1]
    while chain[-1] > 0:
        chain.append(int(before[chain[-1]]))
    return poses[chain[::-1]]


def improved(poses: Array, times: Times, proof: Proof) -> Array:
    """A drive with its inner poses moved a little wherever that saves time and is clear."""
    poses = poses.copy()
    for step in _STEPS:
        for _ in range(2):
            before = poses.copy()
            for first in (1, 2):  # every other one at once
                i = np.arange(first, len(poses) - 1, 2)
                if len(i):
                    poses[i] = _better(poses[i - 1], poses[i], poses[i + 1], step, times, proof)
            if (poses == before).all():
                break
    return poses


def _better(
    before: Array, here: Array, after: Array, step_m: float, times: Times, proof: Proof
) -> Array:
    """Poses between two others each, moved to where most is saved of what is clear, (k, 3)."""
    nearer = moved(before, twists(before, after), np.full(len(here), 0.5)) - here
    nearer[:, 2] = wrapped(nearer[:, 2])
    shares = np.array([0.25, 0.5, 1.0])[:, None]
    moves = np.broadcast_to(step_m * _MOVES, (len(here), *_MOVES.shape))
    tried = here[:, None] + np.concatenate([moves, shares * nearer[:, None]], axis=1)
    ends = [np.broadcast_to(pose[:, None], tried.shape) for pose in (before, after)]
    taken = times(ends[0], tried) + times(tried, ends[1])
    order = np.argsort(taken, axis=1, kind="stable")[:, :_TRIED]
    now = times(before, here) + times(here, after)
    row, rank = np.nonzero(np.take_along_axis(taken, order, axis=1) < now[:, None] - _WORTH_S)
    some = tried[row, order[row, rank]]
    clear = _both_clear(before[row], some, after[row], proof)
    chosen = here.copy()
    for k in np.flatnonzero(clear)[::-1]:  # the best of each row is written last
        chosen[row[k]] = some[k]
    return chosen


def _both_clear(before: Array, some: Array, after: Array, proof: Proof) -> Bools:
    """True where the leg to a pose and the one after it are clear, (m,)."""
    to, on = np.split(proof(np.concatenate([before, some]), np.concatenate([some, after])), 2)
    return to & on


def by_one_pose(
    start: Array,
    goal: Array,
    free: Callable[[Array], Bools],
    times: Times,
    proof: Proof,
) -> Array | None:
    """The fastest clear drive by one of a few poses around the way from start to goal (3,)."""
    apart = float(np.hypot(*(goal - start)[:2])) + 0.1
    along = np.array([-0.5, -0.25, 0.0, 0.25, 0.5])
    turn = float(wrapped(goal[2] - start[2]))
    x, y, share = np.meshgrid(along, along, [0.0, 0.5, 1.0], indexing="ij")
    tried = np.stack([x * apart, y * apart, share * turn], axis=-1).reshape(-1, 3)
    tried += np.array([*(start + goal)[:2] / 2, start[2]])
    ends = [np.broadcast_to(pose, tried.shape) for pose in (start, goal)]
    taken = times(ends[0], tried) + times(tried, ends[1])
    order = np.argsort(taken, kind="stable")
    order = order[free(tried[order])][:_GUESSES]
    some = tried[order]
    clear = _both_clear(ends[0][order], some, ends[1][order], proof)
    return np.array([start, some[clear][0], goal]) if clear.any() else None
