"""``plan_mission(problem)``: tasks as stages, their mode sequences by one branch and bound."""

from __future__ import annotations

import time
from collections.abc import Callable

from twosra_mpc.planning.missions.free_space import StageSolver
from twosra_mpc.planning.missions.placement import MissionPlacer
from twosra_mpc.planning.missions.relaxed import relaxation, stage_tasks
from twosra_mpc.planning.missions.variants import Ways
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound
from twosra_mpc.planning.search.mission_tree import MissionTree
from twosra_mpc.planning.sequence_solver import Solved
from twosra_mpc.problem.problem import Problem
from twosra_mpc.timing import transition_model


def search_mission(
    problem: Problem, deadline: float, on_progress: Callable[[float, float], None]
) -> tuple[SearchResult[Solved], MissionTree[Solved], MissionPlacer | StageSolver]:
    """Search."""
    variants = Ways(problem).variants()
    solver = (
        MissionPlacer(variants, deadline)
        if problem.world_at_start.obstacles or problem.passes
        else StageSolver(variants, deadline)
    )
    tree = MissionTree(
        variants=[stage_tasks(each.problem, each.members[0]) for each in variants],
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
