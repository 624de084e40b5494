"""Logs of an object that is carried: how far off its path it was, and how far it slipped.

Columns ``time``, ``x``, ``y``, ``angle`` (of b0), ``object_x``, ``object_y``, ``object_angle``, SI,
as ``export plan.csv`` writes them, and ``path_x`` and ``path_y``, where the object was to be, if
that is known; other columns are ignored.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twosra_mpc.checking.followed import followed
from twosra_mpc.files import reading
from twosra_mpc.lab.csv_table import CsvTable
from twosra_mpc.lab.identification.motion_log import ASKED, IN_HAND, LEAST_ROWS, times_of
from twosra_mpc.problem.tasks import Follow
from twosra_mpc.robot.coordinates import Array, composed, inverse

_RESTS_M = 0.005  # nearer to where it is first or last, an object is not carried
_FINE_M = 1e-3  # between places that are compared with the path


class Transport(NamedTuple):
    """How an object was carried.

    Attributes:
        from_s: Since when.
        to_s: Until when.
        slip_m: How far it was from its first place in the hand, at most.
        off_path_mean_m: How far it was from its path, on average along the way, while its place in
            the columns of a path moves, if it is these that say it; None: no path.
        off_path_m: The same at worst.
        left_m: What it has not come to of its path.
    """

    from_s: float
    to_s: float
    slip_m: float
    off_path_mean_m: float | None
    off_path_m: float | None
    left_m: float | None


def transport(table: CsvTable, path: Path | None = None) -> Transport | None:
    """Judge a log by its path, in a file or in its own columns; None if it has no object.

    Raises:
        InputError: If a column is missing, a cell is no number, or nothing can follow the path.
    """
    if not set(IN_HAND) & set(table.names):
        return None
    table.check(("time", "x", "y", "angle", *IN_HAND), LEAST_ROWS)
    time_s = times_of(table, "time")
    robot, thing = table.numbers("x", "y", "angle"), table.numbers(*IN_HAND)
    thing[:, 2] = np.unwrap(thing[:, 2])
    away = [np.hypot(*(thing - end)[:, :2].T) > _RESTS_M for end in (thing[0], thing[-1])]
    first = max(int(away[0].argmax()) - 1, 0)
    last = len(thing) - int(away[1][::-1].argmax()) if away[1].any() else len(thing) - 1
    rows = slice(first, max(last, first + 1) + 1)
    in_b0 = composed(inverse(robot[rows]), thing[rows])
    slip_m = float(np.hypot(*(in_b0 - in_b0[0])[:, :2].T).max())
    from_s, to_s = time_s[rows][[0, -1]].tolist()
    points: Any = None if path is None else str(path)
    if path is None and set(ASKED) <= set(table.names):
        moves = np.hypot(*np.diff(table.numbers(*ASKED)[rows], axis=0).T) > 0  # else it is not led
        rows = slice(first + int(moves.argmax()), rows.stop - int(moves[::-1].argmax()))
        points = table.numbers(*ASKED)[rows].tolist()
    if points is None:
        return Transport(from_s, to_s, slip_m, None, None, None)
    with reading(table.source, "path"):
        task = Follow(path=points)
    half_m = float(task.line.length_m[-1]) / 2  # a path that is closed begins where it ends
    task = task.with_values(from_m=float(task.line.along(thing[rows][:1, :2], half_m)[0]))
    found = followed(task, *_finely(time_s[rows], thing[rows]))
    return Transport(from_s, to_s, slip_m, found.off_m.mean(), found.off_m.max(), found.left_m)


def _finely(time_s: Array, poses: Array) -> tuple[Array, Array]:
    """Times and poses, straight between those of rows."""
    gone = np.append(0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    fine = np.unique(np.append(np.arange(0.0, gone[-1], _FINE_M), gone))
    at = [np.interp(fine, gone, column) for column in (time_s, *poses.T)]
    return at[0], np.column_stack(at[1:])
