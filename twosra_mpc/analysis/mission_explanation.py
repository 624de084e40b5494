"""``explain_mission(problem)``: what tasks share, what each costs, and what other ways would cost.

Everything said of another way comes from planning it: goal by goal, each from the end of the one
before, and the tasks in other orders. All are compared at full speed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twosra_mpc.analysis.critical_path import Activity, critical_path, in_words
from twosra_mpc.analysis.explanation import (
    Alternative,
    at_full_speed,
    price_words,
    with_better,
)
from twosra_mpc.errors import InputError
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.plans.carried import object_poses
from twosra_mpc.plans.ending import Ending
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.result import Result
from twosra_mpc.plans.stages import stretches
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.goals import Anywhere
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Task, orders
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import named
from twosra_mpc.timing import transition_model

MOST_ORDERS = 5
_CLEARLY_K = 0.5  # a segment that is solid is so much colder than where it melts, at least
_SAME_S = 1e-5


@dataclass(frozen=True)
class TaskCost:
    """What a task of a plan costs.

    Attributes:
        words: What is done, e.g. "grasp cup".
        from_s: When the task before was done [s].
        done_s: When this one is [s].
        melted: Segments (from 1) whose melts end in that time.
        bends: Whether the robot bends in that time.
        energy_J: Heat of all heaters in that time.
        shape_of: The task whose shape serves this one too, or "the start"; None where the robot
            bends, and where a task asks for no shape (to pass, and to carry).
    """

    words: str
    from_s: float
    done_s: float
    melted: tuple[int, ...]
    bends: bool
    energy_J: float
    shape_of: str | None

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
        return self.done_s - self.from_s

    @property
    def shares(self) -> str:
        """What it melts, or why it need not, in words."""
        if self.melted:
            return f"melts {named('segment', self.melted, len(self.melted) + 1)}"
        if self.bends:
            return "bends what is soft already: no melt of its own"
        if self.shape_of is not None:
            return f"in the shape of {self.shape_of}: no melt of its own"
        return "no melt"


@dataclass(frozen=True, eq=False)
class GoalByGoal:
    """A mission planned one goal after the other.

    Attributes:
        temperatures: What a plan begins with: those the one before ends with, or ``"cold"``, those
            of the air. How long metal takes to become as cold is not counted.
        tasks: What each plan is for, in words.
        results: Of planning; the last one may have no plan, then nothing was planned after it.
        trouble: Why there is no plan of a goal; empty where there are all.
    """

    temperatures: str
    tasks: tuple[str, ...]
    results: tuple[Result, ...]
    trouble: str = ""

    @property
    def cost(self) -> float | None:
        """What all plans cost together [s]; None where one is missing."""
        return None if self.trouble else sum(each.require().cost.total for each in self.results)

    @property
    def melts(self) -> int:
        """How many segments are melted in all plans."""
        made = [item for each in self.results if each.plan for item in each.plan.transitions]
        return sum(item.to == "soft" for item in made)

    def __str__(self) -> str:
        return f"goal by goal, {_TEMPERATURES[self.temperatures]}"


@dataclass(frozen=True, eq=False)
class MissionExplanation:
    """Why the plan of a mission is what it is.

    Attributes:
        result: What is explained: the plan, or that there is none.
        quick: The plan at full speed, which others are compared to; None without one.
        tasks: What each task costs.
        critical_path: Activities that add up to the duration.
        goal_by_goal: From cold, and with temperatures carried on; none of a single goal.
        orders: Other orders of tasks that may be exchanged, as far as they were planned.
        orders_left: How many more there are.
        complete: Whether everything was planned; False after Ctrl-C.
    """

    result: Result
    quick: Plan | None
    tasks: tuple[TaskCost, ...]
    critical_path: tuple[Activity, ...]
    goal_by_goal: tuple[GoalByGoal, ...]
    orders: tuple[Alternative, ...]
    orders_left: int
    complete: bool

    @property
    def shared(self) -> tuple[TaskCost, ...]:
        """Tasks that need no melt because an earlier one left what they need."""
        return tuple(
            each
            for each in self.tasks
            if not each.melted and (each.bends or each.shape_of not in (None, "the start"))
        )

    def price(self, other: GoalByGoal) -> str:
        """What planning goal by goal costs more, in words; empty where it is not known."""
        if self.quick is None or other.cost is None:
            return ""
        return price_words(other.cost - self.quick.cost.total, self.quick.cost.total)

    def outcome(self, other: GoalByGoal) -> str:
        """What came of planning goal by goal, in words."""
        if other.trouble:
            return other.trouble
        each = " + ".join(f"{one.require().cost.total:z.1f}" for one in other.results)
        count = sum(item.to == "soft" for item in self.quick.transitions) if self.quick else 0
        return f"{each} = {other.cost:z.1f} s; melts: {other.melts}, in one plan {count}"

    def __str__(self) -> str:
        lines = [self.result.message]
        for each in self.tasks:
            cost = f"{each.duration_s:z8.2f} s {each.energy_J:z6.0f} J"
            lines.append(f"  {cost} {each.words}: {each.shares}")
        if self.critical_path:
            lines.append(f"The {self.critical_path[-1].end_s:z.1f} s are")
            lines += [f"  {lasts:z8.2f} s {words}" for lasts, words in in_words(self.critical_path)]
        if self.quick is not None:
            lines.append(f"Instead, at full speed ({self.quick.cost.total:z.2f} s for this plan)")
        for way in self.goal_by_goal:
            told = (str(way), self.price(way), self.outcome(way))
            lines.append("  " + ": ".join(filter(None, told)))
        lines += [f"  {other}" for other in self.orders]
        if self.orders_left:
            lines.append(f"  other orders that were not planned: {self.orders_left}")
        if not self.complete:
            lines.append("Interrupted: not everything was planned.")
        return "\n".join(lines)


_TEMPERATURES = {"cold": "each from cold", "carried on": "with temperatures carried on"}


def explain_mission(
    subject: Result | Problem,
    *,
    on_progress: Callable[[str], None] | None = None,
    most_orders: int = MOST_ORDERS,
) -> MissionExplanation:
    """Explain a plan of a mission by planning its goals alone, and its tasks in other orders.

    Every plan may take the problem's ``work_limit``. Ctrl-C ends the planning, and what is known
    so far is returned.

    Args:
        subject: A result of planning, or a problem that is planned first.
        on_progress: Told what is planned next.
        most_orders: How many other orders are planned, at most.

    Raises:
        InputError: If the problem is no mission, or the start is not possible.
    """
    problem = subject.problem if isinstance(subject, Result) else subject
    if not problem.is_mission:
        raise InputError("tasks", problem.tasks, "a mission; `explain` is for a single goal")
    tell = on_progress or (lambda _: None)
    tell("the plan itself")
    result = subject if isinstance(subject, Result) else plan_until_interrupted(subject)
    made, quick = result.plan, None
    ways, orders = list[GoalByGoal](), list[Alternative]()
    complete = isinstance(subject, Result) or result.ending is not Ending.INTERRUPTED
    others = [] if made is None else _other_orders(problem, made.problem.tasks)
    if made is not None and complete:
        try:
            as_ordered = made.problem.with_values(motion="fastest", order="given")
            quick = at_full_speed(made, as_ordered, tell)
            for temperatures in _TEMPERATURES if len(list(_goals(problem))) > 1 else ():
                ways.append(goal_by_goal(quick.problem, temperatures, on_progress=tell))
            for tasks in others[:most_orders]:
                orders.append(_in_order(quick, tasks, tell))
        except KeyboardInterrupt:
            complete = False
        else:
            better = with_better(result, orders) if problem.order == "free" else None
            if better is not None:
                return explain_mission(better, on_progress=on_progress, most_orders=most_orders)
    return MissionExplanation(
        result=result,
        quick=quick,
        tasks=() if made is None else task_costs(made),
        critical_path=() if made is None else critical_path(made),
        goal_by_goal=tuple(ways),
        orders=tuple(orders),
        orders_left=len(others) - len(orders),
        complete=complete,
    )


def task_costs(made: Plan) -> tuple[TaskCost, ...]:
    """What each stage of a mission's plan costs: its times and energies add up to the plan's."""
    heating = transition_model(made.problem).heating(made.transitions)
    found, shape_of = list[TaskCost](), "the start"
    parts = stretches(made.trajectory)
    for i, stage in enumerate(parts):
        ends_s = stage.to_s if i + 1 < len(parts) else made.duration_s
        melts = [item for item in made.transitions if item.to == "soft"]
        melted = {item.segment for item in melts if _within(item.done_s, stage.from_s, ends_s)}
        soft = [each for each in made.phases if any(each.mode)]
        bends = any(_within(each.end_s, stage.from_s, ends_s) for each in soft)
        used = [item.energy_J(ends_s) - item.energy_J(stage.from_s) for item in heating]
        shaped = not bends and (stage.task is None or stage.task.asks_shape)
        found.append(
            TaskCost(
                words=stage.words,
                from_s=stage.from_s,
                done_s=ends_s,
                melted=tuple(sorted(melted)),
                bends=bends,
                energy_J=float(sum(used)),
                shape_of=shape_of if shaped else None,
            )
        )
        if bends:
            shape_of = stage.words
    return tuple(found)


def _within(time_s: float, from_s: float, to_s: float) -> bool:
    return from_s + _SAME_S < time_s <= to_s + _SAME_S


def goal_by_goal(
    problem: Problem,
    temperatures: str = "carried on",
    *,
    on_progress: Callable[[str], None] | None = None,
) -> GoalByGoal:
    """Plan the goals of a mission one after the other, in the order given.

    Each begins where the plan before ends, with the object that is held then. Boxes to pass belong
    to the goal after them.

    Args:
        problem: The mission.
        temperatures: "carried on", or "cold": every plan begins with cold, rigid segments.
        on_progress: Told what is planned next.

    Raises:
        KeyboardInterrupt: At Ctrl-C.
    """
    tell = on_progress or (lambda _: None)
    names, results, before = list[str](), list[Result](), None
    for words, tasks, goal_is_last in _goals(problem):
        tell(f"{words}, {_TEMPERATURES[temperatures]}")
        names.append(words)
        try:
            one = _alone(problem, tasks, goal_is_last)
            if before is not None:
                one = _from_the_end_of(before, one, cold=temperatures == "cold")
            result = plan_until_interrupted(one)
        except InputError as error:
            trouble = f"no plan to {words} from there: {error}"
            return GoalByGoal(temperatures, tuple(names), tuple(results), trouble)
        results.append(result)
        if result.ending is Ending.INTERRUPTED:
            raise KeyboardInterrupt
        if not result.found:
            trouble = f"no plan to {words} from there: {result.message}"
            return GoalByGoal(temperatures, tuple(names), tuple(results), trouble)
        before = result.require().trajectory
    return GoalByGoal(temperatures, tuple(names), tuple(results))


def _goals(problem: Problem) -> Iterator[tuple[str, tuple[Task, ...], bool]]:
    """Yield what each goal is in words, its tasks, and whether it is the problem's own goal."""
    before: tuple[Task, ...] = ()
    for number, task in enumerate(problem.tasks, start=1):
        before = (*before, task)
        if task.rests:
            yield task.said(number), before, False
            before = ()
    if before or not problem.ends_anywhere:
        yield "reach the goal", before, True


def _alone(problem: Problem, tasks: tuple[Task, ...], goal_is_last: bool) -> Problem:
    """The problem of one goal, as if nothing came after it."""
    given = {"order": "given", "start": problem.start.with_values(holding=None)}
    if goal_is_last:
        return problem.with_values(**given, tasks=tasks)
    *passed, last = tasks
    if last.as_goal is not None:
        return problem.with_values(**given, tasks=tuple(passed), goal=last.as_goal)
    if last.needs_held:
        given["start"] = problem.start.with_values(holding=last.about)
    return problem.with_values(**given, tasks=tasks, goal=Anywhere())


def _from_the_end_of(before: Trajectory, problem: Problem, *, cold: bool) -> Problem:
    """The problem from where a plan ends: objects are there, and perhaps it is still warm."""
    end = before.at([before.duration_s])
    x_m, y_m, phi_rad, *kappa_per_m = end.q[0].tolist()
    start = problem.start.with_values(
        x_m=x_m,
        y_m=y_m,
        phi_rad=phi_rad,
        kappa_per_m=tuple(kappa_per_m),
        temperature_C=None if cold else _temperatures(problem, end.temperature_C[0], end.mode[0]),
    )
    poses = object_poses(before, end.t_s)[0] if problem.objects else np.zeros((0, POSE))
    objects = [
        item.with_values(pose=dict(zip(("x_m", "y_m", "phi_rad"), pose, strict=True)))
        for item, pose in zip(problem.objects, poses.tolist(), strict=True)
    ]
    return problem.with_values(start=start, objects=tuple(objects))


def _temperatures(problem: Problem, measured_C: Array, mode: Array) -> tuple[float, ...]:
    """Temperatures that are clearly of the stiffness that segments have."""
    solid, liquid = np.array(problem.segment_thresholds_C).T
    soft = np.maximum(measured_C, liquid + _CLEARLY_K)
    rigid = np.minimum(measured_C, solid - _CLEARLY_K)
    return tuple(np.where(mode, soft, rigid).tolist())


def _other_orders(problem: Problem, planned: Sequence[Task]) -> list[tuple[Task, ...]]:
    """Orders of what may be exchanged, other than the one that was planned."""
    found = dict.fromkeys(orders(problem.tasks, problem.start.holding))
    return [order for order in found if order != tuple(planned)]


def _in_order(quick: Plan, tasks: tuple[Task, ...], tell: Callable[[str], None]) -> Alternative:
    begun = [task.said(number) for number, task in enumerate(tasks, start=1) if not task.needs_held]
    change = f"in the order {', '.join(begun)}"
    tell(change)
    found = plan_until_interrupted(quick.problem.with_values(tasks=tasks))
    if found.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return Alternative(change, "", quick, found)
