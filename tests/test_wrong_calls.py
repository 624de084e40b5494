"""Wrong calls of the library: each is answered with what makes the right argument."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import io
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from once import solved
from shapely import box

import twosra_mpc
from twosra_mpc import (
    Goal,
    InputError,
    Problem,
    Tolerance,
    Workspace,
    check_plan,
    explain,
    json_schema,
    kinematics,
    load_plan,
    load_problem,
    load_robot,
    obstacles_of,
    plan,
    plotting,
    read_obstacles,
    robot_names,
    robot_shape,
    save_setpoints,
    with_path_model,
)
from twosra_mpc.arguments import MADE_BY, Kind, Word, kinds
from twosra_mpc.execution import (
    LEVELS,
    Camera,
    Command,
    Disturbance,
    Executor,
    SimulatedRobot,
    simulate,
    spread,
)
from twosra_mpc.validation import ArrayValue, Value

ROOM = box(1.0, 1.0, 2.0, 2.0)
PLACES = ("twosra_mpc", *(f"twosra_mpc.{each}" for each in ("execution", "plotting", "lab.report")))
EXPORTS = ("lab.export.ros2_mcap", "lab.identification.motion_log", "plans.setpoints")
PAGES = Path(__file__).parents[1] / "docs/reference"


def public_things() -> Iterator[Any]:
    """Functions and classes of the package, of exports, and those that the reference names."""
    for place in map(importlib.import_module, PLACES):
        yield from (getattr(place, name) for name in place.__all__)
    for place in (importlib.import_module(f"twosra_mpc.{name}") for name in EXPORTS):
        yield from (each for name, each in vars(place).items() if name.startswith("save_"))
    pages = "".join(page.read_text() for page in PAGES.glob("*.md"))
    for module, names in re.findall(r"::: (\S+)\n(?: .+\n)* +members: \[([^]]+)\]", pages):
        place = importlib.import_module(module)
        yield from (getattr(place, name.strip()) for name in names.split(","))


def public_calls() -> Iterator[tuple[str, Callable[..., Any], str]]:
    """Functions, methods, and constructors of what users make, with their modules."""
    for thing in {id(each): each for each in public_things()}.values():
        if inspect.isfunction(thing):
            yield thing.__name__, thing, thing.__module__
        if not inspect.isclass(thing) or issubclass(thing, (Exception, Word, Value)):
            continue
        constructor = "__new__" if issubclass(thing, tuple) else "__init__"
        for name in () if getattr(thing, "_is_protocol", False) else [*vars(thing)]:
            member = getattr(thing, name)
            called = inspect.isfunction(member) or inspect.ismethod(member)
            made = name == constructor and hasattr(member, "__wrapped__")
            if called and (not name.startswith("_") or (made and thing.__name__ not in MADE_BY)):
                yield f"{thing.__name__}.{name}", member, thing.__module__


def arguments() -> Iterator[Any]:
    for name, function, module in public_calls():
        for argument, kind in kinds(function, module):
            yield pytest.param(function, argument, kind, id=f"{name}-{argument}")


@pytest.mark.parametrize(("function", "argument", "kind"), [*arguments()])
def test_every_public_call_says_what_makes_the_right_argument(
    function: Callable[..., Any], argument: str, kind: Kind
) -> None:
    """An argument of no kind is named, and nothing is run."""
    with pytest.raises(InputError) as error:
        function(**{argument: object()})
    assert (error.value.field, error.value.allowed) == (argument, kind.words)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), "1", True, 1j, [1.0]])
def test_a_number_is_finite_and_a_number(number: object) -> None:
    with pytest.raises(InputError, match=r"rate_Hz = .*a finite number"):
        save_setpoints(solved("rigid-move").require(), "x.csv", number)  # type: ignore[arg-type]


def test_no_function_of_the_package_is_left_unchecked() -> None:
    for name in twosra_mpc.__all__:
        value = getattr(twosra_mpc, name)
        if inspect.isabstract(value):
            continue
        if inspect.isfunction(value):
            with pytest.raises(InputError):
                value(no_such_argument=1)
        elif name in MADE_BY or (inspect.isclass(value) and Value in value.__mro__):
            with pytest.raises(InputError, match=rf"^{name} = 'paper-1' .*{name}\(|makes"):
                value("paper-1")


@pytest.mark.parametrize("name", robot_names())
def test_the_kinematics_says_which_argument_does_not_fit(name: str) -> None:
    """Refused is every argument of another size or kind, and every mode that is none."""
    robot = load_robot(name)
    model, n = kinematics(robot), robot.geometry.segments
    right: dict[str, Any] = {"q": [0.1] * (3 + n), "sigma": (1,) * n, "kappa": [0.1] * n}
    for function in vars(model).values():
        names = function.name_in()
        assert function(*(right[each] for each in names)) is not None
        for each in names:
            wrong = [right[each][1:], [*right[each], 0.0], [right[each]], "q", None, 1.0, robot]
            wrong += [ca.SX.sym("q", len(right[each]) + 1), [float("nan")] * len(right[each])]
            if each == "sigma":
                wrong += [(2,) * n, (0.5,) * n, (-1,) * n]
            for given in wrong:
                with pytest.raises(InputError) as error:
                    function(*((right | {each: given})[name] for name in names))
                assert error.value.field == each
    for wrong in ([0.0] * 3, [0.0] * 5, "fast", None):
        with pytest.raises(InputError, match="wheel_rad_s"):
            model.inputs(right["q"], right["sigma"], wrong)


WRONG: list[tuple[Callable[[Problem, Any], object], str]] = [
    (lambda problem, _: plan(problem, gap=0.1), r"gap = 0\.1 .*\.with_values\(gap=0\.1\)"),  # type: ignore[call-arg]
    (lambda problem, _: plan(problem=problem, gap=0.1), r"\.with_values\(gap=0\.1\)"),  # type: ignore[call-arg]
    (lambda problem, _: plan(problem, on_progres=print), "did you mean on_progress"),  # type: ignore[call-arg]
    (lambda _, result: plan(result), "load_problem"),
    (lambda _, result: check_plan(result), "a path"),
    (lambda _, result: save_setpoints(result), r"^path is missing: a path; save_setpoints\(plan"),  # type: ignore[call-arg]
    (lambda _, __: plan(), r"^problem is missing: a Problem: load_problem"),  # type: ignore[call-arg]
    (
        lambda problem, _: plan(problem, print, 0.5, 1),
        r"on_progress=\.\.\., risk=\.\.\.\), too many",
    ),  # type: ignore[call-arg,arg-type,misc]
    (lambda problem, _: simulate(problem, executor="greedi"), "did you mean greedy"),
    (lambda _, __: spread(Camera() for _ in range(2)), "at least 1 of them"),  # type: ignore[arg-type]
    (lambda _, __: Goal(), "^value = .* at least one of x_m"),
    (lambda problem, _: load_problem(problem), "a path"),  # type: ignore[arg-type]
    (lambda _, result: simulate(result), "load_problem"),
    (lambda problem, _: with_path_model(problem, "arc"), "load_robot"),  # type: ignore[arg-type]
    (lambda problem, _: Executor(SimulatedRobot(problem)).run(problem), r"\.require\("),  # type: ignore[arg-type]
    (lambda problem, _: setattr(problem.goal, "x_m", 1), r"x_m = 1 .*with_values\(x_m=\.\.\.\)"),
    (lambda problem, _: setattr(problem, "gapp", 1), r"did you mean gap"),
    (lambda problem, _: delattr(problem, "gap"), r"with_values\(gap=\.\.\.\)"),
    (lambda _, __: obstacles_of("map.json"), r"read_obstacles\(path\)"),
    (lambda _, __: obstacles_of(Path("map.json")), r"read_obstacles\(path\)"),
    (lambda _, __: read_obstacles(ROOM), r"obstacles_of\(polygons\)"),  # type: ignore[arg-type]
    (lambda problem, _: problem.with_values(obstacles=[ROOM]), r"obstacles_of\(polygons\)"),
    (lambda _, __: Command("off", 1.0), "heater_setpoint_C = 'off' .*in C"),  # type: ignore[arg-type]
    (lambda _, result: load_plan(result), r"result\.require\(\)"),
    (lambda problem, _: problem.with_values(0.1), r"with_values\(key=\.\.\.\)"),
    (lambda problem, _: SimulatedRobot(problem, seed=-1), "at least 0"),
    (lambda problem, _: simulate(problem, disturbance=LEVELS["mild"]), "a text"),  # type: ignore[arg-type]
    (lambda _, result: simulate(load_problem("paper-2"), plan=result), "this very problem"),
    (lambda _, result: result.require().trajectory.at("x"), "finite numbers"),
    (lambda _, result: result.require().trajectory.at([0.0, float("nan")]), "finite numbers"),
    (lambda _, result: result.require().trajectory.at([[0.0], [1.0]]), "a list of them"),
    (lambda _, result: plotting.draw_motion(plotting.plot_plan(result), result), "subplots"),  # type: ignore[arg-type]
    (lambda _, __: Executor("COM3"), r"SimulatedRobot\(problem\)"),  # type: ignore[arg-type]
    (lambda _, __: Executor(SimulatedRobot), r"SimulatedRobot\(problem\)"),  # type: ignore[arg-type]
    (lambda _, __: Camera(rate_Hz=-1), "more than 0"),
    (lambda _, __: Disturbance(delay_frames=(2, 1)), "2 values, .*the lower one first"),
    (lambda problem, _: plan(problem, on_progress=lambda: None), "a function of 1 argument"),  # type: ignore[arg-type,misc]
    (lambda _, __: twosra_mpc.Status("optimum"), "optimal, feasible, infeasible, failed"),
    (lambda _, result: result.save("plan.toml"), r"ending in \.json"),
    (lambda _, result: save_setpoints(result, "set.xlsx"), r"ending in \.csv"),  # type: ignore[arg-type]
    (lambda _, __: load_problem(io.StringIO()), "a path such as /dev/stdout"),  # type: ignore[arg-type]
    (lambda _, __: load_problem('robot = "2sra-v1"\n'), "this is text"),
    (lambda _, __: obstacles_of(np.zeros((4, 2))), r"shapely\.Polygon\(corners\)"),
    (lambda problem, _: obstacles_of(load_problem("doorway").obstacles[0]), "^geometries = Obst"),
    (lambda problem, _: problem.with_values(obstacles=ROOM), r"obstacles_of\("),
    (
        lambda problem, _: kinematics(problem.robot).jacobian(problem.start, (1, 0)),
        "start.configuration",
    ),  # type: ignore[arg-type]
    (lambda _, __: json_schema("problem"), "scenario, robot, plan"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("call", "words"), WRONG)
def test_wrong_calls_are_answered(call: Callable[[Problem, Any], object], words: str) -> None:
    result = solved("rigid-move")
    with pytest.raises(InputError, match=words):
        call(result.problem, result)


@pytest.mark.parametrize("size", [0, 1, 2, 3, 4, 5, 6])
def test_arrays_of_values_have_the_size_that_is_said(size: int) -> None:
    """Of every method that takes one; never broadcast, whatever they are given as."""
    goal = load_problem("paper-1").goal
    thing, room = load_problem("grasp-cube").objects[0], Workspace(x_m=(0, 1))
    asked: list[tuple[Callable[[Any], object], str, int]] = [
        *((method, "q", 5) for method in (goal.error, goal.met_at, goal.aim)),
        *((method, "near", 5) for method in (goal.box, goal.box_met)),
        (goal.loosened, "widths", 5),
        (lambda kappa: goal.shaped(kappa, 1.0), "kappa", 2),
        (Tolerance.of, "widths", max(size, 4)),
        (thing.at, "pose", 3),
        (room.margin_m, "points", 2),
        (room.holding, "points", 2),
    ]
    for method, name, right in asked:
        given = [np.zeros(size), np.zeros((1, size)), np.zeros((size, 1, 1))]
        for wrong in given[size == right : 1 if name == "points" and size == right else 3]:
            with pytest.raises(InputError) as error:
                method(wrong)
            assert error.value.field == name
        if size == right:
            for right_one in (np.zeros(size), [0.0] * size, pd.Series([0.0] * size)):
                method(right_one)
    if size != 1:
        with pytest.raises(InputError, match="poses"):
            load_problem("grasp-cube").world_with([None] * size)


@pytest.mark.parametrize("wrong", [(1,), (1, 0, 1), (2, 0), "10", None, 1])
def test_a_mode_is_drawn_of_its_robot(wrong: Any) -> None:
    robot, axes = load_robot("2sra-v1"), Figure().add_subplot()
    with pytest.raises(InputError, match=r"^mode = .*1 \(soft\)"):
        plotting.draw_robot(axes, robot.geometry, [0.0] * 5, wrong)
    with pytest.raises(InputError, match=r"^changing = .*1 \(soft\)"):
        plotting.draw_robot(axes, robot.geometry, [0.0] * 5, (0, 0), changing=wrong)


def test_a_result_is_taken_where_a_plan_is_meant(tmp_path: Path) -> None:
    result = solved("rigid-move")
    save_setpoints(result, tmp_path / "a.csv")  # type: ignore[arg-type]
    save_setpoints(result.require(), tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_what_a_plan_has_is_not_looked_for_in_a_result() -> None:
    for name in ("phases", "cost", "trajectory"):
        with pytest.raises(AttributeError, match=rf"result\.require\(\)\.{name}"):
            getattr(solved("rigid-move"), name)
    assert not hasattr(solved("rigid-move"), "nonsense")


def test_whatever_holds_arrays_is_a_value() -> None:
    """It compares, hashes, and prints in a line; a copy that was pickled is the same."""
    classes = [thing for thing in public_things() if inspect.isclass(thing)]
    for each in classes:
        written = " ".join(map(str, vars(each).get("__annotations__", {}).values()))
        if dataclasses.is_dataclass(each) or issubclass(each, tuple):
            assert issubclass(each, ArrayValue) or "Array" not in written, each
    result, robot = solved("rigid-move"), load_robot("2sra-v1")
    simulation = simulate(result.problem, disturbance="none", plan=result.require())
    plain = (result, result.plan, result.require().samples, simulation, simulation.run, robot)
    shape = robot_shape(robot.geometry, [0.1] * 5)
    why = explain(load_problem("paper-2"))
    for value in (*plain, shape, kinematics(robot), why, load_problem("pick-and-place")):
        again = pickle.loads(pickle.dumps(value))
        assert (again, hash(again)) == (value, hash(value))
        assert len(repr(value)) < 500


@pytest.mark.parametrize("path", ["n" * 300, "n/" * 3000, "a\0b", "", "/", "nowhere/x.json"])
def test_whatever_stands_for_a_path_is_answered(path: str) -> None:
    """By all functions that want nothing else, and by one that writes."""
    for name, function, module in public_calls():
        known = dict(kinds(function, module))
        if [*known] in (["path"], ["source"]) and name.startswith(("load_", "check_", "read_")):
            with pytest.raises(InputError):
                function(path)
    with pytest.raises(InputError, match=r"^output = "):
        solved("rigid-move").save(path)


def test_values_of_files_compare_as_values(tmp_path: Path) -> None:
    result = solved("rigid-move")
    result.save(tmp_path / "plan.json")
    again = twosra_mpc.load_plan(tmp_path / "plan.json")
    assert (again, again.plan) == (result, result.plan)
    assert hash(again) == hash(result)
    assert again.require().samples != solved("paper-2").require().samples
