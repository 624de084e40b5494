"""Whether the robot does what it is told: commanded motion compared with what the camera sees.

A segment that is reported soft but is solid does not bend; a camera that shows the same picture for
ever shows a robot that stands. Wheels slip and units drag, so only next to nothing is doubted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twosra_mpc.errors import TwosraError
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

SHARE = 0.05  # of what is commanded; soft segments at `hard` bend by a tenth and more
BEND_PER_M = 8.0  # commanded, before it is asked for: eight times the noise of a frame
DRIVE_M = 0.04  # the same for a rigid drive; turning counts at `ARM_M`
ARM_M = 0.1


class DoubtError(TwosraError):
    """The robot does not move as it is commanded."""

    def __init__(self, text: str, *, bends: bool) -> None:
        self.bends = bends
        super().__init__(text)


@dataclass
class _Account:
    """What was commanded since it was last seen to be done, and what was seen of it."""

    commanded: Array
    seen: Array


class Doubt:
    """Accounts of each segment's bends, and of rigid drives."""

    def __init__(self, segments: int) -> None:
        """Nothing has been commanded yet."""
        self._bends = [_Account(np.zeros(1), np.zeros(1)) for _ in range(segments)]
        self._drive = _Account(np.zeros(POSE), np.zeros(POSE))

    def take(self, mode: Mode, commanded: Array, seen: Array, known: str) -> None:
        """Take in a period of driving.

        Args:
            mode: Mode the robot is in.
            commanded: How q should have changed, (3 + n,).
            seen: How it did, as believed, (3 + n,).
            known: What is known about the segments, in words.

        Raises:
            DoubtError: If next to nothing is seen of what is commanded.
        """
        if is_rigid(mode):
            scale = np.array([1.0, 1.0, ARM_M])
            turned = np.array([*seen[:2], math.remainder(float(seen[2]), math.tau)])
            told_m, seen_m = _added(self._drive, scale * commanded[:POSE], scale * turned, DRIVE_M)
            if seen_m < SHARE * told_m:
                words = f"{1e3 * told_m:.0f} mm are commanded, {1e3 * seen_m:.0f} mm are seen"
                raise DoubtError(f"{words}: do its wheels turn, is its camera alive?", bends=False)
            return
        for segment in soft_segments(mode):
            at = slice(POSE + segment, POSE + segment + 1)
            account = self._bends[segment]
            told, found = _added(account, commanded[at], seen[at], BEND_PER_M)
            if found < SHARE * told:
                words = f"segment {segment + 1} does not bend: {told:.0f} 1/m are commanded"
                why = f"{found:.1f} 1/m are seen; {known}: is its thermistor right, do wheels turn?"
                raise DoubtError(f"{words}, {why}", bends=True)


def _added(account: _Account, commanded: Array, seen: Array, enough: float) -> tuple[float, float]:
    """Add a period; what was commanded and seen in all, or zeros while it is too early to say."""
    account.commanded, account.seen = account.commanded + commanded, account.seen + seen
    told, found = (float(np.linalg.norm(each)) for each in (account.commanded, account.seen))
    if told < enough:
        return 0.0, 0.0
    if found < SHARE * told or told >= 2 * enough:
        account.commanded, account.seen = np.zeros_like(commanded), np.zeros_like(seen)
    return told, found
