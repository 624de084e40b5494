"""A plan is decided on again whenever something was learnt, and stays unless another is better."""

from __future__ import annotations

from dataclasses import replace

import pytest

from twosra_mpc import Plan, load_problem, plan
from twosra_mpc.execution import simulate
from twosra_mpc.execution.replanning import SWITCH_S, cost_of_rest_s
from twosra_mpc.planning.planner import plan_again


@pytest.fixture(scope="module")
def best() -> Plan:
    return plan(load_problem("paper-1")).require()


def test_the_rest_of_a_plan_costs_what_is_left_of_it(best: Plan) -> None:
    """From its own state at the end of every phase, also while metal changes."""
    for index, phase in enumerate(best.phases[:-1], start=1):
        for time_s in (phase.end_s, (phase.end_s + best.phases[index].start_s) / 2):
            cost_s = cost_of_rest_s(best, index, best.rest_at(time_s))
            assert cost_s == pytest.approx(best.duration_s - time_s, abs=1e-3)


def test_nothing_is_better_than_the_rest_of_the_best_plan(best: Plan) -> None:
    for phase in best.phases:
        left, left_s = best.rest_at(phase.end_s), best.duration_s - phase.end_s
        found = plan_again(left, left_s - SWITCH_S)
        assert found.plan is None
        assert found.stats.sequences_solved == 0
        assert found.lower_bound is not None
        assert found.lower_bound <= left_s


def test_only_what_is_better_is_found(best: Plan) -> None:
    found = plan_again(best.problem, best.duration_s + 100.0)
    assert found.require().duration_s < best.duration_s + 1.0


def test_a_bad_plan_is_changed_and_a_good_one_stays(best: Plan) -> None:
    """The greedy rule's plan of the same problem; reasons and both durations are in the log."""
    greedy = plan(best.problem.with_values(planner="greedy")).require()
    bad = replace(greedy, trajectory=replace(greedy.trajectory, problem=best.problem))
    for made, kind, share in ((bad, "replan", 0.75), (best, "kept", 1.05)):
        ran = simulate(best.problem, plan=made, plant="as-planned", disturbance="none")
        assert ran.run.reached
        assert made.confirmed_s is not None
        assert ran.run.duration_s < share * made.confirmed_s
        told = [event for event in ran.run.events if event.kind in ("kept", "replan")]
        assert kind in {event.kind for event in told}
        assert all("s are left, " in event.text and " s" in event.text for event in told)
