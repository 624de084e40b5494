"""Logs of motion: what was commanded, and what a camera saw; and of objects that are carried.

- Trials: columns x, y, angle, k1 ... kn (measured), v1, v2, u0, v0, r0 (inputs), s1 ... sn (mode)
  and time, in SI units; the model's state, where logged too, is ignored. ``export plan.csv`` writes
  the same columns.
- Wheels: columns ``time stamp``, ``LU1 x``, ``LU1 y``, ``LU1 th`` and the same of LU2: poses of
  both units in an image [mm, degrees], y down; the wheel speeds, constant, are not in the file.
- Objects: columns time, x, y, angle (of b0), object_x, object_y, object_angle, in SI units, as
  ``export plan.csv`` writes them, and path_x and path_y, where the object was to be, if that is
  known; other columns are ignored.

Times are seconds, or times of day to a second: the rows of a second are then spread over it.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from twosra_mpc import Follow, InputError, Mode, Plan, Robot, robot_shape
from twosra_mpc.arguments import public
from twosra_mpc.checking.followed import followed
from twosra_mpc.errors import doubt
from twosra_mpc.files import LARGEST, ending_of, reading, write_text
from twosra_mpc.keys import doubts
from twosra_mpc.lab.csv_table import CsvTable, finer_unit, number, read_csv
from twosra_mpc.plans.carried import carried, object_poses
from twosra_mpc.plans.setpoints import csv_of
from twosra_mpc.plans.trajectory import Samples, Trajectory
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array, composed, inverse
from twosra_mpc.robot.modes import is_rigid, soft_segments
from twosra_mpc.validation import ReadOnlyArrays

LEAST_ROWS = 3  # of a log: less has no course
LONGEST_STEP_S = 30.0  # a longer one ends a phase: the robot waits for its metal

IN_HAND, ASKED = ("object_x", "object_y", "object_angle"), ("path_x", "path_y")
_V = ("v1", "v2", "u0", "v0", "r0")
_UNITS = tuple(f"LU{unit} {name}" for unit in (1, 2) for name in ("x", "y", "th"))
_NAMED = re.compile(r"s(\d)_v(\d)_(-?\d+(?:\.\d+)?)$")  # segment, wheel and its speed [rad/s]
_SMOOTHED = 9  # rows, about half a second: headings of a unit jump by 0.2 rad from frame to frame


@dataclass(frozen=True, eq=False, repr=False)
class MotionLog(ReadOnlyArrays):
    """A checked log of n rows; arrays read-only.

    Attributes:
        source: Name of the file.
        time_s: Time of each row since the first, increasing, (rows,).
        q: Configuration measured [m, m, rad, 1/m ...], heading without jumps, (rows, 3 + n).
        mode: Mode in each row, (rows, n).
        commands: What was commanded from each row to the next: inputs [v1, v2 m/s, u0, v0 m/s,
            r0 rad/s], (rows, 5), or wheel speeds [rad/s], (rows, 4).
    """

    source: str
    time_s: Array
    q: Array
    mode: NDArray[np.int_]
    commands: Array

    @property
    def by_wheels(self) -> bool:
        """True if wheel speeds are known, not inputs."""
        return bool(self.commands.shape[1] == WHEELS)

    @property
    def phases(self) -> list[slice]:
        """Rows of one mode without a long pause between them, at least two."""
        switches = np.diff(self.mode, axis=0).any(axis=1) | (np.diff(self.time_s) > LONGEST_STEP_S)
        edges = [0, *(np.flatnonzero(switches) + 1).tolist(), len(self.time_s)]
        return [slice(first, end) for first, end in itertools.pairwise(edges) if end - first > 1]


def read_motion_log(
    path: str | Path,
    robot: Robot,
    *,
    wheel_rad_s: Sequence[float] | None = None,
    mode: Mode | None = None,
) -> MotionLog:
    """Read a CSV file in one of the two formats.

    Args:
        path: The file.
        robot: The robot that was driven.
        wheel_rad_s: Speeds of the four wheels, for a log of wheels; default: by the file's name,
            ``s1_v1_6.csv`` if segment 1 is soft and wheel 1 turns at 6 rad/s.
        mode: Mode of such a log; default: by the file's name.

    Warns:
        InputWarning: If numbers are probably in another unit.

    Raises:
        InputError: If the file cannot be read or is no such log, naming column and row, or what
            was driven is not known.
    """
    source = str(path)
    with reading(source, "log"):
        return _read(Path(path), robot, wheel_rad_s, mode)


def _of_trial(segments: int) -> tuple[str, ...]:
    """Columns of a trial before its time."""
    curvatures, stiffness = ([f"{letter}{j + 1}" for j in range(segments)] for letter in "ks")
    return ("x", "y", "angle", *curvatures, *_V, *stiffness)


@public
def save_authors_csv(plan: Plan, path: str | Path, rate_Hz: float | None = None) -> None:
    """Write configuration, input and stiffness of a plan as a trial, one row a sample, atomically.

    Units are SI: m, rad, 1/m, m/s, rad/s, s. Inputs and stiffness hold from their row to the next.
    Where something is carried along, further columns say where it is, and where on its path.

    Args:
        plan: The plan.
        path: Where to write it.
        rate_Hz: Rows per second, besides those where phases begin and end; default: the plan's
            own grid.

    Raises:
        NoPlanError: If the plan is not verified.
        InputError: If the rate or the path is not acceptable.
    """
    ending_of(path, ".csv")
    held = plan.require().trajectory.held(rate_Hz)
    columns = *held.q.T, *held.v.T, *held.mode.T
    named = dict(zip(_of_trial(held.mode.shape[1]), columns, strict=True))
    write_text(path, csv_of({**named, "time": held.t_s} | _carried(plan.trajectory, held)))


def _carried(trajectory: Trajectory, samples: Samples) -> dict[str, Array]:
    """Columns of the object in hand, or the next or last to be, and of the place on its path."""
    if not (held := carried(trajectory)):
        return {}
    t_s = samples.t_s
    now = np.minimum(np.searchsorted([each.to_s for each in held], t_s), len(held) - 1)
    numbers = np.array([each.object for each in held])[now]
    poses = object_poses(trajectory, t_s, samples.q)[np.arange(len(t_s)), numbers]
    found = dict(zip(IN_HAND, poses.T, strict=True))
    paths = ((i, stage.follows) for i, stage in enumerate(trajectory.problem.stages))
    for i, path in [(i, path) for i, path in paths if path is not None and path.object][:1]:
        begun_s, done_s = (0.0, *trajectory.done_s)[i : i + 2]
        during = (t_s >= begun_s) & (t_s <= done_s)
        at = poses[during, :2]
        most_m = path.position_tolerance_m + 2 * np.hypot(*np.diff(at, axis=0).T).max()
        gone_m = np.interp(t_s, t_s[during], path.left.along(at, float(most_m)))
        found |= dict(zip(ASKED, path.left.at(gone_m).T, strict=True))
    return found


def _read(
    path: Path, robot: Robot, wheel_rad_s: Sequence[float] | None, mode: Mode | None
) -> MotionLog:
    segments = robot.coordinates.segments
    table = read_csv(path, (), least_rows=0)
    wheels = "LU1 x" in table.names
    clock, wanted = ("time stamp", _UNITS) if wheels else ("time", _of_trial(segments))
    table.check((clock, *wanted), LEAST_ROWS)
    source, values = table.source, table.numbers(*wanted)
    times, time_s = table.texts(clock), times_of(table, clock)
    if not wheels:
        bits = values[:, -segments:]
        for row, column in np.argwhere((bits != 0) & (bits != 1)).tolist():
            field = f"s{column + 1}, row {row + 1}"
            raise InputError(field, float(bits[row, column]), "0, rigid, or 1, soft", source)
        q, v = values[:, : POSE + segments], values[:, POSE + segments : -segments]
        _doubt_units(source, q, v)
        q[:, 2] = np.unwrap(q[:, 2])
        return _with_phases(MotionLog(source, time_s, q, bits.astype(int), v), times[0])
    speeds, driven = _what_was_driven(path, robot, wheel_rad_s, mode)
    q = _configurations(robot, _filled_poses(values, source), driven)
    tiled = [np.tile(each, (len(values), 1)) for each in (np.array(driven), speeds)]
    return _with_phases(MotionLog(source, time_s, q, *tiled), times[0])


def _doubt_units(source: str, q: Array, v: Array) -> None:
    """Doubt the largest numbers of a log of configurations (rows, 3 + n) and inputs (rows, 5)."""
    x, y, phi, *kappa = np.abs(q).max(axis=0).round(4).tolist()
    v1, v2, u0, v0, r0 = np.abs(v).max(axis=0).tolist()
    speeds = {"v1_m_s": v1, "v2_m_s": v2, "u0_m_s": u0, "v0_m_s": v0, "r0_rad_s": r0}
    pose = {"x_m": x, "y_m": y, "phi_rad": phi, "kappa_per_m": kappa}
    found = doubts({"start": pose, **speeds})
    doubt((f"largest {each.removeprefix('start.')}" for each in found), source)


def _with_phases(log: MotionLog, clock: str) -> MotionLog:
    hint = "" if ":" in clock else finer_unit(log.time_s)
    if not log.phases:
        allowed = f"one with two rows of one mode, not more than {LONGEST_STEP_S:zg} s apart"
        raise InputError("log", log.source, allowed, hint=hint)
    if hint:
        apart_s = float(np.median(np.diff(log.time_s)))
        doubt([f"rows are {apart_s:zg} s apart; {hint}"], log.source)
    return log


def times_of(table: CsvTable, name: str) -> Array:
    """Times since the first row; those of day to a second are spread (see the module).

    Raises:
        InputError: If one is none, or not after the one before.
    """
    texts, source, seconds = table.texts(name), table.source, list[float]()
    for index, text in enumerate(texts, 1):
        try:
            parts = [float(part) for part in text.split(":")]
        except ValueError:
            parts = []
        if len(parts) == 1:
            parts = [number(text, f"{name}, row {index}", source)]
        if len(parts) not in (1, 3) or not (np.abs(parts) <= LARGEST).all():
            allowed = "a time of day, hh:mm:ss, or a number of seconds"
            raise InputError(f"{name}, row {index}", text, allowed, source)
        seconds.append(sum(part * 60.0**k for k, part in enumerate(reversed(parts))))
    time_s, of_day = np.array(seconds), ":" in texts[0]  # then rows of a second share its time
    if of_day:
        time_s = np.unwrap(time_s, period=86400.0)  # midnight
    back = np.flatnonzero(np.diff(time_s) < 0 if of_day else np.diff(time_s) <= 0)
    if len(back):
        row = int(back[0]) + 1
        allowed = f"{'not before' if of_day else 'after'} the row above it, {texts[row - 1]}"
        raise InputError(f"{name}, row {row + 1}", texts[row], allowed, source)
    return _spread(time_s) if of_day else time_s - time_s[0]


def _spread(time_s: Array) -> Array:
    """Rows of a second evenly within it; in the first and the last of a phase, as close as usual.

    The clock is cut to a second, so a phase's first rows are the last ones of theirs.
    """
    stamps, first, count = np.unique(time_s, return_index=True, return_counts=True)
    begins = np.append(True, np.diff(stamps) > LONGEST_STEP_S)
    ends = np.append(begins[1:], True)
    inner = count[~begins & ~ends]
    usual = float(np.median(inner)) if len(inner) else float(count.max())
    placed = np.empty_like(time_s)
    for stamp, at, rows, begin, end in zip(stamps, first, count, begins, ends, strict=True):
        each = 1.0 / max(rows, usual) if begin or end else 1.0 / rows
        shift = 1.0 - rows * each if begin and not end else 0.0
        placed[at : at + rows] = stamp + shift + each * np.arange(rows)
    return placed - placed[0]


def _filled_poses(values: Array, source: str) -> Array:
    """Poses (rows, 6) with lost frames, all zeros, filled in linearly, and smoothed."""
    here = np.arange(len(values))
    poses = np.empty_like(values)
    for unit in (slice(0, 3), slice(3, 6)):
        seen = values[:, unit].any(axis=1)
        if np.count_nonzero(seen) < LEAST_ROWS:
            name = f"LU{1 + unit.start // 3}"
            raise InputError(name, "never seen", f"in at least {LEAST_ROWS} frames", source)
        known = values[seen, unit]
        known[:, 2] = np.degrees(np.unwrap(np.radians(known[:, 2])))
        for column in range(3):
            filled = np.interp(here, here[seen], known[:, column])
            poses[:, unit.start + column] = median_filter(filled, _SMOOTHED, mode="nearest")
    return poses


def _what_was_driven(
    path: Path, robot: Robot, wheel_rad_s: Sequence[float] | None, mode: Mode | None
) -> tuple[Array, Mode]:
    """Wheel speeds (4,) and mode of a log that has neither."""
    segments, named = robot.coordinates.segments, _NAMED.fullmatch(path.stem)
    if named and wheel_rad_s is None and 1 <= int(named[2]) <= WHEELS:
        wheel_rad_s = np.eye(WHEELS)[int(named[2]) - 1] * float(named[3])
    if named and mode is None:
        mode = tuple(int(j + 1 == int(named[1])) for j in range(segments))
    if wheel_rad_s is None or len(wheel_rad_s) != WHEELS or not np.isfinite(wheel_rad_s).all():
        allowed = "four wheel speeds [rad/s], given or by the file's name, as in s1_v1_6.csv"
        raise InputError("wheel_rad_s", wheel_rad_s, allowed, str(path))
    if mode is None or len(mode) != segments or not set(mode) <= {0, 1} or is_rigid(mode):
        allowed = f"{segments} of 0 and 1, at least one of them 1, or by the file's name"
        raise InputError("mode", mode, allowed, str(path))
    return np.array(wheel_rad_s, dtype=float), mode


def _configurations(robot: Robot, poses: Array, mode: Mode) -> Array:
    """Configurations (rows, 3 + n) by poses of the units (rows, 6), rigid segments straight."""
    centres = 1e-3 * poses.reshape(-1, 2, 3)[..., :2] * (1, -1)  # an image's y axis points down
    headings = -np.unwrap(np.radians(poses[:, [2, 5]]), axis=0)
    soft = list(soft_segments(mode))
    q = np.zeros((len(poses), robot.coordinates.size))
    bend = headings[:, 1] - headings[:, 0]
    bend -= math.tau * np.round(bend[0] / math.tau)
    length_m = sum(robot.geometry.lengths_m[j] for j in soft)
    q[:, [POSE + j for j in soft]] = bend[:, None] / length_m
    shape = robot_shape(robot.geometry, q, 2)  # b0 at the origin, along x
    q[:, 2] = headings[:, 1] - np.unwrap(shape.ends[:, 1, 2])
    c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
    x, y = shape.centres.mean(axis=1).T
    q[:, :2] = centres.mean(axis=1) - np.column_stack([c * x - s * y, s * x + c * y])
    return q


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
