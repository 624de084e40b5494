"""``twosra verify``: a plan file that was changed in any way does not pass."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from once import planned, solved

from twosra_mpc import Result
from twosra_mpc.checking.plan_file import check_plan
from twosra_mpc.checking.verification import examine

Document = dict[str, Any]
Tamper = Callable[[Document], object]


@pytest.fixture
def run(run: Run) -> Run:
    """Run ``twosra verify``; see ``conftest``."""
    return partial(run, "verify")


@pytest.fixture
def document() -> Document:
    """A verified plan as plain data, free to be changed."""
    return deepcopy(solved("paper-1").to_dict())


def write(document: Document, path: Path) -> Path:
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


# --- plans that hold -----------------------------------------------------------------------------


def test_every_plan_that_was_made_is_verified(any_result: Result, tmp_path: Path) -> None:
    any_result.save(tmp_path / "plan.json")
    found = check_plan(tmp_path / "plan.json")
    assert found.ok, found.problems
    assert all(check.margin is None or check.margin >= 0 for check in found.checks)


@pytest.mark.parametrize(
    ("scenario", "given"),
    [
        ("shape-change", {"weights": {"energy_s_per_J": 0.1, "transition_s": 7.0}}),
        ("rigid-move", {"goal": {"x_m": 0.0}}),  # in which nothing happens
    ],
)
def test_plans_of_other_problems_are_verified(
    scenario: str, given: dict[str, Any], tmp_path: Path
) -> None:
    solved(scenario, **given).save(tmp_path / "plan.json")
    assert check_plan(tmp_path / "plan.json").ok


def test_a_verified_plan_shows_every_check_with_its_margin(
    run: Run, document: Document, tmp_path: Path
) -> None:
    write(document, tmp_path / "plan.json")
    code, out, err = run("plan.json")
    assert (code, err) == (0, "")
    assert out.endswith("plan.json: verified")
    assert "FAIL" not in out
    names = ["re-integration", "goal.x_m", "goal.kappa_per_m.1", "cost.energy_J", "gap"]
    for name in [*names, *(f"limit {limit}" for limit in document["verification"]["limits"])]:
        assert f"PASS {name} " in out
    for name, unit in (("wheel_speed_rad_s", "rad/s"), ("wheel_acceleration_rad_s2", "rad/s2")):
        margin = document["verification"]["limits"][name]
        assert f"limit {name} kept {margin:.3g} {unit}" in out


# --- tampering -----------------------------------------------------------------------------------


def samples(document: Document, name: str) -> list[Any]:
    rows: list[Any] = document["samples"][name]
    return rows


def moving(document: Document) -> int:
    """A sample in the middle of a motion."""
    rows = [i for i, v in enumerate(samples(document, "v")) if any(v)]
    return rows[len(rows) // 2]


def add(document: Document, name: str, by: float, column: int = 0) -> None:
    samples(document, name)[moving(document)][column] += by


def transition(document: Document, to: str) -> Document:
    found: Document = next(t for t in document["transitions"] if t["to"] == to)
    return found


def later(item: Document, by: float, *names: str) -> None:
    for name in names:
        item[name] += by


def move_phase(document: Document, by: float) -> None:
    later(document["phases"][-1], by, "start_s", "end_s")


def scale(document: Document, name: str, by: float) -> None:
    document["samples"][name] = [[by * x for x in row] for row in samples(document, name)]


def lower(numbers: Document, name: str) -> None:
    numbers[name] *= 1 - 1e-7


def lower_wheel_limit(document: Document) -> None:
    limits, margins = document["robot"]["limits"], document["verification"]["limits"]
    limits["wheel_speed_rad_s"] -= 1.1 * margins["wheel_speed_rad_s"]


TAMPERINGS: dict[str, tuple[Tamper, str]] = {
    "a wheel turned otherwise": (lambda d: add(d, "wheel_rad_s", -1.0), "do not turn as v asks"),
    "another mode": (lambda d: add(d, "mode", -1), "mode"),
    "a phase before the melt is done": (
        lambda d: later(transition(d, "soft"), 5.0, "done_s"),
        "while segment 1 is changing",
    ),
    "a freeze that is too short": (
        lambda d: later(transition(d, "rigid"), -10.0, "done_s"),
        "has changed at",
    ),
    "a phase at another time": (lambda d: move_phase(d, 1.0), "outside of a phase"),
    "a wrong temperature": (lambda d: add(d, "temperature_C", 5.0), "warmer or colder"),
    "a wrong melt fraction": (lambda d: add(d, "melt_fraction", -0.5), "more or less of it"),
    "weaker currents": (lambda d: scale(d, "heater_current_A", 0.95), "its currents"),
    "currents that flow backwards": (
        lambda d: scale(d, "heater_current_A", -1.0),
        "heater currents: at least -0.8 A",
    ),
    "another set-point": (lambda d: add(d, "heater_setpoint_C", -9.0), "heater 1 does not do"),
    "another cost": (lambda d: d["cost"].update(total=300.0), "cost.total: 300; the samples give"),
    "another duration": (lambda d: d["cost"].update(time_s=300.0), "cost.time_s: 300;"),
    "less energy": (lambda d: d["cost"].update(energy_J=600.0), "cost.energy_J: 600;"),
    "a little less energy": (lambda d: lower(d["cost"], "energy_J"), "cost.energy_J: "),
    "a little less effort": (lambda d: lower(d["cost"], "effort_s"), "cost.effort_s: "),
    "a little less cost": (lambda d: lower(d["cost"], "total"), "cost.total: "),
    "a little less time": (lambda d: lower(d["cost"], "time_s"), "cost.time_s: "),
    "a bound a little above the cost": (
        lambda d: d.update(lower_bound_s=d["cost"]["total"] * (1 + 1e-7), gap=0.0),
        "lower bound: above the cost that it bounds",
    ),
    "currents a little weaker": (
        lambda d: scale(d, "heater_current_A", 1 - 1e-7),
        "A of the heating policy",
    ),
    "fewer transitions": (lambda d: d["cost"].update(transitions=2), "cost.transitions: 2"),
    "a duration that is told otherwise": (lambda d: d.update(duration_s=300.0), "duration_s: 300"),
    "another gap": (lambda d: d.update(gap=0.0), "gap: 0; it should be"),
    "no gap": (lambda d: d.update(gap=None), "gap: none; it should be"),
    "another lower bound": (lambda d: d.update(lower_bound_s=300.0), "it should be 0.12"),
    "a bound above the cost": (
        lambda d: d.update(lower_bound_s=345.0, gap=0.0),
        "lower bound: above the cost",
    ),
    "warmer air": (lambda d: d["scenario"].update(ambient_C=30.0), "its currents make it"),
    "a weaker robot": (lower_wheel_limit, "limit wheel_speed_rad_s exceeded"),
    "another robot": (lambda d: d["scenario"].update(robot="2sr-v2"), "scenario.robot: '2sr-v2'"),
    "modes that were not allowed": (
        lambda d: d["scenario"].update(modes=[[0, 0], [1, 1]]),
        "modes of the scenario: [1,0] is not among them",
    ),
    "a gap that was asked and not reached": (
        lambda d: d["scenario"].update(gap=1e-12),
        "status: optimal; gap",
    ),
    "a proof without a bound": (
        lambda d: d.update(lower_bound_s=None, gap=None),
        "status: optimal: claimed without a lower bound",
    ),
    "a status that says there is no plan": (lambda d: d.update(status="failed"), "status: failed"),
    "a verification that failed": (
        lambda d: d["verification"].update(ok=False),
        "in the file: says failed",
    ),
    "a verification with other numbers": (
        lambda d: d["verification"]["limits"].update(unit_gap_m=1.0),
        "in the file: its numbers are others",
    ),
    "a verification with fewer limits": (
        lambda d: d["verification"]["limits"].pop("unit_gap_m"),
        "in the file: its numbers are others",
    ),
}


@pytest.mark.parametrize("how", TAMPERINGS)
def test_a_changed_plan_is_not_verified(how: str, document: Document, tmp_path: Path) -> None:
    tamper, told = TAMPERINGS[how]
    tamper(document)
    found = check_plan(write(document, tmp_path / "plan.json"))
    assert not found.ok
    assert any(told in problem for problem in found.problems), found.problems
    assert not all(check.ok for check in found.checks)  # the table shows it too


@pytest.mark.parametrize(
    ("how", "rule"),
    [
        ("a phase before the melt is done", "stiffness while moving"),
        ("a phase at another time", "samples and phases"),
        ("another set-point", "heating policy"),
        ("a freeze that is too short", "heating policy"),
    ],
)
def test_the_rule_that_is_broken_is_named(
    how: str, rule: str, document: Document, tmp_path: Path
) -> None:
    TAMPERINGS[how][0](document)
    found = check_plan(write(document, tmp_path / "plan.json"))
    (check,) = (check for check in found.checks if check.name == rule)
    assert not check.ok
    assert check.found in found.problems


def test_of_a_time_that_runs_backwards_nothing_else_is_said() -> None:
    made = planned("paper-1")
    checked = examine(made.trajectory)
    assert all(not broken for broken in checked.rules.values())
    backwards = dataclasses.replace(made.samples, t_s=made.samples.t_s[::-1])
    checked = examine(dataclasses.replace(made.trajectory, samples=backwards))
    assert checked.rules == {"time grid": ("the time of the samples does not grow",)}
    assert not checked.verification.ok


def test_a_plan_of_the_authors_sleeps_is_judged_by_its_own_rules(tmp_path: Path) -> None:
    document = deepcopy(solved("paper-1", timing="paper").to_dict())
    assert check_plan(write(document, tmp_path / "plan.json")).ok
    later(transition(document, "soft"), 10.0, "heater_s")
    found = check_plan(write(document, tmp_path / "plan.json"))
    assert not found.ok


# --- program -------------------------------------------------------------------------------------


def test_a_changed_plan_has_its_exit_code_and_is_told_why(
    run: Run, document: Document, tmp_path: Path
) -> None:
    document["gap"] = 0.5
    write(document, tmp_path / "plan.json")
    code, out, err = run("plan.json")
    assert (code, err) == (4, "")
    assert "FAIL gap 0.5; it should be" in out
    assert "plan.json: NOT VERIFIED gap: 0.5; it should be" in out


def test_several_files_are_checked_and_the_worst_counts(
    run: Run, document: Document, tmp_path: Path
) -> None:
    write(document, tmp_path / "good.json")
    write({**document, "gap": 0.5}, tmp_path / "bad.json")
    (tmp_path / "not.json").write_text("{}", encoding="utf-8")
    assert run("good.json", "good.json").code == 0
    code, out, err = run("not.json", "good.json")
    assert code == 2
    assert "good.json: verified" in out
    assert "not.json: format = (None, None) is not acceptable" in err
    code, out, _ = run("not.json", "bad.json", "good.json")
    assert code == 4
    assert "bad.json: NOT VERIFIED" in out
    assert "good.json: verified" in out


def test_a_program_reads_the_checks_as_json(run: Run, document: Document, tmp_path: Path) -> None:
    write(document, tmp_path / "good.json")
    write({**document, "gap": 0.5}, tmp_path / "bad.json")
    code, out, err = run("good.json", "bad.json", "--json")
    assert (code, err) == (4, "")
    good, bad = json.loads(out)
    assert (good["file"], good["verified"], good["problems"]) == ("good.json", True, [])
    assert (bad["file"], bad["verified"]) == ("bad.json", False)
    assert [check["name"] for check in bad["checks"] if not check["ok"]] == ["gap"]
    assert all(set(c) == {"name", "found", "ok", "margin", "unit"} for c in good["checks"])


def test_quiet_leaves_the_exit_code(run: Run, document: Document, tmp_path: Path) -> None:
    write(document, tmp_path / "good.json")
    write({**document, "gap": 0.5}, tmp_path / "bad.json")
    assert run("--quiet", "good.json") == (0, "", "")
    assert run("--quiet", "bad.json") == (4, "", "")


def test_a_file_without_a_plan_verifies_nothing(run: Run, tmp_path: Path) -> None:
    found = solved("paper-1", work_limit=1e-9)
    found.save(tmp_path / "none.json")
    code, out, _ = run("none.json")
    assert code == 4
    assert "none in this file: no plan found" in out
