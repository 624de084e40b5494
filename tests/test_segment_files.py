"""Files of robots with one and three segments say and check what those of two segments do."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator
from once import solved
from test_other_segments import problem_of, robot_of

from twosra_mpc import InputError, Result, json_schema, load_plan, plan, save_setpoints
from twosra_mpc.checking.plan_file import check_plan, refined
from twosra_mpc.lab.analysis.critical_path import critical_path


@pytest.fixture(scope="module", params=[1, 3])
def result(request: pytest.FixtureRequest) -> Result:
    if request.param == 3:
        return solved("three-segments")
    robot = robot_of(0.04).with_values(name="of one segment")
    return plan(problem_of(robot, (25.0,)))


@pytest.fixture(scope="module")
def segments(result: Result) -> int:
    return result.problem.robot.coordinates.segments


def edited(result: Result, key: str, change: Any, path: Path) -> Path:
    """The result's file with one part of its document changed in place."""
    document = json.loads(json.dumps(result.to_dict()))
    change(document[key])
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_a_plan_file_reads_back_fits_its_schema_and_passes_every_check(
    result: Result, segments: int, tmp_path: Path
) -> None:
    result.save(tmp_path / "plan.json")
    assert load_plan(tmp_path / "plan.json").to_dict() == result.to_dict()
    Draft7Validator(json_schema("plan")).validate(json.loads((tmp_path / "plan.json").read_text()))
    found = check_plan(tmp_path / "plan.json")
    assert found.ok, found.problems
    names = [check.name for check in found.checks if check.name.startswith("goal.kappa_per_m")]
    assert names == [f"goal.kappa_per_m.{j}" for j in range(segments)]


def test_a_denser_plan_is_one_too(result: Result, tmp_path: Path) -> None:
    replace(result, plan=refined(result.require(), 2.0)).save(tmp_path / "dense.json")
    assert check_plan(tmp_path / "dense.json").ok


def test_another_goal_of_the_last_segment_is_noticed(
    result: Result, segments: int, tmp_path: Path
) -> None:
    def bend_otherwise(scenario: dict[str, Any]) -> None:
        scenario["goal"]["kappa_per_m"][-1] += 1.0

    found = check_plan(edited(result, "scenario", bend_otherwise, tmp_path / "plan.json"))
    assert not found.ok
    assert any(f"goal.kappa_per_m.{segments - 1} is missed" in text for text in found.problems)


@pytest.mark.parametrize(
    ("key", "change", "field"),
    [
        ("phases", lambda phases: phases[-1]["mode"].append(0), "phases"),
        ("transitions", lambda items: items[0].update(segment=4), "transitions.0.segment"),
        ("samples", lambda columns: [row.append(0) for row in columns["mode"]], "samples"),
    ],
)
def test_a_file_that_speaks_of_more_segments_is_refused(
    result: Result, key: str, change: Any, field: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        load_plan(edited(result, key, change, tmp_path / "plan.json"))
    assert caught.value.field.startswith(field)


def test_set_points_have_a_column_for_each_segment(
    result: Result, segments: int, tmp_path: Path
) -> None:
    save_setpoints(result.require(), tmp_path / "points.csv", 1.0)
    with (tmp_path / "points.csv").open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    for name in ("mode{}", "heater{}_C", "kappa{}_per_m", "melt_fraction{}"):
        assert [name.format(j + 1) in header for j in range(4)] == [j < segments for j in range(4)]
    last = dict(zip(header, rows[-1], strict=True))
    asked = result.problem.goal.configuration[3:]
    reached = [float(last[f"kappa{j + 1}_per_m"]) for j in range(segments)]
    assert reached == pytest.approx(asked.tolist(), abs=1e-6)


def test_the_critical_path_adds_up_and_names_the_segments(result: Result, segments: int) -> None:
    path = critical_path(result.require())
    assert sum(item.duration_s for item in path) == pytest.approx(result.plan.duration_s, abs=1e-6)
    told = [str(item) for item in path]
    everything = "segment 1" if segments == 1 else "all segments"
    assert told[-1] == f"freezing {everything}"
    assert segments == 1 or "bending segments 2 and 3" in told
    assert not any("both" in words for words in told)
