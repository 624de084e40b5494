"""explain(): every figure is a plan's own, and the duration is accounted for to the last second."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from conftest import Run
from once import planned, solved

import twosra_mpc.lab.analysis.alternatives as alternatives_module
import twosra_mpc.planning.solver.sequence_solver as sequence_solver
import twosra_mpc.planning.solver.turning_drive as turning_drive
from twosra_mpc import InputError, Plan, PlanInterrupted, Status, effort, load_problem, plan
from twosra_mpc.effort import Ending
from twosra_mpc.lab.analysis.alternatives import FARTHER_M, Alternative
from twosra_mpc.lab.analysis.critical_path import (
    activities,
    critical_path,
    hidden_activities,
    in_words,
)
from twosra_mpc.lab.analysis.explanation import Explanation, explain
from twosra_mpc.planning.planner import plan_until_interrupted
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_2, SOFT_BOTH

SCENARIOS = ("paper-1", "shape-change")


@pytest.fixture(scope="module")
def explained() -> Callable[[str], Explanation]:
    """Explain a built-in scenario, once each."""
    known: dict[str, Explanation] = {}

    def get(name: str) -> Explanation:
        if name not in known:
            known[name] = explain(load_problem(name, work_limit=10000.0))
        return known[name]

    return get


def alternative(explanation: Explanation, change: str) -> Alternative:
    (found,) = [one for one in explanation.alternatives if one.change == change]
    return found


# --- what the duration is made of ----------------------------------------------------------------

VARIANTS: list[dict[str, Any]] = [
    {},
    {"timing": "constant"},
    {"timing": "paper"},
    {"heaters_at_once": 1},
    {"modes": [RIGID, SOFT_1, SOFT_2]},
    {"transition_quantile": 0.9},
    {"heating": "least_energy"},
    {"weights": {"energy_s_per_J": 0.1, "transition_s": 5.0}},
]


@pytest.fixture(scope="module", params=range(len(VARIANTS) + 3), ids=str)
def made(request: pytest.FixtureRequest) -> Plan:
    others = ("paper-4", "move-and-shape", "rigid-move")
    if request.param < len(VARIANTS):
        return planned("paper-1", **VARIANTS[request.param])
    return planned(others[request.param - len(VARIANTS)])


def test_the_critical_path_adds_up_to_the_duration(made: Plan) -> None:
    path = critical_path(made)
    assert sum(item.duration_s for item in path) == pytest.approx(made.duration_s, abs=1e-6)
    assert sum(seconds for seconds, _ in in_words(path)) == pytest.approx(made.duration_s, abs=1e-6)
    assert path[0].start_s == 0.0
    assert all(a.end_s == b.start_s for a, b in itertools.pairwise(path))


def test_the_critical_path_has_no_idle_time_and_nothing_invented(made: Plan) -> None:
    every = activities(made)
    for item in critical_path(made):
        assert any(
            (one.kind, one.segments) == (item.kind, item.segments)
            and one.start_s == pytest.approx(item.start_s, abs=1e-4)
            and one.end_s == pytest.approx(item.end_s, abs=1e-4)
            for one in every
        ), item
    for phase in made.phases:
        kind = "drive" if phase.mode == RIGID else "bend"
        assert any((one.kind, one.start_s) == (kind, phase.start_s) for one in every)


def test_everything_is_on_the_path_or_beside_it(made: Plan) -> None:
    path, beside = critical_path(made), hidden_activities(made)
    long = [one for one in activities(made) if one.duration_s > 1e-3]
    assert len([one for one in path if one.duration_s > 1e-3]) + len(beside) == len(long)
    for one in beside:
        covered = sum(
            min(one.activity.end_s, item.end_s) - max(one.activity.start_s, item.start_s)
            for item in one.during
        )
        assert covered == pytest.approx(one.activity.duration_s, abs=5e-3)


def test_what_paper_1_waits_for_is_told_in_words() -> None:
    made = planned("paper-1")
    told = [f"{seconds:.1f} s {words}" for seconds, words in in_words(critical_path(made))]
    assert told == [
        "62.7 s melting segment 1 (26.3 s of it while the robot may still move)",
        "0.9 s bending segment 1",
        "36.4 s until segment 2 is molten",
        "6.9 s bending both segments",
        "234.6 s freezing both segments",
    ]
    assert str(hidden_activities(made)[0]) == "driving, during heating segment 1"


def test_a_wait_that_nothing_explains_is_called_one() -> None:
    """A phase that begins a second late, for no reason."""
    found = planned("rigid-move")
    (phase,) = found.phases
    moved, samples = (phase._replace(start_s=1.0, end_s=phase.end_s + 1.0),), found.samples
    trajectory = dataclasses.replace(
        found.trajectory, phases=moved, samples=dataclasses.replace(samples, t_s=samples.t_s + 1.0)
    )
    late = dataclasses.replace(found, trajectory=trajectory)
    waiting, driving = critical_path(late)
    assert (waiting.kind, waiting.start_s, waiting.end_s) == ("wait", 0.0, 1.0)
    assert str(waiting) == "waiting"
    assert driving.kind == "drive"


# --- other plans ---------------------------------------------------------------------------------


def modes_of(made: Plan) -> list[tuple[int, int]]:
    return [mode for mode, _ in itertools.groupby(phase.mode for phase in made.phases)]


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_next_best_sequence_is_another_one_and_not_below_the_bound(
    explained: Callable[[str], Explanation], name: str
) -> None:
    told = explained(name)
    other = alternative(told, "with the next best mode sequence")
    assert other.plan is not None
    original = told.result.require()
    assert other.result.found
    assert modes_of(other.plan) != modes_of(original)
    assert other.plan.cost.total >= original.lower_bound - 1e-9
    quick = planned(name, motion="fastest")
    assert other.difference_s == other.plan.cost.total - quick.cost.total
    assert other.original.cost == quick.cost
    assert f"instead of {quick.cost.total:.2f} s at full speed" in str(told)


def test_no_alternative_is_cheaper_than_what_is_explained(
    explained: Callable[[str], Explanation],
) -> None:
    """A dear plan is given away for the cheap one that is among its alternatives."""
    known = explained("paper-1").alternatives[0]
    best, dear = plan(known.original.problem), known.result
    assert dear is not None
    assert dear.require().cost.total > best.require().cost.total + 0.1
    told = explain(dear)
    assert told.result.message.endswith("found among the alternatives")
    assert told.result.require().cost == best.require().cost
    assert told.result.require().verification == best.require().verification
    assert all((other.difference_s or 0.0) > -1e-5 for other in told.alternatives)


def test_a_plan_at_full_speed_is_compared_with_itself() -> None:
    made = solved("shape-change", motion="fastest")
    told = explain(made)
    assert all(other.original is made.plan for other in told.alternatives)
    assert f"instead of {made.require().cost.total:.2f} s more" in str(told)


def test_the_next_best_sequence_is_what_the_planner_says(
    explained: Callable[[str], Explanation],
) -> None:
    other = alternative(explained("paper-1"), "with the next best mode sequence")
    best = (RIGID, SOFT_1, SOFT_BOTH, RIGID)
    direct = plan_until_interrupted(
        load_problem("paper-1", motion="fastest"), excluded=frozenset({best})
    ).require()
    assert other.plan is not None
    assert other.plan.cost == direct.cost


def test_sequences_that_only_melt_more_are_passed_over() -> None:
    """Next after [0,0] > [1,0] is the same with an idle melt; what is told bends otherwise."""
    problem = load_problem("shape-change", robot="2sra-v1-paper")
    idle = plan_until_interrupted(problem, excluded=frozenset({(RIGID, SOFT_1, RIGID)})).require()
    assert modes_of(idle) == [RIGID, SOFT_1]
    other = alternatives_module.next_best(plan(problem).require())
    assert other.plan is not None
    assert SOFT_2 in modes_of(other.plan) or SOFT_BOTH in modes_of(other.plan)
    assert other.plan.cost.total >= idle.cost.total - 1e-6


@pytest.mark.parametrize("name", SCENARIOS)
def test_no_mode_is_forbidden_at_a_gain(explained: Callable[[str], Explanation], name: str) -> None:
    told = explained(name)
    original = told.result.require()
    changes = [f"without mode [{mode[0]},{mode[1]}]" for mode in modes_of(original)]
    for change in [*changes, "with one heater at a time"]:
        other = alternative(told, change)
        assert other.result is not None
        if other.plan is not None:
            assert other.plan.cost.total >= original.lower_bound - 1e-9


def test_every_figure_is_that_of_planning_the_changed_problem(
    explained: Callable[[str], Explanation],
) -> None:
    result = explained("paper-1")
    base = load_problem("paper-1", work_limit=10000.0, motion="fastest")
    changed = {
        "without mode [0,0]": base.with_values(modes=[SOFT_2, SOFT_1, SOFT_BOTH]),
        "without mode [1,0]": base.with_values(modes=[RIGID, SOFT_2, SOFT_BOTH]),
        "without mode [1,1]": base.with_values(modes=[RIGID, SOFT_2, SOFT_1]),
        "with one heater at a time": base.with_values(heaters_at_once=1),
    }
    assert {one.change for one in result.alternatives} == {
        *changed,
        "with the next best mode sequence",
    }
    for change, problem in changed.items():
        direct, told = plan(problem), alternative(result, change)
        assert (told.result.status, told.result.message) == (direct.status, direct.message)
        assert told.result.lower_bound == direct.lower_bound
        assert (told.plan and told.plan.cost) == (direct.plan and direct.plan.cost)


def test_a_mode_that_must_not_be_missing_is_proved_so() -> None:
    told = explain(load_problem("shape-change", modes=[RIGID, SOFT_1]))
    other = alternative(told, "without mode [1,0]")
    assert other.result.status is Status.INFEASIBLE
    assert (other.price, other.difference_s, other.difference) == ("", None, None)
    assert "proved infeasible: segment 1 must bend" in str(other)
    assert any("[1,0] cannot be left out of this sequence" in reason for reason in told.why)


def test_the_only_mode_cannot_be_forbidden() -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    problem = load_problem(
        "paper-1", start=start, goal={"kappa_per_m": (10.0, 0.0)}, modes=[SOFT_1]
    )
    told = explain(problem)
    assert alternative(told, "without mode [1,0]").result is None
    assert "at least one mode" in alternative(told, "without mode [1,0]").outcome
    other = alternative(told, "with any other mode sequence")
    assert "there is no other mode sequence" in other.outcome


def test_where_nothing_needs_to_melt_that_is_said() -> None:
    problem = load_problem("rigid-move", work_limit=300.0)
    told = explain(problem)
    other = alternative(told, "with any other mode sequence")
    assert other.plan is not None
    assert other.plan.duration_s > 290
    assert "melts more than it needs; none costs less than" in other.outcome
    assert any("nothing is melted" in reason for reason in told.why)
    assert told.complete  # the time limit of an alternative is no interrupt
    assert not any("heater" in one.change for one in told.alternatives)


def test_a_plan_is_explained_as_its_problem_is(explained: Callable[[str], Explanation]) -> None:
    known = explained("shape-change")
    again = explain(solved("shape-change"))
    assert [str(one) for one in again.alternatives] == [str(one) for one in known.alternatives]


def test_no_plan_has_its_reason_and_no_alternatives() -> None:
    told = explain(load_problem("paper-1", modes=[RIGID, SOFT_BOTH]))
    assert told.complete
    assert (told.why, told.critical_path, told.alternatives) == ((), (), ())
    assert str(told).startswith("proved infeasible: mode [1,1] alone")


def test_resting_is_explained_by_itself() -> None:
    start = load_problem("paper-1").start
    goal = {"x_m": start.x_m, "kappa_per_m": start.kappa_per_m}
    told = explain(load_problem("paper-1", goal=goal))
    assert (told.critical_path, told.alternatives, told.complete) == ((), (), True)


def test_the_greedy_rule_is_not_explained() -> None:
    with pytest.raises(InputError, match="weighs no alternatives"):
        explain(load_problem("paper-1", planner="greedy"))


# --- among obstacles -----------------------------------------------------------------------------


def test_among_obstacles_more_clearance_is_planned_anew() -> None:
    """A straight robot drives between two pillars, or round them."""
    ends = {"x_m": 0.3, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    pillars = [{"disc": {"x_m": 0.0, "y_m": y_m, "radius_m": 0.04}} for y_m in (-0.12, 0.12)]
    given = {"start": ends | {"x_m": -0.3}, "goal": ends, "obstacles": pillars}
    told = explain(load_problem("rigid-move", **given, modes=[RIGID, SOFT_1], work_limit=10000.0))
    other = alternative(told, "with 5 mm more clearance")
    assert other.plan is not None
    asked = told.result.problem.clearance_m + FARTHER_M
    assert other.plan.problem.clearance_m == pytest.approx(asked)


def test_what_is_proved_of_reshaping_is_among_the_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    module = "twosra_mpc.lab.analysis.explanation"
    monkeypatch.setattr(f"{module}.alternatives", lambda *_: iter(()))  # reasons need none
    told = explain(solved("corridor"))
    assert any(why.startswith("one reshaping is not enough") for why in told.why)


# --- Ctrl-C --------------------------------------------------------------------------------------


def interrupted_explanation(*args: Any, **named: Any) -> Explanation:
    """The explanation so far, of one that Ctrl-C ends: it raises, so that loops end, too."""
    with pytest.raises(PlanInterrupted) as interrupt:
        explain(*args, **named)
    assert isinstance(interrupt.value.result, Explanation)
    return interrupt.value.result


def test_an_interrupt_raises_with_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    made = solved("paper-1")
    asked: list[str] = []

    def tell(words: str) -> None:
        asked.append(words)
        if words == "without mode [1,0]":
            raise KeyboardInterrupt

    told = interrupted_explanation(made, on_progress=tell)
    assert not told.complete
    assert [one.change for one in told.alternatives] == [
        "with the next best mode sequence",
        "without mode [0,0]",
    ]
    assert asked[0] == "the plan itself"
    assert "interrupted" in str(told)
    assert told.critical_path == critical_path(made.require())


def test_an_interrupt_that_the_search_caught_ends_the_explanation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = solved("rigid-move", motion="fastest")
    monkeypatch.setattr(sequence_solver, "solve", Mock(side_effect=KeyboardInterrupt))
    told = interrupted_explanation(made)
    assert not told.complete
    last = told.alternatives[-1]
    assert last.change == "without mode [0,0]"
    assert "interrupted" in last.outcome


def test_an_interrupt_before_anything_is_compared_leaves_the_plan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = solved("paper-2")

    monkeypatch.setattr(
        alternatives_module, "plan_until_interrupted", Mock(side_effect=KeyboardInterrupt)
    )
    told = interrupted_explanation(made)  # at full speed it is planned anew
    assert (told.result, told.alternatives, told.complete) == (made, (), False)


def test_an_interrupt_of_the_plan_itself_plans_nothing_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(turning_drive, "turning_drives", Mock(side_effect=KeyboardInterrupt))
    told = interrupted_explanation(load_problem("rigid-move", gap=0.0))
    assert told.result.found
    assert (told.alternatives, told.complete) == ((), False)
    assert told.critical_path


def test_an_interrupt_after_the_time_limit_is_still_an_interrupt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0

    def interrupted(*_: object) -> None:
        nonlocal now
        now += 100.0
        raise KeyboardInterrupt

    monkeypatch.setattr(effort, "time", SimpleNamespace(process_time=lambda: now))
    monkeypatch.setattr(turning_drive, "turning_drives", interrupted)
    told = interrupted_explanation(load_problem("rigid-move", gap=0.0, time_limit_s=60.0))
    assert told.result.ending is Ending.INTERRUPTED
    assert not told.complete


# --- twosra explain ------------------------------------------------------------------------------


def test_the_command_prints_all_of_it(run: Run, explained: Callable[[str], Explanation]) -> None:
    told = explained("shape-change")
    code, out, err = run("explain", "shape-change")
    assert (code, err) == (0, "")
    for text in (
        told.result.message,
        *told.why,
        *(words for _, words in in_words(told.critical_path)),
        *(str(one) for one in told.hidden),
        *(one.change for one in told.alternatives),
        *(one.price for one in told.alternatives),
    ):
        assert " ".join(text.split()) in out


def test_the_command_says_that_it_was_interrupted(
    run: Run, explained: Callable[[str], Explanation], monkeypatch: pytest.MonkeyPatch
) -> None:
    part = dataclasses.replace(explained("paper-1"), complete=False, alternatives=())

    def interrupted(*_: object, **__: object) -> None:
        raise PlanInterrupted(part)

    monkeypatch.setattr("twosra_mpc.lab.analysis.explanation.explain", interrupted)
    code, out, err = run("explain", "paper-1")
    assert code == 4
    assert "234.58 s freezing both segments" in out
    assert err == "twosra: interrupted: not all alternatives were planned"


def test_the_command_says_why_there_is_no_plan(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    stuck = load_problem("paper-1", modes=[RIGID, SOFT_BOTH])
    monkeypatch.setattr("twosra_mpc.cli.options.load_problem", lambda *_, **__: stuck)
    code, out, _ = run("explain", "paper-1")
    assert code == 3
    assert "proved infeasible" in out


def test_a_limit_without_a_plan_is_no_plan(run: Run) -> None:
    code, out, _ = run("explain", "paper-1", "--work-limit", "1e-9")
    assert code == 4
    assert "raise work_limit" in out
