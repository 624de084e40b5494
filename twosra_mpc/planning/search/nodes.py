"""Nodes of the tree of mode sequences: stage after stage, mode after mode.

A node is a variant of the problem with the sequences of its first stages and the modes of the
stage that is open. Sequences are kept in a canonical form that loses nothing: a rigid phase opens
every stage that begins solid and may drive, and closes every one that must end solid (it may have
zero length and then costs nothing), and no phase repeats the mode before it; the same mode may
follow across the end of a stage.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

from twosra_mpc.planning.bounds.stage_bounds import StageBounds
from twosra_mpc.robot.modes import ModeSequence

Stages = Sequence[StageBounds]


class Node(NamedTuple):
    """A variant (-1: none chosen), the sequences of its first stages, the modes of the next one."""

    variant: int
    sequences: tuple[ModeSequence, ...] = ()
    head: ModeSequence = ()


class Whole(NamedTuple):
    """A sequence of every stage, or of the first stages, of a variant."""

    variant: int
    sequences: tuple[ModeSequence, ...]

    @property
    def joined(self) -> ModeSequence:
        """All phases."""
        return tuple(itertools.chain.from_iterable(self.sequences))


class InTheWay:
    """Obstacles in the robot's way in a stage: in free space, none."""

    def blocks(self, sequence: ModeSequence | None) -> str | None:
        """Reason why a stage's sequence, or any if None, cannot be carried out, if known."""
        del sequence
        return None

    def proves_impossible(self, sequence: ModeSequence) -> bool:
        """True if a sequence is proved impossible, by what is known or is worked out now."""
        return self.blocks(sequence) is not None

    def least_drives_s(self, sequence: ModeSequence) -> Sequence[float]:
        """Proved least duration of each phase of a sequence, for the ways to go [s]."""
        return [0.0] * len(sequence)
