"""Tasks: what to do one after the other, before the goal or instead of one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator, model_validator

from twosra_mpc.errors import InputError
from twosra_mpc.problem.goals import Goal, GoalSet
from twosra_mpc.problem.objects import Object
from twosra_mpc.problem.world import Obstacle
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.validation import (
    Metres,
    MetresPair,
    NonNegative,
    Pair,
    Radians,
    Several,
    Tagged,
)

MOST_PHASES = 5  # of a task: sequences that are longer are bounded, not planned


class Task(Tagged):
    """Something to do; ``do`` says what."""

    tag_key: ClassVar[str] = "do"

    do: str
    name: str = ""

    def of_robot(self, robot: Robot) -> Task:
        """Return the task with what was left out filled in for a robot."""
        del robot
        return self


class Pass(Task):
    """Drive b0 through a box of poses on the way; what is left out is free."""

    do: Literal["pass"] = "pass"
    x_m: MetresPair | None = None
    y_m: MetresPair | None = None
    phi_rad: Pair | None = None

    @model_validator(mode="after")
    def _growing(self) -> Pass:
        given = {name: getattr(self, name) for name in ("x_m", "y_m", "phi_rad")}
        if not any(given.values()):
            raise InputError("", {}, "at least one of x_m, y_m, phi_rad")
        for name, pair in given.items():
            if pair is not None and not pair[0] < pair[1]:
                raise InputError(name, pair, "two numbers, the lower one first")
        return self

    @property
    def ends(self) -> Array:
        """Least and largest x, y, phi, (2, 3); infinite where free."""
        free = (-math.inf, math.inf)
        return np.array([self.x_m or free, self.y_m or free, self.phi_rad or free]).T

    def met(self, poses: Array) -> Array:
        """Whether each pose (..., 3) is in the box; headings count modulo full turns."""
        low, high = self.ends
        inside = ((poses[..., :2] >= low[:2]) & (poses[..., :2] <= high[:2])).all(axis=-1)
        if self.phi_rad is not None:
            inside &= np.mod(poses[..., 2] - low[2], math.tau) <= high[2] - low[2]
        found: Array = inside
        return found


class Reach(Task):
    """Come to rest in a goal; with the keys of ``[goal]``, or a `GoalSet` as ``goal``.

    With ``mode = "any"`` the segments may be soft or rigid there; left out, as the goal says.
    """

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


class Conform(Task):
    """Lay segments along an object or obstacle, to within ``gap_m``.

    ``segments`` counts from 1; ``directions_rad`` are the headings of b0 that may be used.
    """

    do: Literal["conform"] = "conform"
    object: str
    segments: Several[Annotated[int, Field(ge=1)]] = (1,)
    gap_m: Annotated[float, Field(gt=0.0)] = 0.001
    directions_rad: Pair = (-math.pi, math.pi)


class Grasp(Task):
    """Close around an object and become rigid.

    ``hold`` "caged": it is proved that the object cannot leave; "pushed": it may, and stays only
    while the robot moves such that contact is kept, which needs the object's ``friction``.
    ``directions_rad`` are the headings of b0 that may be used.
    """

    do: Literal["grasp"] = "grasp"
    object: str
    hold: Literal["caged", "pushed"] = "caged"
    directions_rad: Pair = (-math.pi, math.pi)


class Carry(Task):
    """Drive until the object that is held is at a pose; its heading is free where left out."""

    do: Literal["carry"] = "carry"
    object: str
    x_m: Metres
    y_m: Metres
    phi_rad: Radians | None = None
    position_tolerance_m: NonNegative = 0.0
    heading_tolerance_rad: NonNegative = 0.0


class Release(Task):
    """Open until the object is free, and drive away from it to ``clearance_m``."""

    do: Literal["release"] = "release"
    object: str


def in_one_go(tasks: Sequence[Task], held: str | None) -> list[tuple[Task, ...]]:
    """Tasks in runs whose order may be exchanged: boxes to pass belong to what comes after them.

    What is done with an object in hand stays together; one ``held`` at the start is the first run.
    """
    runs: list[list[Task]] = []
    holding = held is not None
    for task in tasks:
        if runs and (holding or isinstance(runs[-1][-1], Pass)):
            runs[-1].append(task)
        else:
            runs.append([task])
        holding = isinstance(task, Grasp) or (holding and not isinstance(task, Release))
    return [tuple(run) for run in runs]


def orders(tasks: Sequence[Task], held: str | None) -> Iterator[tuple[Task, ...]]:
    """Yield every order of tasks that may be exchanged, as given first; one thing's keep theirs."""
    runs = in_one_go(tasks, held)
    fixed = runs[:1] if held is not None else []
    things = [{getattr(task, "object", None) for task in run} - {None} for run in runs]
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
        names = touchable if isinstance(task, Conform) else things
        named = getattr(task, "object", None)
        if named is not None and named not in names:
            allowed = f"one of {', '.join(names)}" if names else "an object; there are none"
            yield InputError(f"tasks.{i}.object", named, allowed)
            return
        if isinstance(task, Conform):
            wrong = [j for j in task.segments if j > segments]
            if wrong or not task.segments:
                allowed = f"some of 1 to {segments}"
                yield InputError(f"tasks.{i}.segments", task.segments, allowed)
        if isinstance(task, Grasp | Conform) and held is not None:
            yield InputError(f"tasks.{i}.do", task.do, f"release {held} first: it is held")
            return
        if isinstance(task, Carry | Release) and named != held:
            allowed = f"{held}, which is held" if held else "grasp it first: nothing is held"
            yield InputError(f"tasks.{i}.object", named, allowed)
            return
        if isinstance(task, Grasp):
            thing = objects[things.index(task.object)]
            if task.hold == "pushed" and thing.friction is None:
                where = f"objects.{things.index(task.object)}.friction"
                yield InputError(where, None, "a number: pushing needs friction")
            held = task.object
        elif isinstance(task, Release):
            held = None
