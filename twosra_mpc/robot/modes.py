"""Stiffness modes and mode sequences.

A mode is sigma = (s1, ..., sn), one entry for each segment: s_j = 1 when segment j is soft
(liquid), 0 when rigid (solid).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Literal

Mode = tuple[int, ...]
ModeSequence = tuple[Mode, ...]
StartingStiffness = tuple[int | None, ...]  # as a mode; None: changing, neither soft nor rigid
Stiffness = Literal["soft", "rigid"]


@lru_cache(maxsize=8)
def all_modes(segments: int) -> tuple[Mode, ...]:
    """Every mode of a robot of so many segments, the rigid one first."""
    return tuple(itertools.product((0, 1), repeat=segments))


def rigid_mode(segments: int) -> Mode:
    """Every segment solid: the robot drives as one rigid body."""
    return (0,) * segments


def is_rigid(mode: Mode) -> bool:
    """True if every segment is solid."""
    return not any(mode)


def soft_segments(mode: Mode) -> tuple[int, ...]:
    """Soft segments (from 0)."""
    return tuple(j for j, soft in enumerate(mode) if soft)


def merged(modes: Iterable[Mode]) -> ModeSequence:
    """Modes that follow each other, none twice in a row."""
    return tuple(mode for mode, _ in itertools.groupby(modes))


def soft_runs(sequence: Sequence[Mode]) -> list[list[int]]:
    """The phases of each block of a sequence: runs of soft phases without a drive in between."""
    grouped = itertools.groupby(range(len(sequence)), key=lambda i: is_rigid(sequence[i]))
    return [list(run) for rigid, run in grouped if not rigid]


def last_bent(modes: Sequence[Mode]) -> list[int]:
    """Segments (from 0) that are soft in the first of these phases and in no later one."""
    return [j for j in soft_segments(modes[0]) if not any(later[j] for later in modes[1:])]


def blocks_of(sequence: Sequence[Mode]) -> int:
    """Number of blocks of a sequence."""
    return len(soft_runs(sequence))


# The modes of the two-segment agent, for what knows no other robot: the paper and its greedy rule.
MODES: tuple[Mode, ...] = all_modes(2)
RIGID, SOFT_2, SOFT_1, SOFT_BOTH = MODES


def mode_name(mode: Mode) -> str:
    """Name a mode the way the field writes it, e.g. ``[1,0]``."""
    return f"[{','.join(map(str, mode))}]"


def sequence_name(sequence: Sequence[Mode]) -> str:
    """Name a mode sequence, e.g. ``[0,0] > [1,0]``."""
    return " > ".join(mode_name(mode) for mode in sequence) or "(no phase)"


def named(what: str, chosen: Sequence[int], of: int) -> str:
    """Name one or several of so many, counted from 1: segment 2, both segments, heaters 1 and 3."""
    numbers = [str(number) for number in chosen]
    if len(numbers) == 1:
        return f"{what} {numbers[0]}"
    if len(numbers) == of:
        return f"{'both' if of == 2 else 'all'} {what}s"
    return f"{what}s {', '.join(numbers[:-1])} and {numbers[-1]}"
