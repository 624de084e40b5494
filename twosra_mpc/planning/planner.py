"""``plan(problem)``: join the search over mode sequences with the fixed-sequence solver."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from twosra_mpc.deadline import OutOfTimeError, finishing, out_of_time, time_limit
from twosra_mpc.model.flow import roll_out
from twosra_mpc.planning.greedy import plan_greedily
from twosra_mpc.planning.nlp.fixed_sequence import timed
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound
from twosra_mpc.planning.search.infeasibility import disproof, impossibility, too_few_phases
from twosra_mpc.planning.search.mode_tree import ModeTree
from twosra_mpc.planning.single_goal.conclusion import ADVICE, STOPPED, Progress, as_asked, quality
from twosra_mpc.planning.single_goal.outcome import verified
from twosra_mpc.planning.single_goal.relaxed import mode_tree
from twosra_mpc.planning.single_goal.sequence_solver import (
    Check,
    SequenceSolver,
    Solved,
    checked,
    trusted,
)
from twosra_mpc.plans.ending import Ending
from twosra_mpc.plans.plan import Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.ends import check_shapes, check_workspace
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import ModeSequence, mode_name
from twosra_mpc.timing import transition_model

Solution = TypeVar("Solution")


def plan(problem: Problem, *, on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Plan: find a verified plan for ``problem`` and say how far from the best possible it is.

    Never raises for a problem that has no plan: ``Result.status`` and ``Result.message`` say so,
    and ``Result.require()`` turns that into an exception. Ctrl-C and ``time_limit_s`` return the
    best plan so far with its true gap; what was begun within the limit may take half a second more.

    Args:
        problem: The validated problem; ``problem.planner`` chooses the planner.
        on_progress: Called as the search proceeds.

    Raises:
        InputError: If the locomotion units would overlap at the start or at the goal, or the robot
            would be outside of its workspace or overlap an obstacle there.
    """
    started = time.perf_counter()
    with time_limit(problem.time_limit_s):
        try:
            return _plan(problem, on_progress)
        except OutOfTimeError:
            return _too_late(problem, started)


def _plan(problem: Problem, on_progress: Callable[[Progress], None] | None) -> Result:
    check_shapes(problem)
    check_workspace(problem)
    if problem.obstacles:
        from twosra_mpc.checking.clearance import check_obstacles  # only then anyone waits for it

        check_obstacles(problem)
    if problem.is_mission:
        from twosra_mpc.planning.missions.checks import check_mission
        from twosra_mpc.planning.missions.mission import plan_mission

        check_mission(problem)
        return plan_mission(problem, on_progress)
    if problem.planner == "greedy":
        return plan_greedily(problem)
    return _search(problem, frozenset(), on_progress)


def plan_without(
    problem: Problem,
    excluded: frozenset[ModeSequence],
    *,
    on_progress: Callable[[Progress], None] | None = None,
) -> Result:
    """Plan as ``plan`` does, but use none of the ``excluded`` mode sequences."""
    started = time.perf_counter()
    with time_limit(problem.time_limit_s):
        try:
            return _search(problem, excluded, on_progress)
        except OutOfTimeError:
            return _too_late(problem, started)


def _too_late(problem: Problem, started: float) -> Result:
    """The result where time was up before, or after, the search."""
    message = f"no plan found ({STOPPED[Ending.LIMIT]}): {ADVICE[Ending.LIMIT]}"
    stats = Stats(time.perf_counter() - started, 0, 0, 0)
    how = problem.planner, Status.FAILED, message, None, Ending.LIMIT
    return Result(problem, *how, stats, None)


def _search(
    problem: Problem,
    excluded: frozenset[ModeSequence],
    on_progress: Callable[[Progress], None] | None,
) -> Result:
    started = time.perf_counter()
    if (resting := _rest(problem)) is not None:
        return resting
    inside = problem.workspace is not None  # which guesses may leave between nodes
    for guessed in [checked] if inside else [trusted, checked]:
        result, tree, iterations = _searched(problem, excluded, guessed, on_progress)
        with finishing():
            if result.solution is None or result.solution.plan.verification.ok:
                break
        result = replace(result, solution=None)  # a guess that is no plan
        if result.ending is Ending.INTERRUPTED:  # nobody waits for another search
            break
    stats = Stats(
        wall_s=time.perf_counter() - started,
        sequences_bounded=result.bounded,
        sequences_solved=result.solved,
        nlp_iterations=iterations,
    )
    return _conclude(problem, result, tree, stats)


def _searched(
    problem: Problem,
    excluded: frozenset[ModeSequence],
    guessed: Check,
    on_progress: Callable[[Progress], None] | None,
) -> tuple[SearchResult[Solved], ModeTree[Solved], int]:
    """What a search with guesses that are checked or trusted finds, its tree, NLP iterations."""
    if problem.obstacles or problem.tasks:
        from twosra_mpc.planning.obstacles.placement import Placer  # only then anyone waits for it

        placer = Placer(problem, checked)
        solver: SequenceSolver | Placer[Solved] = placer
        tree = mode_tree(problem, placer, excluded, placer.necessity)
    else:
        solver = SequenceSolver(problem, guessed)
        tree = mode_tree(problem, solver, excluded)
    result = branch_and_bound(
        tree,
        gap=problem.gap,
        out_of_time=out_of_time,
        on_progress=lambda cost, low: on_progress(Progress(cost, low)) if on_progress else None,
        first_look=lambda: _drive(tree) if isinstance(solver, SequenceSolver) else None,
        proved=lambda bound: forgiven(bound, problem.replay_tolerance),
    )
    return as_asked(result), tree, solver.iterations


def _drive(tree: ModeTree[Solved]) -> tuple[float, Solved] | None:
    """Only to drive, if that leads to the goal; many sequences may be bounded below it."""
    node = tree.root()
    if not node or tree.leaf_bound(node) == math.inf:
        return None
    guesses = itertools.islice(tree.solve(node), 2)
    return min(filter(None, guesses), key=lambda found: found[0], default=None)


def _rest(problem: Problem) -> Result | None:
    """The empty plan, where the start is the goal already."""
    start = problem.start.configuration
    there = problem.goal.met_at(start) and problem.start_mode == problem.goal.mode
    if not there or problem.tasks:
        return None
    sequence = (problem.start_mode,)
    network = transition_model(problem).network(sequence, problem.goal.mode, [0.0])
    motion = roll_out(problem.robot, start, sequence, np.zeros((1, 1, 5)))
    candidate = timed(motion, network, problem, iterations=0)
    assert candidate is not None, "a robot that rests is where it should be"
    made = replace(verified(problem, candidate, network), lower_bound=0.0)
    message, stats = "the start is the goal: nothing to do", Stats(0.0, 0, 0, 0)
    return Result(problem, "optimal", made.status, message, 0.0, Ending.CLOSED, stats, made)


def _conclude(
    problem: Problem, search: SearchResult[Solved], tree: ModeTree[Solved], stats: Stats
) -> Result:
    """Turn the outcome of the search into a result with a true status and a useful message."""
    lower = search.lower_bound if math.isfinite(search.lower_bound) else None
    ending, made = search.ending, None
    if search.solution is not None:
        made = replace(search.solution.plan, lower_bound=lower)
        status, message = made.status, quality(made, ending)
    elif (proof := _proof(problem, search, tree)) is not None:
        status, message = Status.INFEASIBLE, f"proved infeasible: {proof}"
        lower, ending = None, Ending.EXHAUSTED  # whatever ended the search, nothing is left of it
    else:
        status, message = Status.FAILED, _failure(problem, search, tree)
    return Result(problem, "optimal", status, message, lower, ending, stats, made)


def _proof(problem: Problem, search: SearchResult[Solved], tree: ModeTree[Solved]) -> str | None:
    """Why there is no plan at all; None where that is not proved."""
    proof = tree.in_the_way.blocks(None) or impossibility(tree)
    if proof is None and search.ending is Ending.EXHAUSTED and search.lower_bound == math.inf:
        proof = tree.in_the_way.blocks((problem.robot.rigid,)) or disproof(tree)
    return proof


def _failure(problem: Problem, search: SearchResult[Solved], tree: ModeTree[Solved]) -> str:
    """Why no plan was found although one may exist, and what to change."""
    within = "" if problem.workspace is None else " within the workspace"
    within = " among the obstacles" if problem.obstacles else within
    if (ending := search.ending) is not Ending.EXHAUSTED:
        effort = f"{search.solved} mode sequences tried, time_limit_s is {problem.time_limit_s:g}"
        return f"no plan found{within} ({STOPPED[ending]}): {ADVICE[ending]} ({effort})"
    tried = f"no plan found{within} ({search.solved} mode sequences tried)"
    if search.solved == 0:
        return f"{tried}: {too_few_phases(tree)}"
    rigid = problem.robot.rigid
    if rigid not in problem.modes and not np.isnan(problem.goal.configuration[:POSE]).all():
        only = f"without mode {mode_name(rigid)} the pose changes only by bending"
        return f"{tried}: {only}: add {mode_name(rigid)} to modes"
    wider = "the workspace" if within else "the goal's tolerance"
    return f"{tried}: raise max_phases, allow more modes, or widen {wider}"
