"""A stage of a mission as the search knows it: which sequences it may have, what it must do."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from twosra_mpc.planning.search.bends import (
    BendingTask,
    Intervals,
    least_durations,
    unreachable_reason,
)
from twosra_mpc.problem.tasks import MOST_PHASES
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid, rigid_mode

_MOST_TO_ANY = 3  # phases of a stage that may end in any stiffness


@dataclass(frozen=True, eq=False)
class StageTask:
    """What the search must know of a stage.

    Attributes:
        change: (low, high) of each segment: change of W since t = 0 where the stage ends.
        bend: What its modes must do where the shapes at both of its ends are known exactly.
        modes: Modes that it may use.
        last: Stiffness at its end; None: any.
        drives_first: Whether it may begin with a drive.
        drives_last: Whether it may drive after its last soft phase.
        distance_m: How far b0 must come in it, at least; or in it and in those before it, since
            the last one of which it is known where it ends.
        since: How many stages these are.
        rigid_s: Least duration where nothing bends in it.
        reshapes: Whether it is proved that it must reshape.
    """

    change: Intervals
    bend: BendingTask | None
    modes: tuple[Mode, ...]
    last: Mode | None
    drives_first: bool = True
    drives_last: bool = True
    distance_m: float = 0.0
    since: int = 1
    rigid_s: float = 0.0
    reshapes: bool = False

    @property
    def most_phases(self) -> int:
        """Of the sequences that are opened."""
        return _MOST_TO_ANY if self.last is None else MOST_PHASES

    def sequences(self, begins: Mode) -> Iterator[ModeSequence]:
        """Yield every sequence of up to ``most_phases`` phases from a stiffness on."""
        rigid = rigid_mode(len(begins))
        drives = self.drives_first and rigid in self.modes
        heads: list[ModeSequence] = [()] if any(begins) or not drives else [(rigid,)]
        for length in range(self.most_phases + 1):
            if length:
                heads = [longer for head in heads for longer in self.longer(head, begins)]
            for head in heads:
                whole = self._closed(head, rigid)
                if whole and len(whole) <= self.most_phases and self._fits(whole):
                    yield whole

    def longer(self, head: ModeSequence, begins: Mode) -> Iterator[ModeSequence]:
        """Yield a sequence with every mode that may follow."""
        for mode in self.modes:
            stays = mode == head[-1] if head else not any(begins) and is_rigid(mode)
            if not stays:
                yield (*head, mode)

    def _closed(self, head: ModeSequence, rigid: Mode) -> ModeSequence | None:
        """The sequence that ends as the stage asks for; None if another head stands for it."""
        if self.last is None:
            return head
        if self.last == rigid:
            if head == (rigid,):
                return head
            return None if head and head[-1] == rigid else (*head, rigid)
        return head if head and head[-1] == self.last else None

    def _fits(self, sequence: ModeSequence) -> bool:
        if self.reshapes and not any(map(any, sequence)):
            return False
        return self.bend is None or unreachable_reason(sequence, self.bend) is None

    def moving(self, sequence: ModeSequence) -> list[bool]:
        """In which phases of a sequence something may move."""
        rests = not self.drives_last and len(sequence) > 1 and is_rigid(sequence[-1])
        return [True] * (len(sequence) - rests) + [False] * rests

    @cached_property
    def alike(self) -> Hashable:
        """What bounds of the stage alone depend on."""
        bend = self.bend and (self.bend.change, self.bend.origin, self.bend.origin_within)
        drives = self.drives_first, self.drives_last, self.rigid_s
        return self.modes, self.last, drives, self.reshapes, bend

    def durations(self, sequence: ModeSequence) -> list[float]:
        """Proved least duration of each phase of a sequence."""
        found = [0.0] * len(sequence)
        if self.bend is not None:
            found = list(least_durations(sequence, self.bend))
        if len(sequence) == 1 and is_rigid(sequence[0]):
            found[0] = max(found[0], self.rigid_s)
        return found


class Way(NamedTuple):
    """What moves the robot on: whether it drives, and how many blocks of soft phases there are."""

    drives: bool = False
    blocks: int = 0

    def then(self, sequences: Sequence[ModeSequence], stages: Sequence[StageTask]) -> Way:
        """The same after the sequences of further stages."""
        moving = [
            mode
            for stage, sequence in zip(stages, sequences, strict=False)
            for mode, moves in zip(sequence, stage.moving(sequence), strict=True)
            if moves
        ]
        blocks = sum(1 for rigid, _ in itertools.groupby(moving, key=is_rigid) if not rigid)
        return Way(self.drives or any(map(is_rigid, moving)), self.blocks + blocks)
