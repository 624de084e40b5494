"""The stops of a plan: blocks to carry out and boxes to pass, with drives in between."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.obstacles.block import Block, Sweep
from twosra_mpc.planning.obstacles.stations import Chain, Stations, around, between, shortest_chain
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Pass
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.poses import composed, inverse
from twosra_mpc.space.drives import Drives

_CANDIDATES, _REACH_M = 600, 0.4  # stations of a block, and how far from where it should be
_NEAR_M = 0.1  # from a station found, where better ones may be
_PASSES = 60  # candidates about each end
_INSIDE_M = 5e-3  # of a box if it is as wide, and rad
_MOST_LOOKS = 60
_MOST_CHAINS, _MOST_CHAINS_OF_SEVERAL = 6, 2  # compared
_MOST_POSES = 1500  # all over the plane
_WITHIN = 0.9  # of the half-widths of a goal: how far from its middle is aimed, at most
_AROUND = np.array([*itertools.product((0.0, -1.0, 1.0), repeat=POSE)])


class Stop(NamedTuple):
    """What is done between two drives.

    Attributes:
        displacement: Pose of b0 afterwards, as seen from where it was, (3,).
        may_be_clear: (poses in which it begins (m, 3)) -> which of them to look at, (m,).
        clear: (pose in which it begins) -> whether it is clear.
        moved: (poses) -> candidates of the pose in which it begins, made of these.
        first: Candidates to begin with, (m, 3).
        everywhere: Makes candidates all over the plane, where those lead nowhere.
    """

    displacement: Array
    may_be_clear: Callable[[Array], NDArray[np.bool_]]
    clear: Callable[[Array], bool]
    moved: Callable[[Array], Array]
    first: Array
    everywhere: Callable[[], Array]


class Itinerary:
    """The blocks of a sequence with its drives, None where there is none, one more than blocks."""

    def __init__(
        self,
        problem: Problem,
        blocks: Sequence[Block],
        drives: Sequence[Drives | None],
        hidden_s: Sequence[float],
    ) -> None:
        self._problem, self._drives, self._hidden_s = problem, drives, hidden_s
        self._start = problem.start.configuration[:POSE]
        self._last_shape = blocks[-1].shape if blocks else problem.start.configuration[POSE:]
        self._blocks = [self._block(blocks, k) for k in range(len(blocks))]

    def chain(self, passed_in: Sequence[int]) -> Chain | None:
        """The best chain found that passes each box in one of the drives, told by its number.

        First by stations all around; where drives cost time, then by others near those found.
        """
        stops, drive_of = self._stops(passed_in)
        found = self._shortest(stops, drive_of, [stop.first for stop in stops])
        if found is None and stops:
            found = self._shortest(stops, drive_of, [stop.everywhere() for stop in stops])
        if found is None or not stops or found.cost_s == 0.0:
            return found and self._by_drive(found, drive_of)
        nearer = [
            stop.moved(around(begin, _CANDIDATES, _NEAR_M))
            for stop, begin in zip(stops, found.begins, strict=True)
        ]
        end = composed(found.begins[-1], stops[-1].displacement)
        ends = between(self._goals(end[None])[0], end, _CANDIDATES)
        back = composed(ends, inverse(stops[-1].displacement))
        nearer[-1] = np.vstack([nearer[-1], stops[-1].moved(back)])
        better = self._shortest(stops, drive_of, nearer)
        best = min(found, better or found, key=lambda each: each.cost_s)
        return self._by_drive(best, drive_of)

    def _stops(self, passed_in: Sequence[int]) -> tuple[list[Stop], list[int]]:
        """Blocks and passes in order, and to which drive each leg between them belongs."""
        stops, drive_of = [], [0]
        for k in range(len(self._drives)):
            here = [
                task
                for task, drive in zip(self._problem.passes, passed_in, strict=True)
                if drive == k
            ]
            stops += [*map(self._pass, here), *self._blocks[k : k + 1]]
            drive_of += [k] * len(here) + [k + 1] * (k < len(self._blocks))
        return stops, drive_of

    def _block(self, blocks: Sequence[Block], k: int) -> Stop:
        block, problem = blocks[k], self._problem
        sweep = Sweep(block, problem.robot, problem.world)
        if k == 0 and self._drives[0] is None:
            start = self._start[None]
            fixed = (lambda _: start), start, (lambda: start)
            return Stop(block.displacement, sweep.may_be_clear, sweep.clear, *fixed)
        if k == len(blocks) - 1:
            ends = around(self._goals(self._start[None])[0], _CANDIDATES, _REACH_M)
            first = composed(ends, inverse(block.displacement))
        else:
            first = around(self._start, _CANDIDATES, _REACH_M)
        anywhere = (lambda poses: poses), first, (lambda: self._everywhere(k))
        return Stop(block.displacement, sweep.may_be_clear, sweep.clear, *anywhere)

    def _everywhere(self, k: int) -> Array:
        """Poses in which the robot may drive before a block, all over the plane."""
        drives = self._drives[k]
        return np.zeros((0, POSE)) if drives is None else drives.spread(_MOST_POSES)

    def _pass(self, task: Pass) -> Stop:
        return passing(task, np.vstack([self._start, self._goals(self._start[None])]))

    def _shortest(
        self, stops: Sequence[Stop], drive_of: Sequence[int], begins: Sequence[Array]
    ) -> Chain | None:
        layers = []
        for stop, begin in zip(stops, begins, strict=True):
            clear = begin[stop.may_be_clear(begin)]
            layers.append(Stations(clear, composed(clear, stop.displacement)))
        shares = [self._hidden_s[k] / drive_of.count(k) for k in drive_of]
        return shortest_chain(
            self._start,
            self._goals,
            layers,
            lambda k, pose: stops[k].clear(pose),
            [self._drives[k] for k in drive_of],
            shares,
            _MOST_LOOKS,
            _MOST_CHAINS if len(self._blocks) < 2 else _MOST_CHAINS_OF_SEVERAL,
        )

    def _by_drive(self, chain: Chain, drive_of: Sequence[int]) -> Chain:
        """The chain with one route for each drive."""
        routes = [
            np.concatenate(
                [route for route, of in zip(chain.routes, drive_of, strict=True) if of == k]
            )
            for k in range(len(self._drives))
        ]
        return chain._replace(routes=tuple(routes))

    def _goals(self, poses: Array) -> Array:
        """Members of the goal to aim at from poses (m, 3) in the last shape, (m, 3).

        Where the one to aim at is too near to something, the clearest of the box around it.
        """
        goal, shape, drives = self._problem.goal, self._last_shape, self._drives[-1]
        aims = [goal.aim(np.append(pose, shape))[:POSE] for pose in poses]
        found = np.array(aims).reshape(-1, POSE)
        if drives is not None and goal.is_box:
            several, of = np.unique(found, axis=0, return_inverse=True)
            for i in np.flatnonzero(drives.clear(several) < drives.kept_m):
                low, high = (end[:POSE] for end in goal.box(np.append(several[i], shape)))
                half = np.where(np.isfinite(high - low), _WITHIN * (high - low) / 2, 0.0)
                members = several[i] + half * _AROUND
                several[i] = members[drives.clear(members).argmax()]
            found = several[of.ravel()]
        return found


def passing(task: Pass, ends: Array) -> Stop:
    """A box to pass on the way between poses (m, 3), the last of them the goal."""
    low, high = task.ends
    inset = np.minimum(_INSIDE_M, (high - low) / 4)

    def moved(poses: Array) -> Array:
        poses = np.clip(poses, [*(low + inset)[:2], -np.inf], [*(high - inset)[:2], np.inf])
        if np.isfinite(high[2] - low[2]):
            middle, half = (high[2] + low[2]) / 2, (high[2] - low[2]) / 2 - inset[2]
            off = (poses[:, 2] - middle + np.pi) % (2 * np.pi) - np.pi
            poses[:, 2] = middle + np.clip(off, -half, half)
        return poses

    widely = [around(pose, _PASSES, 2 * _REACH_M) for pose in ends]
    first = moved(np.concatenate(widely))
    if np.isfinite([low[:2], high[:2]]).all():
        first = np.vstack(
            [first, moved(around(_middle(low, high, ends[-1]), _CANDIDATES, _REACH_M))]
        )
    return Stop(np.zeros(POSE), _all, lambda _: True, moved, first, lambda: first)


def _all(poses: Array) -> NDArray[np.bool_]:
    return np.ones(len(poses), dtype=bool)


def _middle(low: Array, high: Array, otherwise: Array) -> Array:
    """The middle of a box, where it has one."""
    free = ~np.isfinite(high - low)
    return np.where(free, otherwise, np.where(free, 0.0, low) / 2 + np.where(free, 0.0, high) / 2)
