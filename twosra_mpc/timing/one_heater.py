"""At most one heater at a time: the spells of the two segments must follow each other.

A *spell* is the time from heater on to heater off around one soft period. Two spells whose soft
phases do not overlap follow each other in the order of the phases. A segment that is liquid at
t = 0 has its heater on already, so its first spell comes first. Two melted segments that are soft
in the same phase need the first one's metal to stay liquid without heat for as long as the second
one's takes to melt; where that is not so they are refused.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

from twosra_mpc.robot.modes import Mode, ModeSequence
from twosra_mpc.timing.network import Event, events_of


class Spell(NamedTuple):
    """One soft period of a segment: its melt (None: liquid at t = 0) and freeze (None: never)."""

    melt: Event | None
    freeze: Event | None


def spells(sequence: ModeSequence, first: Mode, last: Mode) -> tuple[list[Spell], list[Spell]]:
    """Return the soft periods of segment 1 and of segment 2, in order."""
    found: tuple[list[Spell], list[Spell]] = (
        [Spell(None, None)] * first[0],
        [Spell(None, None)] * first[1],
    )
    for event in events_of(sequence, first, last):
        mine = found[event.segment]
        if event.to == "soft":
            mine.append(Spell(event, None))
        else:
            mine[-1] = Spell(mine[-1].melt, event)
    return found


def successive(
    sequence: ModeSequence, first: Mode, last: Mode
) -> Iterator[tuple[Spell, Spell] | None]:
    """Yield (earlier, later) of each pair of spells; None for a pair that overlaps."""
    ones, twos = spells(sequence, first, last)
    for one in ones:
        for two in twos:
            if _before(one, two):
                yield one, two
            elif _before(two, one):
                yield two, one
            else:
                yield None


def overlapping(sequence: ModeSequence, first: Mode, last: Mode) -> Iterator[tuple[Spell, Spell]]:
    """Yield the spells (of segment 1, of segment 2) that do not follow each other."""
    for one, two in itertools.product(*spells(sequence, first, last)):
        if not _before(one, two) and not _before(two, one):
            yield one, two


def _before(earlier: Spell, later: Spell) -> bool:
    if later.melt is None or earlier.freeze is None:
        return False
    return earlier.melt is None or earlier.freeze.gap <= later.melt.gap
