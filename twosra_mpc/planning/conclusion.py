"""Conclusion of a search: a gentler plan where that costs no more, and a result."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.effort import Ending, OutOfEffortError, limit_reached
from twosra_mpc.errors import ContradictionError
from twosra_mpc.planning.search.branch_and_bound import SearchResult
from twosra_mpc.planning.search.infeasibility import disproof, impossibility, too_few_phases
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.solver.gentle import gentle
from twosra_mpc.planning.solver.sequence_solver import Solved
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tasks import MOST_PHASES
from twosra_mpc.problem.tolerances import QUADRATURE_TOLERANCE, ROUNDING
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import mode_name


@public
class Progress(NamedTuple):
    """State of a running search.

    Attributes:
        cost: Of the incumbent [s]; infinite before there is one.
        lower_bound: Proved lower bound on the cost of any plan [s].
    """

    cost: float
    lower_bound: float


STOPPED = {
    Ending.LIMIT: "a limit was reached",
    Ending.INTERRUPTED: "interrupted",
    Ending.CLOSED: "none is better than one that is known",
}


def advice(ending: Ending) -> str:
    """Advice after a search that was stopped."""
    stopped_by = limit_reached()
    if ending is Ending.INTERRUPTED or stopped_by is None:
        return "run again to continue the search"
    return f"raise {stopped_by}"


def as_asked(search: SearchResult[Solved]) -> SearchResult[Solved]:
    """The outcome with a gentler plan if that costs no more than asked, unless stopped."""
    if (found := search.solution) is None or not found.problem.drives_gently:
        return search
    try:
        return replace(search, solution=_gentler(found, search.lower_bound))
    except KeyboardInterrupt:
        return replace(search, ending=Ending.INTERRUPTED)
    except OutOfEffortError:
        early = search.ending is Ending.INTERRUPTED
        return search if early else replace(search, ending=Ending.LIMIT)


def _gentler(found: Solved, lower_bound: float) -> Solved:
    """Plan that was found, or a gentler one of its sequence that costs no more than asked."""
    problem = found.problem
    within = (1 - 2 * ROUNDING) * lower_bound / (1 - problem.gap)
    most = limit = max(found.cost, within)
    for _ in range(2):  # what the energy costs is exactly known only of a plan that is made
        candidate = gentle(problem, found.candidate, found.network, most)
        if candidate is None:
            break
        slower = replace(found, candidate=candidate, fastest_cost=found.cost, plan=None).with_plan()
        assert slower.plan is not None, "it was made just now"
        cost = slower.plan.cost.total
        if cost <= (1 + ROUNDING) * limit and slower.verifies:
            return slower
        most -= 2 * abs(cost - limit)
    return found


def quality(made: Plan, ending: Ending) -> str:
    """Message about a plan that was found; empty where it says itself that it is optimal."""
    if made.status is Status.OPTIMAL:
        return ""
    if ending is Ending.EXHAUSTED:
        alone = len(made.problem.stages) == 1
        phases = (
            f"max_phases = {made.problem.max_phases}" if alone else f"{MOST_PHASES} phases a task"
        )
        tried = f"no mode sequence of up to {phases} is left to try"
        elsewhere = ", in other places and shapes" if made.problem.obstacles else ""
        return f"{made}; {tried}: the gap is slack of the bounds{elsewhere}, or in longer sequences"
    or_gap = " or gap" if ending is Ending.LIMIT else ""
    return f"{made}; {STOPPED[ending]}: {advice(ending)}{or_gap}"


def _at_most_cost(lower: float, made: Plan) -> float:
    """A lower bound of a search, which knows its plan's energy and effort by their quadrature.

    Raises:
        ContradictionError: If it is above the plan's cost by more than that.
    """
    cost, weights = made.cost, made.problem.cost_weights
    inexact = weights.energy_s_per_J * cost.energy_J + weights.effort * (cost.effort_s or 0.0)
    if lower > cost.total * (1 + ROUNDING) + QUADRATURE_TOLERANCE * inexact:
        raise ContradictionError(cost.total, lower)
    return min(lower, cost.total)


def conclude(
    problem: Problem, search: SearchResult[Solved], tree: Tree[Solved], stats: Stats
) -> Result:
    """Turn the outcome of the search into a result with a true status and a useful message."""
    lower = search.lower_bound if math.isfinite(search.lower_bound) else None
    ending, made = search.ending, None
    if search.solution is not None and search.solution.plan is not None:
        made = search.solution.plan
        lower = None if lower is None else _at_most_cost(lower, made)
        made = replace(made, lower_bound=lower)
        problem, status, message = made.problem, made.status, quality(made, ending)
    elif (proof := _proof(problem, search, tree)) is not None:
        status, message = Status.INFEASIBLE, f"proved infeasible: {proof}"
        lower, ending = None, Ending.EXHAUSTED  # whatever ended the search, nothing is left of it
    else:
        status, message = Status.FAILED, _failure(problem, search, tree)
    return Result(problem, "optimal", status, message, lower, ending, stats, made)


def _proof(problem: Problem, search: SearchResult[Solved], tree: Tree[Solved]) -> str | None:
    """Proof that there is no plan at all, in words; None where that is not proved."""
    blocks = tree.in_the_way[0][0].blocks if tree.only else lambda _: None
    proof = blocks(None) or impossibility(tree)
    if proof is None and search.ending is Ending.EXHAUSTED and search.lower_bound == math.inf:
        proof = blocks((problem.robot.rigid,)) or disproof(tree)
    return proof


def _failure(problem: Problem, search: SearchResult[Solved], tree: Tree[Solved]) -> str:
    """Reason why no plan was found although one may exist, and what to change."""
    none = nothing_found(problem)
    if (ending := search.ending) is not Ending.EXHAUSTED:
        limit = limit_reached() or "work_limit"
        effort = f"{search.solved} mode sequences tried, {limit} is {getattr(problem, limit):zg}"
        return f"{none} ({STOPPED[ending]}): {advice(ending)} ({effort})"
    tried = f"{none} ({search.solved} mode sequences tried)"
    if tree.only is None:
        return f"{tried}: allow more modes, widen tolerances or workspace, or lower clearance_m"
    if search.solved == 0:
        return f"{tried}: {too_few_phases(tree)}"
    rigid = problem.robot.rigid
    if rigid not in problem.modes and not np.isnan(problem.goal.configuration[:POSE]).all():
        only = f"without mode {mode_name(rigid)} the pose changes only by bending"
        return f"{tried}: {only}: add {mode_name(rigid)} to modes"
    inside = problem.workspace is not None or problem.obstacles
    wider = "the workspace" if inside else "the goal's tolerance"
    return f"{tried}: raise max_phases, allow more modes, or widen {wider}"


def nothing_found(problem: Problem) -> str:
    """Message that there is no plan."""
    if len(problem.stages) > 1:
        return "no plan of these tasks found"
    within = "" if problem.workspace is None else " within the workspace"
    return f"no plan found{' among the obstacles' if problem.obstacles else within}"
