"""Doubts about a robot: commanded motion compared with what the camera sees.

A segment that is reported soft but is solid does not bend: the units push the whole robot along
instead. So in soft phases an odometer counts the way that the model does not explain, from each
proof that a segment bends to the next; before it has run for long the robot stands, and is looked
at. A camera that shows the same picture for ever shows a robot that stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from twosra_mpc.errors import TwosraError
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import Mode, is_rigid, soft_segments

SHARE = 0.05  # of a rigid drive; wheels slip and units drag, so only next to nothing is doubted
DRIVE_M = 0.03  # commanded, before it is asked for; turning counts at `ARM_M`
ARM_M = 0.1
PUSHED_M = (0.008, 0.015)  # way of b0 that bends do not explain, before they are looked for at rest
TOLD_PER_M = 5.0  # of bends, for the shorter of these ways
BEND_PER_M = 24.0  # commanded, before they are: under one wheel the authors' robot bent by a tenth
MOVING_PER_M = 3.0  # seen while it moves: it bends; beyond the noise of the belief
RESTING_SHARE = 0.05  # of what was commanded, seen at rest: half of the least that is logged
RESTING_PER_M = (0.4, 0.8)  # but no less than noise, nor more than one that is dragged round
SPENT_M = 0.016  # way of solid metal after which nothing is tried again
TOGETHER_PER_M = 2.0  # seen of several soft segments, before each of them is looked for
EACH_PER_M = 0.8 * TOGETHER_PER_M  # the same at rest, where what seemed to bend may be less
STIFF = 0.25  # of their mean; in a log soft segments differ from it by 0.44 of it
BENDS, BENDS_PER_M = 0.5, 1.2  # of what was commanded, or beyond all noise: it bends
PROOF_S = 30.0  # for which bends prove liquid metal; from the set-point it stays so for longer
STANDS = 0.1  # of the way that bending makes: a solid robot that is bent drives 0.2 of it or more


@dataclass(eq=False)
class DoubtError(TwosraError):
    """The robot does not move as it is commanded.

    Attributes:
        text: What is commanded, and what is seen.
        bends: Whether it moves, and does not bend.
        final: Whether it has moved so too far to be tried again.
        stalled: Whether that may be its shape: wheels hardly hold it, or it has bent before.
        segments: Those (from 0) that do not bend.
    """

    text: str
    bends: bool = field(kw_only=True)
    final: bool = field(default=False, kw_only=True)
    stalled: bool = field(default=False, kw_only=True)
    segments: tuple[int, ...] = field(default=(), kw_only=True)


class Doubt:
    """Accounts of rigid drives, and of a soft mode since its segments were last seen to bend.

    Attributes:
        pushed_m: Way of b0 with metal of each segment that has not bent since, (n,).
    """

    def __init__(self, lengths_m: tuple[float, ...]) -> None:
        """Nothing has been commanded yet to a robot with segments of these lengths."""
        self._lengths_m, self.pushed_m = np.array(lengths_m), np.zeros(len(lengths_m))
        self._mode: Mode = (0,) * len(lengths_m)
        self._size = POSE + len(lengths_m)
        self._drive, self._bends = _Account(self._size), _Account(self._size)
        self._bent = self._together = False
        self._proved_s = -math.inf

    @property
    def each_bends(self) -> bool:
        """True if every soft segment of the mode was seen to bend."""
        return self._together and self._proved_s > -math.inf

    def take(
        self,
        now_s: float,
        mode: Mode,
        commanded: Array,
        seen: Array,
        off: Array | float = np.inf,
        held: float = 1.0,
    ) -> bool:
        """Take in a period of driving.

        Args:
            now_s: When it ends.
            mode: Mode the robot is in.
            commanded: How q should have changed, (3 + n,).
            seen: How it did, as believed, (3 + n,).
            off: By how much what is seen may be off, (3 + n,).
            held: Share of its motions that wheels hold in this shape.

        Returns:
            Whether it must stand and be looked at: see ``judge``.

        Raises:
            DoubtError: If next to nothing is seen of a rigid drive.
        """
        soft = soft_segments(mode)
        if mode != self._mode:
            self._mode, self._bends, self._bent = mode, _Account(self._size, soft), False
            self._together, self._proved_s = len(soft) <= 1, -math.inf
        if is_rigid(mode):
            self._drive.add(commanded, seen)
            if self._drive.told >= DRIVE_M:
                told_m, found_m = self._drive.told, self._drive.found
                self._drive = _Account(self._size)
                if found_m < SHARE * told_m:
                    raise DoubtError(_still(told_m, found_m), bends=False)
            return False
        if now_s < self._proved_s + PROOF_S:
            return False
        self._bends.add(commanded, seen, held)
        found, off = self._bends.found, np.broadcast_to(off, self._size)
        self._together |= found >= TOGETHER_PER_M and not self._bends.below(2 * STIFF, off)
        if self._together and self._bends.found >= MOVING_PER_M:
            self._prove(now_s)
        return self._bends.doubtful or (not self._together and self._bends.found >= TOGETHER_PER_M)

    def look(self, seen: Array) -> bool:
        """Take in a look at the robot, which stands.

        Args:
            seen: How q has changed since the period or the look that was taken in last, (3 + n,).

        Returns:
            Whether nothing is in doubt, noise considered; else ``judge`` waits for a longer look.
        """
        self._bends.add(np.zeros_like(seen), seen)
        self._bends.looks += 1
        return not self._suspects(self._bends.looks * self._bends.least, 2 * STIFF)

    def _prove(self, now_s: float) -> None:
        """Begin anew: what is soft was seen to bend."""
        self._bends, self._bent = _Account(self._size, self._bends.soft), True
        self._proved_s, self.pushed_m[list(self._bends.soft)] = now_s, 0.0

    def look_again(self, seen: Array) -> None:
        """Take in a longer look: how q has changed since the first, (3 + n,)."""
        self._bends.add(np.zeros_like(seen), seen)

    def judge(self, now_s: float, known: str) -> None:
        """Judge the bends of a robot that stands and was looked at.

        Args:
            now_s: When.
            known: What is known about the segments, in words.

        Raises:
            DoubtError: If next to nothing is seen of what is commanded, or of one segment's part.
        """
        account, bent = self._bends, self._bent
        if not (stiff := self._suspects(account.least, STIFF)):
            self._together = self._together or account.found >= EACH_PER_M
            if self._together and account.proved:
                self._prove(now_s)
            return  # else it was noise, perhaps: what was pushed counts on
        self._bends, self._bent = _Account(self._size, account.soft), False
        would_m = account.told * float(self._lengths_m[list(stiff)].mean()) * ARM_M
        still = account.pushed_m < PUSHED_M[0] and account.moved_m < STANDS * would_m
        if still and stiff == account.soft:
            raise DoubtError(_still(would_m, account.moved_m), bends=False)
        part_m = SPENT_M if len(stiff) < len(account.soft) else np.inf  # the rest has bent
        self.pushed_m[list(stiff)] += 0.0 if bent else min(account.pushed_m, part_m)
        lost = account.sure < BENDS_PER_M  # liquid metal need not have bent
        names = " and ".join(f"segment {segment + 1}" for segment in stiff)
        does = "does" if len(stiff) == 1 else "do"
        words = f"{names} {does} not bend: {account.told:z.0f} 1/m are commanded"
        found = abs(float(account.seen[[POSE + segment for segment in stiff]].mean()))
        why = f"{found:z.1f} 1/m are seen on {1e3 * account.pushed_m:z.0f} mm"
        doubt = f"wheels hold {account.sure:z.1f} 1/m of it" if lost else "is its thermistor right?"
        raise DoubtError(
            f"{words}, {why}; {known}: {doubt}",
            bends=not lost,
            final=bool((self.pushed_m > SPENT_M).any()),
            stalled=bent or lost,
            segments=() if lost else stiff,
        )

    def _suspects(self, least_per_m: float, share: float) -> tuple[int, ...]:
        """Segments (from 0) that seem not to bend.

        Args:
            least_per_m: Mean bend that is asked for.
            share: Of the mean, what each is asked for.
        """
        account = self._bends
        if not account.proved and account.found < least_per_m:
            return account.soft
        return () if self._together or account.found < EACH_PER_M else account.below(share)


class _Account:
    """Changes of q that were commanded since something was proved, and those that were seen."""

    def __init__(self, size: int, soft: tuple[int, ...] = ()) -> None:
        self.soft, self._curvatures = soft, [POSE + segment for segment in soft]
        self._commanded = self._held = self.seen = np.zeros(size)
        self.looks = 0

    def add(self, commanded: Array, seen: Array, held: float = 1.0) -> None:
        """Add a period."""
        seen = seen.copy()
        seen[2] = math.remainder(seen[2], math.tau)
        self._commanded, self.seen = self._commanded + commanded, self.seen + seen
        self._held = self._held + held * commanded

    @property
    def told(self) -> float:
        """Motion commanded: the mean bend of the soft segments [1/m], or the way [m]."""
        return self._amount(self._commanded)

    @property
    def sure(self) -> float:
        """Motion commanded in shapes in which wheels hold it."""
        return self._amount(self._held)

    @property
    def found(self) -> float:
        """Motion seen of it; one segment that alone is stiff leaves half of it."""
        return self._amount(self.seen)

    def _amount(self, change: Array) -> float:
        return abs(float(change[self._curvatures].mean())) if self.soft else _way_m(change)

    def below(self, share: float, off: Array | None = None) -> tuple[int, ...]:
        """Soft segments that may bend by less than this share of their mean."""
        bends = self.seen[self._curvatures]
        least = np.abs(bends) - (0.0 if off is None else off[self._curvatures])
        return tuple(np.array(self.soft)[least < share * np.abs(bends.mean())].tolist())

    @property
    def proved(self) -> bool:
        """True if the bend that was seen is beyond all noise, or half of what was commanded."""
        return self.found >= min(BENDS_PER_M, BENDS * self.told)

    @property
    def least(self) -> float:
        """Mean bend that a long look at rest must show, and short ones each more of [1/m]."""
        return float(np.clip(RESTING_SHARE * self.told, *RESTING_PER_M))

    @property
    def moved_m(self) -> float:
        """Distance moved, turning included [m]."""
        return _way_m(self.seen)

    @property
    def pushed_m(self) -> float:
        """Distance that b0 has moved beyond what was commanded [m]."""
        return float(np.linalg.norm((self.seen - self._commanded)[:2]))

    @property
    def doubtful(self) -> bool:
        """True if it is time to look for bends."""
        least_m = PUSHED_M[self.told < TOLD_PER_M] + self.looks * PUSHED_M[0]
        return self.pushed_m >= least_m or self.told >= (1 + self.looks) * BEND_PER_M


def _way_m(change: Array) -> float:
    """Way of a change of q (3 + n,), turning included [m]."""
    return float(np.linalg.norm(change[:POSE] * [1.0, 1.0, ARM_M]))


def _still(told_m: float, seen_m: float) -> str:
    words = f"{1e3 * told_m:z.0f} mm are commanded, {1e3 * seen_m:z.0f} mm are seen"
    return f"{words}: do its wheels turn, is its camera alive?"
