"""``plan(problem)``: the search over mode sequences, the solver of one, and what they conclude.

A plan is made gentler where that costs no more; a result says what is known, and what to change.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twosra_mpc.arguments import public
from twosra_mpc.checking.verification import verify
from twosra_mpc.effort import (
    Cost,
    Ending,
    OutOfEffortError,
    charge,
    lend_overtime,
    limit_reached,
    limited,
    out_of_effort,
    spent,
)
from twosra_mpc.errors import ContradictionError, PlanInterrupted
from twosra_mpc.model.flow import roll_out, twists
from twosra_mpc.planning.greedy import plan_greedily
from twosra_mpc.planning.relaxation import stage_tree
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound, dive
from twosra_mpc.planning.search.infeasibility import disproof, impossibility, too_few_phases
from twosra_mpc.planning.search.nodes import Node
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.solver.fixed_sequence import timed, verified
from twosra_mpc.planning.solver.gentle import gentle
from twosra_mpc.planning.solver.sequence_solver import SequenceSolver, Solved, checked, trusted
from twosra_mpc.planning.stages.variants import Variant, ways_of
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.result import Result, Stats
from twosra_mpc.problem.ends import check_shapes, check_workspace
from twosra_mpc.problem.problem import Problem, Risk
from twosra_mpc.problem.tasks import MOST_PHASES
from twosra_mpc.problem.tolerances import QUADRATURE_TOLERANCE, ROUNDING, forgiven
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.modes import ModeSequence, all_modes, mode_name
from twosra_mpc.timing import transition_model

if TYPE_CHECKING:
    from twosra_mpc.planning.solver.placer import Placer

_UNHINDERED = 1 / 15  # of the limits: what may be spent as if no obstacle were there
_LOOKS = 40  # along the direct drive
_WORTH_S = 3.0  # better by less no plan is looked for in a run

# Of a look for a first plan; stages of as many phases are looked at later.
_WIDTH, _LEAVES, _TRIES, _AT_ONCE, _LONG = 4, 30, 8, 2, 5
_LEAPS = 500.0  # units of work that are spent to compare sequences of a stage


@public
class Progress(NamedTuple):
    """State of a running search.

    Attributes:
        cost: Of the incumbent [s]; infinite before there is one.
        lower_bound: Proved lower bound on the cost of any plan [s].
    """

    cost: float
    lower_bound: float


_STOPPED = {
    Ending.LIMIT: "a limit was reached",
    Ending.INTERRUPTED: "interrupted",
    Ending.CLOSED: "none is better than one that is known",
}


def _advice(ending: Ending) -> str:
    """Advice after a search that was stopped."""
    stopped_by = limit_reached()
    if ending is Ending.INTERRUPTED or stopped_by is None:
        return "run again to continue the search"
    return f"raise {stopped_by}"


@public
def plan(
    problem: Problem,
    *,
    on_progress: Callable[[Progress], None] | None = None,
    risk: Risk | None = None,
) -> Result:
    """Plan: find a verified plan for ``problem`` and say how far from the best possible it is.

    Never raises for a problem that has no plan: ``Result.status`` and ``Result.message`` say so,
    and ``Result.require()`` turns that into an exception. ``work_limit`` and ``time_limit_s``
    return the best plan so far with its true gap; what was begun within a limit may take up to
    1000 units of work or 0.4 s of CPU time more. Ctrl-C raises, with the best plan so far.

    Args:
        problem: The validated problem; ``problem.planner`` chooses the planner.
        on_progress: Called as the search proceeds.
        risk: What of the time counts where joint bends are uncertain, if not ``problem.risk``:
            "nominal", "mean", or a quantile; with all but "nominal" the result has a policy.

    Raises:
        InputError: If there is no such risk; or at the start or at the goal the locomotion units
            would overlap, the robot would be outside of its workspace, or overlap an obstacle.
        PlanInterrupted: At Ctrl-C: a ``KeyboardInterrupt`` whose ``result`` is the best so far.
    """
    asked = problem if risk is None else problem.with_values(risk=risk)
    result = plan_until_interrupted(asked, on_progress=on_progress)
    if result.ending is Ending.INTERRUPTED:
        raise PlanInterrupted(result)
    return result


def plan_until_interrupted(
    problem: Problem,
    *,
    on_progress: Callable[[Progress], None] | None = None,
    excluded: Container[ModeSequence] = (),
    than_s: float = math.inf,
    worth_s: float = 0.0,
) -> Result:
    """Plan as ``plan`` does, but at Ctrl-C return the best plan so far.

    Args:
        problem: The problem.
        on_progress: Called as the search proceeds.
        excluded: Mode sequences that are not to be used.
        than_s: Cost of a plan that is known, the first incumbent: where no bound is below it by
            more than ``worth_s``, nothing is solved, and the result has a bound and no plan.
        worth_s: What is better by no more than that is not looked for.

    Raises:
        InputError: As ``plan`` does.
    """
    if problem.risk != "nominal" and not excluded:
        from twosra_mpc.planning.policy import RELYING, plan_policy  # no one else waits for it

        if than_s == math.inf:
            with limited(problem.work_limit, problem.time_limit_s):
                return plan_policy(problem, on_progress, worth_s)
        excluded = RELYING  # what is known to be best counts on nothing more
    return searched(problem, on_progress, excluded, than_s, worth_s)


def searched(
    problem: Problem,
    on_progress: Callable[[Progress], None] | None = None,
    excluded: Container[ModeSequence] = (),
    than_s: float = math.inf,
    worth_s: float = 0.0,
) -> Result:
    """Plan as `plan_until_interrupted` does, as if joint bends were certain."""
    started = time.perf_counter()
    with limited(problem.work_limit, problem.time_limit_s):
        try:
            check_shapes(problem)
            check_workspace(problem)
            if problem.obstacles or problem.objects or problem.tasks:
                from twosra_mpc.planning.stages.checks import check_around  # no one else waits

                check_around(problem)
            if problem.planner == "greedy":
                return plan_greedily(problem)
            if problem.obstacles and not problem.objects:
                found = _unhindered(problem, excluded, than_s, worth_s)
                if found is not None:
                    stats = replace(found.stats, work=spent(), first_plan_work=spent())
                    return replace(found, stats=stats)
            return _search(problem, excluded, on_progress, than_s, worth_s)
        except OutOfEffortError:  # before, or after, the search
            ending = Ending.LIMIT
        except KeyboardInterrupt:
            ending = Ending.INTERRUPTED
        message = f"{_nothing_found(problem)} ({_STOPPED[ending]}): {_advice(ending)}"
        stats = Stats(time.perf_counter() - started, 0, 0, 0, spent())
    return Result(problem, problem.planner, Status.FAILED, message, None, ending, stats, None)


def plan_again(problem: Problem, than_s: float = math.inf) -> Result:
    """Plan as ``plan`` does, but look for nothing that is better by a few seconds only.

    Args:
        problem: What is left of another.
        than_s: Cost of a plan that is known.

    Raises:
        InputError: As ``plan`` does.
        PlanInterrupted: At Ctrl-C.
    """
    result = plan_until_interrupted(problem, than_s=than_s, worth_s=_WORTH_S)
    if result.ending is Ending.INTERRUPTED:
        raise PlanInterrupted(result)
    return result


def _unhindered(
    problem: Problem, excluded: Container[ModeSequence], than_s: float, worth_s: float
) -> Result | None:
    """The plan that is best as if no obstacle were there, and so best, if it is clear of all.

    Where a drive is all there is to do, and the direct one runs into something, none is looked for.
    """
    from twosra_mpc.checking.clearance import Surroundings  # only then anyone waits for it
    from twosra_mpc.planning.stages.necessity import same_shape
    from twosra_mpc.space.screws import moved

    if len(variants := ways_of(problem).variants) == 1:
        problem = variants[0].problem  # a task that comes last is the goal
    around = Surroundings(problem.world, problem.robot.geometry)

    def overlaps(q: Array) -> bool:
        charge(Cost.OUTLINE, len(q))
        return not around.distances_m(q).all()

    start = problem.start.configuration
    low, high = problem.goal.box_met(start)
    if same_shape(problem) and np.isfinite([low, high]).all():
        ways, share = np.tile(start, (_LOOKS, 1)), np.linspace(0.0, 1.0, _LOOKS)
        twist = twists(start[:POSE], (low + high)[:POSE] / 2)
        ways[:, :POSE] = moved(start[:POSE], twist, share)
        if overlaps(ways):
            return None

    def confirmed(found: SearchResult[Solved]) -> SearchResult[Solved] | None:
        solved = found.solution
        if solved and overlaps(np.concatenate([*solved.candidate.motion.states])):
            return replace(found, solution=None)
        return _confirmed(found)

    try:
        with limited(problem.work_limit * _UNHINDERED, problem.time_limit_s * _UNHINDERED):
            free = problem.with_values(obstacles=())
            result = _search(free, excluded, None, than_s, worth_s, confirmed)
    except OutOfEffortError:
        return None
    if result.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    if result.plan is None or result.ending is Ending.LIMIT:
        return None
    asked = result.plan.problem.with_values(obstacles=problem.obstacles)
    trajectory = replace(result.plan.trajectory, problem=asked)
    verification = verify(trajectory)
    made = replace(result.plan, trajectory=trajectory, verification=verification)
    return replace(result, problem=asked, plan=made) if verification.ok else None


def _search(
    problem: Problem,
    excluded: Container[ModeSequence],
    on_progress: Callable[[Progress], None] | None,
    than_s: float,
    worth_s: float,
    confirm: Callable[[SearchResult[Solved]], SearchResult[Solved] | None] | None = None,
) -> Result:
    """Stages, their variants, their tree and its bounds, the solver: a result."""
    started, (variants, refused) = time.perf_counter(), ways_of(problem)
    if not variants:
        why = "; ".join(refused) or "no direction that may be used is left"
        status = Status.INFEASIBLE if all(refused.values()) else Status.FAILED
        stats = Stats(time.perf_counter() - started, 0, 0, 0, spent())
        return Result(problem, "optimal", status, why, None, Ending.EXHAUSTED, stats, None)
    if (resting := _rest(variants)) is not None:
        return resting
    inside = problem.workspace is not None and confirm is None  # which guesses may leave
    guessed = checked if inside else trusted
    solver: SequenceSolver | Placer = SequenceSolver(variants, guessed, worth_s)
    passes = any(stage.through or stage.follows for stage in problem.stages)
    if passes or problem.obstacles or problem.objects:
        from twosra_mpc.planning.solver.placer import Placer  # only then anyone waits for it

        solver = Placer(variants)
    tree = stage_tree(problem, variants, solver, excluded, solver.in_the_way)
    alone = len(variants) == len(variants[0].members[0]) == 1
    aimed, narrower = tree, tuple(variant.aimed for variant in variants)
    if narrower != variants:
        aimed = stage_tree(problem, narrower, solver, excluded, solver.in_the_way)
    result = branch_and_bound(
        tree,
        gap=problem.gap,
        out_of_time=out_of_effort,
        on_progress=lambda cost, low: on_progress(Progress(cost, low)) if on_progress else None,
        incumbent=lambda: _drive(tree, problem.gap) if solver.in_the_way is None else (),
        look=lambda: _look(aimed, alone),
        patience=len(all_modes(len(problem.robot.rigid))) ** 3,  # nodes of three levels
        proved=lambda bound: forgiven(bound, problem.replay_tolerance),
        confirm=confirm or _confirmed,
        worth=worth_s,
        known=than_s,
    )
    stats = Stats(
        wall_s=time.perf_counter() - started,
        sequences_bounded=result.bounded,
        sequences_solved=result.solved,
        nlp_iterations=solver.iterations,
        work=spent(),
        first_plan_work=result.first_work if result.solution else None,
    )
    return _conclude(variants[0].problem if alone else problem, result, tree, stats)


def _confirmed(found: SearchResult[Solved]) -> SearchResult[Solved] | None:
    """The outcome with a plan that is verified; None if it has none, and may be searched on."""
    result = as_asked(found)
    lend_overtime()
    made = None if result.solution is None else result.solution.with_plan()
    if made is not None and made.verifies:
        return replace(result, solution=made)
    return replace(result, solution=None) if result.ending is Ending.INTERRUPTED else None


def _drive(tree: Tree[Solved], gap: float) -> Iterator[tuple[float, Solved] | None]:
    """Yield drives without a melt, if that suffices: a screw; if it may gain, one that turns."""
    stages, only = tree.variants[0], len(tree.variants) == 1
    solid = only and tree.first == stages[0].rigid
    node = tree.opened(0, ((stages[0].rigid,),) * (len(stages) - 1)) if solid else tree.root()
    least = tree.leaf_bound(node)
    for found in itertools.islice(tree.solve(node) if least < math.inf else (), 2):
        yield found
        if found is not None and found[0] - least <= gap * found[0]:
            return


def _look(tree: Tree[Solved], alone: bool) -> tuple[float, Solved] | None:
    """The first of a few promising sequences of all stages; of a single stage the best of them."""
    few = {"width": _WIDTH, "attempts": _LEAVES, "tries": _AT_ONCE if alone else _TRIES}

    def many(node: Node) -> Iterator[Node]:
        until = spent() + _LEAPS
        return itertools.takewhile(lambda _: spent() < until, tree.leaps(node))

    def short(node: Node) -> Iterator[Node]:
        def is_short(leap: Node) -> bool:
            return not leap.sequences or len(leap.sequences[-1]) < _LONG

        return itertools.takewhile(is_short, many(node))

    for children in (short, many):
        found = dive(tree, children, **few, out_of_time=out_of_effort)
        some = itertools.islice(found, None if alone else 1)
        if best := min(some, key=lambda each: each[0], default=None):
            return best
    return None


def _rest(variants: Sequence[Variant]) -> Result | None:
    """The empty plan, where the start is the goal already."""
    problem, stages = variants[0].problem, variants[0].members[0]
    start, goal = problem.start.configuration, stages[0].goal
    there = goal.met_at(start) and problem.start_stiffness == stages[0].stage.last
    plain = len(variants) == len(stages) == 1 and stages[0].reaches and not stages[0].passes
    if not there or not plain:
        return None
    sequence = (problem.start_mode,)
    network = transition_model(problem).network(sequence, problem.start_mode, [0.0])
    motion = roll_out(problem.robot, start, sequence, np.zeros((1, 1, 5)))
    candidate = timed(motion, network, problem, iterations=0)
    assert candidate is not None, "a robot that rests is where it should be"
    made = replace(verified(problem, candidate, network), lower_bound=0.0)
    message, stats = "the start is the goal: nothing to do", Stats(0.0, 0, 0, 0, spent(), spent())
    return Result(problem, "optimal", made.status, message, 0.0, Ending.CLOSED, stats, made)


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


def _quality(made: Plan, ending: Ending) -> str:
    """Message about a plan that was found; empty where it says itself that it is optimal."""
    if made.status is Status.OPTIMAL:
        return ""
    if ending is Ending.EXHAUSTED:
        alone = len(made.problem.stages) == 1
        most = f"max_phases = {made.problem.max_phases}"
        phases = most if alone else f"{MOST_PHASES} phases a task"
        tried = f"no mode sequence of up to {phases} is left to try"
        elsewhere = ", in other places and shapes" if made.problem.obstacles else ""
        return f"{made}; {tried}: the gap is slack of the bounds{elsewhere}, or in longer sequences"
    or_gap = " or gap" if ending is Ending.LIMIT else ""
    return f"{made}; {_STOPPED[ending]}: {_advice(ending)}{or_gap}"


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


def _conclude(
    problem: Problem, search: SearchResult[Solved], tree: Tree[Solved], stats: Stats
) -> Result:
    """Turn the outcome of the search into a result with a true status and a useful message."""
    lower = search.lower_bound if math.isfinite(search.lower_bound) else None
    ending, made = search.ending, None
    if search.solution is not None and search.solution.plan is not None:
        made = search.solution.plan
        lower = None if lower is None else _at_most_cost(lower, made)
        made = replace(made, lower_bound=lower)
        problem, status, message = made.problem, made.status, _quality(made, ending)
    elif (proof := _proof(problem, search, tree)) is not None:
        status, message = Status.INFEASIBLE, f"proved infeasible: {proof}"
        lower, ending = None, Ending.EXHAUSTED  # whatever ended the search, nothing is left of it
    else:
        status, message = Status.FAILED, _failure(problem, search, tree)
    return Result(problem, "optimal", status, message, lower, ending, stats, made)


def _proof(problem: Problem, search: SearchResult[Solved], tree: Tree[Solved]) -> str | None:
    """Proof that there is no plan at all, in words; None where that is not proved."""
    proof = tree.everywhere(lambda _, way: way.blocks(None)) or impossibility(tree)
    if proof is None and search.ending is Ending.EXHAUSTED and search.lower_bound == math.inf:
        rigid = (problem.robot.rigid,)
        proof = tree.everywhere(lambda _, way: way.blocks(rigid)) or disproof(tree)
    return proof


def _failure(problem: Problem, search: SearchResult[Solved], tree: Tree[Solved]) -> str:
    """Reason why no plan was found although one may exist, and what to change."""
    none = _nothing_found(problem)
    if (ending := search.ending) is not Ending.EXHAUSTED:
        limit = limit_reached() or "work_limit"
        effort = f"{search.solved} mode sequences tried, {limit} is {getattr(problem, limit):zg}"
        return f"{none} ({_STOPPED[ending]}): {_advice(ending)} ({effort})"
    tried = f"{none} ({search.solved} mode sequences tried)"
    if sum(map(len, tree.variants)) > 1:
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


def _nothing_found(problem: Problem) -> str:
    """Message that there is no plan."""
    if len(problem.stages) > 1:
        return "no plan of these tasks found"
    within = "" if problem.workspace is None else " within the workspace"
    return f"no plan found{' among the obstacles' if problem.obstacles else within}"
