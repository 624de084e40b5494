"""Wrong calls of the library: each is answered with what makes the right argument."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import pytest
from conftest import Solved

import twosra_mpc
from twosra_mpc import (
    InputError,
    Problem,
    check_plan,
    execution,
    json_schema,
    kinematics,
    load_plan,
    load_problem,
    load_robot,
    obstacles_of,
    plan,
    plotting,
    report,
    robot_names,
    save_setpoints,
    with_path_model,
)
from twosra_mpc.arguments import MADE_BY, checked_kind
from twosra_mpc.execution import Executor, SimulatedRobot, simulate
from twosra_mpc.validation import Value

EXPORTS = ("export.plan_mcap", "export.ros2_mcap", "plans.setpoints")
PLACES = (
    *(twosra_mpc, execution, plotting, report),
    *(importlib.import_module(f"twosra_mpc.{name}") for name in EXPORTS),
)
RIGHT: dict[str, object] = {"str | Path": "x", "float": 1.0, "int": 1, "bool": True, "None": None}
RIGHT |= {"Sequence[str]": ["x"], "ArrayLike": [0.0], "Callable": print}
RIGHT |= {"Mapping[str, Sequence[Plan]]": {}}


def public_functions() -> Iterator[Callable[..., Any]]:
    """Public functions of the package; of exports, those that write a file."""
    for place in PLACES:
        exported = [name for name in vars(place) if name.startswith("save_")]
        for name in getattr(place, "__all__", exported):
            if inspect.isfunction(getattr(place, name)):
                yield getattr(place, name)


def arguments() -> Iterator[Any]:
    """Arguments of public functions that are of a kind which is known."""
    for function in dict.fromkeys(public_functions()):
        for argument, parameter in inspect.signature(function).parameters.items():
            if hasattr(function, "__wrapped__") and checked_kind(str(parameter.annotation)):
                yield pytest.param(function, argument, id=f"{function.__name__}-{argument}")


def right(annotation: str) -> object:
    """What passes as of this kind; a class is known by its name."""
    kind, *_ = checked_kind(annotation) or ("None",)
    return RIGHT[kind] if kind in RIGHT else type(kind, (), {})()


@pytest.mark.parametrize(("function", "argument"), [*arguments()])
def test_every_public_function_says_what_makes_the_right_argument(
    function: Callable[..., Any], argument: str
) -> None:
    """Each argument is of no kind while all others are right: it is named, and nothing is run."""
    parameters = inspect.signature(function).parameters
    given = {
        name: right(str(each.annotation))
        for name, each in parameters.items()
        if each.default is each.empty and each.kind is not each.VAR_KEYWORD
    }
    kind, *_ = checked_kind(str(parameters[argument].annotation))
    with pytest.raises(InputError) as error:
        function(**given | {argument: object()})
    assert error.value.field == argument
    assert MADE_BY.get(kind, "a") in error.value.allowed


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
            wrong += [ca.SX.sym("q", len(right[each]) + 1)]
            if each == "sigma":
                wrong += [(2,) * n, (0.5,) * n, (-1,) * n, (float("nan"),) * n]
            for given in wrong:
                with pytest.raises(InputError) as error:
                    function(*((right | {each: given})[name] for name in names))
                assert error.value.field == each
    for wrong in ([0.0] * 3, [0.0] * 5, "fast", None):
        with pytest.raises(InputError, match="wheel_rad_s"):
            model.inputs(right["q"], right["sigma"], wrong)


WRONG: list[tuple[Callable[[Problem, Any], object], str]] = [
    (lambda problem, _: plan(problem, gap=0.1), r"gap = 0\.1 .*\.with_values\(gap=0\.1\)"),  # type: ignore[call-arg]
    (lambda problem, _: plan(problem, on_progres=print), "did you mean on_progress"),  # type: ignore[call-arg]
    (lambda _, result: plan(result), "load_problem"),
    (lambda _, result: check_plan(result), "a path"),
    (lambda _, result: save_setpoints(result), "'path'"),  # type: ignore[call-arg]
    (lambda problem, _: load_problem(problem), "a path"),  # type: ignore[arg-type]
    (lambda _, result: simulate(result), "load_problem"),
    (lambda problem, _: with_path_model(problem, "arc"), "load_robot"),  # type: ignore[arg-type]
    (lambda problem, _: Executor(SimulatedRobot(problem)).run(problem), r"\.require\("),  # type: ignore[arg-type]
    (lambda problem, _: setattr(problem.goal, "x_m", 1), r"x_m = 1 .*with_values\(x_m=\.\.\.\)"),
    (lambda problem, _: setattr(problem, "gapp", 1), r"did you mean gap"),
    (lambda problem, _: delattr(problem, "gap"), r"with_values\(gap=\.\.\.\)"),
    (lambda _, __: obstacles_of("map.json"), r"read_obstacles\(path\)"),
    (lambda _, result: load_plan(result), r"result\.require\(\)"),
    (lambda _, __: json_schema("problem"), "scenario, robot, plan"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("call", "words"), WRONG)
def test_wrong_calls_are_answered(
    call: Callable[[Problem, Any], object], words: str, solved: Solved
) -> None:
    result = solved("rigid-move")
    with pytest.raises(InputError, match=words):
        call(result.problem, result)


def test_a_result_is_taken_where_a_plan_is_meant(solved: Solved, tmp_path: Path) -> None:
    result = solved("rigid-move")
    save_setpoints(result, tmp_path / "a.csv")  # type: ignore[arg-type]
    save_setpoints(result.require(), tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_what_a_plan_has_is_not_looked_for_in_a_result(solved: Solved) -> None:
    for name in ("phases", "cost", "trajectory"):
        with pytest.raises(AttributeError, match=rf"result\.require\(\)\.{name}"):
            getattr(solved("rigid-move"), name)
    assert not hasattr(solved("rigid-move"), "nonsense")


def test_values_compare_and_print_as_values(solved: Solved, tmp_path: Path) -> None:
    result = solved("rigid-move")
    result.save(tmp_path / "plan.json")
    again = twosra_mpc.load_plan(tmp_path / "plan.json")
    assert (again, again.plan) == (result, result.plan)
    assert hash(again) == hash(result)
    assert again.require().samples != solved("paper-2").require().samples
    simulation = simulate(result.problem, disturbance="none", plan=result.require())
    for value in (result, result.plan, again.require().samples, simulation, simulation.run):
        assert len(repr(value)) < 500
