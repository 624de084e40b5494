"""Record of a run: plans, events, everything measured and sent, and how it ended; its file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from twosra_mpc.arguments import Word, public
from twosra_mpc.checking.followed import Followed, followed_in
from twosra_mpc.control.stiffness import KnownStiffness
from twosra_mpc.errors import InputError
from twosra_mpc.files import check_kind, plain_data, read_document, reading
from twosra_mpc.installation import __version__
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import plan_within
from twosra_mpc.problem.goals import GoalSet
from twosra_mpc.problem.problem import Problem, embedded_problem
from twosra_mpc.problem.tasks import Task
from twosra_mpc.robot.accuracy import Accuracy
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode, Stiffness
from twosra_mpc.validation import ArrayValue

if TYPE_CHECKING:
    from twosra_mpc.execution.controller import Controller

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

    def followed(self, t_s: Array, q: Array, objects: Array) -> list[Followed]:
        """How its paths were followed; arguments as `followed_in` has them."""
        problem = self.plans[0].problem if self.plans else self.problem
        return followed_in(problem, self._spans(problem.tasks), t_s, q, objects)

    def _spans(self, tasks: Sequence[Task]) -> Iterator[tuple[float, float]]:
        """Begin and end of each task as the robot saw it [s]; inf if it was not done."""
        told, since_s = iter([each for each in self.events if each.kind == "task"]), 0.0
        for task in tasks:
            own = (each.time_s for each in told if each.text.startswith(f"{task.called} is done"))
            until_s = next(own, math.inf)
            yield since_s, until_s
            since_s = until_s

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
            **{name: plain_data(getattr(self, name)) for name in _WRITTEN},
            "accuracy": self.accuracy.model_dump(),
            "plans": [plan.to_dict() for plan in self.plans],
        }


_WRITTEN = (  # as they are
    *("executor", "ending", "reason", "duration_s", "error", "transitions", "replans"),
    *("corrections", "begun", "changes", "drives", "done_s", "lost", "events", "log"),
)


def times(count: int) -> str:
    """Number of times in words."""
    return {0: "never", 1: "once", 2: "twice"}.get(count, f"{count} times")


_CODES: dict[KnownStiffness | None, float] = {
    **{"rigid": 0.0, "changing": CHANGING, "soft": 1.0},
    None: np.nan,
}


class RunRecord:
    """Record of everything measured, believed and commanded.

    Attributes:
        controller: What drives the robot.
    """

    def __init__(self, controller: Controller) -> None:
        """Nothing has happened yet."""
        self.controller = controller
        self._rows: list[tuple[object, ...]] = []  # in the order of the log's columns
        coordinates = controller.belief.problem.robot.coordinates
        self._unknown = np.full(coordinates.size, np.nan)
        self._no_mode = (np.nan,) * coordinates.segments

    def note(self) -> None:
        """Note what was read, and the command given on it."""
        belief = self.controller.belief
        reading, command = belief.reading, belief.command
        seen = reading.frames.mean(axis=0) if len(reading.frames) else self._unknown
        stiffness = tuple(_CODES[now] for now in reading.stiffness)
        planned = command.planned if command.planned.size else self._unknown
        mode = self._no_mode if command.mode is None else command.mode
        known = (reading.time_s, belief.q, seen, planned, reading.temperature_C, stiffness)
        self._rows.append((*known, command.heater_setpoint_C, command.wheel_rad_s, mode))

    def run(self, verdict: Verdict) -> Run:
        """The run as it is written down up to now, with this verdict."""
        belief = self.controller.belief
        kinds = [event.kind for event in belief.events]
        columns = (np.array(column, dtype=float) for column in zip(*self._rows, strict=True))
        return Run(
            problem=belief.problem,
            **verdict._asdict(),
            error=belief.error,
            replans=kinds.count("replan"),
            corrections=kinds.count("correct"),
            changes=tuple(belief.changes),
            drives=tuple(belief.drives),
            events=tuple(belief.events),
            log=RunLog(*columns),
        )


@public
def load_run(path: str | Path) -> Run:
    """Read a run back that was saved from ``Run.to_dict``.

    Raises:
        InputError: If the file is no run of this version, or does not fit together.
    """
    source = str(path)
    document = read_document(Path(path), source)
    check_kind(document, "run", source)
    found = document.get("format"), document.get("version")
    if found != (FORMAT, FORMAT_VERSION):
        raise InputError("format", found, f"{FORMAT!r} version {FORMAT_VERSION}", source)
    with reading(source, "run"):
        return _run(document, source)


def _run(data: dict[str, Any], source: str) -> Run:
    return Run(
        problem=embedded_problem(data["robot"], data["scenario"], source),
        plans=tuple(plan_within(each, data["robot"], source) for each in data["plans"]),
        ending=Ending(data["ending"]),
        error=np.array(data["error"], dtype=float),
        begun=tuple(data["begun"]),
        changes=tuple(Change(**each) for each in data["changes"]),
        drives=tuple(Drive(**{**each, "mode": tuple(each["mode"])}) for each in data["drives"]),
        events=tuple(RunEvent(**each) for each in data["events"]),
        log=_log(data["log"]),
        done_s=tuple(data["done_s"]),
        **{name: data[name] for name in ("executor", "reason", "replans", "corrections", "lost")},
    )


def _log(columns: dict[str, Any]) -> RunLog:
    arrays: dict[str, Array] = {
        item.name: np.array(columns[item.name], dtype=float)  # None becomes NaN
        for item in fields(RunLog)
    }
    if len({len(column) for column in arrays.values()}) != 1:
        raise ValueError("the columns of the log differ in length")
    return RunLog(**arrays)
