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

from twosra_mpc.plans.carried import CarriedObject, TaskDone
from twosra_mpc.plans.document import PhaseDocument, PlanDocument
from twosra_mpc.plans.plan import Cost
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
_UNITS = {  # ending of a key -> unit; the longest that fits counts
    **{"_m": "m", "_s": "s", "_A": "A", "_C": "degrees C", "_J": "J", "_rad": "rad"},
    **{"_ohm": "ohm", "_ohm_m": "ohm m", "_m_s": "m/s", "_rad_s": "rad/s", "_rad_s2": "rad/s2"},
    **{"_per_m": "1/m", "_per_s": "1/s", "_per_K": "1/K", "_s_per_J": "s/J"},
    **{"_J_per_K": "J/K", "_W_per_K": "W/K", "_K_per_s": "K/s", "_kg_per_m3": "kg/m3"},
    **{"_J_per_kg": "J/kg", "_J_per_kg_K": "J/(kg K)", "_W_per_m2_K": "W/(m2 K)"},
}
_WORDS = {  # key -> what it is, where the key alone does not say it
    "accuracy": "how near to their goals runs end; goals are met exactly without it",
    "a": "rate of change of the input to the next sample [m/s2, and rad/s2]; not in version 1",
    "ambient_C": "temperature of the air",
    "angle_ratio": "turns of spirals I, II, III per bending angle",
    "body_ratio": "heat capacity of the body over that of the core",
    "certificate": "what proves a lower bound anew (twosra verify --proof); only where asked for",
    "clearance_m": "kept to all obstacles; in a verification, what is left of it",
    "coil": "the heating wire",
    "cost": "what the plan costs, and what that is made of; null without a plan",
    "description": "one line for people",
    "do": "what to do: reach, pass, conform, grasp, carry or release",
    "done_s": "when the segment has changed, or the task is done",
    "effort": "cost of the effort, per second of it",
    "effort_s": "integral of the sum of (wheel speed / largest)^2; not in older files",
    "fastest_cost_s": "cost of the same plan at full speed, as the search found it",
    "fill": "share of the annulus that is metal",
    "gap": "proved relative gap (cost - lower bound) / cost; in a scenario, the gap to stop at",
    "geometry": "lengths of the fibre and the locomotion units",
    "goal": "where the robot should be; a coordinate left out is free",
    "goal_error": "distance to the goal box [m, m, rad, 1/m, 1/m]",
    "growth": "b of spirals I, II, III",
    "heater": "temperatures, currents and coil of one segment's heater",
    "heater_s": "when the heater is switched",
    "heaters_at_once": "how many heaters the supply feeds at a time",
    "heating": "what counts beyond time: fastest, least_energy or keep_warm",
    "hold_duty": "share of the time for which the melting current holds a segment soft",
    "kappa_per_m": "curvatures of the segments",
    "limits": "limits of motion and shape; in a verification, the margin to each",
    "lower_bound_s": "proved lower bound on the cost of any plan",
    "max_defect": "largest difference of the samples to their re-integration [m, rad, 1/m]",
    "max_phases": "longest mode sequence that is searched",
    "message": "one sentence a person can act on",
    "metal": "the low-melting metal",
    "mode": "stiffness of the segments: 1 soft, 0 rigid",
    "model": "which model the other keys of this table belong to",
    "modes": "stiffness modes that may be used",
    "motion": "gentle: as slow as time to spare and the gap allow; or fastest; not with effort",
    "name": "what it is called",
    "obstacles": "what the robot must not touch: polygons, boxes, discs, or a GeoJSON file's path",
    "polygon_m": "corners, in either direction, the first one not repeated",
    "soft_travel_m": "how far the middle link may move while segments are soft, among obstacles",
    "tasks": "what to do before the goal, or instead of one; in a plan file, when each is done",
    "object": "name of what is touched, held or carried",
    "objects": "things that can be touched, held and carried",
    "order": "whether tasks keep the given order, or are done in the best one (free)",
    "outline": "path of a CSV file of points x, y of a closed curve [m]",
    "hold": "caged: it is proved that the object cannot leave; pushed: friction holds it",
    "holding": "name of the object that is held at the start",
    "directions_rad": "least and largest heading of b0 that may be used",
    "gap_m": "how far segments may be away from what they lie along",
    "friction": "coefficient of an object against the robot; only what is pushed needs one",
    "pose": "where the object is at the start",
    "pose_in_b0": "where the object is as seen from b0 [m, m, rad]",
    "carried": "what moves with the robot, and when",
    "from_s": "since when it is held",
    "to_s": "until when it is held",
    "configuration": "where the robot is then [m, m, rad, 1/m ...]",
    "disc": "a disc; of an object, about the origin of its frame",
    "box": "a box along the axes; of an object, in its frame",
    "contact_m": "what is left of the overlap allowed with what is touched",
    "position_tolerance_m": "how far the object may be from where it should be",
    "heading_tolerance_rad": "how far it may be turned from that",
    "curvature_uncertainty_per_m": "how far off curvatures may be; widens the robot",
    "nlp_iterations": "iterations of the nonlinear solver",
    "ok": "whether everything holds",
    "onset_s": "when the segment begins to change; nothing may move from then on",
    "overlap": "whether transitions may overlap: none, full, or thermal (times from the segment)",
    "package": "version of the program that wrote the file",
    "path": "how the fibre bends when a unit moves",
    "phases": "motion phases in order; holds are the gaps between them",
    "phi_modulo": "whether headings that differ by full turns are the same",
    "phi_per_alpha": "slope of the polar angle over the bending angle in cases I, II, III",
    "planner": "optimal, or greedy as in the paper",
    "problems": "what does not hold, in words",
    "q": "configuration [x m, y m, phi rad, and the curvature of each segment 1/m]",
    "ranges": "5 % and 95 % values of uncertain parameters",
    "robot": "the robot: a built-in name, a path to its file, or its table",
    "robot_id": "number of the robot, sent at the end of every line if its firmware expects one",
    "rubber": "the silicone of core and tube",
    "samples": "the plan on its grid; null without a plan",
    "scale": "a of spirals I, II, III, in segment lengths",
    "scenario": "the problem, defaults filled in",
    "search_gap": "proved relative gap at full speed, (fastest cost - lower bound) / fastest cost",
    "segment": "how a segment warms and cools; of a transition, which segment, from 1",
    "segment_length_m": "length of every segment, or a list of their lengths",
    "segments": "how many; in a plan file, how each warms and cools; of a task, which, from 1",
    "sensor_gain": "reading above the air per degree of the core",
    "sequences_bounded": "mode sequences whose lower bound was found",
    "sequences_solved": "mode sequences that were solved",
    "speed_reference": "whose speed v_j is: fibre_end or side_wheel",
    "start": "where the robot is, and its shape",
    "stats": "effort spent",
    "status": "what is known about the plan",
    "stopped_early": "whether a limit or an interrupt ended the search",
    "t_s": "time of each sample",
    "temperature_C": "temperatures of the segments",
    "timing": "sets of transition times by name; in a scenario, the name of one",
    "to": "what the segment becomes",
    "tolerance": "half-widths of the goal box, or exact; by default from the robot's accuracy",
    "total": "cost [s]: time, energy, transitions and effort by their weights",
    "transition_quantile": "share of early and of late transitions that windows must hold",
    "transition_s": "cost of a transition",
    "transitions": "melts and freezes; in a cost, how many",
    "turns": "turns of the coil",
    "unit_offset_m": "how far the units lie beside the fibre",
    "v": "input [v1 m/s, v2 m/s, u0 m/s, v0 m/s, r0 rad/s]",
    "verification": "what the independent check found",
    "time_limit_s": "when the search stops",
    "wall_s": "time spent",
    "weights": "weights of energy, transitions and effort in the cost, which is in seconds",
    "x_m": "place along x, or the least and the largest",
    "y_m": "place along y, or the least and the largest",
    "phi_rad": "heading, or the least and the largest",
    "energy_s_per_J": "cost of heater energy",
    "workspace": "box in the plane that no point of the robot leaves",
    "workspace_m": "margin to the edge of the workspace",
    "wheel_independence": "least singular value of the wheel matrix with which the robot drives",
    "wheels": "where the four wheels sit and point; left out, they follow from the lengths",
}


class _Quiet(GenerateJsonSchema):
    """Leaves out defaults that are no JSON (frozen tables) without a warning."""

    ignored_warning_kinds = {"skipped-choice", "non-serializable-default"}  # noqa: RUF012


def json_schema(subject: Subject) -> Schema:
    """Return the JSON Schema (draft 7) of a scenario, robot or plan file; units in descriptions."""
    schema = {"scenario": _scenario, "robot": _robot, "plan": _plan}[subject]()
    for name, key in _keys(schema):
        key["description"] = describe(name)
    return {"$schema": _DRAFT, "title": f"twosra_mpc {subject}", **schema}


def describe(key: str) -> str:
    """Say what a key is, with its unit in brackets where it has one."""
    endings = sorted((end for end in _UNITS if f"_{key}".endswith(end)), key=len)
    words = _WORDS.get(key)
    if not endings:
        return words or key.replace("_", " ")
    unit = _UNITS[endings[-1]]
    return f"{words or key.removesuffix(endings[-1]).replace('_', ' ')} [{unit}]"


def _of(model: type[BaseModel]) -> Schema:
    """Pydantic's schema of a record in draft 7."""
    template = "#/definitions/{model}"
    schema = model.model_json_schema(ref_template=template, schema_generator=_Quiet)
    found: Schema = _draft_7({"definitions": schema.pop("$defs", {}), **schema})
    return found


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
    properties["segments"] = {
        "anyOf": [{**geometry["properties"]["segments"]}, properties["segments"]]
    }
    return schema


def _scenario() -> Schema:
    schema, goal, robot = _of(Problem), _of(Goal), _robot()
    definitions = {**schema["definitions"], **goal.pop("definitions"), **robot.pop("definitions")}
    del definitions["GoalSet"]
    kappa = goal["properties"]["kappa_per_m"]
    kappa["items"] = {"anyOf": [{"type": "number"}, {"const": "free"}, {"type": "null"}]}
    properties = schema["properties"]
    properties["goal"] = {"$ref": "#/definitions/Goal"}  # the kind that files can say
    properties["robot"] = {"anyOf": [{"type": "string"}, {"$ref": "#/definitions/Robot"}]}
    properties["obstacles"] = {"anyOf": [{"type": "string"}, properties["obstacles"]]}
    properties["goal"] = {"anyOf": [properties["goal"], {"type": "null"}]}
    schema["anyOf"] = [{"required": ["goal"]}, {"required": ["tasks"]}]
    definitions["Object"]["properties"]["outline"] = {"type": "string"}
    definitions["Reach"] = _reach(definitions["Reach"], goal)
    for kind in definitions["Task"]["oneOf"]:
        if "$ref" not in kind:
            kind["required"] = ["do", *kind.get("required", [])]
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
