"""``plan_mission(problem)``: tasks as stages, their mode sequences by one branch and bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from twosra_mpc.deadline import OutOfTimeError, out_of_time
from twosra_mpc.planning.missions.free_space import StageSolver
from twosra_mpc.planning.missions.placement import MissionPlacer
from twosra_mpc.planning.missions.relaxed import relaxation, stage_tasks
from twosra_mpc.planning.missions.variants import Variant, Ways
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound, dive
from twosra_mpc.planning.search.mission_tree import MissionTree
from twosra_mpc.planning.single_goal.conclusion import ADVICE, STOPPED, Progress, as_asked, quality
from twosra_mpc.planning.single_goal.sequence_solver import Solved
from twosra_mpc.plans.ending import Ending
from twosra_mpc.plans.plan import Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.timing import transition_model

_WIDTH, _ATTEMPTS = 4, 30  # of the first look for a plan


def plan_mission(problem: Problem, on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Plan the tasks of a problem one after the other, as one plan.

    Its lower bound is one on every plan of these tasks with the touches that were considered
    (``contact.touch``) and, with ``order = "free"``, in every order.
    """
    started = time.perf_counter()
    ways, ending = Ways(problem), Ending.LIMIT
    try:
        variants = ways.variants()
    except OutOfTimeError:
        variants = None
    except KeyboardInterrupt:
        variants, ending = None, Ending.INTERRUPTED
    stats = Stats(time.perf_counter() - started, 0, 0, 0)
    if variants is None:
        why = _nothing(f"{STOPPED[ending]} before all ways were known", ADVICE[ending])
        return Result(problem, "optimal", Status.FAILED, why, None, ending, stats, None)
    if not variants:
        why = "; ".join(dict.fromkeys(ways.refused)) or "no direction that may be used is left"
        status, ending = Status.INFEASIBLE, Ending.EXHAUSTED
        return Result(problem, "optimal", status, why, None, ending, stats, None)
    free = not problem.world_at_start.obstacles and not problem.passes
    solver = StageSolver(variants) if free else MissionPlacer(variants)
    tree = mission_tree(problem, variants, solver)
    result = branch_and_bound(
        tree,
        gap=problem.gap,
        out_of_time=out_of_time,
        on_progress=lambda cost, low: on_progress(Progress(cost, low)) if on_progress else None,
        first_look=lambda: dive(tree, width=_WIDTH, attempts=_ATTEMPTS, out_of_time=out_of_time),
        proved=lambda bound: forgiven(bound, problem.replay_tolerance),
    )
    result = as_asked(result)
    stats = Stats(time.perf_counter() - started, result.bounded, result.solved, 0)
    return _conclude(problem, result, tree, stats)


def mission_tree(
    problem: Problem, variants: Sequence[Variant], solver: StageSolver | MissionPlacer
) -> MissionTree[Solved]:
    """Build the tree of a mission's variants and of the mode sequences of their stages."""
    return MissionTree(
        variants=[stage_tasks(each.problem, each.members) for each in variants],
        first=problem.start_mode,
        timing=transition_model(problem),
        weights=problem.cost_weights,
        relaxation=relaxation(problem),
        solver=solver,
    )


def _conclude(
    problem: Problem, search: SearchResult[Solved], tree: MissionTree[Solved], stats: Stats
) -> Result:
    """A result with a true status and a message."""
    lower = search.lower_bound if math.isfinite(search.lower_bound) else None
    if search.solution is not None:
        made = replace(search.solution.plan, lower_bound=lower)
        message = quality(made, search.ending)
        found = made.problem, "optimal", made.status, message, lower, search.ending, stats, made
        return Result(*found)
    if search.ending is Ending.EXHAUSTED and search.lower_bound == math.inf:
        why = next(iter(tree.unreachable.values()), "no stage sequence is left")
        status, message, lower = Status.INFEASIBLE, f"proved infeasible: {why}", None
    elif search.ending is Ending.EXHAUSTED:
        status = Status.FAILED
        tried = f"no plan of these tasks found ({search.solved} mode sequences tried)"
        message = f"{tried}: allow more modes, widen tolerances or workspace, or lower clearance_m"
    else:
        status = Status.FAILED
        message = _nothing(STOPPED[search.ending], ADVICE[search.ending])
    return Result(problem, "optimal", status, message, lower, search.ending, stats, None)


def _nothing(stopped: str, advice: str) -> str:
    return f"no plan of these tasks found ({stopped}): {advice}"
