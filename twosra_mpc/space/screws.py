"""Legs: constant body twists between two poses, how long they take, and which are proved clear.

A leg is proved by distances at few poses, and by how far any point travels between them. Drives
are made shorter by fewer legs, by better poses between them, or by one pose guessed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.model.flow import rigid_moves, twists
from twosra_mpc.problem.tolerances import UNSEEN_M
from twosra_mpc.robot.coordinates import Array, wrapped


def moved(start: Array, twist: Array, share: Array) -> Array:
    """Poses after a share of displacements by constant twists, (..., 3)."""
    return start + rigid_moves(start[..., 2], twist * share[..., None])


def times_at_speed_s(rows: Array, twist: Array) -> Array:
    """Least times of displacements (..., 3) at full speed, (...,) [s], by `drive_rows` (m, 3)."""
    found: Array = np.abs(rows @ twist.reshape(-1, 3).T).max(axis=0)  # over an axis that leads
    return found.reshape(twist.shape[:-1])


def times_from_rest_s(at_speed_s: Array, gained_s2: Array) -> Array:
    """The same from rest to rest, zero for what does not move, (...,) [s].

    ``gained_s2`` is what they travel divided by the largest acceleration, in any unit of length.
    """
    ramp_s = gained_s2 / np.maximum(at_speed_s, 1e-300)
    return np.where(at_speed_s >= ramp_s, at_speed_s + ramp_s, 2 * np.sqrt(gained_s2))


def continued(poses: Array) -> Array:
    """Poses with headings that go on over full turns; one that is as before is left out."""
    poses = poses.copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    moving = np.abs(np.diff(poses, axis=0)).max(axis=1) > 1e-12
    return poses[np.append(True, moving)]


Clear = Callable[[Array], Array]  # poses (m, 3) -> lower bounds of what they keep, (m,) [m]

_LOOKED_AT_M = UNSEEN_M / 4  # of travel to the next pose that is looked at


def clear_legs(
    clear: Clear, start: Array, twist: Array, radius_m: float, needed_m: Array | float
) -> NDArray[np.bool_]:
    """True for legs that are proved to keep a distance all the way, (m,).

    On a share w of a leg no point of the robot travels more than (|(s_u, s_v)| + radius |s_r|) w.
    So a pose that keeps d proves what is within (d - needed) / travel of it; one that just keeps
    what is needed, what is so near that nothing else can be seen there.

    Args:
        clear: Lower bounds of what poses keep.
        start: Where legs start, (m, 3).
        twist: Their displacements, (m, 3).
        radius_m: Farthest point of the robot from b0.
        needed_m: What legs must keep, (m,) or one number.
    """
    travel = np.hypot(twist[:, 0], twist[:, 1]) + radius_m * np.abs(twist[:, 2]) + 1e-12
    needed = np.broadcast_to(needed_m, travel.shape)
    good = np.ones(len(travel), dtype=bool)
    leg, low, high = np.arange(len(travel)), np.zeros(len(travel)), np.ones(len(travel))
    while len(leg):
        middle = (low + high) / 2
        kept = clear(moved(start[leg], twist[leg], middle)) - needed[leg]
        proved = np.maximum(kept, _LOOKED_AT_M) / travel[leg]
        rest = low + proved < middle
        good[leg[kept < 0]] = False
        open_ = rest & good[leg]
        leg, low, high = (
            np.tile(leg[open_], 2),
            np.concatenate([low[open_], (middle + proved)[open_]]),
            np.concatenate([(middle - proved)[open_], high[open_]]),
        )
    return good


Bools = NDArray[np.bool_]
Times = Callable[[Array, Array], Array]  # of legs between poses (..., 3) each, (...,) [s]
Proof = Callable[[Array, Array], Bools]  # which of them are clear, (m,)
Free = Callable[[Array], Bools]  # which of poses (m, 3) are, (m,)
ByFew = Callable[[Array, Array, Free, Times, Proof], Array | None]  # a drive from start to goal

_WINDOW = 20  # poses of which every pair may be a leg
_PROVED = 16  # of those, at once
_STEPS = (0.04, 0.02, 0.01, 0.005)  # m, by which poses between legs are moved
_PER_STEP_RAD = 5.0  # turns go with them, per metre
_WORTH_S = 1e-3  # a shorter way by less is rounding
_TRIED = 4  # of the moves that save most
_GUESSES = 16  # poses tried between two legs, the quickest first
_PAIRS = 640  # of poses, between three legs
_NEAR, _WIDE = np.linspace(-0.5, 0.5, 5), np.linspace(-1.0, 1.0, 7)  # of the way, to either side
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
    """The fastest way through some of a few poses, neighbours among them taken as clear.

    Of the other legs those of the fastest ways are proved, a few at once, until a way is.
    """
    legs = np.where(np.tri(len(poses)), np.inf, times(poses[:, None], poses))
    own = np.concatenate([[0.0], np.cumsum(legs.diagonal(1))])
    asked = np.triu(legs < own - own[:, None], k=2)
    legs[~asked & np.triu(np.ones_like(asked), k=2)] = np.inf
    while True:
        apart = np.where(np.eye(len(poses)), 0.0, legs)
        for _ in range(_WINDOW.bit_length()):  # ways of one leg, two, four and so on
            apart = (apart[:, :, None] + apart).min(axis=1)
        before, chain = (apart[0, :, None] + legs).argmin(axis=0), [len(poses) - 1]
        while chain[-1] > 0:
            chain.append(int(before[chain[-1]]))
        if not asked[chain[1:], chain[:-1]].any():
            return poses[chain[::-1]]
        through = (apart[0, :, None] + legs + apart[:, -1])[asked]
        some = np.argwhere(asked)[np.argsort(through, kind="stable")[:_PROVED]].T
        asked[*some] = False
        legs[*some] = np.where(proof(poses[some[0]], poses[some[1]]), legs[*some], np.inf)


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


def by_one_pose(start: Array, goal: Array, free: Free, times: Times, proof: Proof) -> Array | None:
    """The fastest clear drive by one of a few poses around the way from start to goal (3,)."""
    tried = _around(start, goal, _NEAR)
    ends = [np.broadcast_to(pose, tried.shape) for pose in (start, goal)]
    taken = times(ends[0], tried) + times(tried, ends[1])
    order = np.argsort(taken, kind="stable")
    order = order[free(tried[order])][:_GUESSES]
    some = tried[order]
    clear = _both_clear(ends[0][order], some, ends[1][order], proof)
    return np.array([start, some[clear][0], goal]) if clear.any() else None


def by_two_poses(start: Array, goal: Array, free: Free, times: Times, proof: Proof) -> Array | None:
    """A fast clear drive by two poses, of many around the way from start to goal (3,)."""
    tried = _around(start, goal, _WIDE)
    tried = tried[free(tried)]
    ends = [np.broadcast_to(pose, tried.shape) for pose in (start, goal)]
    to, on = proof(ends[0], tried), proof(tried, ends[1])
    first, last = tried[to], tried[on]
    taken = times(first[:, None], last)
    taken += times(ends[0][to], first)[:, None] + times(last, ends[1][on])
    order = np.argsort(taken, axis=None, kind="stable")[:_PAIRS]
    for some in np.split(order, range(_PROVED, len(order), _PROVED)):
        i, j = np.unravel_index(some, taken.shape)
        clear = proof(first[i], last[j])
        if clear.any():
            found = clear.argmax()
            return continued(np.array([start, first[i[found]], last[j[found]], goal]))
    return None


def _around(start: Array, goal: Array, along: Array) -> Array:
    """Poses of a grid about the way from start to goal (3,), before, amid and after its turn."""
    apart = float(np.hypot(*(goal - start)[:2])) + 0.1
    turn = float(wrapped(goal[2] - start[2]))
    x, y, share = np.meshgrid(along, along, [0.0, 0.5, 1.0], indexing="ij")
    by = np.stack([x * apart, y * apart, share * turn], axis=-1).reshape(-1, 3)
    poses: Array = by + np.array([*(start + goal)[:2] / 2, start[2]])
    return poses
