"""Integration of a plan's inputs anew: where the robot is at its samples, and between them.

The method is Dormand and Prince's of order 8, with errors of orders 5 and 3 (DOP853; Hairer,
Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.5). It serves the
verification of plans alone: what makes them uses another method.

Limits are proved between the samples of plan files, where these may be few. Nothing is to be done
for rigid motion: its shape stays, its inputs grow steadily, so that most is used of every limit at
a sample. Nor for curvatures, each of which changes one way only from sample to sample. Other motion
is cut where inputs have moved a tenth of a millimetre, and integrated anew. Where the rate of a
share of a speed limit is within [m, M] for a time h, the share is nowhere more than (M - m) h / 4
above the larger one at the ends. Parts of the robot come no nearer to each other than half of what
their gaps at the ends add up to, less how far points of them may have moved.
"""

from __future__ import annotations

import bisect
import itertools
import math
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from twosra_mpc.effort import Cost, charge
from twosra_mpc.errors import InputError
from twosra_mpc.files import data_file
from twosra_mpc.model.cache import per_body
from twosra_mpc.model.flow import weighted
from twosra_mpc.model.intervals import enclose
from twosra_mpc.model.kinematics import InPlace, kinematics
from twosra_mpc.model.rows import in_mode
from twosra_mpc.plans.trajectory import Samples, Trajectory
from twosra_mpc.problem.limits import BODY_GAP, UNIT_GAP, parts_moved_m, shape_margins
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.speeds import shares_used, speed_function, speed_limits
from twosra_mpc.problem.tolerances import BODY_TOLERANCE_M, RATE_TOLERANCE, ROUNDING
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array
from twosra_mpc.robot.description import Body, Robot
from twosra_mpc.robot.modes import Mode

Bounds = tuple[Array, Array]  # lower and upper


def share_rates(
    robot: Robot, kappa: Bounds, v: Bounds, a: Array, mode: NDArray[np.int64]
) -> Bounds:
    """Enclose d/dt of the shares of the speed limits that are used, (shares, m) [1/s].

    Interval arithmetic on the derivative along q' = J(q, sigma) v, v' = a. Shares are signed, in
    the order of ``speed_function``.

    Args:
        robot: The robot.
        kappa: Least and largest curvatures, each (m, n) [1/m].
        v: Least and largest inputs, each (m, 5).
        a: Their rate of change, (m, 5).
        mode: Stiffness, (m, n).
    """
    lower, upper = (np.hstack([k, s, a, mode]).T for k, s in zip(kappa, v, strict=True))
    return enclose(_share_rates(robot), lower, upper)


@per_body()
def _share_rates(body: Body) -> ca.Function:
    """(kappa, v, a, sigma) as one vector -> rates of the shares."""
    segments = body.geometry.segments
    parts = (segments, INPUTS, INPUTS, segments)
    x, q = ca.SX.sym("x", sum(parts)), ca.SX.sym("q", POSE + segments)
    kappa, v, a, sigma = ca.vertsplit(x, np.cumsum([0, *parts]).tolist())
    speeds, growth = (ca.vertcat(*speed_function(body)(q, s, sigma)) for s in (v, a))
    rates = growth + ca.jtimes(speeds, q, kinematics(body).jacobian(q, sigma) @ v)
    (rates,) = ca.substitute([rates], [q], [ca.vertcat(ca.SX.zeros(POSE), kappa)])
    return ca.Function("share_rates", [x], [ca.densify(rates)], {"cse": True})


_DOP853 = tomllib.loads(data_file("checking/dop853.toml"))
_STAGES, _EIGHTH, _OFF_FIFTH, _THIRD = _DOP853.values()
_RTOL, _ATOL = 1e-12, 1e-14  # at 1e-10 a long step can miss the kink of the spirals at kappa = 0
_NO_ERROR = 1e-300  # avoids 0 / 0 where nothing moves


@per_body()
def step_of_order_8(body: Body) -> ca.Function:
    """(q, s, c, sigma) -> (q after the input displacement s, (error, largest curvature there)).

    A share w of the way the input is s + c (w - 1/2). The error is that of a relative tolerance of
    1e-12: more than 1 is too much.
    """
    segments = body.geometry.segments
    q, s, c = ca.SX.sym("q", POSE + segments), ca.SX.sym("s", INPUTS), ca.SX.sym("c", INPUTS)
    sigma, jacobian = ca.SX.sym("sigma", segments), kinematics(body).jacobian
    slopes: list[ca.SX] = []
    for stage in _STAGES:
        here = s + c * (sum(stage) - 0.5)
        slopes.append(jacobian(q + weighted(stage, slopes), sigma) @ here)
    off_third = [a - b for a, b in zip(_EIGHTH, _THIRD, strict=True)]
    after = q + weighted(_EIGHTH, slopes)
    scale = _ATOL + _RTOL * ca.fmax(ca.fabs(q), ca.fabs(after))
    fifth, third = (
        ca.sumsqr(weighted(off, slopes) / scale) / q.numel() for off in (_OFF_FIFTH, off_third)
    )
    error = fifth / ca.sqrt(fifth + 0.01 * third + _NO_ERROR)
    told = ca.vertcat(error, ca.mmax(ca.fabs(after[POSE:])))
    return ca.Function("step_of_order_8", [q, s, c, sigma], [after, told])


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
    """Commands that move a robot, of `Samples`: times (m,), inputs, rates (m, 5), modes (m, n)."""

    t_s: Array
    v: Array
    a: Array
    mode: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def moves(self) -> NDArray[np.bool_]:
        """True where the robot moves from each row to the next, (m,)."""
        return ((self.v != 0) | (self.a != 0)).any(axis=1)


def reintegrate(problem: Problem, samples: Samples | Sent) -> Array:
    """Integrate q' = J(q, mode) v over the samples from the start configuration, (m, 3 + n).

    Adaptive Dormand-Prince 8(5,3), relative tolerance 1e-12, restarted where the direction of the
    input or the mode changes; in between only the speed does, which does not change the path, or
    the input evenly in time. Rows are NaN from where a curvature runs away beyond twice its limit.
    """
    beyond, q = 2 * problem.robot.limits.curvature_per_m, problem.start.configuration
    reached, known = np.full((len(samples), len(q)), np.nan), dict[tuple[Mode, bool], _Steps]()
    reached[0] = q
    for first, last, way, lengths in paths(samples):
        rows, mode = reached[first + 1 : last + 1], tuple(samples.mode[first].tolist())
        if not way.any():
            rows[:] = reached[first]
            continue
        kind = mode, bool(way[1].any())
        if kind not in known:
            idle = _idle(problem.robot, *kind)
            known[kind] = idle.pop() if idle else _Steps(problem.robot, *kind)
        ends = np.cumsum(lengths).tolist()
        if not _follow(known[kind], reached[first], way, ends, beyond, rows):
            break
    for kind, steps in known.items():
        _idle(problem.robot, *kind).append(steps)
    return reached


@per_body(8)
def _idle(body: Body, mode: Mode, turns: bool) -> list[_Steps]:
    """Those of a kind that nobody takes now: in another thread somebody may."""
    del body, mode, turns
    return []


def _follow(
    steps: _Steps, q: Array, way: Array, ends: list[float], beyond: float, rows: Array
) -> bool:
    """Fill in configurations after lengths of a path; False where a curvature runs away.

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
        moved = way[0] * step + way[1] * (step * (done + step / 2)), way[1] * step**2
        after, error, curvature = steps(q, *moved, False)
        if many and error <= 1:
            after, error, curvature = steps(q, *moved, True)
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
    """Steps in one mode, with inputs that turn on the way or do not."""

    def __init__(self, robot: Robot, mode: Mode, turns: bool) -> None:
        step = in_mode(step_of_order_8(robot), mode)
        if not turns:  # what a change would do falls away
            q, s, c = (ca.SX.sym("x", step.size1_in(i)) for i in range(3))
            step = ca.Function(step.name(), [q, s, c], step.call([q, s, ca.DM.zeros(INPUTS)]))
        size, self._made = step.numel_out(0), list[tuple[list[Array], InPlace]]()
        for count in (1, _DEGREE):
            arrays = [np.zeros((count, k)) for k in (size, INPUTS, INPUTS, size, 2)]
            function = step if count == 1 else step.map(count)
            self._made.append((arrays, InPlace(function, arrays[:3], arrays[3:])))

    def __call__(self, q: Array, s: Array, c: Array, many: bool) -> tuple[Array, float, float]:
        """Step by s, or by shares of it: configurations (m, 3 + n), worst error and curvature."""
        (at, moved, change, after, told), in_place = self._made[many]
        at[:], moved[:], change[:] = q, s, c
        if many:
            moved += (_SHARES - 1) / 2 * c
            moved *= _SHARES
            change *= _SHARES**2
        in_place.evaluate()
        error, curvature = (told.max(axis=0) if many else told[0]).tolist()
        return after, error, curvature


def paths(samples: Samples | Sent) -> Iterator[tuple[int, int, Array, Array]]:
    """Runs of samples in one mode on one path: (first, last, way, lengths).

    The input at a length l of the path is along way[0] + way[1] l, (5,) each. Mostly that is one
    direction, s / |s| of the displacements s with lengths |s|, zero at rest. Where an input turns
    on the way, lengths are times, and a run is as long as it changes evenly.
    """
    dt = np.diff(samples.t_s)
    direction = samples.a[:-1] * dt[:, None]  # the rest is done in place: there may be many rows
    direction /= 2
    direction += samples.v[:-1]
    direction *= dt[:, None]
    lengths = np.linalg.norm(direction, axis=1)
    direction /= np.where(lengths > 0, lengths, 1.0)[:, None]
    breaks = np.abs(np.diff(direction, axis=0)).max(axis=1, initial=0.0) > _SAME_DIRECTION
    turns = turns_aside(samples)
    if turns.any():
        begin, rate = samples.v[:-1], samples.a[:-1]
        jumps = np.abs(begin[1:] - begin[:-1] - rate[:-1] * dt[:-1, None]).max(axis=1)
        goes_on = (rate[1:] == rate[:-1]).all(axis=1) & (jumps <= _SAME_DIRECTION)
        breaks = np.where(turns[1:] & turns[:-1], ~goes_on, breaks | turns[1:] | turns[:-1])
        lengths = np.where(turns, dt, lengths)
    breaks |= np.diff(samples.mode[:-1], axis=0).any(axis=1)
    starts = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(lengths)]
    still = np.broadcast_to(0.0, direction.shape)
    for first, last in itertools.pairwise(starts):
        if last > first:
            begin, rate = (samples.v, samples.a) if turns[first] else (direction, still)
            yield first, last, np.array([begin[first], rate[first]]), lengths[first:last]


def turns_aside(samples: Samples | Sent) -> NDArray[np.bool_]:
    """True where the input does not keep its direction until the next row, (m - 1,)."""
    begin = samples.v[:-1]
    change = samples.a[:-1] * np.diff(samples.t_s)[:, None]
    size = np.abs(begin).max(axis=1) + np.abs(change).max(axis=1)
    aside = np.zeros(len(begin))
    for i, j in itertools.combinations(range(INPUTS), 2):  # all at once would be most of a plan
        across = begin[:, i] * change[:, j] - begin[:, j] * change[:, i]
        np.maximum(aside, np.abs(across), out=aside)
    back = (begin * (begin + change)).sum(axis=1) < -ROUNDING * size**2
    turns: NDArray[np.bool_] = back | (aside > ROUNDING * size**2)
    return turns


def between(samples: Samples, cut: float | Array, least: int) -> tuple[Sent, NDArray[np.intp]]:
    """Commands that move the robot no more than ``cut`` (m or rad) from one row to the next.

    ``cut`` may be a list, one for each interval. Those that move are cut into ``least`` more parts.

    Returns:
        The finer rows, and for each the row of ``samples`` in force.

    Raises:
        InputError: If something moves absurdly far.
    """
    dt = np.diff(samples.t_s)
    end = samples.v[:-1] + samples.a[:-1] * dt[:, None]
    moved = ((np.abs(samples.v[:-1]) + np.abs(end)) / 2).max(axis=1) * dt
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


_CUT = 1e-4  # m: what an input moves between the places that are looked at


def between_problems(trajectory: Trajectory) -> Iterator[str]:
    """Limits of speed, and of gaps between parts, that are exceeded between samples."""
    samples, robot = trajectory.samples, trajectory.problem.robot
    soft = samples.mode[:-1].any(axis=1)
    fine, _ = between(samples, np.where(soft, _CUT, np.inf), least=1)
    q = reintegrate(trajectory.problem, fine)
    rows = np.flatnonzero(fine.mode[:-1].any(axis=1) & fine.moves[:-1])
    if not len(rows) or not np.isfinite(q).all():  # what is anywhere is told of already
        return
    h, a, mode = np.diff(fine.t_s)[rows], fine.a[rows], fine.mode[rows]
    places, inputs = (q[rows], q[rows + 1]), (fine.v[rows], fine.v[rows] + a * h[:, None])
    kappa = places[0][:, POSE:], places[1][:, POSE:]
    shapes, speeds = ((np.minimum(*ends), np.maximum(*ends)) for ends in (kappa, inputs))
    low, high = share_rates(robot, shapes, speeds, a, mode)
    ends = [shares_used(robot, *end, mode) for end in zip(places, inputs, strict=True)]
    beyond = iter((high - low) * h / 4)
    for limit, begin, end in zip(speed_limits(robot), *ends, strict=True):
        worst = (np.maximum(begin, end) + [next(beyond) for _ in begin]).max(axis=0)
        if worst.max() > 1 + RATE_TOLERANCE:
            by = (worst.max() - 1) * limit.most(robot)
            when = fine.t_s[rows[int(worst.argmax())]]
            when = f"at {when:z.3f} s, between samples"
            yield f"limit {limit.name} exceeded by up to {by:z.3g} {when}"
    moved_m = parts_moved_m(robot, np.abs(kappa[1] - kappa[0]))
    margins = [shape_margins(robot, end) for end in kappa]
    for gap in (UNIT_GAP, BODY_GAP):
        least = (margins[0][gap.name] + margins[1][gap.name] - moved_m) / 2
        if least.min() < -BODY_TOLERANCE_M:
            when, by = fine.t_s[rows[int(least.argmin())]], -least.min()
            yield f"limit {gap.name} exceeded by up to {by:z.3g} at {when:z.3f} s, between samples"
