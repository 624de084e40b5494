"""Lower bounds on the time in which any plan is confirmed, and on the cost of every policy.

The first is the same search, with later changes. The second: before its first joint bend, no one
knows how that goes. So what a policy does before is the same whatever the truth is, and so is the
shape that it bends there. If it suits the truth, a run may end with the joint bend: the melts and
freezes of such a run are all that it must take. If not, a segment has to melt or freeze once more,
whatever is known by then. Bends of runs with joint ones take no time here, drives neither, and
shapes count as right within the accuracy of runs; so that holds of every way in which bends are
shared.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.arguments import public
from twosra_mpc.effort import limited
from twosra_mpc.model.bending import bending
from twosra_mpc.planning.bounds.sequence_bound import SequenceBound
from twosra_mpc.planning.relaxation import relaxation, stage_bounds, stage_tree
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound
from twosra_mpc.planning.search.tree import tree_of
from twosra_mpc.planning.stages.necessity import necessities
from twosra_mpc.planning.stages.variants import ways_of
from twosra_mpc.plans.branches import priced
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.problem import Problem
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.robot.joint_bends import JointBend
from twosra_mpc.robot.modes import Mode, ModeSequence, last_bent, soft_segments
from twosra_mpc.timing import TransitionModel, transition_model
from twosra_mpc.timing.thermal import confirmed_model

_STEPS = 100  # of a search that only bounds
_FARTHEST = 1.5  # times what a policy costs: what costs more is not told apart


@public
def confirmed_lower_bound(plan: Plan) -> float | None:
    """Lower bound on ``confirmed_s`` of all plans of the same problem [s], however it is timed.

    Among obstacles and in missions it is that of the time as described: all changes are confirmed
    after they are over, so the same heating would be a plan that is done no later. That holds of
    exact thermal times alone. None elsewhere, where cost is not only time, and of the greedy rule.
    """
    problem, known, duration_s = plan.problem, plan.lower_bound, plan.confirmed_s
    model = confirmed_model(problem)
    if model is None or duration_s is None or known is None:
        return None
    if any(problem.cost_weights.model_dump().values()):
        return None
    if problem.obstacles or problem.objects or len(problem.stages) > 1:
        exact = model.problem is problem and problem.transition_quantile is None
        return min(known, duration_s) if exact else None
    return least_time_s(model, duration_s)


def least_time_s(
    timing: TransitionModel, known_s: float, excluded: Container[ModeSequence] = ()
) -> float:
    """Lower bound on the time of all plans by sequences that are not excluded, or that known."""
    problem, steps = timing.problem, iter(range(_STEPS))

    def none(*_: object) -> Iterator[None]:
        """No plan is looked for."""
        return iter(())

    with limited(problem.work_limit, problem.time_limit_s):
        search: SearchResult[None] = branch_and_bound(
            stage_tree(problem, ways_of(problem).variants, none, excluded, timing=timing),
            gap=problem.gap,
            out_of_time=lambda: next(steps, None) is None,
            on_progress=lambda *_: None,
            known=known_s,
            proved=lambda bound: forgiven(bound, problem.replay_tolerance),
        )
    return min(search.lower_bound, known_s)


@dataclass(frozen=True)
class Sequences:
    """All mode sequences of a kind."""

    kind: Callable[[Sequence[Mode]], bool]

    def __contains__(self, modes: object) -> bool:
        return isinstance(modes, tuple) and self.kind(modes)


def at_once(modes: Sequence[Mode]) -> bool:
    """True if several segments end in a joint bend, after a single melt of each.

    Whoever misses then must melt or freeze once more.
    """
    return any(
        len(last := last_bent(modes[k:])) > 1
        and all(sorted(own) == own for own in ([m[j] for m in modes[: k + 1]] for j in last))
        for k in range(len(modes))
    )


def bent_before(modes: Sequence[Mode]) -> tuple[int, ...] | None:
    """Segments (from 0) that are soft before the first joint bend; None: there is no joint bend.

    Of two segments; of more nothing is told apart.
    """
    joint = next((k for k, mode in enumerate(modes) if len(soft_segments(mode)) > 1), None)
    if joint is None:
        return None
    before = {j for mode in modes[:joint] for j in soft_segments(mode)}
    return tuple(sorted(before)) if len(modes[joint]) == 2 else ()


def least_costs_s(
    problem: Problem, bends: Sequence[JointBend], known_s: float
) -> tuple[float, float]:
    """Proved lower bounds on the cost of every policy [s], and of knowing the truth before.

    Args:
        problem: The problem; its ``risk`` says what of the time is the cost.
        bends: How joint bends may go; all are equally likely.
        known_s: Cost of a policy that is known.
    """
    timing = confirmed_model(problem) or transition_model(problem)
    blocked = _blocked(problem)
    share, least_s, known = 1 / len(bends), known_s, np.full(len(bends), np.inf)

    def cost_s(each: Array) -> float:
        return priced([(share, cost) for cost in each.tolist()], problem.risk)

    for bent in ((), (0,), (1,), (0, 1)) if problem.robot.geometry.segments == 2 else ((),):
        missed_s, right_s = (
            _melting_s(timing, bent, once, blocked, _FARTHEST * known_s) for once in (False, True)
        )
        costs = np.where(_suits(problem, bends, bent), min(right_s, missed_s), missed_s)
        known = np.minimum(known, costs.min(axis=0))
        least_s = min(least_s, *map(cost_s, costs))
    joint = Sequences(lambda modes: bent_before(modes) is not None or blocked(modes))
    alone_s = least_time_s(timing, least_s, joint)
    return alone_s, min(alone_s, cost_s(np.minimum(known, alone_s)))


def _blocked(problem: Problem) -> Callable[[Sequence[Mode]], bool]:
    """Whether obstacles are proved to forbid a sequence, wherever runs may end; not of missions."""
    if not problem.obstacles or len(problem.stages) > 1:
        return lambda modes: False
    robot, goal = problem.robot, problem.judged_goal
    ended = problem.with_values(goal=goal.loosened(robot.ends_within.scale(robot.coordinates)))
    ways = [way for each in ways_of(ended).variants for way in necessities(each)]
    for way in ways:
        way.proves_impossible((robot.rigid,))
    return lambda modes: all(way.blocks(tuple(modes)) is not None for way in ways)


def _melting_s(
    timing: TransitionModel,
    bent: tuple[int, ...],
    once: bool,
    blocked: Callable[[Sequence[Mode]], bool],
    most_s: float,
) -> float:
    """Least time of the melts and freezes of any sequence of a kind, or ``most_s`` if that is less.

    Args:
        timing: The transition model.
        bent: Segments that are soft before the first joint bend.
        once: Whether it ends `at_once`.
        blocked: Whether obstacles forbid a sequence.
        most_s: What takes longer need not be looked at [s].
    """
    problem = timing.problem
    anything = ((-np.inf, np.inf),) * problem.robot.geometry.segments
    free = [
        tuple(replace(stage, bend=None, change=anything) for stage in stage_bounds(variant))
        for variant in ways_of(problem).variants
    ]

    def known(_: object, bound: SequenceBound, __: object) -> Iterator[tuple[float, None]]:
        """It takes what it must."""
        yield bound.cost, None

    first = problem.start_stiffness
    others = Sequences(
        lambda modes: bent_before(modes) != bent or at_once(modes) != once or blocked(modes)
    )
    facts = problem.cost_weights, relaxation(problem)
    with limited(problem.work_limit, problem.time_limit_s):
        search: SearchResult[None] = branch_and_bound(
            tree_of(free, first, timing, *facts, known, excluded=others),
            gap=0.0,
            out_of_time=lambda: False,
            on_progress=lambda *_: None,
            known=most_s,
        )
    return forgiven(search.lower_bound, problem.replay_tolerance)


def _suits(
    problem: Problem, bends: Sequence[JointBend], bent: tuple[int, ...]
) -> NDArray[np.bool_]:
    """For each choice of the shape before: which joint bends may then end right, (choices, bends).

    Where one of two segments is bent before, a joint bend ends right from an interval of its W. It
    keeps e2 W1 - e1 W2, e = (1 + split, 1 - split), so with the other W known that is linear.
    """
    if problem.robot.geometry.segments != 2 or len(bent) > 1:
        return np.ones((1, len(bends)), dtype=bool)
    facts, most = bending(problem.robot), problem.robot.limits.curvature_per_m
    accuracy = problem.robot.ends_within.scale(problem.robot.coordinates)
    box = problem.judged_goal.box(problem.start.configuration)
    ends = np.array([box[0] - accuracy, box[1] + accuracy])[:, POSE:]
    low, high = facts.coordinates(np.clip(ends, -most, most))
    here, first = facts.coordinates(problem.start.kappa_per_m), bent[0] if bent else 0
    furthest = facts.coordinate(most, first)
    spans = np.empty((len(bends), 2))
    for each, bend in zip(spans, bends, strict=True):
        shares = np.array([1 - bend.split, -1 - bend.split])  # of W1 and W2 in what is kept
        before = np.tile(here, (2, 1))
        before[:, first] = 0.0, 1.0
        before += bend.relaxation * (before.mean(axis=1, keepdims=True) - before)
        at_zero, at_one = before @ shares
        asked = shares @ [low[0], high[1]] - at_zero, shares @ [high[0], low[1]] - at_zero
        if abs(slope := at_one - at_zero) < 1e-9:
            each[:] = (-np.inf, np.inf) if asked[0] <= 0 <= asked[1] else np.nan
        else:
            each[:] = sorted(end / slope for end in asked)
    chosen = np.clip(spans[:, :1], -furthest, furthest) if bent else here[:1, None]
    return (spans[:, 0] <= chosen) & (chosen <= spans[:, 1])
