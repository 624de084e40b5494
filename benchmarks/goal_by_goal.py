"""A mission planned one goal after the other, as if nothing came after: what one plan saves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from twosra_mpc.effort import Ending
from twosra_mpc.errors import InputError
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.plans.plan import objects_at, start_at
from twosra_mpc.plans.result import Result
from twosra_mpc.plans.trajectory import Trajectory
from twosra_mpc.problem.goals import Anywhere
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Task

TEMPERATURES = {"cold": "each from cold", "carried on": "with temperatures carried on"}


@dataclass(frozen=True, eq=False)
class GoalByGoal:
    """A mission planned one goal after the other.

    Attributes:
        results: Of planning; the last one may have no plan, then nothing was planned after it.
        trouble: Why there is no plan of a goal; empty where there are all.
    """

    results: tuple[Result, ...]
    trouble: str = ""

    @property
    def cost(self) -> float | None:
        """Cost of all plans together [s]; None where one is missing."""
        return None if self.trouble else sum(each.require().cost.total for each in self.results)

    @property
    def melts(self) -> int:
        """Number of melts in all plans."""
        made = [item for each in self.results if each.plan for item in each.plan.transitions]
        return sum(item.to == "soft" for item in made)

    def __str__(self) -> str:
        if self.cost is None:
            return self.trouble
        each = " + ".join(f"{one.require().cost.total:z.1f}" for one in self.results)
        return f"{each} = {self.cost:z.1f} s; melts: {self.melts}"


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
        temperatures: "carried on", or "cold": every plan begins with cold, rigid segments. How long
            metal takes to become as cold is not counted.
        on_progress: Told what is planned next.

    Raises:
        KeyboardInterrupt: At Ctrl-C.
    """
    tell = on_progress or (lambda _: None)
    results, before = list[Result](), None
    for words, tasks, goal_is_last in goals(problem):
        tell(f"{words}, {TEMPERATURES[temperatures]}")
        try:
            one = _alone(problem, tasks, goal_is_last)
            if before is not None:
                one = _from_the_end_of(before, one, cold=temperatures == "cold")
            result = plan_until_interrupted(one)
        except InputError as error:
            return GoalByGoal(tuple(results), f"no plan to {words} from there: {error}")
        results.append(result)
        if result.ending is Ending.INTERRUPTED:
            raise KeyboardInterrupt
        if not result.found:
            return GoalByGoal(tuple(results), f"no plan to {words} from there: {result.message}")
        before = result.require().trajectory
    return GoalByGoal(tuple(results))


def goals(problem: Problem) -> Iterator[tuple[str, tuple[Task, ...], bool]]:
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
    end_s, holding = before.duration_s, problem.start.holding
    start = start_at(before, end_s).with_values(holding=holding)
    if cold:
        metal = ("temperature_C", "melt_fraction", "body_temperature_C")
        start = start.with_values(**dict.fromkeys(metal))
    return problem.with_values(start=start, objects=objects_at(before, end_s))
