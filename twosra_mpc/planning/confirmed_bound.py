"""Lower bound on the time in which any plan is confirmed: the same search, with later changes."""

from __future__ import annotations

from collections.abc import Container, Iterator

from twosra_mpc.arguments import public
from twosra_mpc.effort import limited
from twosra_mpc.planning.relaxation import stage_tree
from twosra_mpc.planning.search.branch_and_bound import SearchResult, branch_and_bound
from twosra_mpc.planning.stages.variants import ways_of
from twosra_mpc.plans.plan import Plan
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.robot.modes import ModeSequence
from twosra_mpc.timing import TransitionModel
from twosra_mpc.timing.thermal import confirmed_model

_STEPS = 100  # of a search that only bounds


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
