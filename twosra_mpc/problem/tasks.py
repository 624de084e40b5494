"""Tasks, one after the other before the goal or instead of one, and the stages that they make."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.problem.goals import Anywhere, Goal, GoalSet
from twosra_mpc.problem.polyline import Polyline, flattened, read_path, wrong_place
from twosra_mpc.problem.tolerances import ROUNDING
from twosra_mpc.problem.world import Object, Obstacle
from twosra_mpc.robot.coordinates import POSE, Array, composed, inverse
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, rigid_mode
from twosra_mpc.validation import (
    Distance,
    Interval,
    Length,
    Metres,
    MetresInterval,
    NonNegative,
    Pair,
    Positive,
    Radians,
    Several,
    Tagged,
)


@dataclass(frozen=True)
class Stage:
    """A stretch of a plan, from the end of the stage before to its own.

    Attributes:
        modes: Modes that it may use.
        last: Stiffness at its end; None: any.
        goal: Goal set in which it ends, if there is one.
        through: Box that b0 has entered at its end, where it need not be at rest.
        along: Thing that segments lie along at its end.
        grasps: Object that is in hand at its end.
        carries: Pose of the object in hand at its end.
        follows: Path along which it leads.
        releases: Object that is free at its end.
        least_s: Least duration [s].
        words: What is done, e.g. "grasp cup".
        touches: Names of what the robot need not keep clear of.
        holds: Name of the object that is in hand all the time.
        task: The task that asks for it; None: the goal does.
    """

    modes: Sequence[Mode]
    last: Mode | None = None
    goal: GoalSet | None = None
    through: Pass | None = None
    along: Conform | None = None
    grasps: Grasp | None = None
    carries: Carry | None = None
    follows: Follow | None = None
    releases: Release | None = None
    least_s: float = 0.0
    words: str = ""
    touches: frozenset[str] = frozenset()
    holds: str | None = None
    task: Task | None = None


def stages_of(
    tasks: Sequence[Task], goal: GoalSet, modes: Sequence[Mode], held: str | None
) -> Iterator[Stage]:
    """Yield the stages of tasks in this order, and of the goal, unless that is anywhere.

    Args:
        tasks: The tasks.
        goal: What comes after them.
        modes: Modes that stages may use.
        held: Name of the object in hand at t = 0.
    """
    along, rests = frozenset[str](), False
    for number, task in enumerate(tasks, start=1):
        about = frozenset([task.about] if task.about else ())
        own, held = task.stage(modes), None if task.lets_go else held
        touches = along | about if task.touches else along
        own = replace(own, words=task.said(number), touches=touches, task=task)
        yield _with_in_hand(own, held)
        along, rests = about if task.lies_along else frozenset(), task.rests
        held = task.about if task.takes else held
    if not (rests and isinstance(goal, Anywhere)):
        to_goal = Stage(modes, goal.mode, goal, words="reach the goal", touches=along)
        yield _with_in_hand(to_goal, held)


def _with_in_hand(stage: Stage, held: str | None) -> Stage:
    """The stage with an object in hand, if there is one: then nothing bends."""
    if held is None:
        return stage
    return replace(stage, modes=(rigid_mode(len(stage.modes[0])),), holds=held)


MOST_PHASES = 5  # of a task: sequences that are longer are bounded, not planned


Kind = TypeVar("Kind", bound="Task")


class Task(Tagged):
    """Something to do; ``do`` says what.

    Nobody asks which kind of task one is: it says here what follows from it, and makes the `Stage`
    that leads to its end. So a further kind is one class.

    Attributes:
        do: The kind of task, as files have it.
        name: What it is called in messages; may be empty.
        tag_key: Key of files that says which kind it is.
        rests: Whether the robot is at rest when it is done; else it is done on the way.
        asks_shape: Whether the shape in which it is done matters.
        needs_held: Whether an object is in hand as it begins; None: either.
        takes: Whether it takes hold of the object that it is about.
        lets_go: Whether it lets that go.
        touches: Whether what it is about may be touched until it is done.
        lies_along: Whether it may be touched until the next task is done, too.
    """

    tag_key: ClassVar[str] = "do"
    rests: ClassVar[bool] = True
    asks_shape: ClassVar[bool] = False
    needs_held: ClassVar[bool | None] = None
    takes: ClassVar[bool] = False
    lets_go: ClassVar[bool] = False
    touches: ClassVar[bool] = False
    lies_along: ClassVar[bool] = False

    do: str
    name: str = ""

    def of_robot(self, robot: Robot) -> Task:
        """Return the task with what was left out filled in for a robot."""
        del robot
        return self

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """The stage that leads to its end, alone; ``modes`` are those of the problem."""
        raise NotImplementedError(f"{type(self).__name__}.stage")

    def said(self, number: int) -> str:
        """Task in words, e.g. "grasp cup"; ``number`` from 1 names one that nothing else does."""
        return f"{self.do} {self.name or self.about or f'goal {number}'}"

    @property
    def called(self) -> str:
        """What it is called where its number is not known, e.g. "grasp cup"."""
        return f"{self.do} {self.name or self.about or ''}".strip()

    @property
    def about(self) -> str | None:
        """Name of the object, or obstacle, that it is about."""
        return getattr(self, "object", None)

    @property
    def closes(self) -> bool:
        """True if it closes round what it is about, which decides what shape the robot can take."""
        return False

    @property
    def asks_heading(self) -> bool:
        """True if the heading matters of the object that it moves."""
        return False

    def kept_from(self, clearance_m: float) -> Task:
        """Return the task with no more clearance at its own object, where other things need it."""
        del clearance_m
        return self

    @property
    def ends_in(self) -> GoalSet | None:
        """The goal set in which it is done, if it is one."""
        return None

    @property
    def as_goal(self) -> GoalSet | None:
        """The goal of a problem that says the same, if one does."""
        return None


class Pass(Task):
    """Drive b0 through a box of poses on the way; what is left out is free."""

    rests: ClassVar[bool] = False

    do: Literal["pass"] = "pass"
    x_m: MetresInterval | None = None
    y_m: MetresInterval | None = None
    phi_rad: Interval | None = None

    @model_validator(mode="after")
    def _asked(self) -> Pass:
        if self.x_m is None and self.y_m is None and self.phi_rad is None:
            raise InputError("", {}, "at least one of x_m, y_m, phi_rad")
        return self

    @property
    def ends(self) -> Array:
        """Least and largest x, y, phi, (2, 3); infinite where free."""
        free = (-math.inf, math.inf)
        return np.array([self.x_m or free, self.y_m or free, self.phi_rad or free]).T

    def met(self, poses: Array) -> Array:
        """Truth for each pose (..., 3): it is in the box, to rounding and full turns."""
        low, high = np.add(self.ends, [[-ROUNDING], [ROUNDING]])
        inside = ((poses[..., :2] >= low[:2]) & (poses[..., :2] <= high[:2])).all(axis=-1)
        if self.phi_rad is not None:
            inside &= np.mod(poses[..., 2] - low[2], math.tau) <= high[2] - low[2]
        return inside

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """Through the box, without a rest."""
        return Stage(modes, through=self)

    def said(self, number: int) -> str:
        """Task in words."""
        return f"pass through {self.name or f'goal {number}'}"


class Reach(Task):
    """Come to rest in a goal; with the keys of ``[goal]``, or a `GoalSet` as ``goal``.

    With ``mode = "any"`` the segments may be soft or rigid there; left out, as the goal says.
    """

    asks_shape: ClassVar[bool] = True

    do: Literal["reach"] = "reach"
    mode: Literal["any"] | None = None
    goal: SerializeAsAny[GoalSet]

    @model_validator(mode="before")
    @classmethod
    def _of_a_goal(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "goal" in data:
            return data
        own = {key: data[key] for key in ("do", "name") if key in data}
        if data.get("mode") == "any":
            own["mode"] = "any"
        rest = {key: value for key, value in data.items() if key not in own}
        return {**own, "goal": Goal(**rest)}

    @field_validator("goal", mode="before")
    @classmethod
    def _box_unless_told_otherwise(cls, goal: object) -> object:
        return Goal(**goal) if isinstance(goal, dict) else goal

    def of_robot(self, robot: Robot) -> Reach:
        """Return the task with its goal filled in for a robot."""
        return self.with_values(goal=self.goal.of_robot(robot))

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """Until the robot is in the goal, soft or rigid as asked."""
        return Stage(modes, None if self.mode == "any" else self.goal.mode, self.goal)

    @property
    def ends_in(self) -> GoalSet:
        """Its goal."""
        return self.goal

    @property
    def as_goal(self) -> GoalSet | None:
        """Its goal, unless the segments may be soft or rigid there."""
        return None if self.mode == "any" else self.goal


class Conform(Task):
    """Lay segments along an object or obstacle, to within ``gap_m``.

    ``segments`` counts from 1; ``directions_rad`` are the headings of b0 that may be used.
    """

    asks_shape: ClassVar[bool] = True
    needs_held: ClassVar[bool | None] = False
    touches: ClassVar[bool] = True
    lies_along: ClassVar[bool] = True

    do: Literal["conform"] = "conform"
    object: str
    segments: Several[Annotated[int, Field(ge=1)]] = (1,)
    gap_m: Annotated[float, Field(gt=0.0)] = 0.001
    directions_rad: Pair = (-math.pi, math.pi)

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """Until segments lie along the thing, rigid."""
        return Stage(modes, rigid_mode(len(modes[0])), along=self)

    def said(self, number: int) -> str:
        """Task in words."""
        return f"conform to {self.name or self.object}"


class Grasp(Task):
    """Close around an object and become rigid.

    ``hold`` "caged": it is proved that the object cannot leave; "pushed": it may, and stays only
    while the robot moves such that contact is kept, which needs the object's ``friction``.
    ``directions_rad`` are the headings of b0 that may be used.
    """

    asks_shape: ClassVar[bool] = True
    needs_held: ClassVar[bool | None] = False
    takes: ClassVar[bool] = True
    touches: ClassVar[bool] = True

    do: Literal["grasp"] = "grasp"
    object: str
    hold: Literal["caged", "pushed"] = "caged"
    directions_rad: Pair = (-math.pi, math.pi)

    @property
    def closes(self) -> bool:
        """True for a cage: what is pushed is driven up to."""
        return self.hold == "caged"

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """Until the object is in the rigid robot."""
        return Stage(modes, rigid_mode(len(modes[0])), grasps=self)


class Carry(Task):
    """Drive until the object that is held is at a pose; its heading is free where left out."""

    needs_held: ClassVar[bool | None] = True

    do: Literal["carry"] = "carry"
    object: str
    x_m: Metres
    y_m: Metres
    phi_rad: Radians | None = None
    position_tolerance_m: NonNegative = 0.0
    heading_tolerance_rad: NonNegative = 0.0

    @property
    def asks_heading(self) -> bool:
        """True if it has a heading."""
        return self.phi_rad is not None

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """With the object in the rigid robot, to where it is to be."""
        rigid = rigid_mode(len(modes[0]))
        return Stage((rigid,), rigid, carries=self)


class Follow(Task):
    """Move the object that is held along a path, or a part of the robot where none is named.

    ``path`` is a list of points, the name of a CSV or SVG file, or ``{ bezier = [...] }`` with the
    3 k + 1 control points of cubic curves. It is followed from where its first point is, to within
    ``position_tolerance_m`` and as fast as the robot can. The ``heading`` is "free", "tangent" to
    the path or one that is kept; or points have one each, as a third number. It is that of what
    follows; a disc has none, so it is b0's. Of the path ``from_m`` lies behind. With ``times_s``,
    one for each point, or a column ``t_s`` of the CSV file, it is at each point at its time, to
    within ``position_tolerance_m``; it sets off at that of the first.
    """

    do: Literal["follow"] = "follow"
    object: str | None = None
    part: Literal["middle link", "unit 1"] = "middle link"
    path: Several[Several[Metres]]
    heading: Literal["free", "tangent"] | Radians = "free"
    position_tolerance_m: Length = 0.005
    heading_tolerance_rad: Positive = 0.1
    from_m: Distance = 0.0
    times_s: Several[NonNegative] | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_a_file(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("path"), str | Path):
            return data
        try:
            points, times_s = read_path(data["path"])
        except InputError as error:
            raise error.within("path", "") from None
        return {**data, "path": points} | ({"times_s": times_s} if times_s else {})

    @field_validator("path", mode="before")
    @classmethod
    def _read(cls, path: Any) -> Any:
        if isinstance(path, dict):
            control: Any = path.get("bezier")
            if set(path) != {"bezier"} or np.shape(control) not in _BEZIER:
                allowed = "{ bezier = [...] } with 4, 7, 10 ... control points [x, y]"
                raise InputError("", path, allowed)
            return flattened(control)
        return path

    @model_validator(mode="after")
    def _followable(self) -> Follow:
        columns = {len(row) for row in self.path}
        if columns not in ({2}, {3}) or len(set(self.path)) < 2:
            allowed = "two different points or more, all of 2 or 3 numbers"
            raise InputError("path", self.path, allowed)
        if columns == {3} and self.heading != "free":
            raise InputError("heading", self.heading, "left out: the points have headings")
        most_rad = 2 * self.heading_tolerance_rad if self.heading == "tangent" else math.inf
        wrong = wrong_place(self.line, most_rad, self.position_tolerance_m)
        if wrong is not None:
            raise InputError(f"path.{wrong[0]}", self.path[wrong[0]], wrong[1])
        if self.times_s is not None:
            self._check_times(self.times_s)
        if not self.from_m < self.line.length_m[-1]:
            raise InputError("from_m", self.from_m, f"less than {self.line.length_m[-1]:zg} m")
        return self

    def _check_times(self, times_s: Sequence[float]) -> None:
        if len(times_s) != len(self.path):
            raise InputError("times_s", len(times_s), f"one for each of {len(self.path)} points")
        if len(self.line.points) != len(self.path):
            raise InputError("path", self.path, "no point twice in a row, where they have times")
        for i, (before, after) in enumerate(itertools.pairwise(times_s), start=1):
            if not after > before:
                raise InputError(f"times_s.{i}", after, f"later than the one before, {before:zg} s")

    @property
    def due(self) -> Array:
        """How far along what is left it is to be [m], and when since it set off [s], (m, 2)."""
        if self.times_s is None:
            return np.zeros((0, 2))
        begun_s = np.interp(self.from_m, self.line.length_m, self.times_s)
        due = np.column_stack(
            [self.line.length_m - self.from_m, np.subtract(self.times_s, begun_s)]
        )
        return due[due[:, 0] > 0]

    def said(self, number: int) -> str:
        """Task in words."""
        return f"follow {self.name or f'path {number}'}"

    @property
    def line(self) -> Polyline:
        """All of its path, with the headings that are asked for."""
        if isinstance(self.heading, str):
            line = Polyline.of(self.path)
            return line.tangent if self.heading == "tangent" else line
        return Polyline.of([(*row, self.heading) for row in self.path])

    @property
    def asks_heading(self) -> bool:
        """True if its path has headings."""
        return self.heading != "free" or len(self.path[0]) == 3

    def no_nearer_than(self, room_m: float) -> Follow:
        """The same path, with a tolerance of no less than a cage leaves of room."""
        return self.with_values(position_tolerance_m=max(self.position_tolerance_m, room_m))

    @property
    def left(self) -> Polyline:
        """What is left of its path."""
        return self.line.after(self.from_m)

    def astray(self, pose: Array, room_m: float = 0.0) -> tuple[str, bool] | None:
        """Reason why it is not begun at a pose (3,) of what follows it, and whether none can be.

        Args:
            pose: Where what follows it is.
            room_m: How far it may get from there, of the tolerance.
        """
        line = self.left
        x, y = line.points[0].tolist()
        off_m = math.dist(pose[:2].tolist(), (x, y))
        off_rad = abs(math.remainder(pose[2] - line.headings[0], math.tau))
        within_m, within_rad = self.position_tolerance_m - room_m, self.heading_tolerance_rad
        if off_m <= _BEGINS * within_m and not off_rad > _BEGINS * within_rad:
            return None
        turned = f", {math.degrees(off_rad):z.0f} degrees turned" if off_rad > 0 else ""
        heading = "" if math.isnan(off_rad) else f", phi_rad = {line.headings[0]:z.4g}"
        to = "carry" if self.object else "reach"
        asked = f'a task "{to}" before it: x_m = {x:z.4g}, y_m = {y:z.4g}{heading}'
        words = f"the path begins {1e3 * off_m:z.3g} mm away{turned}: {asked}"
        return words, off_m > within_m or off_rad > within_rad

    def led_to(self, pose: Array, q: Array) -> Iterator[Task]:
        """Yield the task that leads to where it begins, if that is elsewhere.

        Args:
            pose: Where what follows it is, (3,).
            q: The robot then, (3 + n,).
        """
        room_m = self.position_tolerance_m / 2 if self.object else 0.0  # no cage is known yet
        if self.astray(pose, room_m) is None:
            return
        (x_m, y_m), heading = self.left.points[0].tolist(), float(self.left.headings[0])
        if self.object is not None:
            phi_rad = None if math.isnan(heading) else heading
            yield Carry(object=self.object, x_m=x_m, y_m=y_m, phi_rad=phi_rad)
            return
        begin = np.array([x_m, y_m, pose[2] if math.isnan(heading) else heading])
        b0 = composed(begin, composed(inverse(pose), q[:POSE]))
        there = dict(zip(("x_m", "y_m", "phi_rad"), b0.tolist(), strict=True))
        yield Reach(goal=Goal(**there, kappa_per_m=tuple(q[POSE:].tolist())))

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """In the shape that the robot has, to the end of the path."""
        rigid, due = rigid_mode(len(modes[0])), self.due
        return Stage((rigid,), rigid, follows=self, least_s=float(due[-1, 1]) if len(due) else 0.0)


_BEGINS = 0.95  # of the tolerance, from where it is begun; verification proves to within the rest
_BEZIER = [(3 * k + 1, 2) for k in range(1, 100)]  # shapes of control points


class Release(Task):
    """Open until the object is free, and drive away to ``clearance_m``, or that of the problem."""

    needs_held: ClassVar[bool | None] = True
    lets_go: ClassVar[bool] = True
    touches: ClassVar[bool] = True

    do: Literal["release"] = "release"
    object: str
    clearance_m: NonNegative | None = None

    def kept_from(self, clearance_m: float) -> Release:
        """Return the task with a clearance, if it has none of its own."""
        return self if self.clearance_m is not None else self.with_values(clearance_m=clearance_m)

    def stage(self, modes: Sequence[Mode]) -> Stage:
        """Until the robot is open, soft or rigid."""
        return Stage(modes, releases=self)


def passes(tasks: Sequence[Task]) -> dict[int, Pass]:
    """Boxes to pass, by their place among the tasks."""
    return _of_kind(tasks, Pass)


def grasps(tasks: Sequence[Task]) -> dict[int, Grasp]:
    """Tasks that grasp, by their place."""
    return _of_kind(tasks, Grasp)


def carries(tasks: Sequence[Task]) -> dict[int, Carry]:
    """Tasks that carry, by their place."""
    return _of_kind(tasks, Carry)


def put(tasks: Sequence[Task]) -> dict[str, Carry]:
    """Where objects are brought last, by their names; at the end of a path, with its tolerance."""
    found = dict[str, Carry]()
    for task in tasks:
        if isinstance(task, Follow) and task.object is not None:
            (x_m, y_m), within_m = task.line.points[-1].tolist(), task.position_tolerance_m
            task = Carry(object=task.object, x_m=x_m, y_m=y_m, position_tolerance_m=within_m)
        if isinstance(task, Carry):
            found[task.object] = task
    return found


def part_in_b0(robot: Robot, kappa: Array, part: str) -> Array:
    """Pose of what follows a path in the frame of b0, (3,)."""
    if part == "middle link":
        return np.zeros(POSE)
    from twosra_mpc.model.outline import robot_shape  # certificates are checked without the model

    shape = robot_shape(robot.geometry, np.concatenate([np.zeros(POSE), kappa]), 2)
    return np.append(shape.centres[0], shape.ends[0, 2])


def with_ways(
    robot: Robot, q: Array, objects: Sequence[Object], tasks: Sequence[Task]
) -> Iterator[Task]:
    """Yield tasks, and before each path that begins elsewhere one that leads to its begin.

    Of a part of the robot that is known where the path is the first task alone.

    Args:
        robot: The robot.
        q: Where it starts, (3 + n,).
        objects: Where they are then.
        tasks: What is asked, in order.
    """
    known = {item.name: item.pose.pose for item in objects}
    for number, task in enumerate(tasks):
        path = task.stage([robot.rigid]).follows
        if path is not None and (number == 0 or path.object is not None):
            part = composed(q[:POSE], part_in_b0(robot, q[POSE:], path.part))
            yield from path.led_to(known[path.object] if path.object else part, q)
        for name, to in put([task]).items():
            heading = math.nan if to.phi_rad is None else to.phi_rad
            known[name] = np.array([to.x_m, to.y_m, heading])
        yield task


def follows(tasks: Sequence[Task], name: str) -> dict[int, Follow]:
    """Tasks that lead an object along a path, by their place."""
    found = _of_kind(tasks, Follow)
    return {i: task for i, task in found.items() if task.object == name}


def _of_kind(tasks: Sequence[Task], kind: type[Kind]) -> dict[int, Kind]:
    return {i: task for i, task in enumerate(tasks) if isinstance(task, kind)}


def in_one_go(tasks: Sequence[Task], held: str | None) -> list[tuple[Task, ...]]:
    """Tasks in runs whose order may be exchanged: boxes to pass belong to what comes after them.

    What is done with an object in hand stays together; one ``held`` at the start is the first run.
    """
    runs: list[list[Task]] = []
    holding = held is not None
    for task in tasks:
        if runs and (holding or not runs[-1][-1].rests):
            runs[-1].append(task)
        else:
            runs.append([task])
        holding = task.takes or (holding and not task.lets_go)
    return [tuple(run) for run in runs]


def orders(tasks: Sequence[Task], held: str | None) -> Iterator[tuple[Task, ...]]:
    """Yield every order of tasks that may be exchanged, as given first; one thing's keep theirs."""
    runs = in_one_go(tasks, held)
    fixed = runs[:1] if held is not None else []
    things = [{task.about for task in run} - {None} for run in runs]
    for order in itertools.permutations(range(len(fixed), len(runs))):
        pairs = itertools.combinations(order, 2)
        if not any(j < i and things[i] & things[j] for i, j in pairs):
            yield tuple(itertools.chain(*fixed, *(runs[i] for i in order)))


def task_problems(
    tasks: Sequence[Task],
    objects: Sequence[Object],
    obstacles: Sequence[Obstacle],
    segments: int,
    held: str | None,
) -> Iterator[InputError]:
    """Yield what is wrong with tasks in this order, each by its place; ``held`` at the start."""
    things = [item.name for item in objects]
    touchable = [*things, *(item.name for item in obstacles if item.name)]
    if held is not None and held not in things:
        allowed = f"one of {', '.join(things)}" if things else "an object; there are none"
        yield InputError("start.holding", held, allowed)
        return
    for i, task in enumerate(tasks):
        names, named = touchable if task.lies_along else things, task.about
        if named is not None and named not in names:
            allowed = f"one of {', '.join(names)}" if names else "an object; there are none"
            yield InputError(f"tasks.{i}.object", named, allowed)
            return
        if (
            isinstance(task, Conform)
            and not set(range(1, segments + 1)) >= set(task.segments) > set()
        ):
            yield InputError(f"tasks.{i}.segments", task.segments, f"some of 1 to {segments}")
        if task.needs_held is False and held is not None:
            yield InputError(f"tasks.{i}.do", task.do, f"what empty hands do: release {held} first")
            return
        if (task.needs_held or isinstance(task, Follow)) and named not in (held, None):
            allowed = f"{held}, which is held" if held else "what is held: grasp it first"
            yield InputError(f"tasks.{i}.object", named, allowed)
            return
        if isinstance(task, Grasp) and task.hold == "pushed":
            number = things.index(task.object)
            if objects[number].friction is None:
                where = f"objects.{number}.friction"
                yield InputError(where, None, "a number: pushing needs friction")
        held = named if task.takes else None if task.lets_go else held
