"""What a plan sends, integrated anew: where the robot is at its samples, and between them."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from twosra_mpc.checking.dormand_prince import step_of_order_8
from twosra_mpc.effort import Cost, charge
from twosra_mpc.errors import InputError
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.kinematics import InPlace
from twosra_mpc.model.rows import in_mode
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import INPUTS, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import Mode

_MOST_CUTS = 2_000_000  # of all intervals
_SAME_DIRECTION = 1e-13  # rounding of a unit vector
_SAFE, _LEAST_GROWTH, _MOST_GROWTH = 0.9, 0.2, 10.0  # of the next step
# Shares of a step through which the polynomial of that degree is laid, and its coefficients.
_DEGREE, _MANY = 12, 8
_NODES = (1 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)) / 2
_SHARES = _NODES[1:, None]
_FIT = np.linalg.inv(chebvander(2 * _NODES - 1, _DEGREE))
_LEAST_STEP = 1e-12  # m or rad: where that is too long, a curvature runs away


@dataclass(frozen=True, eq=False)
class Sent:
    """What moves a robot, of `Samples`: times (m,), inputs and rates (m, 5), modes (m, n)."""

    t_s: Array
    v: Array
    a: Array
    mode: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Whether the robot moves from each row to the next, (m,)."""
        return ((self.v != 0) | (self.a != 0)).any(axis=1)  # type: ignore[no-any-return]


def reintegrate(problem: Problem, samples: Samples | Sent) -> Array:
    """Integrate q' = J(q, mode) v over the samples from the start configuration, (m, 3 + n).

    Adaptive Dormand-Prince 8(5,3), relative tolerance 1e-12, restarted where the direction of the
    input or the mode changes; in between only the speed does, which does not change the path.
    Rows are NaN from where a curvature runs away beyond twice its limit.
    """
    beyond, q = 2 * problem.robot.limits.curvature_per_m, problem.start.configuration
    reached, known = np.full((len(samples), len(q)), np.nan), dict[Mode, _Steps]()
    reached[0] = q
    for first, last, direction, lengths in paths(samples):
        rows, mode = reached[first + 1 : last + 1], tuple(samples.mode[first].tolist())
        if not direction.any():
            rows[:] = reached[first]
            continue
        if mode not in known:
            idle = _idle(problem.robot, mode)
            known[mode] = idle.pop() if idle else _Steps(problem.robot, mode)
        if not _follow(
            known[mode], reached[first], direction, np.cumsum(lengths).tolist(), beyond, rows
        ):
            break
    for mode, steps in known.items():
        _idle(problem.robot, mode).append(steps)
    return reached


@per_body(8)
def _idle(body: Body, mode: Mode) -> list[_Steps]:
    """Those of a mode that nobody takes now: in another thread somebody may."""
    del body, mode
    return []


def _follow(
    steps: _Steps, q: Array, direction: Array, ends: list[float], beyond: float, rows: Array
) -> bool:
    """Fill in configurations after lengths of one direction; False where a curvature runs away.

    Where many are within a step, they are read off the polynomial through steps of shares of it,
    whose order is higher than that of the method.
    """
    row, done, longest = 0, 0.0, math.inf
    while row < len(ends):
        charge(Cost.REINTEGRATION)
        many = row + _MANY < len(ends) and ends[row + _MANY] < done + longest
        to = bisect.bisect_right(ends, done + longest) if many else row + 1
        left = ends[to - 1] - done
        step = min(longest, left)
        after, error, curvature = steps(q, step * direction, many)
        growth = _SAFE * error**-0.125 if error > 0 else _MOST_GROWTH
        if not error <= 1:  # nor where it is no number
            longest = step * (max(_LEAST_GROWTH, growth) if error > 1 else _LEAST_GROWTH)
            if longest < _LEAST_STEP:
                return False
            continue
        if curvature > beyond:
            return False
        if step < left:
            done += step
        else:
            if many:
                places = chebvander(2 * (np.array(ends[row:to]) - done) / step - 1, _DEGREE)
                rows[row:to] = places @ (_FIT @ np.vstack([q, after]))
            rows[to - 1], done, row = after[-1], ends[to - 1], to
        q, longest = after[-1].copy(), max(longest, step * min(_MOST_GROWTH, growth))
    return True


class _Steps:
    """Steps in one mode."""

    def __init__(self, robot: Robot, mode: Mode) -> None:
        step = in_mode(step_of_order_8(robot), mode)
        size, self._made = step.numel_out(0), list[tuple[list[Array], InPlace]]()
        for count in (1, _DEGREE):
            arrays = [np.zeros((count, k)) for k in (size, INPUTS, size, 2)]
            function = step if count == 1 else step.map(count)
            self._made.append((arrays, InPlace(function, arrays[:2], arrays[2:])))

    def __call__(self, q: Array, s: Array, many: bool) -> tuple[Array, float, float]:
        """Step by s, or by shares of it: configurations (m, 3 + n), worst error and curvature."""
        (at, moved, after, told), in_place = self._made[many]
        at[:] = q
        np.multiply(_SHARES, s, out=moved) if many else np.copyto(moved, s)
        in_place.evaluate()
        error, curvature = (told.max(axis=0) if many else told[0]).tolist()
        return after, error, curvature


def displacements(samples: Samples | Sent) -> Array:
    """Input displacements s = (v + a dt / 2) dt from each row to the next, (m - 1, 5)."""
    dt = np.diff(samples.t_s)[:, None]
    moved = samples.a[:-1] * dt  # the rest is done in place: there may be many rows
    moved /= 2
    moved += samples.v[:-1]
    moved *= dt
    return moved


def paths(samples: Samples | Sent) -> Iterator[tuple[int, int, Array, Array]]:
    """Runs of samples with one mode and one direction: (first, last, direction, lengths).

    Lengths are those of the input displacements s, direction is s / |s|, zero at rest.
    """
    direction = displacements(samples)
    lengths = np.linalg.norm(direction, axis=1)
    direction /= np.where(lengths > 0, lengths, 1.0)[:, None]
    turns = np.diff(direction, axis=0)
    turned = np.abs(turns, out=turns).max(axis=1, initial=0.0) > _SAME_DIRECTION
    turned |= np.diff(samples.mode[:-1], axis=0).any(axis=1)
    starts = [0, *(np.flatnonzero(turned) + 1).tolist(), len(lengths)]
    for first, last in itertools.pairwise(starts):
        if last > first:
            yield first, last, direction[first], lengths[first:last]


def between(samples: Samples, cut: float | Array, least: int) -> tuple[Sent, NDArray[np.intp]]:
    """What moves the robot no more than ``cut`` (m or rad) from one row to the next.

    ``cut`` may be a list, one for each interval. Those that move are cut into ``least`` more parts.

    Returns:
        The finer rows, and for each the row of ``samples`` in force.

    Raises:
        InputError: If something moves absurdly far.
    """
    dt = np.diff(samples.t_s)
    moved = np.abs(displacements(samples)).max(axis=1)
    if not (moved / cut).sum() <= _MOST_CUTS:
        allowed = "inputs that move the robot by no more than metres"
        raise InputError("samples.v", float(moved.max()), allowed)
    cuts = np.maximum(np.ceil(moved / cut) + least, 1).astype(int)
    at = np.repeat(np.arange(len(cuts)), cuts)
    share = (np.arange(len(at)) - (np.cumsum(cuts) - cuts)[at]) / cuts[at]
    t = np.append(samples.t_s[at] + share * dt[at], samples.t_s[-1])
    at = np.append(at, len(cuts))
    a = samples.a[at]
    return Sent(t, samples.v[at] + a * (t - samples.t_s[at])[:, None], a, samples.mode[at]), at
