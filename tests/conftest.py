"""Plans that several test files look at, computed once a session."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import pytest
from hypothesis import settings

from twosra_mpc import Plan, load_problem, plan

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

Planned: TypeAlias = Callable[..., Plan]

PLANNERS_AND_TIMINGS = [
    (planner, timing)
    for planner in ("optimal", "greedy")
    for timing in ("nominal", "constant", "paper")
]


@pytest.fixture(scope="session")
def planned() -> Planned:
    """Plan a built-in scenario with overrides (hashable values), once each."""
    known: dict[object, Plan] = {}

    def get(scenario: str = "paper-1", **overrides: Any) -> Plan:
        key = (scenario, *sorted(overrides.items()))
        if key not in known:
            known[key] = plan(load_problem(scenario, **overrides))
        return known[key]

    return get


@pytest.fixture(scope="session", params=PLANNERS_AND_TIMINGS, ids="-".join)
def any_plan(request: pytest.FixtureRequest, planned: Planned) -> Plan:
    """The plan of paper-1 by each planner with each set of transition times."""
    planner, timing = request.param
    return planned("paper-1", planner=planner, timing=timing)
