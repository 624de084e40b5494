"""At most one heater at a time: the dwells of different segments must follow each other.

A *dwell* is the time from heater on to heater off around one soft period. Two dwells whose soft
phases do not overlap follow each other in the order of the phases. A segment that is liquid at
t = 0 has its heater on already, so its first dwell comes first. Two melted segments that are soft
in the same phase need the first one's metal to stay liquid without heat for as long as the second
one's takes to melt; where that is not so they are refused. All this is said of two segments at a
time, whatever their number: no two heaters are on at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

from twosra_mpc.robot.modes import Mode, ModeSequence, mode_name
from twosra_mpc.timing.network import Event, events_of


class Dwell(NamedTuple):
    """A soft period of a segment: its melt (None: liquid at t = 0) and freeze (None: never)."""

    segment: int
    melt: Event | None
    freeze: Event | None


def handovers(
    sequence: ModeSequence, first: Mode, last: Mode
) -> Iterator[tuple[Event | None, Event, Event]]:
    """Yield (melt, freeze, melt of another segment) where one heater goes off before another on."""
    for pair in _pairs(sequence, first, last):
        for earlier, later in (pair, pair[::-1]):
            if earlier.freeze and later.melt and _before(earlier, later):
                yield earlier.melt, earlier.freeze, later.melt


def overlaps(
    sequence: ModeSequence, first: Mode, last: Mode
) -> Iterator[tuple[Dwell, Dwell, Mode]]:
    """Yield any two dwells that do not follow each other, and the first mode with both soft."""
    for one, two in _pairs(sequence, first, last):
        if not _before(one, two) and not _before(two, one):
            modes = (first, *sequence, last)
            both = next(mode for mode in modes if mode[one.segment] and mode[two.segment])
            yield one, two, both


def refused(mode: Mode) -> str:
    """Say that a mode needs more heaters than one."""
    count = "both" if sum(mode) == 2 else str(sum(mode))
    return f"mode {mode_name(mode)} needs {count} heaters at once, but heaters_at_once is 1"


def _pairs(sequence: ModeSequence, first: Mode, last: Mode) -> Iterator[tuple[Dwell, Dwell]]:
    dwells = [[Dwell(j, None, None)] * soft for j, soft in enumerate(first)]
    for event in events_of(sequence, first, last):
        mine = dwells[event.segment]
        if event.to == "soft":
            mine.append(Dwell(event.segment, event, None))
        else:
            mine[-1] = mine[-1]._replace(freeze=event)
    for ones, twos in itertools.combinations(dwells, 2):
        yield from itertools.product(ones, twos)


def _before(earlier: Dwell, later: Dwell) -> bool:
    if later.melt is None or earlier.freeze is None:
        return False
    return earlier.melt is None or earlier.freeze.gap <= later.melt.gap
