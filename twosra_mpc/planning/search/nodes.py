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
from dataclasses import dataclass
from typing import NamedTuple

from twosra_mpc.planning.bounds.stage_bounds import StageBounds
from twosra_mpc.robot.modes import Mode, ModeSequence, StartingStiffness

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


@dataclass(frozen=True)
class Nodes:
    """Nodes and their children.

    Attributes:
        variants: The stages of every variant.
        first: Stiffness at t = 0.
    """

    variants: Sequence[Stages]
    first: StartingStiffness

    @property
    def only(self) -> StageBounds | None:
        """The stage, where there is but one in one variant."""
        stages = self.variants[0]
        return stages[0] if len(self.variants) == len(stages) == 1 else None

    def root(self) -> Node:
        """No variant chosen, unless there is but one."""
        return Node(-1) if len(self.variants) > 1 else self.opened(0, ())

    def opened(self, variant: int, sequences: tuple[ModeSequence, ...]) -> Node:
        """The node where the next stage begins, if there is one."""
        stages = self.variants[variant]
        if len(sequences) == len(stages):
            return Node(variant, sequences)
        begins = sequences[-1][-1] if sequences else self.first
        return Node(variant, sequences, stages[len(sequences)].opening(begins))

    def open_stage(self, node: Node) -> tuple[StageBounds, StartingStiffness] | None:
        """The stage that is open, and the stiffness in which it begins; None: all are over."""
        stages = self.variants[node.variant]
        if len(node.sequences) == len(stages):
            return None
        begins = node.sequences[-1][-1] if node.sequences else self.first
        return stages[len(node.sequences)], begins

    def children(self, node: Node) -> list[Node]:
        """The variants, or one more mode, or the next stage."""
        if node.variant < 0:
            return [self.opened(variant, ()) for variant in range(len(self.variants))]
        if (opened := self.open_stage(node)) is None:
            return []
        stage, begins = opened
        found = [Node(*node[:2], head) for head in stage.longer(node.head, begins)]
        closed = None if stage.final else stage.closed(node.head, begins)
        if closed and len(closed) <= stage.most_phases and stage.misfit(closed) is None:
            found.insert(0, self.opened(node.variant, (*node.sequences, closed)))
        return found

    def leaps(self, node: Node) -> list[Node]:
        """The variants, or the stage that is open with each of its sequences."""
        if node.variant < 0:
            return self.children(node)
        if (opened := self.open_stage(node)) is None:
            return []
        sequences = opened[0].sequences(opened[1])
        return [self.opened(node.variant, (*node.sequences, each)) for each in sequences]

    def too_deep(self, node: Node) -> bool:
        """True if the open stage, or its shortest child, has more phases than are opened."""
        if node.variant < 0 or (opened := self.open_stage(node)) is None:
            return False
        stage, begins = opened
        if len(node.head) < stage.most_phases:  # one more closes it
            return False
        return len(stage.closed(node.head, begins) or node.head) > stage.most_phases

    def whole(self, node: Node) -> Whole | None:
        """The sequences of all stages a node stands for; None if another node stands for them."""
        if node.variant < 0:
            return None
        if (opened := self.open_stage(node)) is None:
            return Whole(*node[:2])
        stage, begins = opened
        last = stage.closed(node.head, begins) if stage.final else None
        return None if last is None else Whole(node.variant, (*node.sequences, last))

    def last(self, whole: Whole) -> Mode:
        """Stiffness at the end of a sequence of every stage."""
        return self.variants[whole.variant][-1].settled(whole.sequences[-1])


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
