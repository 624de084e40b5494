"""The hardware trials of the paper against its simulations, from their logs.

A log is read by ``identification.motion_log``. The clock of the authors' logs has a resolution of
1 s, so durations are known to about 1 s. Distances are those of dynamic time warping (DTW, by
similaritymeasures as in the authors' notebook), as published and by values alone. The published
recipe: columns of the log are averaged over 15 rows, the simulation's last row is repeated until
both are equally long, each column gets mean 0 and standard deviation 1, and its points are (row,
value); rows are not scaled, so the distance is mostly one of rows.

The first heating of a trial is before its log: the controller of the trials slept a fixed time,
whatever the metal did (``mainController.py`` of the authors' 2sr-agent-control).

Trials: Labazanova et al., IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from twosra_mpc import InputError, Robot
from twosra_mpc.arguments import public
from twosra_mpc.installation import require
from twosra_mpc.lab.identification.motion_log import MotionLog, read_motion_log
from twosra_mpc.lab.reproduction.published_model import checked_configuration
from twosra_mpc.lab.reproduction.published_runs import SIMULATIONS, PublishedTrajectory
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import ModeSequence

EXTRA = "paper"
WINDOW = 15  # rows, of the trailing mean
# How far from its simulation a trial may start: it was placed by hand [m, m, rad, 1/m, 1/m].
PLACED = np.array([0.02, 0.02, 0.15, 5.0, 5.0])

# Where a clone of the authors' repository 2sr-agent-control has its trials.
_CLONED = ("ExpData/mainExperiment*.csv", "Analysis/*.csv")

HEAT_ONE_S, HEAT_BOTH_S = 102.0, 100.0  # the controller's sleep while one or both segments melt

Q = tuple[float, ...]  # of [x, y, phi, kappa_1, kappa_2]


class DtwRow(NamedTuple):
    """Distances of a log from a simulation, of x, y, phi, kappa_1 and kappa_2.

    Attributes:
        published: Distances by the published recipe, without a unit, (5,).
        mean: Mean deviation along the path of time warping [m, m, rad, 1/m, 1/m], (5,).
        largest: Largest deviation along it, likewise.
    """

    published: Q
    mean: Q
    largest: Q


class WaitingShares(NamedTuple):
    """Shares of the time of a log.

    Attributes:
        sequence: Modes of its phases.
        first_heating_s: Wait before the log, by the controller of the trials.
        waits_s: Waits in the log.
        motion_s: The rest of the log.
        total_s: All time, the first heating included.
        share_waiting: Waits over all time, the first heating included.
        final_error: Last configuration less the target [m, m, rad, 1/m, 1/m]; empty without one.
    """

    sequence: ModeSequence
    first_heating_s: float
    waits_s: float
    motion_s: float
    total_s: float
    share_waiting: float
    final_error: Q


def trial_paths(folder: str | Path) -> list[Path]:
    """CSV files of trials, by name: of a folder, or of a clone of the authors' 2sr-agent-control.

    Raises:
        InputError: If there is none.
    """
    cloned = [path for pattern in _CLONED for path in Path(folder).glob(pattern)]
    paths = sorted(cloned or Path(folder).glob("*.csv"), key=lambda path: path.name)
    if not paths:
        raise InputError("folder", str(folder), "a folder with logs of trials (.csv)")
    return paths


@public
def read_trials(folder: str | Path, robot: Robot) -> Iterator[MotionLog]:
    """Yield the log in each CSV file of trials, by name (`trial_paths`), and copies of it once.

    Raises:
        InputError: If there is none, or one is no log of motion with inputs of two segments.
    """
    known: set[bytes] = set()
    for path in trial_paths(folder):
        log = _log_of_two_segments(read_motion_log(path, robot))
        if (content := log.time_s.tobytes() + log.q.tobytes()) not in known:
            known.add(content)
            yield log


def _log_of_two_segments(log: MotionLog) -> MotionLog:
    if log.by_wheels or log.q.shape[1] != len(PLACED):
        raise InputError("log", log.source, "one of inputs and two segments")
    return log


@public
def trial_of(log: MotionLog) -> int | None:
    """Trial (1 to 5) whose simulation starts where a log does; None if there is none.

    Raises:
        InputError: If it is no log of inputs and two segments.
    """
    first = _log_of_two_segments(log).q[0]
    off = {n: np.abs(first - each.start) / PLACED for n, each in SIMULATIONS.items()}
    nearest = min(off, key=lambda trial: float(off[trial].max()))
    return nearest if off[nearest].max() <= 1.0 else None


@public
def dtw_table(log: MotionLog, simulation: PublishedTrajectory) -> DtwRow:
    """Compare a log with a simulation, as published and by values alone (see the module).

    Raises:
        InputError: If the log is too short or not one of inputs and two segments, or
            similaritymeasures is not installed.
    """
    if len(_log_of_two_segments(log).q) <= WINDOW:
        raise InputError("rows", len(log.q), f"more than {WINDOW}", log.source)
    windows = np.lib.stride_tricks.sliding_window_view(log.q, WINDOW, axis=0)
    q, simulated = windows.mean(axis=-1), simulation.q
    rest = np.repeat(simulated[-1:], max(len(q) - len(simulated), 0), axis=0)
    simulated = np.vstack([simulated, rest])
    published, mean, largest = [], [], []
    for mine, theirs in zip(q.T, simulated.T, strict=True):
        published.append(_warped(_points(mine), _points(theirs))[0])
        _, path = _warped(mine[:, None], theirs[:, None])
        apart = np.abs(mine[path[:, 0]] - theirs[path[:, 1]])
        mean.append(float(apart.mean()))
        largest.append(float(apart.max()))
    return DtwRow(tuple(published), tuple(mean), tuple(largest))


def _points(column: Array) -> Array:
    """Points (row, value) of a column with mean 0 and deviation 1; a constant one is 0."""
    spread = np.ptp(column) and np.std(column, ddof=1)
    return np.column_stack([np.arange(len(column)), (column - column.mean()) / (spread or 1.0)])


def _warped(points: Array, others: Array) -> tuple[float, Array]:
    """Sum of Euclidean distances along the best path, and the path: pairs of rows, (pairs, 2)."""
    require("time warping as published", EXTRA, "similaritymeasures")
    import similaritymeasures  # type: ignore[import-untyped]

    cumulative = _cumulative(cdist(points, others))
    return float(cumulative[-1, -1]), similaritymeasures.dtw_path(cumulative)


def _cumulative(apart: Array) -> Array:
    """Least sums of distances along paths to each pair of rows, as ``similaritymeasures.dtw``.

    The pairs of one antidiagonal need only those of the two before it, so each is one operation.
    """
    rows, columns = apart.shape
    width = columns + 1
    padded = np.full((rows + 1, width), np.inf)
    padded[0, 0], flat = 0.0, padded.reshape(-1)
    distances = np.pad(apart, ((1, 0), (1, 0))).reshape(-1)
    for diagonal in range(2, rows + columns + 1):
        first, last = max(1, diagonal - columns), min(rows, diagonal - 1)
        at = slice(first * width + diagonal - first, last * width + diagonal - last + 1, columns)
        above, left, before = (
            flat[at.start - step : at.stop - step : columns] for step in (width, 1, width + 1)
        )
        flat[at] = distances[at] + np.minimum(np.minimum(above, left), before)
    return padded[1:, 1:]


@public
def waiting(log: MotionLog, goal: Sequence[float] | Array | None = None) -> WaitingShares:
    """Shares of waiting and motion in the time of a log.

    Args:
        log: The log.
        goal: Target [m, m, rad, 1/m, 1/m], for the final error; None if it is not known.

    Raises:
        InputError: If it is no log of inputs and two segments, or the goal is none.
    """
    last, time_s = _log_of_two_segments(log).q[-1], log.time_s
    target = None if goal is None else checked_configuration("goal", goal)
    sequence = tuple(tuple(log.mode[phase.start].tolist()) for phase in log.phases)
    first_heating_s = (0.0, HEAT_ONE_S, HEAT_BOTH_S)[sum(sequence[0])]
    gaps = itertools.pairwise(log.phases)
    waits_s = float(sum(time_s[after.start] - time_s[before.stop - 1] for before, after in gaps))
    total_s = first_heating_s + float(time_s[-1])
    return WaitingShares(
        sequence=sequence,
        first_heating_s=first_heating_s,
        waits_s=waits_s,
        motion_s=float(time_s[-1]) - waits_s,
        total_s=total_s,
        share_waiting=(first_heating_s + waits_s) / total_s,
        final_error=() if target is None else tuple((last - target).tolist()),
    )
