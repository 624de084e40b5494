"""Planning that failed says which setting to change."""

from __future__ import annotations

import re

import pytest

from twosra_mpc import Problem, Status, effort, load_problem, plan

SETTINGS = ("work_limit", "max_phases", "modes", "tolerance", "workspace", "planner", "clearance_m")
ADVICE = re.compile(rf"(raise|set|allow|add|widen|lower)[\w ,']* ({'|'.join(SETTINGS)})\b")


def paper(name: str = "paper-1", **changes: object) -> Problem:
    return load_problem(name, **changes)


FAILING = {
    "no time for tasks": paper("pick-and-place", work_limit=1e-9),
    "no time for the greedy rule": paper(work_limit=1e-9, planner="greedy"),
    "too few modes for the greedy rule": paper(modes=[[0, 0]], planner="greedy"),
}


@pytest.mark.parametrize("name", FAILING)
def test_what_failed_says_what_to_change(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(effort, "OVERTIME", 0)  # the greedy rule would be done in it
    made = plan(FAILING[name])
    assert made.status is not Status.OPTIMAL
    assert ADVICE.search(made.message), made.message
