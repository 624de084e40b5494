"""explain() of tasks: what they cost adds up, and every other way was planned."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from conftest import Run

from twosra_mpc import Explanation, Problem, explain, load_problem, plan
from twosra_mpc.lab.analysis.alternatives import Alternative
from twosra_mpc.problem.tasks import Pass, Reach, in_one_go


def reach(x_m: float, kappa_per_m: tuple[float, float], name: str) -> dict[str, Any]:
    box = {"kappa_per_m": (5.0, 5.0)}
    return {"do": "reach", "name": name, "x_m": x_m, "kappa_per_m": kappa_per_m, "tolerance": box}


def mission(**changes: Any) -> Problem:
    """Two tasks that one shape serves, and a goal that needs one of its own."""
    tasks = [reach(0.1, (20.0, 20.0), "dock"), reach(0.2, (20.0, 25.0), "shelf")]
    goal = {"x_m": 0.0, "kappa_per_m": (0.0, 20.0)}
    given = {"tasks": tasks, "goal": goal, "obstacles": (), "time_limit_s": 10.0, **changes}
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}
    return load_problem("rigid-move", start=start, **given)


@pytest.fixture(scope="module")
def explained() -> Explanation:
    return explain(mission())


def other_orders(explained: Explanation) -> list[Alternative]:
    return [each for each in explained.alternatives if each.change.startswith("in the order")]


def test_what_tasks_cost_adds_up_to_the_plan(explained: Explanation) -> None:
    made = explained.result.require()
    assert [each.words for each in explained.tasks] == [
        "reach dock",
        "reach shelf",
        "reach the goal",
    ]
    assert sum(each.duration_s for each in explained.tasks) == pytest.approx(made.duration_s)
    assert sum(each.energy_J for each in explained.tasks) == pytest.approx(made.cost.energy_J)
    melts = [item.segment for item in made.transitions if item.to == "soft"]
    assert sum(len(each.melted) for each in explained.tasks) == len(melts)
    assert sum(each.duration_s for each in explained.critical_path) == pytest.approx(
        made.duration_s
    )


def test_what_a_task_finds_melted_and_frozen_is_said(explained: Explanation) -> None:
    dock, shelf, home = explained.tasks
    assert not shelf.melted
    assert shelf.shape_of == "reach dock"
    assert dock.melted
    assert home.melted
    assert "in the shape of reach dock: no melt of its own" in str(explained)


def test_the_other_order_costs_what_planning_it_does(explained: Explanation) -> None:
    (other,) = other_orders(explained)
    assert other.change == "in the order reach shelf, reach dock"
    quick = other.original
    turned = quick.problem.with_values(tasks=quick.problem.tasks[::-1])
    again = plan(turned).require().cost.total
    assert other.difference_s == pytest.approx(again - quick.cost.total)
    assert explained.orders_left == 0


def test_where_the_order_was_chosen_the_one_listed_is_another() -> None:
    listed = [reach(0.1, (20.0, 0.0), "desk"), reach(-0.1, (0.0, 0.0), "door")]
    found = explain(mission(tasks=listed, order="free", motion="fastest"))
    assert [each.words for each in found.tasks][:2] == ["reach door", "reach desk"]
    assert found.tasks[0].shape_of == "the start"
    (other,) = found.alternatives
    assert other.change == "in the order reach desk, reach door"
    assert other.difference_s is not None
    assert other.difference_s > 0


def test_of_many_orders_some_are_planned() -> None:
    problem = mission(tasks=[reach(0.1, (0.0, 0.0), name) for name in "abcd"])
    result = plan(problem)
    told: list[str] = []
    found = explain(result, on_progress=told.append, most_orders=2)
    assert (len(found.alternatives), found.orders_left) == (2, 21)
    assert len([words for words in told if words.startswith("in the order")]) == 2


def test_no_plan_has_its_reason() -> None:
    found = explain(mission(modes=[(0, 0), (1, 0)]))
    assert (found.tasks, found.alternatives, found.orders_left) == ((), (), 0)
    assert found.complete
    assert str(found) == found.result.message


def test_what_is_done_with_an_object_in_hand_stays_together() -> None:
    tasks = load_problem("tidy-up").tasks
    assert in_one_go(tasks, None) == [tasks[:3], tasks[3:]]
    assert in_one_go(tasks[1:], "cup") == [tasks[1:3], tasks[3:]]
    box = Pass(x_m=(0.0, 0.1))
    some = [Reach(goal={"x_m": float(i)}) for i in range(2)]
    assert in_one_go([some[0], box, some[1]], None) == [(some[0],), (box, some[1])]


def test_the_command_prints_it_and_writes_json(run: Run) -> None:
    code, out, err = run("explain", "conform-cylinder", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert [each["words"] for each in found["tasks"]] == ["conform to cylinder"]
    assert found["alternatives"] == []
    total = sum(each["duration_s"] for each in found["tasks"])
    assert total == pytest.approx(found["plan"]["duration_s"])
    code, out, _ = run("explain", "three-shapes", "--time-limit", "60")
    assert code == 0
    assert "in the shape of reach dock" in out
    assert "in the order" in out


def test_a_cheaper_order_becomes_the_plan() -> None:
    """Where the order is free, a dear order is given away for the cheap one among the others."""
    dear = load_problem("three-shapes", motion="fastest")
    tasks = dear.tasks[::-1]
    found = plan(dear.with_values(tasks=tasks)).require()
    asked = found.problem.with_values(order="free")
    given = replace(found, trajectory=replace(found.trajectory, problem=asked))
    told = explain(replace(plan(dear), problem=asked, plan=given))
    made = told.result.require()
    assert made.cost.total < found.cost.total
    assert made.problem.tasks == dear.tasks
    assert made.verification.ok
    assert all((other.difference_s or 0.0) >= 0.0 for other in told.alternatives)
