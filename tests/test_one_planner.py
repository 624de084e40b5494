"""One question, one answer: a goal, the same goal as a task, and as a task before the goal."""

from __future__ import annotations

import pytest
from once import solution
from problems import random_problem
from test_obstacles import random_problem as random_scene

from twosra_mpc import Problem, Result, load_problem, plan
from twosra_mpc.problem.goals import Anywhere
from twosra_mpc.problem.tasks import Reach

SCENARIOS = [
    *(
        "paper-1",
        "paper-4",
        "shape-change",
        "move-and-shape",
        "rigid-move",
        "three-segments",
        "scattered",
        "blocked",
    ),
    *("corridor", "doorway"),
]
DEARER = 1.3  # times the work of a goal, of the same goal said as a task


def as_task(problem: Problem) -> Problem:
    """The goal said as a task, after which nothing is asked."""
    tasks = (*problem.tasks, Reach(goal=problem.goal))
    return problem.with_values(tasks=tasks, goal=Anywhere())


def before_the_goal(problem: Problem) -> Problem:
    """The goal said as a task, and reached again: two stages, of which the last has no way."""
    return problem.with_values(tasks=(*problem.tasks, Reach(goal=problem.goal)))


def check_alike(one: Result, other: Result) -> None:
    """The same status, cost and bound, for not much more work."""
    assert other.stats.work <= DEARER * one.stats.work
    assert other.status is one.status, other.message
    assert other.found == one.found
    if one.plan is None or other.plan is None:
        return
    assert one.lower_bound is not None
    assert other.lower_bound is not None
    assert other.plan.cost.total == pytest.approx(one.plan.cost.total, rel=1e-6)
    assert other.lower_bound == pytest.approx(one.lower_bound, rel=1e-6)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_goal_is_planned_alike_however_it_is_said(name: str) -> None:
    problem = load_problem(name)
    check_alike(solution(problem), plan(as_task(problem)))
    check_alike(solution(problem), plan(before_the_goal(problem)))


@pytest.mark.parametrize("number", range(2, 7))
def test_random_problems_are_planned_alike_as_goals_and_as_tasks(number: int) -> None:
    """The first of them among obstacles, within a workspace."""
    problem = random_scene(number) if number < 3 else random_problem(200 + number)
    check_alike(solution(problem), plan(as_task(problem)))
    if number >= 3:
        check_alike(solution(problem), plan(before_the_goal(problem)))
