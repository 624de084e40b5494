"""``plan_mission(problem)``: tasks as stages, their mode sequences by one branch and bound."""

from __future__ import annotations

import time
from collections.abc import Callable

from twosra_mpc.planning.missions.free_space import StageSolver
from twosra_mpc.planning.missions.relaxed import relaxation, stage_tasks
from twosra_mpc.planning.missions.stages import Stage
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound
from twosra_mpc.planning.search.mission_tree import MissionTree
from twosra_mpc.planning.sequence_solver import Solved
from twosra_mpc.problem.goals import Anywhere
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import Reach
from twosra_mpc.timing import transition_model


def reach_stages(problem: Problem) -> list[Stage]:
    found = []
    for task in problem.tasks:
        assert isinstance(task, Reach)
        last = None if task.mode == "any" else task.goal.mode
        found.append(Stage(task.goal, last, problem.modes, problem.world))
    if not isinstance(problem.goal, Anywhere):
        found.append(Stage(problem.goal, problem.goal.mode, problem.modes, problem.world))
    return found


def search_mission(
    problem: Problem, deadline: float, on_progress: Callable[[float, float], None]
) -> tuple[SearchResult[Solved], MissionTree[Solved], StageSolver]:
    stages = reach_stages(problem)
    solver = StageSolver(problem, stages, deadline)
    tree = MissionTree(
        variants=[stage_tasks(problem, stages)],
        first=problem.start_mode,
        timing=transition_model(problem),
        weights=problem.cost_weights,
        relaxation=relaxation(problem),
        solver=solver,
    )
    result = branch_and_bound(
        tree,
        gap=problem.gap,
        out_of_time=lambda: time.perf_counter() > deadline,
        on_progress=on_progress,
    )
    return result, tree, solver
