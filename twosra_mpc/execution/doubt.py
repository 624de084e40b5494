"""Whether the robot does what it is told: commanded motion compared with what the camera sees.

A segment that is reported soft but is solid does not bend; a camera that shows the same picture for
ever shows a robot that stands. Wheels slip and units drag, so only next to nothing is doubted.
"""

from __future__ import annotations

import math

import numpy as np

from twosra_mpc.errors import TwosraError
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

SHARE = 0.05  # of what is commanded; soft segments at `hard` bend by a tenth and more
BEND_PER_M = 12.0  # commanded, before it is asked for: ten times the noise of a frame
DRIVE_M = 0.03  # the same for a rigid drive; turning counts at `ARM_M`
ARM_M = 0.1
BENT_SHARE = 0.03  # the paper's wheel map makes 0.17 of a bend, and slip 0.3 of that
BENT_PER_M = 3.0  # seen: a segment that has bent so far is soft; beyond the noise of the belief
_BENT = (BEND_PER_M, math.inf)
STANDS = 0.1  # of the way that bending makes: a solid robot that is bent drives 0.2 of it or more


class DoubtError(TwosraError):
    """The robot does not move as it is commanded."""

    def __init__(self, text: str, *, bends: bool) -> None:
        self.bends = bends
        super().__init__(text)


class Doubt:
    """Accounts of rigid drives, and of each segment's bends until it was seen to bend once.

    Later ones prove nothing: what slip adds to a bend has to be commanded away.
    """

    def __init__(self, lengths_m: tuple[float, ...]) -> None:
        """Nothing has been commanded yet to a robot with segments of these lengths."""
        self._lengths_m = lengths_m
        self._bends = [_Account() for _ in lengths_m]
        self._bent: set[int] = set()
        self._drive = _Account()

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
        lever_m = np.array([1.0, 1.0, ARM_M])
        turned = lever_m * [*seen[:2], math.remainder(seen[2], math.tau)]
        if is_rigid(mode):
            told_m = self._drive.add(lever_m * commanded[:POSE], turned, (DRIVE_M, DRIVE_M))
            if told_m and self._drive.seen_share < SHARE:
                raise DoubtError(_still(told_m, self._drive.moved_m), bends=False)
        for segment in range(len(mode)):
            if not mode[segment]:  # next time it has to melt again
                self._bends[segment] = _Account()
                self._bent.discard(segment)
        for segment in set(soft_segments(mode)) - self._bent:
            at, account = POSE + segment, self._bends[segment]
            told = account.add(commanded[at : at + 1], seen[at : at + 1], _BENT, turned)
            if account.seen_share * told >= BENT_PER_M:
                self._bent.add(segment)
                continue
            if not told or account.seen_share >= BENT_SHARE:
                continue
            would_m = told * self._lengths_m[segment] * ARM_M
            if account.moved_m < STANDS * would_m:
                raise DoubtError(_still(would_m, account.moved_m), bends=False)
            words = f"segment {segment + 1} does not bend: {told:.0f} 1/m are commanded"
            why = f"{account.seen_share * told:.1f} 1/m are seen; {known}: is its thermistor right?"
            raise DoubtError(f"{words}, {why}", bends=True)


class _Account:
    """What was commanded since it was last seen to be done, and what was seen of it."""

    def __init__(self) -> None:
        self._commanded, self._seen, self._moved = np.zeros(1), np.zeros(1), np.zeros(POSE)
        self.seen_share, self.moved_m = 1.0, 0.0

    def add(
        self,
        commanded: Array,
        seen: Array,
        enough: tuple[float, float],
        moved: Array | None = None,
    ) -> float:
        """Add a period; what was commanded in all, or 0 while it is too early to say.

        It is asked for from the first of ``enough`` on, and begun anew at the second. ``moved`` is
        how the pose has changed meanwhile, (3,) [m], if that is not what is ``seen``.
        """
        self._commanded, self._seen = self._commanded + commanded, self._seen + seen
        self._moved = self._moved + (seen if moved is None else moved)
        told, found = (float(np.linalg.norm(each)) for each in (self._commanded, self._seen))
        if told < enough[0]:
            return 0.0
        self.seen_share, self.moved_m = found / told, float(np.linalg.norm(self._moved))
        if self.seen_share < SHARE or told >= enough[1]:
            self._commanded, self._seen, self._moved = np.zeros(1), np.zeros(1), np.zeros(POSE)
        return told


def _still(told_m: float, seen_m: float) -> str:
    words = f"{1e3 * told_m:.0f} mm are commanded, {1e3 * seen_m:.0f} mm are seen"
    return f"{words}: do its wheels turn, is its camera alive?"
