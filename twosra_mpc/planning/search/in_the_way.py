"""What is in the robot's way, as the search asks for it."""

from __future__ import annotations

from collections.abc import Sequence

from twosra_mpc.robot.modes import ModeSequence


class InTheWay:
    """What is in the robot's way in a stage: in free space, nothing."""

    def blocks(self, sequence: ModeSequence | None) -> str | None:
        """Why a stage's sequence, or any if None, cannot be carried out, as far as is known."""
        del sequence
        return None

    def proves_impossible(self, sequence: ModeSequence) -> bool:
        """Whether a sequence is proved impossible, by what is known or is worked out now."""
        return self.blocks(sequence) is not None

    def least_drives_s(self, sequence: ModeSequence) -> Sequence[float]:
        """Proved least duration of each phase of a sequence, for the ways to go [s]."""
        return [0.0] * len(sequence)
