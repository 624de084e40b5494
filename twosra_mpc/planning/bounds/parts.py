r"""Bounds of a mode sequence from parts of what it may do: shapes to end in, and bends left free.

Modes that are soft more often than there are segments, such as [0,1] > [1,0] > [1,1], reach a shape
by many bends. With d_f those of phases whose modes depend on the modes of others (``free_bends``),
the rest follow from them and from the change w that is asked for. So every plan of the sequence
lies in a box of (w, d_f), which is known: no bend is larger than the curvature limits are apart.
How fast the robot bends, and which forbidden shapes it passes, is better known in a smaller box.
The worst one is cut in two again and again, longer where its middle passes such a shape. Each is
bounded by least durations of its phases, or excluded because its bends pass a forbidden shape
whatever they are; the least of these bounds is one of the sequence, because the boxes cover all of
its plans.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import replace

import numpy as np

from twosra_mpc.planning.bounds.bends import (
    BendingTask,
    Intervals,
    determined_bends,
    free_bends,
    least_durations,
    middle_bends,
)
from twosra_mpc.planning.bounds.sequence_bound import (
    Events,
    SequenceBound,
    longest_path_bound,
    sequence_bound,
)

_CUTS, _FREE_CUTS = 7, 20  # of a box of shapes, and of a box with free bends
_MOST_CUTS = 40  # where the bends in the middle of the least part pass a forbidden shape


def bound_by_parts(events: Events, task: BendingTask, enough: float) -> SequenceBound | None:
    """Bound a sequence by cutting what it may do into parts; None if it has no choice.

    Its bends are those in the middle of the least part where these pass no forbidden shape.

    Args:
        events: Of the sequence.
        task: What the bending coordinates must do.
        enough: A bound that need not be exceeded.
    """
    sequence, free = events.network.sequence, free_bends(events.network.sequence, task)
    if not free and determined_bends(sequence, task) is not None:
        return None
    parts = [(-math.inf, (*task.change, *free))]

    def passable(box: Intervals) -> bool:
        return _in_box(_middle(box), events, task) is not None

    few = _FREE_CUTS if free else _CUTS
    for cut in range(_MOST_CUTS):
        whole, box = parts[0]
        if whole >= enough or (cut >= few and passable(box)):
            break
        heapq.heappop(parts)
        j = max(range(len(box)), key=lambda j: box[j][1] - box[j][0])
        middle = sum(box[j]) / 2
        for half in ((box[j][0], middle), (middle, box[j][1])):
            part = (*box[:j], half, *box[j + 1 :])
            bound = _bound_of(part, events, task)
            heapq.heappush(parts, (max(whole, bound), part))
    possible = (box for cost, box in sorted(parts) if cost < math.inf)
    best = next(filter(passable, possible), parts[0][1])
    change, choice = _split(best, task)
    return SequenceBound(parts[0][0], np.zeros(0), middle_bends(sequence, change, choice))


def _split(box: Intervals, task: BendingTask) -> tuple[Intervals, Intervals]:
    """The change of W asked for, and the free bends."""
    return box[: len(task.change)], box[len(task.change) :]


def _middle(box: Intervals) -> Intervals:
    return tuple((sum(ends) / 2,) * 2 for ends in box)


def _in_box(box: Intervals, events: Events, task: BendingTask) -> Events | None:
    """Events as long as the bends of a box take; None if these pass a forbidden shape."""
    change, choice = _split(box, task)
    least = least_durations(events.network.sequence, replace(task, change=change), choice)
    longer = list(map(max, least, events.least_s))
    return events._replace(least_s=longer) if max(least) < math.inf else None


def _bound_of(box: Intervals, events: Events, task: BendingTask) -> float:
    change, choice = _split(box, task)
    if (longer := _in_box(box, events, task)) is None:
        return math.inf
    if choice:
        found = longest_path_bound(longer, np.zeros(0))
    else:
        found = sequence_bound(longer, replace(task, change=change))
    return math.inf if found is None else found.cost
