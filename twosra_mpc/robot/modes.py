"""Stiffness modes and mode sequences.

A mode is the pair sigma = (s1, s2); s_j = 1 when segment j is soft (liquid), 0 when rigid (solid).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

Mode = tuple[int, int]
ModeSequence = tuple[Mode, ...]
Stiffness = Literal["soft", "rigid"]

RIGID: Mode = (0, 0)
SOFT_2: Mode = (0, 1)
SOFT_1: Mode = (1, 0)
SOFT_BOTH: Mode = (1, 1)
MODES: tuple[Mode, ...] = (RIGID, SOFT_2, SOFT_1, SOFT_BOTH)


def mode_name(mode: Mode) -> str:
    """Name a mode the way the field writes it, e.g. ``[1,0]``."""
    return f"[{mode[0]},{mode[1]}]"


def sequence_name(sequence: Sequence[Mode]) -> str:
    """Name a mode sequence, e.g. ``[0,0] > [1,0]``."""
    return " > ".join(mode_name(mode) for mode in sequence) or "(no phase)"
