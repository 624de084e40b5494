"""What a plan sends, integrated anew: where the robot is at its samples, and between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.checking.dormand_prince import step_of_order_8
from twosra_mpc.deadline import check_time
from twosra_mpc.errors import InputError
from twosra_mpc.model.kinematics import InPlace
from twosra_mpc.model.rows import in_mode
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import INPUTS, Array
from twosra_mpc.robot.modes import Mode

_MOST_CUTS = 2_000_000  # of all intervals
_SAME_DIRECTION = 1e-13  # rounding of a unit vector
_SAFE, _LEAST_GROWTH, _MOST_GROWTH = 0.9, 0.2, 10.0  # of the next step
_LEAST_STEP = 1e-12  # m or rad: where that is too long, a curvature runs away


def reintegrate(problem: Problem, samples: Samples) -> Array:
    """Integrate q' = J(q, mode) v over the samples from the start configuration, (m, 3 + n).

    Adaptive Dormand-Prince 8(5,3), relative tolerance 1e-12, restarted where the direction of the
    input or the mode changes; in between only the speed does, which does not change the path.
    Rows are NaN from where a curvature runs away beyond twice its limit.
    """
    beyond, size = 2 * problem.robot.limits.curvature_per_m, problem.robot.coordinates.size
    q, s = problem.start.configuration.copy(), np.empty(INPUTS)
    after, told, integrators = np.empty(size), np.empty(2), dict[Mode, InPlace]()
    reached = np.full((len(samples), size), np.nan)
    reached[0] = q
    for first, last, direction, lengths in paths(samples):
        if not direction.any():
            reached[first + 1 : last + 1] = q
            continue
        mode, longest = tuple(samples.mode[first].tolist()), math.inf
        if mode not in integrators:
            step_in_mode = in_mode(step_of_order_8(problem.robot), mode)
            integrators[mode] = InPlace(step_in_mode, [q, s], [after, told])
        evaluate = integrators[mode].evaluate
        for row, left in enumerate(lengths.tolist(), start=first + 1):
            while left > 0:
                check_time()
                step = min(longest, left)
                np.multiply(direction, step, out=s)
                evaluate()
                error, curvature = told.tolist()
                growth = _SAFE * error**-0.125 if error > 0 else _MOST_GROWTH
                if not error <= 1:  # nor where it is no number
                    longest = step * (max(_LEAST_GROWTH, growth) if error > 1 else _LEAST_GROWTH)
                    if longest < _LEAST_STEP:
                        return reached
                    continue
                if curvature > beyond:
                    return reached
                q[:] = after
                left -= step
                longest = max(longest, step * min(_MOST_GROWTH, growth))
            reached[row] = q
    return reached


def paths(samples: Samples) -> Iterator[tuple[int, int, Array, Array]]:
    """Runs of samples with one mode and one direction: (first, last, direction, lengths).

    Lengths are those of the input displacements s = (v + a dt / 2) dt, direction is s / |s|, zero
    at rest.
    """
    dt = np.diff(samples.t_s)[:, None]
    moved = (samples.v[:-1] + samples.a[:-1] * dt / 2) * dt
    lengths = np.linalg.norm(moved, axis=1)
    direction = moved / np.where(lengths > 0, lengths, 1.0)[:, None]
    turned = np.abs(np.diff(direction, axis=0)).max(axis=1, initial=0.0) > _SAME_DIRECTION
    turned |= np.diff(samples.mode[:-1], axis=0).any(axis=1)
    starts = [0, *(np.flatnonzero(turned) + 1).tolist(), len(lengths)]
    for first, last in itertools.pairwise(starts):
        if last > first:
            yield first, last, direction[first], lengths[first:last]


def between(samples: Samples, cut: float | Array, least: int) -> tuple[Samples, NDArray[np.intp]]:
    """Samples whose inputs move no more than ``cut`` (m or rad) from one to the next.

    ``cut`` may be a list, one for each interval. Those that move are cut into ``least`` more parts.
    Only times, inputs, rates and modes are those of the plan at these times; the rest is held.

    Returns:
        The finer samples, and for each the row of ``samples`` in force.

    Raises:
        InputError: If something moves absurdly far.
    """
    dt = np.diff(samples.t_s)
    moved = np.abs((samples.v[:-1] + samples.a[:-1] * dt[:, None] / 2) * dt[:, None]).max(axis=1)
    if not (moved / cut).sum() <= _MOST_CUTS:
        allowed = "inputs that move the robot by no more than metres"
        raise InputError("samples.v", float(moved.max()), allowed)
    cuts = np.maximum(np.ceil(moved / cut) + least, 1).astype(int)
    at = np.repeat(np.arange(len(cuts)), cuts)
    share = (np.arange(len(at)) - (np.cumsum(cuts) - cuts)[at]) / cuts[at]
    t = np.append(samples.t_s[at] + share * dt[at], samples.t_s[-1])
    at = np.append(at, len(cuts))
    v = samples.v[at] + samples.a[at] * (t - samples.t_s[at])[:, None]
    held = {item.name: getattr(samples, item.name)[at] for item in fields(samples)}
    return Samples(**{**held, "t_s": t, "v": v}), at
