"""Record of a run: plans, events, everything measured and sent, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np

from twosra_mpc.arguments import Word, public
from twosra_mpc.installation import __version__
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.accuracy import Accuracy
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, Stiffness
from twosra_mpc.validation import ArrayValue

EventKind = Literal[
    "plan", "drive", "confirmed", "look", "task", "correct", "kept", "replan", "failure", "end"
]

Executed = Literal["optimal", "greedy", "stream"]

FORMAT, FORMAT_VERSION = "twosra-run", 1
CHANGING = 0.5  # between 0, rigid, and 1, soft, in ``RunLog.stiffness``


class Ending(Word):
    """Ending of a run; ``Run.reason`` says it in words."""

    REACHED = "reached"  # within the accuracy of the goal, as measured
    UNSEEN = "arrived unseen"  # by dead reckoning: nobody has seen lately, or well, where it is
    NO_PLAN = "no plan"  # the rest of the problem has no plan, or none was found
    CAMERA_LOST = "camera lost"  # nothing sees the robot any more
    HEATER_FAILED = "heater failed"  # and what is left without it has no plan
    HEATER_STUCK = "heater stuck on"  # it is warm and told to be off: switch the power off
    COOLS_SLOWLY = "cools too slowly"  # a segment that is not heated does not become rigid
    TOO_HOT = "too hot"  # a segment is at temperature_max_C
    SENSOR_FAILED = "sensor failed"  # a temperature that cannot be, or nobody can read
    NOT_MOVING = "does not move"  # what is commanded is not what the camera sees
    OBJECT_LOST = "object lost"  # and it could not be grasped again
    TOO_NEAR = "too near"  # stopped before it touched something
    GAVE_UP = "gave up"  # replanned or corrected too often, or no mode comes nearer
    TIME_LIMIT = "time limit"  # the run took too long
    LOGGED = "logged"  # written down as it was; nobody has judged where it ended


class Verdict(NamedTuple):
    """Verdict: what carried a run out, how and why it ended, and by which plans; see `Run`."""

    executor: Executed
    ending: Ending
    reason: str
    plans: tuple[Plan, ...] = ()
    begun: tuple[int, ...] = ()
    done_s: tuple[float, ...] = ()
    lost: int = 0


class RunEvent(NamedTuple):
    """Something worth knowing, when it happened and in words."""

    time_s: float
    kind: EventKind
    text: str


class Drive(NamedTuple):
    """A stretch of time in which the robot was driven in one mode [s]."""

    mode: Mode
    start_s: float
    end_s: float


class Change(NamedTuple):
    """A segment (from 1) that has melted or frozen, and when its controller said so."""

    time_s: float
    segment: int
    to: Stiffness


@dataclass(frozen=True, eq=False, repr=False)
class RunLog(ArrayValue):
    """Everything measured, believed and sent; arrays of one length, read-only.

    Attributes:
        time_s: When it was read, (rows,).
        q: Configuration believed [m, m, rad, 1/m ...], (rows, 3 + n).
        measured: Mean of the frames that had come in, NaN if none had, (rows, 3 + n).
        planned: Where the plan was at that moment, NaN without one, (rows, 3 + n).
        temperature_C: Measured temperatures, (rows, n).
        stiffness: As reported: 0 rigid, 0.5 changing, 1 soft, NaN not, (rows, n).
        setpoint_C: Set-points asked for until the next, (rows, n).
        wheel_rad_s: Wheel speeds sent until the next, (rows, 4).
        mode: Mode in which the wheels are driven until the next: 0 rigid, 1 soft, NaN while they
            stand, (rows, n).
    """

    time_s: Array
    q: Array
    measured: Array
    planned: Array
    temperature_C: Array
    stiffness: Array
    setpoint_C: Array
    wheel_rad_s: Array
    mode: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)


@public
@dataclass(frozen=True, eq=False, repr=False)
class Run(ArrayValue):
    """A run from start to end.

    Attributes:
        problem: What was asked.
        executor: "optimal" or "greedy"; "stream" if a plan was sent without a camera.
        plans: Plans in the order in which they were followed; none by the greedy executor.
        ending: How it ended.
        reason: Why, in a sentence.
        error: Distance to ``goal`` at the end, as believed, (3 + n,) [m, m, rad, 1/m ...].
        replans: How often the remaining problem was planned again.
        corrections: How often the pose was corrected after everything was solid.
        begun: Transitions of each plan that were begun.
        changes: Melts and freezes, as reported.
        drives: When the robot was driven.
        events: What happened, in words.
        log: Everything measured, believed and sent.
        done_s: When tasks of a mission were seen to be done, in the order in which they were.
        lost: How often an object was not where it should have been held.
    """

    problem: Problem
    executor: Executed
    plans: tuple[Plan, ...]
    ending: Ending
    reason: str
    error: Array
    replans: int
    corrections: int
    begun: tuple[int, ...]
    changes: tuple[Change, ...]
    drives: tuple[Drive, ...]
    events: tuple[RunEvent, ...]
    log: RunLog
    done_s: tuple[float, ...] = ()
    lost: int = 0

    @property
    def reached(self) -> bool:
        """True if the goal was reached, as far as the robot can tell."""
        return self.ending is Ending.REACHED

    @property
    def goal(self) -> GoalSet:
        """Goal that the run is measured by."""
        return self.problem.judged_goal

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy that is near enough."""
        return self.problem.robot.ends_within

    @property
    def duration_s(self) -> float:
        """Time from start to end."""
        return float(self.log.time_s[-1])

    @property
    def transitions(self) -> int:
        """Melts and freezes that were reported."""
        return len(self.changes)

    def to_dict(self) -> dict[str, Any]:
        """The run as plain data."""
        return {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "package": __version__,
            "robot": self.problem.robot.model_dump(mode="json"),
            "scenario": self.problem.scenario(),
            "executor": self.executor,
            "accuracy": self.accuracy.model_dump(),
            "ending": str(self.ending),
            "reason": self.reason,
            "duration_s": self.duration_s,
            "error": self.error.tolist(),
            "transitions": self.transitions,
            "replans": self.replans,
            "corrections": self.corrections,
            "begun": list(self.begun),
            "changes": [change._asdict() for change in self.changes],
            "drives": [drive._asdict() for drive in self.drives],
            "done_s": list(self.done_s),
            "lost": self.lost,
            "events": [event._asdict() for event in self.events],
            "plans": [plan.to_dict() for plan in self.plans],
            "log": {item.name: _numbers(getattr(self.log, item.name)) for item in fields(RunLog)},
        }


def times(count: int) -> str:
    """Number of times in words."""
    return {0: "never", 1: "once", 2: "twice"}.get(count, f"{count} times")


def _numbers(array: Array) -> list[Any]:
    """Plain lists, None where there is no number."""
    plain = array.astype(object)
    plain[np.isnan(array)] = None
    return plain.tolist()
