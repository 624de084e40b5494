"""How good a plan is, in words: what the search proved, and what the plan is slower on purpose."""

from __future__ import annotations

from twosra_mpc.plans.plan import Plan

_ROUNDING = 1e-5  # of a cost: no smaller gap is claimed in words


def percent(share: float) -> str:
    """Write a share in per cent with two digits that count, and a tiny one as what it is below."""
    return "< 0.001 %" if 0 < share < 1e-5 else f"{float(f'{100 * share:z.2g}'):zg} %"


def quality(plan: Plan) -> str:
    """Say how near to the best possible a plan is, and what it would cost at full speed.

    E.g. "driven gently; at full speed 338.0 s, proved within 0.006 % of the best".
    """
    if plan.lower_bound is None or plan.gap is None:
        return "no bound proved"
    if not plan.slower_by or plan.fastest_cost is None or plan.search_gap is None:
        return within(plan.gap)
    quickest = f"{_costs(plan)}{plan.fastest_cost:z.1f} s"
    return f"driven gently; at full speed {quickest}, {within(plan.search_gap)}"


def headline(plan: Plan) -> str:
    """Say what a plan costs, and how good that is, in a line without its modes."""
    known = f"by the {plan.planner} rule" if plan.lower_bound is None else quality(plan)
    comma = " " if plan.lower_bound is None else ", "
    return f"{_costs(plan)}{plan.cost.total:z.1f} s{comma}{known}"


def above_bound(plan: Plan) -> str:
    """Say how much above the lower bound a plan is, and how much of it on purpose."""
    if plan.lower_bound is None:
        return ""
    above = f"{max(plan.cost.total - plan.lower_bound, 0.0):z.2f} s above it"
    if not plan.slower_by:
        return above
    return f"{above}, {plan.slower_by:z.2f} s of them on purpose"


def within(gap: float) -> str:
    """Say that no plan is better by more than a relative gap; rounding is counted as a gap."""
    return f"proved within {percent(max(gap, _ROUNDING))} of the best"


def _costs(plan: Plan) -> str:
    """What is put before a number of seconds that is not only time."""
    return "cost " if any(plan.problem.weights.model_dump().values()) else ""
