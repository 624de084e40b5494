"""Critical path of a plan: activities that follow each other without a gap.

Each of them ends exactly when the next one begins, the first begins at t = 0 and the last one ends
the plan. What happens beside them costs no time of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from twosra_mpc.plans.plan import Plan
from twosra_mpc.robot.modes import named, soft_segments

Kind = Literal["drive", "bend", "heat", "melt", "cool", "freeze", "wait"]

_SAME_S = 1e-5  # events closer than this are one
_WORTH_TELLING_S = 1e-3  # shorter activities are rounding to a reader
_RANK = {"drive": 0, "bend": 0, "melt": 1, "freeze": 1, "heat": 2, "cool": 2, "wait": 3}
_VERB = {
    "drive": "driving",
    "bend": "bending",
    "heat": "heating",
    "melt": "melting",
    "cool": "cooling",
    "freeze": "freezing",
    "wait": "waiting",
}


@dataclass(frozen=True)
class Activity:
    """Activity of a plan: a motion, a change of metal or a wait, with its time span.

    Attributes:
        kind: A motion phase ("drive": rigid, "bend": soft), the heating before a melt and the
            cooling before a freeze, during which the robot may still move, the melt and the freeze
            themselves, during which it may not, or "wait".
        segments: The segments it is about, counted from 1.
        of: Number of segments of the robot.
        start_s: When it begins [s].
        end_s: When it ends [s].
    """

    kind: Kind
    segments: tuple[int, ...]
    of: int
    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.end_s - self.start_s

    def overlap_s(self, other: Activity) -> float:
        """Time that both take [s]; negative where they are apart."""
        return min(self.end_s, other.end_s) - max(self.start_s, other.start_s)

    def __str__(self) -> str:
        return f"{_VERB[self.kind]} {self.about}".rstrip()

    @property
    def about(self) -> str:
        """The segments by name; nothing without any."""
        return named("segment", self.segments, self.of) if self.segments else ""


class Hidden(NamedTuple):
    """An activity that costs no time of its own, and what takes that time meanwhile."""

    activity: Activity
    during: tuple[Activity, ...]

    def __str__(self) -> str:
        return f"{self.activity}, during {' and '.join(map(str, self.during))}"


class _Chain(NamedTuple):
    wait_s: float
    activities: tuple[Activity, ...]

    @property
    def end_s(self) -> float:
        return self.activities[-1].end_s if self.activities else 0.0


def critical_path(made: Plan) -> tuple[Activity, ...]:
    """Return activities of ``made`` that add up to its duration, in order of time.

    Of several that end at the same moment: motion rather than a transition, a melt or freeze rather
    than the heating or cooling before another one.
    """
    ends = made.duration_s
    path: list[Activity] = []
    for item in reversed(_chain(activities(made), ends)):
        begins = item.start_s if item.start_s > _SAME_S else 0.0
        path.append(replace(item, start_s=begins, end_s=ends))
        ends = begins
    return tuple(reversed(path))


def hidden_activities(made: Plan) -> tuple[Hidden, ...]:
    """Return what happens beside the critical path for over a millisecond, in order of time."""
    every = activities(made)
    path = _chain(every, made.duration_s)
    return tuple(
        Hidden(item, tuple(one for one in path if one.overlap_s(item) > _WORTH_TELLING_S))
        for item in sorted(every, key=lambda one: one.start_s)
        if item not in path and item.duration_s > _WORTH_TELLING_S
    )


def in_words(path: Sequence[Activity]) -> tuple[tuple[float, str], ...]:
    """Put a path in words, (duration [s], what), a transition and its preparation as one."""
    told: list[tuple[float, str]] = []
    lead: Activity | None = None
    for item in path:
        prepared = lead is not None and lead.segments == item.segments
        if lead is not None and prepared and item.kind in ("melt", "freeze"):
            moving = f"{lead.duration_s:z.1f} s of it while the robot may still move"
            told[-1] = (lead.duration_s + item.duration_s, f"{item} ({moving})")
        elif item.kind == "melt":
            state = "is molten" if len(item.segments) == 1 else "are molten"
            told.append((item.duration_s, f"until {item.about} {state}"))
        else:
            told.append((item.duration_s, str(item)))
        lead = item if item.kind in ("heat", "cool") else None
    return tuple(told)


def activities(made: Plan) -> list[Activity]:
    """Return everything that takes time in ``made``; what segments do together as one."""
    found: list[Activity] = []
    count = made.robot.geometry.segments
    for mode, start, end in made.phases:
        segments = tuple(j + 1 for j in soft_segments(mode))
        found.append(Activity("bend" if segments else "drive", segments, count, start, end))
    for item in made.transitions:
        lead: Kind = "heat" if item.to == "soft" else "cool"
        plateau: Kind = "melt" if item.to == "soft" else "freeze"
        for kind, start, end in (
            (lead, item.heater_s, item.onset_s),
            (plateau, item.onset_s, item.done_s),
        ):
            near = (each for each in found if abs(each.start_s - start) < _SAME_S)
            alike = (each for each in near if abs(each.end_s - end) < _SAME_S)
            twin = next((each for each in alike if each.kind == kind), None)
            if twin is not None:
                found.remove(twin)
                together = tuple(sorted((*twin.segments, item.segment)))
                found.append(replace(twin, segments=together))
            else:
                found.append(Activity(kind, (item.segment,), count, start, end))
    return [item for item in found if item.duration_s > _SAME_S / 10]


def _chain(todo: Sequence[Activity], end_s: float) -> tuple[Activity, ...]:
    """The chain from 0 to ``end_s`` that waits least."""
    chains: list[_Chain] = []
    for item in sorted(todo, key=lambda one: one.end_s):
        before = _best(chains, item.start_s)
        chains.append(_Chain(before.wait_s, (*before.activities, item)))
    return _best(chains, end_s).activities


def _best(chains: Sequence[_Chain], end_s: float) -> _Chain:
    """The chain to ``end_s`` that waits least; a wait at its end where nothing ends then."""
    if end_s <= _SAME_S:
        return _Chain(0.0, ())
    touching = [chain for chain in chains if abs(chain.end_s - end_s) <= _SAME_S]
    if touching:
        return min(touching, key=lambda one: (round(one.wait_s, 4), _RANK[one.activities[-1].kind]))
    earlier = [chain for chain in chains if chain.end_s < end_s]
    last = max(earlier, key=lambda one: one.end_s, default=_Chain(0.0, ()))
    wait = Activity("wait", (), 0, last.end_s, end_s)
    return _Chain(last.wait_s + wait.duration_s, (*last.activities, wait))
