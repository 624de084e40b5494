"""Bounds of a stage alone: which mode sequences it may have, and what is proved of each."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from twosra_mpc.planning.bounds.bends import (
    BendingTask,
    Intervals,
    least_durations,
    unreachable_reason,
)
from twosra_mpc.robot.modes import (
    Mode,
    ModeSequence,
    StartingStiffness,
    blocks_of,
    is_rigid,
    rigid_mode,
)


class Drive(NamedTuple):
    """Least duration of a stage that is nothing but a drive.

    Attributes:
        least_s: For the distance [s].
        longer: Proved least duration [s]; more work is put into it where it is less than the
            argument, what is enough. None where the pose in which it begins is not known.
    """

    least_s: float
    longer: Callable[[float], float] | None = None

    def at_least(self, enough: float = 0.0) -> float:
        """Proved least duration [s], with more work where it is less than what is enough."""
        return self.least_s if self.longer is None else self.longer(enough)


NO_WAY = Drive(0.0)


@dataclass(frozen=True, eq=False)
class StageBounds:
    """Mode sequences of a stage, and what is proved of each.

    Attributes:
        change: (low, high) of each segment: change of W since t = 0 where the stage ends.
        bend: What its modes must do, where the shapes at both of its ends are nearly known.
        modes: Modes that it may use.
        last: Stiffness at its end; None: any.
        most_phases: Of the sequences that are opened.
        final: Whether the plan ends with it: then segments may melt or freeze after its phases.
        drives_first: Whether it may begin with a drive.
        drives_last: Whether it may drive after its last soft phase.
        distance_m: How far b0 must come in it, at least; or in it and in those before it, since
            the last one of which it is known where it ends.
        since: How many stages these are.
        drive: Least duration where it is nothing but a drive.
        least_s: Least duration [s].
        reshapes: Whether it is proved that it must reshape.
    """

    change: Intervals
    bend: BendingTask | None
    modes: Sequence[Mode]
    last: Mode | None
    most_phases: int
    final: bool = False
    drives_first: bool = True
    drives_last: bool = True
    distance_m: float = 0.0
    since: int = 1
    drive: Drive = NO_WAY
    least_s: float = 0.0
    reshapes: bool = False

    @cached_property
    def rigid(self) -> Mode:
        """The mode in which every segment is solid."""
        return rigid_mode(len(self.change))

    def opening(self, begins: StartingStiffness) -> ModeSequence:
        """The first drive if the robot is solid and may drive, else nothing."""
        drives = self.drives_first and self.rigid in self.modes and begins == self.rigid
        return (self.rigid,) if drives else ()

    def sequences(self, begins: StartingStiffness) -> Iterator[ModeSequence]:
        """Yield every sequence of up to ``most_phases`` phases from a stiffness on."""
        heads = [self.opening(begins)]
        for length in range(self.most_phases + 1):
            if length:
                heads = [longer for head in heads for longer in self.longer(head, begins)]
            for head in heads:
                whole = self.closed(head, begins)
                if whole and len(whole) <= self.most_phases and self.misfit(whole) is None:
                    yield whole

    def longer(self, head: ModeSequence, begins: StartingStiffness) -> Iterator[ModeSequence]:
        """Yield a sequence with every mode that may follow."""
        for mode in self.modes:
            stays = mode == head[-1] if head else begins == self.rigid == mode
            if not stays:
                yield (*head, mode)

    def closed(self, head: ModeSequence, begins: StartingStiffness) -> ModeSequence | None:
        """The sequence that ends as the stage asks for; None if another head stands for it."""
        rigid, opening = self.rigid, head == (self.rigid,) and begins == self.rigid
        if self.last == rigid and rigid in self.modes and not opening:
            return None if head and head[-1] == rigid else (*head, rigid)
        if not (self.final or self.last in (None, *head[-1:])):
            return None
        return head or None

    def misfit(self, sequence: ModeSequence) -> str | None:
        """Reason why a sequence cannot be one of this stage."""
        if self.reshapes and not any(map(any, sequence)):
            return "a task must reshape"
        return None if self.bend is None else unreachable_reason(sequence, self.bend)

    @cached_property
    def impossible(self) -> str | None:
        """Reason why no sequence of its modes brings about the bend, if none does."""
        if self.bend is None:
            return None
        rigid_first = sorted(self.modes, key=lambda mode: mode != self.rigid)
        return unreachable_reason(rigid_first, self.bend)

    @cached_property
    def must_bend(self) -> list[int]:
        """Segments (from 0) that have another shape after it, as is proved."""
        bend = self.bend
        return [] if bend is None else [j for j in bend.segments if bend.must_bend(j)]

    def settled(self, sequence: ModeSequence) -> Mode:
        """Stiffness after a sequence of it."""
        return self.last if self.final and self.last is not None else sequence[-1]

    @property
    def endings(self) -> Sequence[Mode]:
        """Stiffnesses in which it may end."""
        return self.modes if self.last is None else (self.last,)

    def moving(self, sequence: ModeSequence) -> list[bool]:
        """In which phases of a sequence something may move."""
        rests = not self.drives_last and len(sequence) > 1 and is_rigid(sequence[-1])
        return [True] * (len(sequence) - rests) + [False] * rests

    @cached_property
    def alike(self) -> Hashable:
        """Key of all that bounds of the stage alone depend on."""
        bend = self.bend and (self.bend.change, self.bend.origin, self.bend.origin_within)
        moves = self.drives_first, self.drives_last, self.drive, self.reshapes, self.least_s
        return self.modes, self.last, self.final, self.most_phases, moves, bend

    def durations(self, sequence: ModeSequence) -> list[float]:
        """Proved least durations of the phases of a sequence."""
        bend = self.bend
        found = [0.0] * len(sequence) if bend is None else list(least_durations(sequence, bend))
        if sequence == (self.rigid,):
            found[0] = max(found[0], self.drive.at_least())
        return found


class Way(NamedTuple):
    """Way of moving on: whether it drives, and how many blocks of soft phases there are."""

    drives: bool = False
    blocks: int = 0

    def then(self, sequences: Sequence[ModeSequence], stages: Sequence[StageBounds]) -> Way:
        """The same after the sequences of further stages."""
        moving = [
            mode
            for stage, sequence in zip(stages, sequences, strict=False)
            for mode, moves in zip(sequence, stage.moving(sequence), strict=True)
            if moves
        ]
        return Way(self.drives or any(map(is_rigid, moving)), self.blocks + blocks_of(moving))
