"""Distributions of joint bends from runs: how segments that are soft together share a bend.

Where a joint bend begins, a share of the difference of their W is lost, and the rest grows with
their mean by twice the split. A run counts as one observation, since repetition within a run tells
nothing of the next one. The robot's file is the prior: it weighs as one run in the mean, and as two
in the variance. Equally likely values stand for the predictive distribution of the next run
(Student's): after one run it is as wide as the prior, after more it narrows to the spread between
runs, and never below.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from twosra_mpc import InputError, Mode, Robot
from twosra_mpc.execution.run import Drive, Run
from twosra_mpc.lab.identification.replay import LEAST_BEND_RAD
from twosra_mpc.model.bending import bending
from twosra_mpc.model.rolling import rolled
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import soft_segments

_SEEN_S = 1.0  # s after a bend, in which the camera sees where it ended
VALUES = 5  # equally likely ones for a distribution: a policy has as many branches


class Told(NamedTuple):
    """Observation of a run: means over its joint bends, NaN where there is none.

    Attributes:
        split: Share by which the first of segments that are soft together bends more than on
            average, the second less.
        relaxation: Share of the difference between them that is lost when they begin.
        gain: How far soft segments bend, as a share of what their wheels' commands should bend.
    """

    split: float
    relaxation: float
    gain: float


class Learned(NamedTuple):
    """Predictive distribution of the next run: mean, deviation, equally likely values."""

    mean: float
    spread: float
    values: tuple[float, ...]


def told_by(run: Run, robot: Robot) -> Told:
    """Observe the joint bends of a run.

    Raises:
        InputError: If it is a run of another robot.
    """
    if run.problem.robot.geometry != robot.geometry:
        raise InputError("run", run.problem.robot.name, f"a run of {robot.name}: same geometry")
    found = [_told(run, robot, *each) for each in _soft_drives(run)]
    columns = zip(*found, strict=True) if found else [(), (), ()]
    known = ([value for value in column if math.isfinite(value)] for column in columns)
    return Told(*(float(np.mean(each)) if each else math.nan for each in known))


def _soft_drives(run: Run) -> Iterator[tuple[Mode, float, float]]:
    """Yield soft modes with when they begin and end [s]: drives between melts and freezes."""

    def block(drive: Drive) -> tuple[Mode, int]:
        return drive.mode, sum(change.time_s <= drive.start_s for change in run.changes)

    for (mode, _), drives in itertools.groupby(run.drives, key=block):
        if any(mode):
            times = [(drive.start_s, drive.end_s) for drive in drives]
            yield mode, times[0][0], times[-1][1]


def _told(run: Run, robot: Robot, mode: Mode, start_s: float, end_s: float) -> Told:
    """Split, relaxation and gain of one bend."""
    log, soft, facts = run.log, list(soft_segments(mode)), bending(robot)
    first, end, last = np.searchsorted(log.time_s, (start_s, end_s, end_s + _SEEN_S)).tolist()
    w = facts.coordinates(log.q[:, POSE:])[:, soft]
    moved = float((w[min(last, len(w) - 1)] - w[first]).mean())
    turned = log.wheel_rad_s[first:end] * np.diff(log.time_s[first : end + 1])[:, None]
    rolled_to = rolled(robot.body, mode, log.q[first], turned)[-1, POSE:]
    asked = float((facts.coordinates(rolled_to)[soft] - w[first]).mean())
    least = facts.coordinate(LEAST_BEND_RAD / robot.geometry.lengths_m[soft[0]], soft[0])
    gain = moved / asked if abs(asked) >= least else math.nan
    seen = facts.coordinates(log.measured[first : last + 1, POSE:])[:, soft]
    seen = seen[np.isfinite(seen).all(axis=1)]
    if len(soft) != 2 or not len(seen):
        return Told(math.nan, math.nan, gain)
    bent, apart = seen.mean(axis=1) - w[first].mean(), seen @ [1.0, -1.0]
    bends = len(seen) > 1 and abs(moved) >= least
    slope, begun = np.polyfit(bent, apart, 1) if bends else (math.nan, apart.mean())
    rigid = np.flatnonzero((log.stiffness[:first, soft] == 0).any(axis=1))
    before = w[rigid[-1]] @ [1.0, -1.0] if len(rigid) else 0.0
    relaxation = float(1 - begun / before) if abs(before) >= least else math.nan
    return Told(float(slope / 2), relaxation, gain)


def learned(
    known: Sequence[float] | None, shown: Sequence[float], within: tuple[float, float]
) -> Learned:
    """Predict the next run from the prior and the runs observed.

    Args:
        known: Prior: equally likely values of the robot's file; None if it says nothing.
        shown: Observation of each run; at least one, or two without a prior.
        within: Least and largest value there may be.
    """
    n, weight = len(shown), 0 if known is None else 1
    prior, prior_variance = (0.0, 0.0) if known is None else (np.mean(known), np.var(known))
    ours, between = float(np.mean(shown)), float(np.var(shown, ddof=1)) if n > 1 else 0.0
    mean = float(weight * prior + n * ours) / (weight + n)
    odd = weight * n / (weight + n) * (ours - prior) ** 2
    freedom = 2 * weight + n - (0 if weight else 1)
    variance = (2 * weight * prior_variance + (n - 1) * between + odd) / freedom
    spread = math.sqrt(max(variance * (1 + 1 / (weight + n)), between))
    nodes = np.array([NormalDist().inv_cdf((i + 0.5) / VALUES) for i in range(VALUES)])
    values = np.clip(mean + spread * nodes / nodes.std(), *within)
    return Learned(mean, spread, tuple(np.round(values, 3).tolist()))
