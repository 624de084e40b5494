"""The stiffness of the segments over a plan: rigid, melting, soft or freezing, in intervals."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Literal, NamedTuple

from twosra_mpc.plans.trajectory import SAME_TIME_S, Trajectory
from twosra_mpc.robot.modes import Mode

State = Literal["rigid", "melting", "soft", "freezing"]
CHANGING: tuple[State, ...] = ("melting", "freezing")


class Interval(NamedTuple):
    """From ``start_s`` on, until ``end_s``, a segment is in one state."""

    start_s: float
    end_s: float
    state: State


def stiffness_intervals(trajectory: Trajectory) -> tuple[tuple[Interval, ...], ...]:
    """For each segment, the intervals that fill the plan; the last one may have no length."""
    changes: list[list[tuple[float, State]]] = [
        [(0.0, "soft" if soft else "rigid")] for soft in trajectory.problem.start_mode
    ]
    for item in trajectory.transitions:
        changing: State = "melting" if item.to == "soft" else "freezing"
        changes[item.segment - 1] += [(item.onset_s, changing), (item.done_s, item.to)]
    return tuple(_intervals(each, trajectory.duration_s) for each in changes)


def state_at(intervals: Sequence[Interval], time_s: float) -> State:
    """The state at a time; at a border that of the interval that begins."""
    place = bisect_right([one.start_s for one in intervals], time_s + SAME_TIME_S) - 1
    return intervals[max(place, 0)].state


def soft_and_changing(states: Sequence[State]) -> tuple[Mode, Mode]:
    """Which segments are soft, or were until they froze, and which melt or freeze; 1: they do."""
    soft = tuple(int(state in ("soft", "freezing")) for state in states)
    return soft, tuple(int(state in CHANGING) for state in states)


def _intervals(changes: list[tuple[float, State]], end_s: float) -> tuple[Interval, ...]:
    ends = [*(t for t, _ in changes[1:]), end_s]
    whole = [Interval(t, end, state) for (t, state), end in zip(changes, ends, strict=True)]
    return (*(one for one in whole[:-1] if one.end_s > one.start_s), whole[-1])
