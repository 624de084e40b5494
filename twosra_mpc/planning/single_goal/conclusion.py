"""What is made of a search's outcome: a gentler plan where that costs no more, and words."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from twosra_mpc.deadline import OutOfTimeError
from twosra_mpc.planning.search.branch_and_bound import SearchResult
from twosra_mpc.planning.single_goal.gentle import ROUNDING, gentle
from twosra_mpc.planning.single_goal.sequence_solver import Solved
from twosra_mpc.plans.ending import Ending
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.problem.tasks import MOST_PHASES


class Progress(NamedTuple):
    """State of a running search.

    Attributes:
        cost: Of the incumbent [s]; infinite before there is one.
        lower_bound: Proved lower bound on the cost of any plan [s].
    """

    cost: float
    lower_bound: float


STOPPED = {Ending.LIMIT: "a limit was reached", Ending.INTERRUPTED: "interrupted"}
ADVICE = {
    Ending.LIMIT: "raise time_limit_s",
    Ending.INTERRUPTED: "run again to continue the search",
}


def as_asked(search: SearchResult[Solved]) -> SearchResult[Solved]:
    """The outcome with a gentler plan if that costs no more than asked, unless stopped."""
    if (found := search.solution) is None or not found.problem.drives_gently:
        return search
    try:
        return replace(search, solution=_gentler(found, search.lower_bound))
    except KeyboardInterrupt:
        return replace(search, ending=Ending.INTERRUPTED)
    except OutOfTimeError:
        early = search.ending is Ending.INTERRUPTED
        return search if early else replace(search, ending=Ending.LIMIT)


def _gentler(found: Solved, lower_bound: float) -> Solved:
    """What was found, or a gentler plan of its sequence that costs no more than asked."""
    problem = found.problem
    within = (1 - 2 * ROUNDING) * lower_bound / (1 - problem.gap)
    most = limit = max(found.cost, within)
    for _ in range(2):  # what the energy costs is exactly known only of a plan that is made
        candidate = gentle(problem, found.candidate, found.network, most)
        if candidate is None:
            break
        slower = replace(found, candidate=candidate, fastest_cost=found.cost)
        cost = slower.plan.cost.total
        if cost <= (1 + ROUNDING) * limit and slower.plan.verification.ok:
            return slower
        most -= 2 * abs(cost - limit)
    return found


def quality(made: Plan, ending: Ending) -> str:
    """Message about a plan that was found."""
    if made.status is Status.OPTIMAL:
        return str(made)
    if ending is Ending.EXHAUSTED:
        phases = f"max_phases = {made.problem.max_phases}"
        if made.problem.is_mission:
            phases = f"{MOST_PHASES} phases a task"
        tried = f"no mode sequence of up to {phases} is left to try"
        elsewhere = ", in other places and shapes" if made.problem.obstacles else ""
        return f"{made}; {tried}: the gap is slack of the bounds{elsewhere}, or in longer sequences"
    or_gap = " or gap" if ending is Ending.LIMIT else ""
    return f"{made}; {STOPPED[ending]}: {ADVICE[ending]}{or_gap}"
