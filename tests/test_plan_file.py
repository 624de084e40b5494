"""Plan and set-point files: the contract, what holds between rows, rates and atomic writing."""

from __future__ import annotations

import base64
import csv
import errno
import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from once import planned, solved
from scipy.integrate import solve_ivp

from twosra_mpc import (
    InputError,
    NoPlanError,
    Plan,
    Problem,
    Result,
    Status,
    __version__,
    check_plan,
    load_plan,
    load_problem,
    load_robot,
    plan,
    save_setpoints,
)
from twosra_mpc.effort import Ending
from twosra_mpc.files import write_text
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.plans.plan import Cost, percent
from twosra_mpc.plans.setpoints import columns
from twosra_mpc.plans.trajectory import SAME_TIME_S
from twosra_mpc.robot.description import Robot, segment_model

Array = NDArray[np.float64]

DEFECT = 1e-6  # m, rad, 1/m
EVENT_S = 2e-6  # inputs may change this much before or after their event


@pytest.fixture(scope="module")
def infeasible() -> Result:
    """Proved infeasible: [1,1] alone bends both segments by the same angle."""
    goal = {"kappa_per_m": (20.0, -10.0)}
    return solved("shape-change", goal=goal, modes=((0, 0), (1, 1)))


@pytest.fixture(scope="module")
def empty() -> Result:
    """The goal is where the robot is already."""
    return solved("rigid-move", goal={"x_m": 0.0})


# --- the JSON file -------------------------------------------------------------------------------

CONTRACT = {
    "": {
        *("format", "version", "package", "robot", "scenario", "planner", "status", "message"),
        *("duration_s", "lower_bound_s", "gap", "cost", "phases", "transitions", "samples"),
        *("fastest_cost_s", "search_gap", "confirmed_duration_s", "confirmed_lower_bound_s"),
        *("verification", "stats"),
    },
    "cost": {"total", "time_s", "energy_J", "transitions", "effort_s"},
    "phases": {"mode", "start_s", "end_s"},
    "transitions": {"segment", "to", "heater_s", "onset_s", "done_s"},
    "samples": {
        *("t_s", "q", "v", "a", "mode", "wheel_rad_s", "temperature_C", "melt_fraction"),
        *("heater_setpoint_C", "heater_current_A"),
    },
    "verification": {"max_defect", "goal_error", "limits", "ok"},
    "stats": {
        *("wall_s", "sequences_bounded", "sequences_solved", "nlp_iterations"),
        *("work", "first_plan_work"),
    },
}
EXTENSIONS = {"": {"stopped_early", "ending"}, "verification": {"problems"}}
WIDTHS = {
    **{"q": 5, "v": 5, "a": 5, "mode": 2, "wheel_rad_s": 4, "temperature_C": 2},
    **{"melt_fraction": 2, "heater_setpoint_C": 2, "heater_current_A": 2},
}


def table(document: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """The tables of the document under ``name``; the document itself under the empty name."""
    inner = document[name] if name else document
    return inner if isinstance(inner, list) else [inner]


@pytest.mark.parametrize("name", CONTRACT)
def test_the_keys_are_exactly_those_of_the_contract(any_result: Result, name: str) -> None:
    tables = table(any_result.to_dict(), name)
    assert tables
    for inner in tables:
        assert set(inner) == CONTRACT[name] | EXTENSIONS.get(name, set())


def test_the_values_have_the_types_of_the_contract(any_result: Result, tmp_path: Path) -> None:
    any_result.save(tmp_path / "plan.json")
    text = (tmp_path / "plan.json").read_text(encoding="utf-8")
    assert text.endswith("}\n")
    data = json.loads(text)
    assert (data["format"], data["version"], data["package"]) == ("twosra-plan", 2, __version__)
    assert data["planner"] in ("optimal", "greedy")
    assert data["status"] in ("optimal", "feasible", "infeasible", "failed")
    assert type(data["message"]) is str
    assert data["message"]
    for number in (data["duration_s"], *list(data["cost"].values())[:3]):
        assert type(number) is float
    assert type(data["cost"]["transitions"]) is int
    proved = data["planner"] == "optimal"
    assert (data["lower_bound_s"] is None, data["gap"] is None) == (not proved, not proved)
    for phase in data["phases"]:
        assert [type(bit) for bit in phase["mode"]] == [int, int]
        assert 0.0 <= phase["start_s"] < phase["end_s"] <= data["duration_s"] + 1e-9
    for item in data["transitions"]:
        assert item["segment"] in (1, 2)
        assert item["to"] in ("soft", "rigid")
        assert 0.0 <= item["heater_s"] <= item["onset_s"] <= item["done_s"]
        assert item["done_s"] <= data["duration_s"] + 1e-9
    assert data["verification"]["ok"] is True
    assert data["verification"]["problems"] == []
    assert len(data["verification"]["goal_error"]) == 5
    assert all(type(margin) is float for margin in data["verification"]["limits"].values())
    assert type(data["stats"]["sequences_bounded"]) is int
    assert type(data["stopped_early"]) is bool


def test_every_sample_list_has_one_row_a_sample(any_result: Result) -> None:
    data = json.loads(json.dumps(any_result.to_dict(), allow_nan=False))["samples"]
    assert all(type(t) is float for t in data["t_s"])
    assert len(any_result.plan.samples) == len(data["t_s"])
    for name, width in WIDTHS.items():
        assert len(data[name]) == len(data["t_s"]), name
        assert {len(row) for row in data[name]} == {width}, name
        kind = int if name == "mode" else float
        assert {type(item) for row in data[name] for item in row} == {kind}, name
    assert {bit for row in data["mode"] for bit in row} <= {0, 1}


def test_the_robot_and_the_scenario_in_the_file_are_complete(any_result: Result) -> None:
    data = any_result.to_dict()
    assert Robot(**data["robot"]) == any_result.problem.robot == load_problem("paper-1").robot
    assert data["scenario"] == any_result.problem.scenario()
    assert data["scenario"]["timing"] == any_result.problem.timing


def energy_J(some: Plan) -> float:
    """Heat that the currents of the samples give off in the coils."""
    samples = some.samples
    held_s, currents = np.diff(samples.t_s).tolist(), samples.heater_current_A
    total = 0.0
    if some.problem.timing == "nominal":  # the hotter the coil, the more it resists
        model = segment_model(some.robot, some.problem.ambient, 0)
        for j, temperature in enumerate(some.problem.temperatures):
            state = model.initial(temperature)
            for current, held in zip(currents[:-1, j].tolist(), held_s, strict=True):
                total += model.energy_J(state, current, held)
                state = model.propagate(state, current, held)
        return total
    return float((held_s @ (some.robot.heater.resistance_ohm * currents[:-1] ** 2)).sum())


def test_the_cost_is_the_time_and_energy_of_the_samples(any_plan: Plan) -> None:
    samples, cost = any_plan.samples, any_plan.cost
    assert cost.time_s == any_plan.duration_s == samples.t_s[-1]
    assert cost.energy_J == pytest.approx(energy_J(any_plan), rel=1e-5)
    assert cost.transitions == len(any_plan.transitions)
    assert cost.total == pytest.approx(cost.time_s)  # the default weights count seconds


def test_a_bound_is_never_above_the_cost_it_bounds(any_plan: Plan) -> None:
    if any_plan.planner == "greedy":
        assert any_plan.lower_bound is None
        assert any_plan.gap is None
        assert any_plan.status is Status.FEASIBLE
    else:
        assert any_plan.lower_bound is not None
        assert any_plan.gap is not None
        assert any_plan.lower_bound <= any_plan.cost.total
        assert any_plan.gap == pytest.approx(1 - any_plan.lower_bound / any_plan.cost.total)
        assert any_plan.gap <= any_plan.problem.gap
        assert any_plan.status is Status.OPTIMAL


def test_a_plan_file_reads_back_as_the_same_plan(any_result: Result, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    any_result.save(path)
    again = load_plan(path)
    assert again.to_dict() == any_result.to_dict()
    assert again.problem == any_result.problem
    assert again.plan.phases == any_result.plan.phases
    assert again.plan.transitions == any_result.plan.transitions
    assert again.status is any_result.status
    assert not again.plan.samples.q.flags.writeable
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_a_plan_that_was_not_found_reads_back_too(infeasible: Result, tmp_path: Path) -> None:
    infeasible.save(tmp_path / "plan.json")
    data = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
    unknown = ("duration_s", "lower_bound_s", "gap", "fastest_cost_s", "search_gap", "cost")
    for key in (*unknown, "samples", "verification"):
        assert data[key] is None
    assert data["phases"] == data["transitions"] == []
    assert set(data) == CONTRACT[""] | EXTENSIONS[""]
    assert load_plan(tmp_path / "plan.json").to_dict() == infeasible.to_dict()


def test_an_empty_plan_has_one_sample_no_cost_and_no_gap(empty: Result, tmp_path: Path) -> None:
    assert empty.found
    made = empty.require()
    assert (made.duration_s, made.gap, made.phases) == (0.0, 0.0, ())
    assert made.samples.t_s.tolist() == [0.0]
    empty.save(tmp_path / "plan.json")
    assert load_plan(tmp_path / "plan.json").to_dict() == empty.to_dict()
    regular, own = columns(made.trajectory.held(10.0)), columns(made.samples)
    assert [regular[name].tolist() for name in own] == [own[name].tolist() for name in own]


def test_only_verified_plans_pass_require(any_result: Result, infeasible: Result) -> None:
    assert any_result.found
    assert any_result.require() is any_result.plan
    assert not infeasible.found
    with pytest.raises(NoPlanError, match="infeasible") as caught:
        infeasible.require()
    assert (caught.value.status, caught.value.reason) == ("infeasible", infeasible.message)
    failed = replace(infeasible, status=Status.FAILED)
    with pytest.raises(NoPlanError, match=r"no verified plan \(failed\)"):
        failed.require()


def test_the_gap_is_that_between_cost_and_bound() -> None:
    made = replace(planned("paper-2"), cost=Cost(200.0, 200.0, energy_J=0.0, transitions=0))
    assert replace(made, lower_bound=None).gap is None
    assert replace(made, lower_bound=100.0).gap == 0.5
    assert replace(made, lower_bound=201.0).gap == 0.0


@pytest.mark.parametrize(
    ("name", "weights"),
    [
        *[("paper-2", weights) for weights in ({}, {"transition_s": 5.0}, {"energy_s_per_J": 0.1})],
        ("shape-change", {"energy_s_per_J": 0.1}),
        ("three-shapes", {"transition_s": 5.0}),
    ],
)
def test_what_the_search_proved_and_what_is_slow_on_purpose_are_two_numbers(
    name: str, weights: dict[str, float], tmp_path: Path
) -> None:
    """At full speed the same problem is planned to the same cost, which is verified there."""
    gentle, quick = (
        planned(name, weights=weights, motion=motion) for motion in ("gentle", "fastest")
    )
    assert (quick.fastest_cost, quick.search_gap) == (quick.cost.total, quick.gap)
    assert (quick.slower_by, "gently" in str(quick)) == (0.0, False)
    assert gentle.fastest_cost == pytest.approx(quick.cost.total, rel=1e-6)
    assert gentle.search_gap == pytest.approx(quick.gap, abs=1e-6)
    assert gentle.slower_by == pytest.approx(gentle.cost.total - quick.cost.total, abs=1e-3)
    told = f"full speed {'cost ' if weights else ''}{quick.cost.total:.1f} s, "
    assert (told in str(gentle)) == bool(gentle.slower_by)
    assert gentle.slower_by or name == "three-shapes"  # whose gap is larger than asked
    younger = plan(gentle.problem), lambda d: (d.pop("fastest_cost_s"), d.pop("search_gap"))
    path = edited(*younger, tmp_path / "plan.json")
    older = load_plan(path).require()  # as written before: nothing is known of the search
    assert (older.search_gap, older.slower_by, older.gap) == (None, None, gentle.gap)
    assert str(older).endswith(f" s, proved within {percent(gentle.gap or 0.0)} of the best")


def test_the_status_of_a_plan_follows_from_its_gap_and_verification() -> None:
    made = planned("paper-2")
    failed = replace(made.verification, ok=False)
    assert made.status is Status.OPTIMAL
    assert replace(made, lower_bound=0.5 * made.cost.total).status is Status.FEASIBLE
    assert replace(made, verification=failed).status is Status.FAILED


def test_results_and_plans_are_shown_in_one_line(any_result: Result, infeasible: Result) -> None:
    for shown in (any_result, any_result.plan, infeasible):
        assert "\n" not in repr(shown)
        assert len(repr(shown)) < 500
    assert str(any_result.plan) in repr(any_result)


def test_a_notebook_shows_the_figure_or_why_there_is_none(infeasible: Result) -> None:
    found = solved("rigid-move")
    html = found.require()._repr_html_()
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    assert base64.b64decode(picture).startswith(b"\x89PNG")
    assert found._repr_html_().startswith(f"<p>{found.status}: [0,0]")
    assert "proved infeasible" in infeasible._repr_html_()
    assert "<img" not in infeasible._repr_html_()


@pytest.mark.parametrize("ending", [*Ending, None])
def test_why_the_search_ended_is_in_the_file(
    infeasible: Result, ending: Ending | None, tmp_path: Path
) -> None:
    replace(infeasible, ending=ending).save(tmp_path / "plan.json")
    assert load_plan(tmp_path / "plan.json").ending is ending


@pytest.mark.parametrize(("early", "ending"), [(True, Ending.LIMIT), (False, None)])
def test_files_that_do_not_say_why_the_search_ended_still_load(
    early: bool, ending: Ending | None, tmp_path: Path
) -> None:
    path = edited(
        solved("paper-2"),
        lambda d: (d.pop("ending"), d.update(stopped_early=early)),
        tmp_path / "plan.json",
    )
    again = load_plan(path)
    assert (again.ending, again.stopped_early) == (ending, early)
    assert again.require().cost == solved("paper-2").require().cost


@pytest.mark.parametrize(("margin", "verified"), [("body_gap_m", True), ("unit_gap_m", False)])
def test_files_from_before_a_limit_still_verify(
    margin: str, verified: bool, tmp_path: Path
) -> None:
    path = edited(
        solved("paper-2"), lambda d: d["verification"]["limits"].pop(margin), tmp_path / "plan.json"
    )
    assert check_plan(path).ok == verified


@pytest.mark.parametrize(("share", "verified"), [(2e-8, True), (-2e-8, True), (1e-7, False)])
def test_an_effort_may_be_that_of_another_quadrature(
    share: float, verified: bool, tmp_path: Path
) -> None:
    """Versions differ by 2e-8 of it at most; a plan that says less may undercut a bound."""

    def edit(document: dict[str, Any]) -> None:
        document["cost"]["effort_s"] *= 1 + share

    assert check_plan(edited(solved("paper-2"), edit, tmp_path / "plan.json")).ok == verified


def test_a_file_of_version_1_holds_its_inputs(tmp_path: Path) -> None:
    robot = load_robot("2sra-v1-paper")
    some = solved("shape-change", robot=robot)
    assert not some.require().samples.a.any()  # this robot may start and stop at once

    def written_then(document: dict[str, Any]) -> None:
        document["version"] = 1
        del document["samples"]["a"]

    again = load_plan(edited(some, written_then, tmp_path / "plan.json"))
    assert again.to_dict() == some.to_dict()


# --- bad plan files ------------------------------------------------------------------------------

Edit = Callable[[dict[str, Any]], object]
BAD_PLANS: dict[str, tuple[Edit, str]] = {
    "another format": (lambda d: d.update(format="other"), "format"),
    "a later version": (lambda d: d.update(version=4), "format"),
    "no format": (lambda d: d.pop("format"), "format"),
    "no robot": (lambda d: d.pop("robot"), "plan.robot"),
    "no status": (lambda d: d.pop("status"), "plan.status"),
    "no samples": (lambda d: d.pop("samples"), "plan.samples"),
    "no stats": (lambda d: d.pop("stats"), "plan.stats"),
    "no goal errors": (
        lambda d: d["verification"].pop("goal_error"),
        "plan.verification.goal_error",
    ),
    "a list of samples missing": (lambda d: d["samples"].pop("q"), "plan.samples"),
    "no rates of the inputs": (lambda d: d["samples"].pop("a"), "plan.samples"),
    "an unknown list of samples": (lambda d: d["samples"].update(z=[]), "plan.samples"),
    "a phase without mode": (lambda d: d["phases"][0].pop("mode"), "plan.phases.0.mode"),
    "no onset": (lambda d: d["transitions"][0].pop("onset_s"), "plan.transitions.0.onset_s"),
    "an unknown key of the cost": (lambda d: d["cost"].update(money=1.0), "plan.cost.money"),
    "phases that are no list": (lambda d: d.update(phases=3), "plan.phases"),
    "samples without cost": (lambda d: d.update(cost=None), "plan.cost"),
    "samples without verification": (lambda d: d.update(verification=None), "plan.verification"),
    "samples that are a list": (lambda d: d.update(samples=[1, 2]), "plan.samples"),
    "a bad robot": (lambda d: d["robot"].update(name=3), "name"),
    "a bad scenario": (lambda d: d["scenario"].update(gap=3.0), "gap"),
}
BAD_VALUES: dict[str, Edit] = {
    "an unknown status": lambda d: d.update(status="great"),
    "an unknown planner": lambda d: d.update(planner="lucky"),
    "samples of different lengths": lambda d: d["samples"]["q"].pop(),
    "a ragged list of samples": lambda d: d["samples"]["q"][0].pop(),
    "samples of the wrong width": lambda d: d["samples"].update(
        v=[row[:4] for row in d["samples"]["v"]]
    ),
    "a word among the samples": lambda d: d["samples"]["t_s"].append("later"),
    "an unknown stiffness": lambda d: d["transitions"][0].update(to="warm"),
    "a third segment": lambda d: d["transitions"][0].update(segment=3),
    "a cost in words": lambda d: d["cost"].update(total="cheap"),
    "a phase in words": lambda d: d["phases"][0].update(start_s="soon"),
}

ODD_VALUES: dict[str, Edit] = {
    "a segment that is partly soft": lambda d: d["samples"]["mode"][0].__setitem__(0, 0.7),
    "time that runs backwards": lambda d: d["samples"]["t_s"].reverse(),
    "a phase in a mode that does not exist": lambda d: d["phases"][0].update(mode=[3, 7]),
    "a verification in words": lambda d: d["verification"].update(ok="yes"),
}


def edited(some: Result, edit: Edit, path: Path) -> Path:
    """Save the plan with its document edited."""
    data = json.loads(json.dumps(some.to_dict()))
    edit(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


@pytest.mark.parametrize("mistake", BAD_PLANS)
def test_a_file_that_is_no_plan_is_refused(mistake: str, tmp_path: Path) -> None:
    edit, field = BAD_PLANS[mistake]
    path = edited(solved("shape-change"), edit, tmp_path / "plan.json")
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert caught.value.field == field
    assert str(path) in str(caught.value)
    assert str(path) in (caught.value.source or "")
    if field == "format":
        assert "'twosra-plan' version 1, 2 or 3" in caught.value.allowed


@pytest.mark.parametrize("mistake", ["no status", "no stats", "no onset"])
def test_a_missing_key_of_a_plan_is_named_in_one_line(mistake: str, tmp_path: Path) -> None:
    edit, field = BAD_PLANS[mistake]
    path = edited(solved("shape-change"), edit, tmp_path / "plan.json")
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert (caught.value.field, caught.value.value) == (field, "missing")
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("mistake", ODD_VALUES)
def test_a_plan_that_no_planner_writes_is_refused(mistake: str, tmp_path: Path) -> None:
    path = edited(solved("shape-change"), ODD_VALUES[mistake], tmp_path / "plan.json")
    with pytest.raises(InputError, match=re.escape(str(path))):
        load_plan(path)


@pytest.mark.parametrize("mistake", BAD_VALUES)
def test_a_plan_that_does_not_fit_together_is_refused(mistake: str, tmp_path: Path) -> None:
    path = edited(solved("shape-change"), BAD_VALUES[mistake], tmp_path / "plan.json")
    with pytest.raises(InputError) as caught:
        load_plan(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"{", b"[]", b"\xff", None])
def test_a_file_that_is_no_json_table_is_no_plan(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"plan\.json") as caught:
        load_plan(path)
    assert caught.value.field == "file"


# --- samples -------------------------------------------------------------------------------------


def follow(some: Plan, row: int, q: Array, duration_s: float) -> Array:
    """Integrate q' = J(q, mode) (v + a t) for some time after a sample."""
    jacobian, samples = kinematics(some.robot).jacobian, some.samples
    v, a, mode = samples.v[row], samples.a[row], samples.mode[row]
    if duration_s <= 0.0 or not samples.moves[row]:
        return q
    end = solve_ivp(
        lambda t, at: (jacobian(at, mode) @ (v + a * t)).full().ravel(),
        (0.0, duration_s),
        q,
        rtol=1e-9,
        atol=1e-11,
    )
    reached: Array = end.y[:, -1]
    return reached


def test_time_runs_from_zero_and_never_stands_still(any_plan: Plan) -> None:
    t = any_plan.samples.t_s
    assert t[0] == 0.0
    assert (np.diff(t) > 0.0).all()
    assert t[-1] == any_plan.duration_s
    events = [time for item in any_plan.transitions for time in item[2:]]
    assert t[-1] == pytest.approx(max(*events, any_plan.phases[-1].end_s), abs=EVENT_S)


@pytest.mark.parametrize("planner", ["optimal", "greedy"])
def test_samples_are_further_apart_than_what_counts_as_one_time(planner: str) -> None:
    samples = planned("paper-1", planner=planner).samples
    assert np.diff(samples.t_s).min() > SAME_TIME_S


def test_the_robot_rests_at_the_end_and_between_phases(any_plan: Plan) -> None:
    samples = any_plan.samples
    assert not samples.v[-1].any()
    assert not samples.wheel_rad_s[-1].any()
    middle = (samples.t_s[:-1] + samples.t_s[1:]) / 2
    moving = samples.moves
    for t, moves, mode in zip(middle, moving[:-1], samples.mode[:-1], strict=True):
        inside = [phase.mode for phase in any_plan.phases if phase.start_s < t < phase.end_s]
        assert bool(inside) == moves
        if moves:
            assert inside == [tuple(mode)]
    assert not samples.wheel_rad_s[~moving].any()


def test_the_wheels_do_what_the_inputs_ask(any_plan: Plan) -> None:
    samples = any_plan.samples
    wheels = kinematics(any_plan.robot).wheel_matrix
    for q, v, mode, wheel in zip(
        samples.q, samples.v, samples.mode, samples.wheel_rad_s, strict=True
    ):
        if v.any():
            assert (wheels(q, mode) @ v).full().ravel() == pytest.approx(wheel, abs=1e-12)
    assert np.abs(samples.wheel_rad_s).max() <= any_plan.robot.limits.wheel_speed_rad_s + 1e-6


def test_holds_are_sampled_at_least_every_five_seconds(any_plan: Plan) -> None:
    assert np.diff(any_plan.samples.t_s).max() <= 5.0 + EVENT_S


def test_every_event_of_a_heater_is_a_sample(any_plan: Plan) -> None:
    t = any_plan.samples.t_s
    for item in any_plan.transitions:
        for time in (item.heater_s, item.onset_s, item.done_s):
            assert np.abs(t - time).min() <= EVENT_S


def test_samples_cannot_be_changed(any_plan: Plan) -> None:
    for name, array in vars(any_plan.samples).items():
        assert not array.flags.writeable, name


# --- set-points ----------------------------------------------------------------------------------

HEADER = (
    "t_s,mode1,mode2,wheel1_rad_s,wheel2_rad_s,wheel3_rad_s,wheel4_rad_s,heater1_C,heater2_C,"
    "current1_A,current2_A,x_m,y_m,phi_rad,kappa1_per_m,kappa2_per_m,temperature1_C,temperature2_C,"
    "melt_fraction1,melt_fraction2"
)
ORDER = [
    *("t_s", "mode", "wheel_rad_s", "heater_setpoint_C", "heater_current_A", "q"),
    *("temperature_C", "melt_fraction"),
]


def test_the_csv_file_is_the_samples_with_wheel_speeds_that_hold(
    any_plan: Plan, tmp_path: Path
) -> None:
    save_setpoints(any_plan, tmp_path / "points.csv")
    raw = (tmp_path / "points.csv").read_bytes()
    assert b"\r" not in raw
    header, *lines = raw.decode("utf-8").splitlines()
    assert header == HEADER
    samples, turned = any_plan.samples, any_plan.trajectory.wheel_travel_rad
    assert len(lines) == len(samples)
    means = np.diff(turned(samples.t_s), axis=0) / np.diff(samples.t_s)[:, None]
    given = vars(samples) | {"wheel_rad_s": np.vstack([means, np.zeros(4)])}
    expected = np.column_stack([given[name] for name in ORDER])
    found = np.array([[float(item) for item in row] for row in csv.reader(lines)])
    assert np.array_equal(found, expected)
    assert {item for row in csv.reader(lines) for item in row[1:3]} <= {"0", "1"}


@lru_cache(maxsize=64)
def held(some: Plan, rate_Hz: float) -> dict[str, Array]:
    """Columns of the set-points at a rate by name of the samples' array."""
    named = columns(some.trajectory.held(rate_Hz))
    assert ",".join(named) == HEADER
    widths = [1 if name == "t_s" else WIDTHS[name] for name in ORDER]
    parts = np.split(np.column_stack(list(named.values())), np.cumsum(widths)[:-1], axis=1)
    found = dict(zip(ORDER, parts, strict=True))
    found["t_s"] = found["t_s"].ravel()
    return found


@pytest.mark.parametrize("rate_Hz", [0.001, 0.3, 1.0, 2.3])
def test_rows_lie_on_a_regular_grid_and_where_phases_begin_and_end(
    any_plan: Plan, rate_Hz: float
) -> None:
    t, end = held(any_plan, rate_Hz)["t_s"], any_plan.samples.t_s[-1]
    regular = np.arange(int(end * rate_Hz) + 1) / rate_Hz
    ends = [time for phase in any_plan.phases for time in (phase.start_s, phase.end_s)]
    asked = np.array([*regular, *ends, end])
    assert t[0] == 0.0
    assert t[-1] == end
    assert np.abs(t[:, None] - asked).min(axis=1).max() <= EVENT_S
    assert np.abs(asked[:, None] - t).min(axis=1).max() <= EVENT_S
    assert np.diff(t).min() > 0.0
    assert np.diff(t).max() <= 1 / rate_Hz + EVENT_S


@pytest.mark.parametrize("rate_Hz", [1.0, 2.3])
def test_commands_are_those_in_force_and_wheels_turn_as_far_as_in_the_plan(
    any_plan: Plan, rate_Hz: float
) -> None:
    points, samples = held(any_plan, rate_Hz), any_plan.samples
    clear = np.abs(points["t_s"][:, None] - samples.t_s).min(axis=1) > EVENT_S
    clear |= np.isin(points["t_s"], samples.t_s)
    assert clear.sum() > 100
    in_force = np.searchsorted(samples.t_s, points["t_s"], side="right") - 1
    for name in ("mode", "heater_setpoint_C", "heater_current_A"):
        assert np.array_equal(points[name][clear], getattr(samples, name)[in_force][clear]), name
    turned = points["wheel_rad_s"][:-1] * np.diff(points["t_s"])[:, None]
    meant = np.diff(any_plan.trajectory.wheel_travel_rad(points["t_s"]), axis=0)
    assert np.abs(turned - meant).max() <= 1e-12
    assert np.abs(points["wheel_rad_s"]).max() <= np.abs(samples.wheel_rad_s).max() + 1e-9


@pytest.mark.parametrize("planner", ["optimal", "greedy"])
@pytest.mark.parametrize(
    ("timing", "rate_Hz"), [("nominal", 7.3), ("constant", 2.3), ("paper", 1.0)]
)
def test_configurations_at_a_rate_follow_the_path(
    planner: str, timing: str, rate_Hz: float
) -> None:
    found = planned("paper-1", planner=planner, timing=timing)
    points, samples = held(found, rate_Hz), found.samples
    last = np.searchsorted(samples.t_s, points["t_s"], side="right") - 1
    for t, q, i in zip(points["t_s"], points["q"], last, strict=True):
        span = float(t - samples.t_s[i])
        expected = follow(found, i, samples.q[i], span)
        assert np.abs(q - expected).max() <= 10 * DEFECT, t  # events within 1e-6 s are one
    assert np.abs(points["q"][-1] - samples.q[-1]).max() <= DEFECT


def test_a_rate_changes_nothing_at_common_times(any_plan: Plan) -> None:
    points, samples = held(any_plan, 1.0), any_plan.samples
    common = np.isin(points["t_s"], samples.t_s)
    assert common.sum() >= 60
    at = np.searchsorted(samples.t_s, points["t_s"][common])
    for name in ("q", "temperature_C", "melt_fraction", "mode", "heater_setpoint_C"):
        difference = points[name][common] - getattr(samples, name)[at]
        assert np.abs(difference).max() <= 1e-12, name


def test_configurations_at_a_rate_are_continuous() -> None:
    fine = planned("rigid-move")
    points = held(fine, 200.0)
    speed = np.abs(np.diff(fine.samples.q, axis=0)) / np.diff(fine.samples.t_s)[:, None]
    steps = np.abs(np.diff(points["q"], axis=0)) / np.diff(points["t_s"])[:, None]
    assert (steps <= 1.1 * speed.max(axis=0) + 1e-9).all()


@given(rate_Hz=st.floats(0.01, 40.0))
def test_any_rate_keeps_the_ends_of_the_plan(rate_Hz: float) -> None:
    found = planned("rigid-move")
    points, samples = held(found, rate_Hz), found.samples
    assert np.array_equal(points["q"][0], samples.q[0])
    assert np.abs(points["q"][-1] - samples.q[-1]).max() <= DEFECT
    assert (np.diff(points["t_s"]) > 0).all()
    assert not points["wheel_rad_s"][-1].any()


@pytest.mark.parametrize("rate_Hz", [0.0, -1.0, math.nan, math.inf, -math.inf])
def test_a_rate_that_is_not_positive_and_finite_is_refused(rate_Hz: float, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        save_setpoints(planned("rigid-move"), tmp_path / "points.csv", rate_Hz)
    assert caught.value.field.startswith("rate")
    assert repr(caught.value.value) == repr(rate_Hz)
    assert caught.value.allowed in ("more than 0 and at most 1000 Hz", "a finite number")
    assert not list(tmp_path.iterdir())


def test_the_highest_rate_is_allowed_and_more_is_refused(empty: Result) -> None:
    empty.require().trajectory.held(1000.0)
    with pytest.raises(InputError, match="at most 1000 Hz") as caught:
        empty.require().trajectory.held(1000.1)
    assert (caught.value.field, caught.value.value) == ("rate", 1000.1)


# --- atomic writing ------------------------------------------------------------------------------


@pytest.mark.parametrize("named", [False, True])
def test_a_file_is_replaced_as_a_whole(
    named: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if named:  # as where a file cannot be without a name
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    target, seen = tmp_path / "some.txt", list[str]()
    write_text(target, "old")
    target.chmod(0o600)
    fsync = os.fsync

    def look(handle: int) -> None:
        fsync(handle)
        seen.append(target.read_text(encoding="utf-8"))

    monkeypatch.setattr(os, "fsync", look)
    write_text(target, "new")
    assert (seen, target.read_text(encoding="utf-8")) == (["old"], "new")
    assert list(tmp_path.iterdir()) == [target]
    assert target.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, OSError])
@pytest.mark.parametrize("before", ["old", None])
def test_a_failure_while_writing_changes_nothing(
    error: type[BaseException],
    before: str | None,
    named: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if named:
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    target = tmp_path / "some.txt"
    if before is not None:
        target.write_text(before, encoding="utf-8")

    def fail(_: int) -> None:
        raise error(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    expected = InputError if error is OSError else error
    with pytest.raises(expected, match="No space left") as caught:
        write_text(target, "half of the new")
    assert error is not OSError or str(target) in str(caught.value)
    assert [path.read_text(encoding="utf-8") for path in tmp_path.iterdir()] == (
        [before] if before is not None else []
    )


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files have names here")
def test_a_killed_program_leaves_no_temporary_file(tmp_path: Path) -> None:
    killed = (
        "import os, signal, sys; from twosra_mpc.files import write_text\n"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)\n"
        "write_text(sys.argv[1], 'new')"
    )
    target = tmp_path / "some.txt"
    target.write_text("old", encoding="utf-8")
    ended = subprocess.run([sys.executable, "-c", killed, str(target)], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert [path.read_text(encoding="utf-8") for path in tmp_path.iterdir()] == ["old"]


def test_what_a_link_points_to_is_written_and_a_pipe_is_written_through(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "some.txt", tmp_path / "link.txt", tmp_path / "pipe"
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text(encoding="utf-8") == "new"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert pipe.is_fifo()


def test_written_files_may_be_read_as_the_umask_says(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "some.txt", "x")
        assert os.umask(0o027) == 0o027  # and the umask itself is left alone
    finally:
        os.umask(before)
    assert (tmp_path / "some.txt").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("save", ["plan", "setpoints", "text"])
def test_a_missing_folder_is_named(save: str, tmp_path: Path) -> None:
    found, target = solved("rigid-move"), tmp_path / "missing" / "file.csv"
    action = {
        "plan": lambda: found.save(target.parent / "file.json"),
        "setpoints": lambda: save_setpoints(found.plan, target),
        "text": lambda: write_text(target, ""),
    }[save]
    with pytest.raises(InputError, match="folder that exists") as caught:
        action()
    assert caught.value.field == "output"
    assert str(caught.value.value).startswith(str(target.with_suffix("")))
    assert not list(tmp_path.iterdir())


def test_a_folder_is_no_file_to_write_to(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError) as caught:
        write_text(tmp_path / "folder", "x")
    assert caught.value.field == "output"
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_a_plan_file_names_no_other_file(tmp_path: Path) -> None:
    """The files are there and would be read, if a scenario named them."""
    obstacles, outline, path = (tmp_path / name for name in ("a.geojson", "b.csv", "plan.json"))
    corners = [[3, 3], [3.1, 3], [3, 3.1], [3, 3]]
    obstacles.write_text(json.dumps({"type": "Polygon", "coordinates": [corners]}))
    outline.write_text("0,0\n0.02,0\n0,0.02\n")
    cup = {"name": "cup", "pose": {"x_m": 1.0, "y_m": 1.0}, "outline": str(outline)}
    for key, value, file in (("obstacles", str(obstacles), obstacles), ("objects", [cup], outline)):
        document = solved("paper-1").to_dict()
        assert Problem.parse({**document["scenario"], "robot": "2sra-v1", key: value}, "own")
        path.write_text(json.dumps({**document, "scenario": {**document["scenario"], key: value}}))
        with pytest.raises(InputError, match="plan files name no other file") as caught:
            load_plan(path)
        assert key in caught.value.field
        assert caught.value.value == str(file)


def test_boxes_are_passed_in_turn_also_in_files_that_do_not_say_when(tmp_path: Path) -> None:
    boxes = [{"do": "pass", "x_m": (x_m, x_m + 0.02)} for x_m in (0.05, 0.1)]
    made = plan(load_problem("rigid-move", tasks=boxes))
    path, trajectory = tmp_path / "plan.json", made.require().trajectory
    first_s, second_s = trajectory.done_s
    assert 0.0 < first_s < second_s < trajectory.duration_s
    there = trajectory.configuration(trajectory.done_s)
    for task, q in zip(trajectory.problem.tasks, there, strict=True):
        assert task.x_m[0] <= q[0] <= task.x_m[1]
    document = made.to_dict()
    assert document["version"] == 3
    for older in (document, {**document, "version": 2}):
        if older["version"] == 2:
            del older["tasks"], older["carried"]
        path.write_text(json.dumps(older))
        assert check_plan(path).ok
        assert load_plan(path).require().trajectory.done_s == pytest.approx((first_s, second_s))
