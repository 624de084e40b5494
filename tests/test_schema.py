"""``twosra schema``: the JSON Schemas accept what the program accepts, and not what it refuses."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any, get_args

import pytest
from conftest import Run
from jsonschema import Draft7Validator
from once import cases, solved
from test_problem import ROBOT, SCENARIO, changed, without

from twosra_mpc import InputError, Result, robot_names, scenario_names
from twosra_mpc.keys import describe
from twosra_mpc.lab.schema import Subject, json_schema
from twosra_mpc.plans.result import PlanDocument
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.description import Robot

Schema = dict[str, Any]
VALIDATORS = {subject: Draft7Validator(json_schema(subject)) for subject in get_args(Subject)}


def built_in(folder: str, name: str) -> Schema:
    text = files("twosra_mpc").joinpath(folder, f"{name}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def keys(schema: Any) -> Iterator[tuple[str, Schema]]:
    """Every key of a file, with its schema."""
    if isinstance(schema, list):
        for item in schema:
            yield from keys(item)
    elif isinstance(schema, dict):
        yield from schema.get("properties", {}).items()
        for item in schema.values():
            yield from keys(item)


# --- what is right fits --------------------------------------------------------------------------


@pytest.mark.parametrize("subject", get_args(Subject))
def test_a_schema_is_a_schema_of_draft_7(subject: Subject) -> None:
    schema = json_schema(subject)
    Draft7Validator.check_schema(schema)
    assert schema["$schema"].endswith("draft-07/schema#")
    text = json.dumps(schema)
    assert "prefixItems" not in text  # of a later draft
    assert "$defs" not in text


@pytest.mark.parametrize("name", scenario_names())
def test_every_built_in_scenario_fits(name: str) -> None:
    VALIDATORS["scenario"].validate(built_in("scenarios", name))


@pytest.mark.parametrize("name", robot_names())
def test_every_built_in_robot_fits(name: str) -> None:
    VALIDATORS["robot"].validate(built_in("robots", name))
    VALIDATORS["scenario"].validate({**SCENARIO, "robot": built_in("robots", name)})


def test_every_saved_plan_fits(any_result: Result) -> None:
    VALIDATORS["plan"].validate(json.loads(json.dumps(any_result.to_dict())))


def test_a_file_without_a_plan_fits() -> None:
    found = solved("paper-1", work_limit=1e-9)
    VALIDATORS["plan"].validate(json.loads(json.dumps(found.to_dict())))


def test_free_curvatures_fit() -> None:
    VALIDATORS["scenario"].validate(changed(SCENARIO, "goal.kappa_per_m", ["free", 3.0]))
    VALIDATORS["scenario"].validate(changed(SCENARIO, "goal.kappa_per_m", [3.0, "free"]))


# --- what is wrong does not, and the program agrees ----------------------------------------------


@pytest.mark.parametrize(("key", "value"), cases("schema")["wrong_scenarios"])
def test_a_wrong_scenario_does_not_fit(key: str, value: object) -> None:
    document = changed(SCENARIO, key, value)
    with pytest.raises(InputError):
        Problem.parse(document, "test")
    assert not VALIDATORS["scenario"].is_valid(document)


ARCS = built_in("robots", "2sra-v1")  # spirals know two equal segments only
BARE = without(ARCS, "geometry.segment_length_m")
THERMAL = ARCS["segment"]
LISTED = [{"length_m": 0.03}, {"length_m": 0.05}]


@pytest.mark.parametrize(
    "document",
    [
        changed(ARCS, "segments", 3),
        changed(ARCS, "geometry.segment_length_m", [0.03, 0.05]),
        changed(BARE, "segment", [one | THERMAL for one in LISTED]),
    ],
)
def test_segments_may_be_counted_or_listed(document: Schema) -> None:
    Robot.parse(document, "test")
    VALIDATORS["robot"].validate(document)
    VALIDATORS["scenario"].validate({**SCENARIO, "robot": document})


@pytest.mark.parametrize(("key", "value"), cases("schema")["wrong_robots"])
def test_a_wrong_robot_does_not_fit(key: str, value: object) -> None:
    document = changed(ROBOT, key, value)
    with pytest.raises(InputError):
        Robot.parse(document, "test")
    assert not VALIDATORS["robot"].is_valid(document)


@pytest.mark.parametrize(("key", "value"), cases("schema")["wrong_plans"])
def test_a_wrong_plan_does_not_fit(key: str, value: object) -> None:
    document = json.loads(json.dumps(solved("paper-1").to_dict()))
    assert not VALIDATORS["plan"].is_valid(changed(document, key, value))


REQUIRED = [key for key, field in PlanDocument.model_fields.items() if field.is_required()]


@pytest.mark.parametrize("key", REQUIRED)
def test_a_plan_needs_all_its_keys(key: str) -> None:
    document = solved("paper-1").to_dict()
    del document[key]
    assert not VALIDATORS["plan"].is_valid(json.loads(json.dumps(document)))


# --- descriptions --------------------------------------------------------------------------------

UNITS = {"_m": "m", "_rad": "rad", "_s": "s", "_C": "degrees C", "_A": "A", "_J": "J"}


@pytest.mark.parametrize("subject", get_args(Subject))
def test_every_key_is_described_with_its_unit(subject: Subject) -> None:
    found = list(keys(json_schema(subject)))
    assert len(found) > 60
    for name, schema in found:
        assert schema["description"] == describe(name)
        if any(name.endswith(ending) for ending in UNITS):
            assert schema["description"].endswith("]"), name


@pytest.mark.parametrize(("key", "unit"), cases("schema")["units"])
def test_the_unit_is_that_of_the_name(key: str, unit: str) -> None:
    assert describe(key).endswith(f" [{unit}]")


# --- program -------------------------------------------------------------------------------------


@pytest.mark.parametrize("subject", get_args(Subject))
def test_the_command_prints_the_schema(subject: Subject, run_as_is: Run) -> None:
    code, out, err = run_as_is("schema", subject)
    assert (code, err) == (0, "")
    assert json.loads(out) == json_schema(subject)
