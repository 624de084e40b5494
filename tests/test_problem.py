"""Scenario and robot files: what is accepted, and what is said about what is not."""

from __future__ import annotations

import copy
import json
import math
import pickle
import re
import tomllib
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from once import cases

from twosra_mpc import (
    ContradictionError,
    Goal,
    InputError,
    NoPlanError,
    Problem,
    Robot,
    Start,
    Tolerance,
    TwosraError,
    load_problem,
    load_robot,
    robot_names,
    scenario_names,
)
from twosra_mpc.lab.serial.stream import StreamError
from twosra_mpc.robot.modes import MODES
from twosra_mpc.robot.timing import OverlappedTiming, SequentialTiming, ThermalTiming

Array = NDArray[np.float64]
Document = dict[str, Any]

SCENARIO: Document = {
    "robot": "2sra-v1",
    "start": {"x_m": 0.1, "y_m": -0.2, "phi_rad": 0.3, "kappa_per_m": [10.0, -20.0]},
    "goal": {"x_m": 0.4, "phi_rad": 0.5, "kappa_per_m": [30.0, -40.0]},
}
ROBOT: Document = tomllib.loads(
    files("twosra_mpc").joinpath("robots", "2sra-v1-paper.toml").read_text(encoding="utf-8")
)
OVERLAPPED = {"overlap": "full", "melt_s": 60.0, "melt_changing_s": 30.0}
OVERLAPPED |= {"freeze_s": 200.0, "freeze_changing_s": 150.0, "superheat_s": 3.0}
WHEELS = [
    {"x_m": -0.08, "y_m": 0.0, "angle_rad": 1.5},
    {"x_m": -0.05, "y_m": 0.03, "angle_rad": 0.0},
    {"x_m": 0.08, "y_m": 0.0, "angle_rad": -1.5},
    {"x_m": 0.05, "y_m": -0.03, "angle_rad": 3.0},
]


def changed(document: Document, key: str, value: object) -> Document:
    """A copy with the dotted ``key`` set; tables on the way are made, of a list it is a number."""
    result = copy.deepcopy(document)
    *tables, last = key.split(".")
    table: Any = result
    for name in tables:
        table = table[int(name)] if isinstance(table, list) else table.setdefault(name, {})
    table[int(last) if isinstance(table, list) else last] = value
    return result


def without(document: Document, key: str) -> Document:
    """A copy with the dotted ``key`` left out."""
    result = copy.deepcopy(document)
    *tables, last = key.split(".")
    table = result
    for name in tables:
        table = table[name]
    del table[last]
    return result


def toml(value: object) -> str:
    """Write a value as inline TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}" = {toml(item)}' for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value)


def write(document: Document, path: Path) -> Path:
    """Write a document as TOML or JSON, by the ending of ``path``."""
    if path.suffix == ".json":
        path.write_text(json.dumps(document), encoding="utf-8")
    else:
        lines = [f"{key} = {toml(value)}\n" for key, value in document.items()]
        path.write_text("".join(lines), encoding="utf-8")
    return path


def listed(value: object) -> object:
    """Tuples as lists, so that what was given compares with what is reported."""
    return [listed(item) for item in value] if isinstance(value, list | tuple) else value


def problems_of(error: InputError) -> list[InputError]:
    """The error and all that were found with it, flat."""
    return [error, *(inner for other in error.others for inner in problems_of(other))]


def refusal(make: Callable[[], object]) -> InputError:
    """The error that ``make`` raises: in the words of the file."""
    with pytest.raises(InputError) as caught:
        make()
    strange = r"[Tt]uple|instance|validation error|discriminator|\btag\b"
    assert not re.search(strange, str(caught.value)), str(caught.value)
    return caught.value


def assert_refused(
    make: Callable[[], object], field: str, value: object, allowed: str, source: str | None
) -> None:
    """``make`` raises exactly one problem: this field, value, allowed (regex) and source."""
    (error,) = problems_of(refusal(make))
    assert error.field == field
    assert repr(listed(error.value)) == repr(listed(value))
    said = f"{error.hint} {error.allowed}"
    assert re.search(allowed, said if "did you mean" in allowed else error.allowed), said
    assert error.source == source
    where = f"{source}: " if source else ""
    if value == "missing":
        assert str(error) == f"{where}{field} is missing: {error.allowed}"
        return
    hint = f"{error.hint} " if error.hint else ""
    said = f"{field} = {error.value!r} is not acceptable; {hint}allowed: {error.allowed}"
    assert str(error) == f"{where}{said}"


CASES = cases("problem")
SCENARIO_MISSING = [
    *("robot", "start", "goal"),
    *("start.x_m", "start.y_m", "start.phi_rad", "start.kappa_per_m"),
]

ROBOT_MISSING = [
    *("name", "geometry", "path", "limits", "heater", "timing"),
    *("geometry.middle_link_m", "path.scale", "limits.unit_speed_m_s", "heater.ambient_C"),
    *("timing.constant.melt_s", "timing.paper.reconfigure_s"),
]


def reported(value: object, key: str, field: str) -> object:
    """What the error shows of a ``value`` set at ``key``: the part that ``field`` names."""
    for part in field.removeprefix(key).split("."):
        if part.isdigit():
            value = value[int(part)]  # type: ignore[index]
        elif part and isinstance(value, dict):
            value = value[part]
    return value


Reads = Callable[[str, Document], tuple[Callable[[], object], str | None]]
BUILT: dict[str, tuple[Callable[..., object], Callable[[Path], object]]] = {
    "scenario": (Problem, load_problem),
    "robot": (Robot, load_robot),
}


@pytest.fixture(params=["toml", "json", "python"])
def reads(request: pytest.FixtureRequest, tmp_path: Path) -> Reads:
    """What makes a scenario or robot of a document, and the source that its errors name."""

    def prepared(what: str, document: Document) -> tuple[Callable[[], object], str | None]:
        build, load = BUILT[what]
        if request.param == "python":
            return lambda: build(**document), None
        path = write(document, tmp_path / f"{what}.{request.param}")
        return lambda: load(path), str(path)

    return prepared


@pytest.mark.parametrize(("key", "value", "field", "allowed"), CASES["scenario"])
def test_a_mistake_in_a_scenario_is_named(
    key: str, value: object, field: str, allowed: str, reads: Reads
) -> None:
    make, source = reads("scenario", changed(SCENARIO, key, value))
    assert_refused(make, field, reported(value, key, field), allowed, source)


@pytest.mark.parametrize(("key", "value", "field", "allowed"), CASES["robot"])
def test_a_mistake_in_a_robot_is_named(
    key: str, value: object, field: str, allowed: str, reads: Reads
) -> None:
    shown = reported(value, key, field)
    if field != key and field.startswith("heater."):  # the neighbour that no longer fits
        shown = ROBOT["heater"][field.removeprefix("heater.")]
    make, source = reads("robot", changed(ROBOT, key, value))
    assert_refused(make, field, shown, allowed, source)


@pytest.mark.parametrize(
    ("what", "document", "key"),
    [
        *(("scenario", SCENARIO, key) for key in SCENARIO_MISSING),
        *(("robot", ROBOT, key) for key in ROBOT_MISSING),
    ],
)
def test_a_missing_key_is_named(what: str, document: Document, key: str, reads: Reads) -> None:
    make, source = reads(what, without(document, key))
    assert_refused(make, key, "missing", "required", source)


def numbers(document: object, key: str = "") -> Iterator[str]:
    """The dotted key of every number of a document."""
    if isinstance(document, dict | list):
        inner = document.items() if isinstance(document, dict) else enumerate(document)
        for name, value in inner:
            yield from numbers(value, f"{key}.{name}".strip("."))
    elif isinstance(document, int | float) and not isinstance(document, bool):
        yield key


@pytest.mark.parametrize("what", BUILT)
def test_every_number_is_one_and_finite(what: str) -> None:
    """A boolean or a string is no number, wherever it stands."""
    document = Problem(**SCENARIO).scenario() if what == "scenario" else ROBOT
    for key in numbers(document):
        for value in (True, "0.1", "Free", [0.1], math.nan, math.inf, -math.inf):
            wrong = changed(document, key, value)
            (error,) = problems_of(refusal(lambda wrong=wrong: BUILT[what][0](**wrong)))
            assert error.field == key
            assert repr(listed(error.value)) == repr(value)
            allowed = "finite|positive|whole" if isinstance(value, float) else "number"
            assert re.search(allowed, error.allowed), error


@pytest.mark.parametrize(("key", "value", "fields"), CASES["too_short"])
def test_the_missing_entries_of_a_short_list_are_named(
    key: str, value: list[float], fields: list[str]
) -> None:
    error = refusal(lambda: Problem(**changed(SCENARIO, key, value)))
    assert [problem.field for problem in problems_of(error)] == fields


@pytest.mark.parametrize(
    ("modes", "field"),
    [([], "modes"), ([[0, 0], [1, 2]], "modes.1.1"), ([[0]], "modes.0.1"), ([0, 1], "modes.0")],
)
def test_a_wrong_list_of_modes_is_named(modes: list[object], field: str) -> None:
    error = refusal(lambda: Problem(**changed(SCENARIO, "modes", modes)))
    assert field in [problem.field for problem in problems_of(error)]


@pytest.mark.parametrize(
    "goal", [{}, {"tolerance": {"x_m": 0.1}}, {"kappa_per_m": ["free", "free"]}, {"mode": [1, 1]}]
)
def test_a_goal_that_asks_for_nothing_is_refused(goal: Document) -> None:
    document = changed(SCENARIO, "goal", goal)
    allowed = "at least one of x_m, y_m, phi_rad, kappa_per_m"
    assert_refused(lambda: Problem(**document), "goal", {}, allowed, None)


def test_a_robot_has_four_wheels_apart_from_each_other() -> None:
    assert Robot(**changed(ROBOT, "geometry.wheels", WHEELS)).geometry.wheel_placement[3] == (
        *(0.05, -0.03, 3.0),
    )
    three = changed(ROBOT, "geometry.wheels", WHEELS[:3])
    assert_refused(lambda: Robot(**three), "geometry.wheels", 3, "^four wheels", None)
    for k in (1, 3):
        wheels = copy.deepcopy(WHEELS)
        wheels[k] = {**wheels[k - 1], "x_m": wheels[k - 1]["x_m"] + 0.0099}
        shown = [wheels[k]["x_m"], wheels[k]["y_m"]]
        same = changed(ROBOT, "geometry.wheels", wheels)
        allowed = f"at least wheel_radius_m from wheel {k} of the same unit"
        assert_refused(
            lambda same=same: Robot(**same), f"geometry.wheels.{k}", shown, allowed, None
        )


UNION_MISTAKES = [
    ("path.model", "log", "path.model", "log"),
    ("path.model", None, "path.model", "missing"),
    ("timing.nominal.overlap", "half", "timing.nominal.overlap", "half"),
    ("timing.nominal.overlap", None, "timing.nominal.overlap", "missing"),
]


@pytest.mark.parametrize(("key", "value", "field", "shown"), UNION_MISTAKES)
def test_the_key_that_chooses_between_models_is_named(
    key: str, value: str | None, field: str, shown: str
) -> None:
    document = without(ROBOT, key) if value is None else changed(ROBOT, key, value)
    (error,) = problems_of(refusal(lambda: Robot(**document)))
    assert error.field.split(".")[0] == key.split(".")[0]
    assert (error.field, error.value) == (field, shown)
    assert re.search("arc, cardioid|full, none, thermal|required", error.allowed)


@pytest.mark.parametrize("name", ["slow", "full", "none", "arc", "float"])
def test_any_name_of_a_set_of_times_is_shown_in_full(name: str) -> None:
    document = changed(ROBOT, f"timing.{name}", {**OVERLAPPED, "melt_s": "long"})
    assert_refused(lambda: Robot(**document), f"timing.{name}.melt_s", "long", "number", None)


@pytest.mark.parametrize("key", ["start.start", "goal.goal"])
def test_an_unknown_key_named_like_its_table_is_shown_in_full(key: str) -> None:
    assert_refused(lambda: Problem(**changed(SCENARIO, key, 1.0)), key, 1.0, "known keys", None)


@pytest.mark.parametrize("key", ["self", "start.self", "goal.tolerance.self"])
def test_the_key_self_is_an_unknown_key(key: str, tmp_path: Path) -> None:
    path = write(changed(SCENARIO, key, 1.0), tmp_path / "scenario.toml")
    assert_refused(lambda: load_problem(path), key, 1.0, "known keys", str(path))


@pytest.mark.parametrize("modes", [[[0]], [[0, 0, 0]], [0, 1]])
def test_one_mistake_in_the_modes_is_reported_once(modes: list[object]) -> None:
    error = refusal(lambda: Problem(**changed(SCENARIO, "modes", modes)))
    assert "modes" not in [problem.field for problem in problems_of(error)]


# Mistakes that do not touch each other: key, bad value, field.
INDEPENDENT = [
    ("gaol", 1.0, "gaol"),
    ("start.x_m", "0", "start.x_m"),
    ("start.kappa_per_m", [math.nan, math.inf], "start.kappa_per_m.0 start.kappa_per_m.1"),
    ("start.z_m", 1.0, "start.z_m"),
    ("goal.y_m", True, "goal.y_m"),
    ("goal.tolerance.x_m", -1.0, "goal.tolerance.x_m"),
    ("goal.tolerance.phi_rad", "1", "goal.tolerance.phi_rad"),
    ("goal.mode", [0, 2], "goal.mode.1"),
    ("weights.transition_s", -1.0, "weights.transition_s"),
    ("gap", 2.0, "gap"),
    ("robot", "nowhere", "robot"),
]


@given(st.sets(st.sampled_from(range(len(INDEPENDENT))), min_size=1))
def test_all_mistakes_are_reported_at_once(chosen: set[int]) -> None:
    document, expected = SCENARIO, set()
    for key, value, field in (INDEPENDENT[i] for i in chosen):
        document = changed(document, key, value)
        expected |= set(field.split())
    error = refusal(lambda: Problem.parse(document, "some.toml"))
    found = problems_of(error)
    assert sorted(problem.field for problem in found) == sorted(expected)
    assert {problem.source for problem in found} == {"some.toml"}
    assert [line.split(" = ")[0] for line in str(error).splitlines()] == [
        f"some.toml: {problem.field}" for problem in found
    ]


def test_all_values_out_of_range_are_reported_at_once() -> None:
    document = changed(SCENARIO, "start.kappa_per_m", [80.0, -80.0])
    document = changed(document, "start.temperature_C", [90.0, 25.0])
    document = changed(document, "timing", "never")
    fields = {problem.field for problem in problems_of(refusal(lambda: Problem(**document)))}
    assert fields == {
        *("start.kappa_per_m.0", "start.kappa_per_m.1", "start.temperature_C.0", "timing")
    }


@pytest.mark.parametrize(
    "error",
    [
        InputError("start.x_m", (1.0, "a"), "a number"),
        InputError("gap", 2.0, "less than 1", "s.toml", (InputError("goal", {}, "more"),)),
        NoPlanError("infeasible", "proved"),
        ContradictionError(298.0, 299.5),
        StreamError(3.0, "in phase 1", "why"),
    ],
)
def test_errors_survive_pickling(error: TwosraError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    plain = {key: value for key, value in vars(error).items() if key != "others"}
    assert {key: value for key, value in vars(again).items() if key != "others"} == plain
    assert [str(other) for other in vars(again).get("others", ())] == [
        str(other) for other in vars(error).get("others", ())
    ]


def test_errors_are_what_callers_would_catch() -> None:
    assert issubclass(InputError, ValueError)
    assert issubclass(InputError, TwosraError)
    assert issubclass(NoPlanError, TwosraError)


# --- files ---------------------------------------------------------------------------------------

BROKEN = [
    ("broken.toml", b"robot = \nplanner = 1\n", r"valid TOML.*line 1"),
    ("broken.toml", b'robot = "a"\nrobot = "b"\n', r"valid TOML.*line 2"),
    ("broken.json", b'{"robot": ', r"valid JSON .*line 1 column"),
    ("toml-as.json", b'robot = "2sra-v1"', r"valid JSON"),
    ("latin.toml", 'description = "é"'.encode("latin-1"), "UTF-8 text"),
    ("latin.json", '{"description": "é"}'.encode("latin-1"), "UTF-8 text"),
    ("list.json", b"[1, 2]", "table of keys"),
    ("number.json", b"3", "table of keys"),
]


@pytest.mark.parametrize("load", [load_problem, load_robot], ids=["scenario", "robot"])
@pytest.mark.parametrize(("name", "content", "allowed"), BROKEN)
def test_a_file_that_cannot_be_parsed_is_named(
    load: Callable[[Path], object], name: str, content: bytes, allowed: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    (error,) = problems_of(refusal(lambda: load(path)))
    assert error.field == "file"
    assert str(path) in str(error)
    assert re.search(allowed, error.allowed), error.allowed


def test_a_file_that_may_not_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(SCENARIO, tmp_path / "scenario.toml")

    def denied(*_args: object, **_more: object) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", denied)
    assert_refused(
        lambda: load_problem(path), "file", str(path), "can be read .Permission denied", None
    )


@pytest.mark.parametrize(
    ("load", "field", "close", "names"),
    [
        (load_problem, "scenario", "paper-11", scenario_names()),
        (load_robot, "robot", "2sra", robot_names()),
    ],
)
def test_a_name_that_does_not_exist_is_answered_with_those_that_do(
    load: Callable[[str], object], field: str, close: str, names: list[str], tmp_path: Path
) -> None:
    for name in (close, "qqq", str(tmp_path), "missing.toml", "a\0b"):
        (error,) = problems_of(refusal(lambda name=name: load(name)))
        assert (error.field, error.value) == (field, name)
        assert all(known in error.allowed for known in names)
        assert "a file that exists" in error.allowed
        assert ("did you mean" in error.hint) == (name == close)


def test_a_relative_robot_path_is_taken_from_the_folder_of_the_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, elsewhere = tmp_path / "mine", tmp_path / "elsewhere"
    for place, name in ((folder, "beside the scenario"), (elsewhere, "in the working folder")):
        (place / "robots").mkdir(parents=True)
        write({**ROBOT, "name": name}, place / "robots" / "mine.toml")
    path = write({**SCENARIO, "robot": "robots/mine.toml"}, folder / "scenario.toml")
    monkeypatch.chdir(elsewhere)
    assert load_problem(path).robot.name == "beside the scenario"
    assert load_problem("../mine/scenario.toml").robot.name == "beside the scenario"
    assert Problem(**{**SCENARIO, "robot": "robots/mine.toml"}).robot.name == (
        "in the working folder"
    )
    (folder / "robots" / "mine.toml").unlink()
    assert load_problem(path).robot.name == "in the working folder"


def test_a_mistake_in_the_robot_file_of_a_scenario_names_the_robot_file(tmp_path: Path) -> None:
    robot = write(changed(ROBOT, "heater.ambient_C", "warm"), tmp_path / "robot.toml")
    path = write({**SCENARIO, "robot": "robot.toml"}, tmp_path / "scenario.toml")
    (error,) = problems_of(refusal(lambda: load_problem(path)))
    assert error.field == "robot.heater.ambient_C"
    assert error.source is not None
    assert Path(error.source).name == robot.name


def test_json_and_toml_and_python_mean_the_same(tmp_path: Path) -> None:
    expected = Problem(**SCENARIO)
    assert load_problem(write(SCENARIO, tmp_path / "a.toml")) == expected
    assert load_problem(write(SCENARIO, tmp_path / "a.json")) == expected
    assert hash(Problem(**SCENARIO)) == hash(expected)
    assert expected != Problem(**SCENARIO, gap=0.5)
    robot = Robot(**ROBOT)
    assert load_robot(write(ROBOT, tmp_path / "r.json")) == robot == load_robot("2sra-v1-paper")
    assert hash(robot) == hash(load_robot("2sra-v1-paper"))


def test_overrides_replace_keys_of_the_file() -> None:
    problem = load_problem("paper-1", gap=0.5, timing="paper", robot=load_robot("2sra-v1"))
    assert (problem.gap, problem.timing) == (0.5, "paper")
    assert problem.start == load_problem("paper-1").start
    error = refusal(lambda: load_problem("paper-1", gap=2.0))
    assert (error.field, error.source) == ("gap", "paper-1")


def test_defaults_filled_in_describe_the_same_problem() -> None:
    problem = load_problem("paper-1")
    scenario = problem.scenario()
    assert json.loads(json.dumps(scenario)) == scenario
    assert set(scenario) == set(Problem.model_fields) - {"objects", "order", "risk"}
    assert Problem(**scenario) == problem


# --- values --------------------------------------------------------------------------------------

# kinematics.md, section 8: "paper-N" is experiment N of the paper, not simulation N.
PUBLISHED = {
    "paper-1": ([0.238, 0.276, -0.24, -38, -24], [0.24, 0.3, -0.15, -15, -5]),
    "paper-2": ([0.29, 0.2, -0.62, -27, 15], [0.27, 0.24, 0.9, 30, 15]),
    "paper-3": ([0.231, 0.2, 0.44, -11, -13], [0.225, 0.245, -0.235, 38, 34]),
    "paper-4": ([0.26, 0.23, -0.3, 28, -16], [0.24, 0.21, 0.5, 28, 3]),
    "paper-5": ([0.231, 0.262, -0.34, -27, -16], [0.241, 0.266, -0.5, -25, 12]),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_built_in_problems_are_the_published_ones(name: str) -> None:
    problem = load_problem(name)
    start, goal = PUBLISHED[name]
    assert problem.start.configuration.tolist() == start
    assert problem.goal.configuration.tolist() == goal
    assert not load_problem(name, robot="2sra-v1-paper").goal.half_width.any()
    assert (problem.robot.name, problem.planner, problem.timing) == (
        *("2sra-v1", "optimal", "nominal"),
    )


@pytest.mark.parametrize("name", scenario_names())
def test_every_built_in_scenario_loads_and_says_what_it_is(name: str) -> None:
    problem = load_problem(name)
    assert problem.description
    assert problem.robot.name in robot_names()
    assert problem.start_mode == problem.goal.mode == problem.robot.rigid


@pytest.mark.parametrize("name", robot_names())
def test_every_built_in_robot_loads_under_its_own_name(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    assert robot.description
    nominal = robot.timing["nominal"]
    assert isinstance(nominal, OverlappedTiming if robot.segment is None else ThermalTiming)
    assert any(isinstance(times, OverlappedTiming) for times in robot.timing.values())


def test_the_robot_of_the_paper_has_the_sleeps_of_the_paper() -> None:
    assert load_robot("2sra-v1").timing["paper"] == SequentialTiming(
        overlap="none", heat_s=100.0, freeze_s=300.0, reconfigure_s=502.0, reconfigure_cool_s=400.0
    )


def test_wheel_places_follow_from_the_lengths() -> None:
    geometry = load_robot("2sra-v1").geometry  # 33 mm link, 42 mm unit, 15 mm wheel
    assert geometry.side_wheel_m == pytest.approx(0.033 + 0.042 + 0.0075)
    assert geometry.front_wheel_m == pytest.approx((0.033 + 0.021, 0.0285))


def test_numpy_numbers_and_arrays_are_accepted_and_become_plain() -> None:
    plain = Problem(**SCENARIO, max_phases=4, gap=0.25, modes=[[0, 0], [1, 1]])
    start = {
        "x_m": np.float64(0.1),
        "y_m": np.array(-0.2),
        "phi_rad": np.float64(0.3),
        "kappa_per_m": np.array([10, -20]),
    }
    goal = {"x_m": np.float64(0.4), "phi_rad": 0.5, "kappa_per_m": np.array([30.0, -40.0])}
    problem = Problem(
        robot=load_robot("2sra-v1"),
        start=start,
        goal=Goal(**goal),
        max_phases=np.int64(4),
        gap=np.float64(0.25),
        modes=np.array([[0, 0], [1, 1]]),
    )
    assert problem == plain
    assert problem.model_dump_json() == plain.model_dump_json()
    assert type(problem.start.y_m) is float
    assert type(problem.modes[1][0]) is int
    assert Start(**{**start, "x_m": np.float32(0.5)}).x_m == 0.5
    assert Start(**{**start, "x_m": np.int64(1)}).x_m == 1.0


def test_values_cannot_be_changed() -> None:
    problem = load_problem("paper-1")
    for value, name in (
        (problem, "gap"),
        (problem.start, "x_m"),
        (problem.goal, "mode"),
        (problem.goal.tolerance, "x_m"),
        (problem.robot, "name"),
        (problem.robot.heater, "ambient_C"),
    ):
        with pytest.raises(InputError, match=r"with_values\("):
            setattr(value, name, getattr(value, name))
    for array in (
        *(problem.start.configuration, problem.goal.configuration, problem.goal.half_width),
    ):
        assert not array.flags.writeable
        assert array.shape == (5,)
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_robots_and_problems_survive_pickling_and_copying() -> None:
    problem = load_problem("paper-1")
    for again in (pickle.loads(pickle.dumps(problem)), copy.deepcopy(problem)):
        assert again == problem
        assert hash(again) == hash(problem)
        assert again.robot.timing == problem.robot.timing
        assert type(again.robot.timing) is type(problem.robot.timing)


def test_the_transition_times_of_a_robot_cannot_be_changed() -> None:
    robot = load_robot("2sra-v1")
    before = hash(robot)
    with pytest.raises(TypeError):
        robot.timing["mine"] = robot.timing["paper"]
    assert hash(robot) == before


@pytest.mark.parametrize(
    ("temperature", "mode"),
    [
        (None, (0, 0)),
        ((60.9, 61.1), (0, 1)),
        ((61.1, 60.9), (1, 0)),
        ((85.0, 0.0), (1, 0)),
        ((70, 65), (1, 1)),
    ],
)
def test_a_segment_is_soft_above_its_melting_point(
    temperature: tuple[float, float] | None, mode: tuple[int, int]
) -> None:
    problem = Problem(**changed(SCENARIO, "start.temperature_C", temperature))
    assert problem.start_mode == mode
    assert problem.temperatures == (temperature or (25.0, 25.0))


@pytest.mark.parametrize("limit", [78.5, -78.5])
def test_limits_of_curvature_and_temperature_belong_to_the_range(limit: float) -> None:
    document = changed(SCENARIO, "start.kappa_per_m", [limit, limit])
    document = changed(document, "goal.kappa_per_m", [limit, -limit])
    document = changed(document, "start.temperature_C", [0, 85])
    problem = Problem(**{**document, "gap": 0, "max_phases": 12, "timing": "paper"})
    assert problem.start.configuration[3] == limit
    assert problem.transition_times is problem.robot.timing["paper"]
    assert Problem(**{**document, "max_phases": 1}).modes == MODES


# --- the goal ------------------------------------------------------------------------------------

COORDINATE = st.floats(-10.0, 10.0)
CONFIGURATION = st.tuples(*[COORDINATE] * 5).map(np.array)
WIDTH = st.tuples(*[st.floats(0.0, 2.0)] * 5)


def box(q: Array, width: tuple[float, ...], *, modulo: bool) -> Goal:
    tolerance = Tolerance(
        x_m=width[0], y_m=width[1], phi_rad=width[2], kappa_per_m=(width[3], width[4])
    )
    return Goal(
        x_m=q[0], y_m=q[1], phi_rad=q[2], kappa_per_m=q[3:], tolerance=tolerance, phi_modulo=modulo
    )


@given(CONFIGURATION, CONFIGURATION, WIDTH)
def test_the_error_is_the_shortest_way_out_of_the_goal_box(
    q: Array, target: Array, width: tuple[float, ...]
) -> None:
    error = box(target, width, modulo=False).error(q)
    nearest = np.clip(q, target - width, target + np.array(width))
    assert error == pytest.approx(q - nearest, abs=1e-12)
    inside = np.abs(q - target) < np.array(width) - 1e-12
    assert not error[inside].any()


@given(CONFIGURATION, CONFIGURATION, WIDTH, st.integers(-3, 3))
def test_full_turns_change_nothing_unless_they_are_asked_for(
    q: Array, target: Array, width: tuple[float, ...], turns: int
) -> None:
    goal = box(target, (0.0,) * 5, modulo=True)
    turned = q + np.array([0.0, 0.0, turns * math.tau, 0.0, 0.0])
    apart = math.remainder(turned[2] - target[2], math.tau)
    assert goal.error(turned)[2] == pytest.approx(apart, abs=1e-9)
    assert abs(goal.error(turned)[2]) <= math.pi + 1e-12
    difference = goal.error(turned)[2] - goal.error(q)[2]
    assert math.remainder(difference, math.tau) == pytest.approx(0.0, abs=1e-9)
    loose = box(target, width, modulo=True)
    assert abs(loose.error(q)[2]) == pytest.approx(
        max(0.0, abs(goal.error(q)[2]) - width[2]), abs=1e-12
    )
    exact = box(target, (0.0,) * 5, modulo=False)
    assert exact.error(turned) == pytest.approx(turned - target, abs=1e-12)


@pytest.mark.parametrize(
    ("key", "index"), [("x_m", 0), ("y_m", 1), ("phi_rad", 2), ("kappa_per_m", slice(3, 5))]
)
@given(q=CONFIGURATION)
def test_a_coordinate_left_out_is_free(key: str, index: int | slice, q: Array) -> None:
    full = {"x_m": 1.0, "y_m": 2.0, "phi_rad": 3.0, "kappa_per_m": [4.0, 5.0]}
    part = {name: value for name, value in full.items() if name != key}
    left_out, none = Goal(**part), Goal(**part, **{key: None})
    assert left_out == none
    assert np.isnan(left_out.configuration[index]).all()
    expected = Goal(**full).error(q)
    expected[index] = 0.0
    assert left_out.error(q).tolist() == expected.tolist()


@given(q=CONFIGURATION)
def test_a_curvature_may_be_free_alone(q: Array) -> None:
    word, none = Goal(kappa_per_m=["free", 5.0]), Goal(kappa_per_m=[None, 5.0])
    assert word == none
    assert word.kappa_per_m == (None, 5.0)
    assert word.error(q).tolist() == [0.0, 0.0, 0.0, 0.0, q[4] - 5.0]
    assert Goal(x_m=1.0, kappa_per_m=["free", "free"]).error(q).tolist() == (
        Goal(x_m=1.0).error(q).tolist()
    )


def test_the_error_leaves_its_argument_alone() -> None:
    q = load_problem("paper-1").start.configuration
    before = q.copy()
    load_problem("paper-1").goal.error(q)
    assert np.array_equal(q, before)


# --- other values --------------------------------------------------------------------------------


def test_a_record_with_other_values_is_validated_anew() -> None:
    problem = load_problem("paper-1")
    changed_one = problem.with_values(gap=0.05, robot=problem.robot.with_values(name="mine"))
    assert (changed_one.gap, changed_one.robot.name, problem.gap) == (0.05, "mine", 0.01)
    assert changed_one.with_values(gap=problem.gap, robot=problem.robot) == problem
    for wrong, field in (({"timing": "nope"}, "timing"), ({"gapp": 0.1}, "gapp")):
        assert refusal(lambda wrong=wrong: problem.with_values(**wrong)).field == field
