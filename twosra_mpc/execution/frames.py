"""Which frames of a camera are of use at all: a lost frame is better than a wrong one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.execution.camera_filter import REMEMBERED_S
from twosra_mpc.execution.robot_interface import Reading, RobotError
from twosra_mpc.robot.coordinates import POSE

_AHEAD_S = 0.2  # clocks of camera and robot may differ by
_FAR_M, _BENT_PER_M = 100.0, 1e3  # no robot of this kind goes, or bends, so far: see `Metres`


def usable(reading: Reading, newest_s: float) -> Reading:
    """The reading without frames that are not finite, too far, too old, ahead of time, or no news.

    Args:
        reading: What was read.
        newest_s: When the newest frame before it was taken.

    Raises:
        RobotError: If nobody knows what time it is.
    """
    if not np.isfinite(reading.time_s):
        raise RobotError(f"the robot's clock shows {reading.time_s}")
    taken_s = reading.taken_s
    away = np.abs(reading.frames)
    sound = np.isfinite(taken_s) & np.isfinite(away).all(axis=1)
    sound &= (away[:, :2] <= _FAR_M).all(axis=1) & (away[:, POSE:] <= _BENT_PER_M).all(axis=1)
    sound &= (taken_s >= reading.time_s - REMEMBERED_S) & (taken_s <= reading.time_s + _AHEAD_S)
    newest = np.maximum.accumulate(np.where(sound, taken_s, -np.inf))
    sound &= taken_s > np.maximum(newest_s, np.concatenate([[-np.inf], newest[:-1]]))
    return only(reading, sound)


def only(reading: Reading, kept: NDArray[np.bool_]) -> Reading:
    """The reading with these of its frames (k,) alone."""
    if kept.all():
        return reading
    objects = None if reading.objects is None else reading.objects[kept]
    taken_s, frames = reading.taken_s[kept], reading.frames[kept]
    return replace(reading, taken_s=taken_s, frames=frames, objects=objects)
