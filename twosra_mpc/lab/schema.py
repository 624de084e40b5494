"""JSON Schemas of the files, for editors and other programs; from the records that read them.

Draft 7, which is what editors of TOML understand. A schema cannot say everything: a file that fits
may still contradict itself, e.g. ask for more curvature than its robot has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from twosra_mpc.arguments import public
from twosra_mpc.keys import describe
from twosra_mpc.plans.carried import CarriedObject, TaskDone
from twosra_mpc.plans.plan import Cost
from twosra_mpc.plans.result import PhaseDocument, PlanDocument
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.problem.goals import Goal
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import INPUTS, POSE, WHEELS
from twosra_mpc.robot.description import Robot
from twosra_mpc.timing import Transition
from twosra_mpc.validation import MOST_SEGMENTS

Subject = Literal["scenario", "robot", "plan"]
Schema = dict[str, Any]

_DRAFT = "http://json-schema.org/draft-07/schema#"


class _Quiet(GenerateJsonSchema):
    """Leaves out defaults that are no JSON (frozen tables) without a warning."""

    ignored_warning_kinds = {"skipped-choice", "non-serializable-default"}  # noqa: RUF012


@public
def json_schema(subject: Subject) -> Schema:
    """Return the JSON Schema (draft 7) of a scenario, robot or plan file; units in descriptions.

    Raises:
        InputError: If it is another subject.
    """
    known = {"scenario": _scenario, "robot": _robot, "plan": _plan}
    schema = known[subject]()
    for name, key in _keys(schema):
        key["description"] = describe(name)
    return {"$schema": _DRAFT, "title": f"twosra_mpc {subject}", **schema}


def _of(model: type[BaseModel]) -> Schema:
    """Pydantic's schema of a record in draft 7."""
    template = "#/definitions/{model}"
    schema = model.model_json_schema(ref_template=template, schema_generator=_Quiet)
    return _draft_7({"definitions": schema.pop("$defs", {}), **schema})


def _draft_7(schema: Any) -> Any:
    """Name the items of tuples as draft 7 does, and drop titles that only repeat the key."""
    if isinstance(schema, list):
        return [_draft_7(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    renamed = {"prefixItems": "items"}
    return {renamed.get(k, k): _draft_7(item) for k, item in schema.items() if k != "title"}


def _robot() -> Schema:
    """Segments are counted (``segments = 3``), or listed (``[[segment]]``) with their lengths."""
    schema = _of(Robot)
    properties, definitions = schema["properties"], schema["definitions"]
    bare = _table([{"type": "number", "exclusiveMinimum": 0.0}], ("length_m",))
    kinds = [
        kind
        | {"properties": {**bare["properties"], **kind["properties"]}}
        | {"required": ["length_m", *kind["required"]]}
        for kind in definitions["Segment"]["oneOf"]
    ]
    properties["segment"]["anyOf"].append(_list({"anyOf": [bare, *kinds]}, 1, MOST_SEGMENTS))
    geometry = definitions["Geometry"]
    geometry["required"].remove("segment_length_m")  # where the list has the lengths
    counted = {**geometry["properties"]["segments"]}
    properties["segments"] = {"anyOf": [counted, properties["segments"]]}
    return schema


def _scenario() -> Schema:
    schema, goal, robot = _of(Problem), _of(Goal), _robot()
    definitions = {**schema["definitions"], **goal.pop("definitions"), **robot.pop("definitions")}
    del definitions["GoalSet"]
    kappa = goal["properties"]["kappa_per_m"]
    kappa["items"] = {"anyOf": [{"type": "number"}, {"const": "free"}, {"type": "null"}]}
    properties = schema["properties"]
    properties["robot"] = {"anyOf": [{"type": "string"}, {"$ref": "#/definitions/Robot"}]}
    properties["obstacles"] = {"anyOf": [{"type": "string"}, properties["obstacles"]]}
    kind = {"$ref": "#/definitions/Goal"}  # the one that files can say
    properties["goal"] = {"anyOf": [kind, {"type": "null"}]}
    schema["anyOf"] = [{"required": ["goal"]}, {"required": ["tasks"]}]
    definitions["Object"]["properties"]["outline"] = {"type": "string"}
    pair = _list({"type": "number"}, 2, 2)
    bezier = _table([{"type": "array", "items": pair, "minItems": 4}], ("bezier",))
    definitions["Reach"] = _reach(definitions["Reach"], goal)
    for kind in definitions["Task"]["oneOf"]:
        if "$ref" not in kind:
            kind["required"] = ["do", *kind.get("required", [])]
        if "path" in (own := kind.get("properties", {})):
            own["path"] = {"anyOf": [{"type": "string"}, bezier, own["path"]]}
    return {**schema, "definitions": {**definitions, "Goal": goal, "Robot": robot}}


def _reach(table: Schema, goal: Schema) -> Schema:
    """A goal on the way: with the keys of one, or with one as ``goal``."""
    own, keys = table["properties"], goal["properties"]
    mode = {"anyOf": [{"const": "any"}, keys["mode"]]}
    flat = {"do": own["do"], "name": own["name"], **keys, "mode": mode}
    table["properties"] = {**own, "goal": {"$ref": "#/definitions/Goal"}}
    table["required"] = ["do", "goal"]
    return {"oneOf": [table, {**table, "properties": flat, "required": ["do"]}]}


def _plan() -> Schema:
    schema, scenario = _of(PlanDocument), _scenario()
    definitions = {**scenario.pop("definitions"), **schema["definitions"], "Scenario": scenario}
    for record in (Cost, Transition, PhaseDocument, TaskDone, CarriedObject):  # tables in the file
        definitions[record.__name__] = _table(definitions[record.__name__]["items"], record._fields)
    number = definitions["Transition"]["properties"]["segment"]
    number |= {"minimum": 1, "maximum": MOST_SEGMENTS}
    properties = schema["properties"]
    properties["robot"] = {"$ref": "#/definitions/Robot"}
    properties["scenario"] = {"$ref": "#/definitions/Scenario"}
    properties["samples"]["anyOf"][0] = _samples()
    return {**schema, "definitions": definitions}


def _samples() -> Schema:
    """A list of numbers a sample for time, else a list of rows."""
    widths = {"wheel_rad_s": (WHEELS, WHEELS), "v": (INPUTS, INPUTS), "a": (INPUTS, INPUTS)}
    widths["q"] = (POSE + 1, POSE + MOST_SEGMENTS)
    properties: dict[str, Schema] = {}
    for item in fields(Samples):
        cell: Schema = {"enum": [0, 1]} if item.name == "mode" else {"type": "number"}
        row = _list(cell, *widths.get(item.name, (1, MOST_SEGMENTS)))
        properties[item.name] = {"type": "array", "items": cell if item.name == "t_s" else row}
    table = _table(list(properties.values()), tuple(properties))
    table["required"].remove("a")  # it is younger than version 1
    return table


def _list(item: Schema, least: int, most: int) -> Schema:
    return {"type": "array", "items": item, "minItems": least, "maxItems": most}


def _table(values: list[Schema], keys: tuple[str, ...]) -> Schema:
    return {
        "type": "object",
        "properties": dict(zip(keys, values, strict=True)),
        "required": list(keys),
        "additionalProperties": False,
    }


def _keys(schema: Any) -> Iterator[tuple[str, Schema]]:
    """Every key that a file may have, with its schema."""
    if isinstance(schema, list):
        for item in schema:
            yield from _keys(item)
    elif isinstance(schema, dict):
        yield from schema.get("properties", {}).items()
        for item in schema.values():
            yield from _keys(item)
