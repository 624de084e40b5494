"""SciPy integrates what a plan sends: where the robot is at its samples, and between them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from twosra_mpc.deadline import check_time
from twosra_mpc.errors import InputError
from twosra_mpc.model.kinematics import InPlace, kinematics
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import INPUTS, POSE, Array

_MOST_CUTS = 2_000_000  # of all intervals
_SAME_DIRECTION = 1e-13  # rounding of a unit vector
_RTOL, _ATOL = 1e-12, 1e-14  # at 1e-10 a long step can miss the kink of the spirals at kappa = 0


def reintegrate(problem: Problem, samples: Samples) -> Array:
    """Integrate q' = J(q, mode) v over the samples from the start configuration, (m, 3 + n).

    Adaptive Dormand-Prince 8(5,3), relative tolerance 1e-12, restarted where the direction of the
    input or the mode changes; in between only the speed does, which does not change the path.
    Rows are NaN from where a curvature runs away beyond twice its limit.
    """
    beyond = 2 * problem.robot.limits.curvature_per_m

    def runs_away(_s: float, at: Array) -> float:
        return beyond - float(np.abs(at[3:]).max())

    runs_away.terminal = True  # type: ignore[attr-defined]  # SciPy's way to stop at an event
    size = problem.robot.coordinates.size
    q, sigma, columns = np.zeros(size), np.zeros(size - POSE), np.zeros((INPUTS, size))
    jacobian = InPlace(kinematics(problem.robot).jacobian, [q, sigma], [columns])
    reached = np.full((len(samples), size), np.nan)
    reached[0] = problem.start.configuration
    for first, last, direction, lengths in paths(samples):
        if not direction.any():
            reached[first + 1 : last + 1] = reached[first]
            continue
        sigma[:] = samples.mode[first]

        def rate(_s: float, at: Array, direction: Array = direction) -> Array:
            check_time()
            q[:] = at
            jacobian.evaluate()
            return direction @ columns

        marks = np.cumsum(lengths)
        with np.errstate(over="ignore", invalid="ignore"):  # then its steps vanish, and it fails
            end = solve_ivp(
                rate,
                (0.0, float(marks[-1])),
                reached[first],
                method="DOP853",
                t_eval=marks,
                rtol=_RTOL,
                atol=_ATOL,
                events=runs_away,
            )
        passed = len(end.t)
        reached[first + 1 : first + 1 + passed] = np.reshape(end.y, (size, passed)).T
        if end.status != 0:
            break
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
    cuts = np.where(moved > 0, np.ceil(moved / cut) + least, 1).astype(int)
    at = np.repeat(np.arange(len(cuts)), cuts)
    share = (np.arange(len(at)) - (np.cumsum(cuts) - cuts)[at]) / cuts[at]
    t = np.append(samples.t_s[at] + share * dt[at], samples.t_s[-1])
    at = np.append(at, len(cuts))
    v = samples.v[at] + samples.a[at] * (t - samples.t_s[at])[:, None]
    held = {item.name: getattr(samples, item.name)[at] for item in fields(samples)}
    return Samples(**{**held, "t_s": t, "v": v}), at
