"""``plan(problem)``: join the search over mode sequences with the fixed-sequence solver."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from twosra_mpc.model.bending import bending, from_rest_to_rest
from twosra_mpc.model.flow import Motion, roll_out
from twosra_mpc.model.path_models import path_model
from twosra_mpc.planning.gentle import ROUNDING, gentle
from twosra_mpc.planning.greedy import plan_greedily
from twosra_mpc.planning.nlp.fixed_sequence import scheduled
from twosra_mpc.planning.nlp.guess import (
    bend_changes,
    guess_motion,
)
from twosra_mpc.planning.outcome import verified
from twosra_mpc.planning.search.bends import BendingTask, Conserved
from twosra_mpc.planning.search.bounds import SequenceBound
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound
from twosra_mpc.planning.search.infeasibility import disproof, impossibility, too_few_phases
from twosra_mpc.planning.search.mode_tree import InTheWay, ModeTree
from twosra_mpc.planning.search.pose_bound import PoseTask
from twosra_mpc.planning.search.rigid_motion import least_time
from twosra_mpc.planning.sequence_solver import SequenceSolver, Solved, checked
from twosra_mpc.plans.ending import Ending
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.limits import (
    CURVATURE,
    check_shapes,
    check_workspace,
    interval_durations,
    rigid_ramp_s,
    rigid_rows,
    rigid_rows_between,
    surely_broken,
)
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.modes import Mode, ModeSequence, mode_name
from twosra_mpc.timing import TemporalNetwork, transition_model

Solution = TypeVar("Solution")


class Progress(NamedTuple):
    """State of a running search: incumbent cost (inf: none yet) and lower bound, both in s."""

    cost: float
    lower_bound: float


def plan(problem: Problem, *, on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Plan: find a verified plan for ``problem`` and say how far from the best possible it is.

    Never raises for a problem that has no plan: ``Result.status`` and ``Result.message`` say so,
    and ``Result.require()`` turns that into an exception. Ctrl-C and ``time_limit_s`` return the
    best plan so far with its true gap.

    Args:
        problem: The validated problem; ``problem.planner`` chooses the planner.
        on_progress: Called as the search proceeds.

    Raises:
        InputError: If the locomotion units would overlap at the start or at the goal, or the robot
            would be outside of its workspace or overlap an obstacle there.
    """
    check_shapes(problem)
    check_workspace(problem)
    if problem.obstacles:
        from twosra_mpc.checking.clearance import check_obstacles  # only then anyone waits for it

        check_obstacles(problem)
    if problem.planner == "greedy":
        return plan_greedily(problem)
    return plan_without(problem, frozenset(), on_progress=on_progress)


def plan_without(
    problem: Problem,
    excluded: frozenset[ModeSequence],
    *,
    on_progress: Callable[[Progress], None] | None = None,
) -> Result:
    """Plan as ``plan`` does, but use none of the ``excluded`` mode sequences."""
    started = time.perf_counter()
    if (resting := _rest(problem)) is not None:
        return resting
    deadline = started + problem.time_limit_s
    if problem.obstacles or problem.tasks:
        from twosra_mpc.planning.obstacles.placement import Placer  # only then anyone waits for it

        placer = Placer(problem, checked, deadline)
        solver: SequenceSolver | Placer[Solved] = placer
        tree = mode_tree(problem, placer, excluded, placer.necessity)
    else:
        solver = SequenceSolver(problem, deadline)
        tree = mode_tree(problem, solver, excluded)
    result = branch_and_bound(
        tree,
        gap=problem.gap,
        out_of_time=lambda: time.perf_counter() - started > problem.time_limit_s,
        on_progress=lambda cost, low: on_progress(Progress(cost, low)) if on_progress else None,
    )
    result = _as_asked(problem, result)
    stats = Stats(
        wall_s=time.perf_counter() - started,
        sequences_bounded=result.bounded,
        sequences_solved=result.solved,
        nlp_iterations=solver.iterations,
    )
    return _conclude(problem, result, tree, stats)


def mode_tree(
    problem: Problem,
    solver: Callable[[TemporalNetwork, SequenceBound], Iterable[tuple[float, Solution] | None]],
    excluded: frozenset[ModeSequence] = frozenset(),
    in_the_way: InTheWay | None = None,
) -> ModeTree[Solution]:
    """Build the tree of mode sequences of ``problem``; ``solver`` makes plans of one of them."""
    return ModeTree(
        first=problem.start_mode,
        last=problem.goal.mode,
        modes=problem.modes,
        max_phases=problem.max_phases,
        timing=transition_model(problem),
        task=bending_task(problem),
        weights=problem.cost_weights,
        rigid_time=lambda: rigid_time(problem),
        solver=solver,
        excluded=excluded,
        in_the_way=in_the_way or InTheWay(),
    )


def _rest(problem: Problem) -> Result | None:
    """The empty plan, where the start is the goal already."""
    start = problem.start.configuration
    away = problem.goal.error(start.copy()).any() or problem.start_mode != problem.goal.mode
    if away or problem.tasks:
        return None
    sequence = (problem.start_mode,)
    network = transition_model(problem).network(sequence, problem.goal.mode, [0.0])
    motion = roll_out(problem.robot, start, sequence, np.zeros((1, 1, 5)))
    candidate = scheduled(motion, network, problem, iterations=0)
    assert candidate is not None, "a robot that rests is where it should be"
    made = replace(verified(problem, candidate, network), lower_bound=0.0)
    message, stats = "the start is the goal: nothing to do", Stats(0.0, 0, 0, 0)
    return Result(problem, "optimal", made.status, message, 0.0, Ending.CLOSED, stats, made)


def bending_task(problem: Problem) -> BendingTask:
    """What the plan must do to the bending coordinates, from start, goal and path model."""
    facts = bending(problem.robot)
    start = problem.start.configuration
    ends = zip(*(end[POSE:].tolist() for end in problem.goal.box(start)), strict=True)
    limit = problem.robot.limits.curvature_per_m
    origin = facts.coordinates(start[POSE:].tolist())
    room, exact, words = [], [], []
    for j, (here, (low, high)) in enumerate(zip(origin, ends, strict=True)):
        most = facts.coordinate(limit, j)
        room.append((-most - here, most - here))
        exact.append(low if low == high else None)
        words.append(_asked(f"kappa{j + 1}", float(start[POSE + j]), low, high))

    def forbidden(mode: Mode, before: tuple[tuple[float, float], ...], bend: float) -> str | None:
        limit = surely_broken(problem.robot, *facts.shapes_on_the_way(mode, before, bend))
        return None if limit is None else limit.words(problem.robot.limits)

    return BendingTask(
        change=tuple(map(tuple, bend_changes(problem, problem.goal).T.tolist())),
        room=tuple(room),
        start=tuple(start[POSE:].tolist()),
        goal=tuple(exact),
        rate=facts.fastest,
        origin=origin,
        least_time=facts.least_time,
        least_effort=facts.least_effort_s2,
        forbidden=forbidden,
        beyond=f"beyond {CURVATURE.name} = {limit:g} {CURVATURE.unit}",
        shape=", ".join(words),
        conserved=Conserved(*path_model(problem.robot).conserved),
        curvature=facts.curvatures,
        pose=pose_task(problem),
    )


def _asked(name: str, start: float, low: float, high: float) -> str:
    """What a goal asks of a curvature, in words."""
    if not math.isfinite(high - low):
        return f"{name} free"
    box = f" (+- {(high - low) / 2:g})" if high > low else ""
    return f"{name} from {start:g} to {(low + high) / 2:g}{box} 1/m"


def pose_task(problem: Problem) -> PoseTask | None:
    """What the plan must do to the pose; None where the goal leaves part of it free."""
    start = problem.start.configuration
    low, high = (end[:POSE] for end in problem.goal.box(start))
    if not np.isfinite(high - low).all():
        return None
    goal, (half_x, half_y, half_turn) = (low + high) / 2, (high - low) / 2
    guess = guess_motion(problem.robot, start, problem.goal, (problem.robot.rigid,), np.zeros(1), 1)
    c, s = math.cos(start[2]), math.sin(start[2])
    east, north = (goal[:2] - start[:2]).tolist()
    return PoseTask(
        shift=np.array([c * east + s * north, -s * east + c * north]),
        turn=float(goal[2] - start[2]),
        reach=np.array([[c * half_x, -s * half_x], [s * half_y, c * half_y]]),
        turn_reach=float(half_turn),
        known_s=_known_s(guess),
        speed_rows=partial(rigid_rows_between, problem.robot),
        soft_motions=bending(problem.robot).motions_between,
    )


def rigid_time(problem: Problem) -> float:
    """Proved lower bound on the duration of a plan that drives rigidly from start to goal [s]."""
    start = problem.start.configuration
    low, high = (end[:POSE] - start[:POSE] for end in problem.goal.box(start))
    guess = guess_motion(problem.robot, start, problem.goal, (problem.robot.rigid,), np.zeros(1), 1)
    rows = rigid_rows(problem.robot, start[POSE:])
    c, s = math.cos(start[2]), math.sin(start[2])
    given = np.isfinite(high - low)
    ends = np.where(given, [low, high], math.nan)
    shift, box = ends[:, :2].mean(axis=0), np.where(given, (ends[1] - ends[0]) / 2, 0.0)
    if given[:2].all() and not box[:2].any():
        shift = np.array([c * shift[0] + s * shift[1], -s * shift[0] + c * shift[1]])
    else:  # boxes and free coordinates are aligned with the world: turn the wheels instead
        rows = rows @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    at_speed = least_time(
        speed_rows=rows,
        shift=shift,
        shift_box=box[:2],
        turns=(float(low[2]), float(high[2])),
        modulo=problem.goal.phi_modulo,
        known_s=_known_s(guess),
    )
    return from_rest_to_rest(at_speed, rigid_ramp_s(problem.robot, start[POSE:]))


def _known_s(guess: Motion) -> float:
    """How long a rigid drive takes at full speed, as guessed: by a screw, or straight and a turn.

    The screw of nearly a full turn leads far away.
    """
    screw_s = float(interval_durations(guess).sum())
    first, last = guess.states[0, 0], guess.states[-1, -1]
    turn = float(last[2] - first[2])
    if abs(turn) <= math.pi:
        return screw_s
    rows, far = rigid_rows(guess.robot, first[POSE:]), float(np.hypot(*(last - first)[:2]))
    straight_s = far * float(np.linalg.norm(rows[:, :2], axis=1).max())
    return min(screw_s, straight_s + abs(turn) * float(np.abs(rows[:, 2]).max()))


def _conclude(
    problem: Problem, search: SearchResult[Solved], tree: ModeTree[Solved], stats: Stats
) -> Result:
    """Turn the outcome of the search into a result with a true status and a useful message."""
    lower = search.lower_bound if math.isfinite(search.lower_bound) else None
    ending, made = search.ending, None
    if search.solution is not None:
        made = replace(search.solution.plan, lower_bound=lower)
        status, message = made.status, _quality(made, ending)
    elif (proof := _proof(problem, search, tree)) is not None:
        status, message = Status.INFEASIBLE, f"proved infeasible: {proof}"
        lower, ending = None, Ending.EXHAUSTED  # whatever ended the search, nothing is left of it
    else:
        status, message = Status.FAILED, _failure(problem, search, tree)
    return Result(problem, "optimal", status, message, lower, ending, stats, made)


def _as_asked(problem: Problem, search: SearchResult[Solved]) -> SearchResult[Solved]:
    """The outcome with a gentler plan if that costs no more than asked; Ctrl-C leaves it as is."""
    if (found := search.solution) is None or not problem.drives_gently:
        return search
    try:
        return replace(search, solution=found._replace(plan=_gentler(problem, found, search)))
    except KeyboardInterrupt:
        return replace(search, ending=Ending.INTERRUPTED)


def _gentler(problem: Problem, found: Solved, search: SearchResult[Solved]) -> Plan:
    """The plan that was found, or a gentler one of its sequence that costs no more than asked."""
    within = (1 - 2 * ROUNDING) * search.lower_bound / (1 - problem.gap)
    most = limit = max(found.plan.cost.total, within)
    for _ in range(2):  # what the energy costs is exactly known only of a plan that is made
        candidate = gentle(problem, found.candidate, found.network, most)
        made = verified(problem, candidate, found.network) if candidate else found.plan
        if made.verification.ok and made.cost.total <= (1 + ROUNDING) * limit:
            return made
        most -= 2 * abs(made.cost.total - limit)
    return found.plan


def _quality(made: Plan, ending: Ending) -> str:
    """Message about a plan that was found."""
    if made.status is Status.OPTIMAL:
        return str(made)
    if ending is Ending.EXHAUSTED:
        tried = f"no mode sequence of up to max_phases = {made.problem.max_phases} is left to try"
        elsewhere = ", in other places and shapes" if made.problem.obstacles else ""
        return f"{made}; {tried}: the gap is slack of the bounds{elsewhere}, or in longer sequences"
    return f"{made}; {_STOPPED[ending]}: {_ADVICE[ending]}"


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
        return f"no plan found{within} ({_STOPPED[ending]}): {_ADVICE[ending]} ({effort})"
    tried = f"no plan found{within} ({search.solved} mode sequences tried)"
    if search.solved == 0:
        return f"{tried}: {too_few_phases(tree)}"
    rigid = problem.robot.rigid
    if rigid not in problem.modes and not np.isnan(problem.goal.configuration[:POSE]).all():
        only = f"without mode {mode_name(rigid)} the pose changes only by bending"
        return f"{tried}: {only}: add {mode_name(rigid)} to modes"
    wider = "the workspace" if within else "the goal's tolerance"
    return f"{tried}: raise max_phases, allow more modes, or widen {wider}"


_STOPPED = {Ending.LIMIT: "a limit was reached", Ending.INTERRUPTED: "interrupted"}
_ADVICE = {
    Ending.LIMIT: "raise time_limit_s or gap",
    Ending.INTERRUPTED: "run again to continue the search",
}
