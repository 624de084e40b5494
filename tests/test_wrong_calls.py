"""Wrong calls of the library: each is answered with what makes the right argument."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import Solved

import twosra_mpc
from twosra_mpc import (
    InputError,
    Problem,
    check_plan,
    execution,
    load_problem,
    plan,
    plotting,
    report,
    save_setpoints,
    with_path_model,
)
from twosra_mpc.execution import Executor, SimulatedRobot, simulate

KINDS = {"Problem", "Plan", "Result", "Robot", "Run"}
EXPORTS = ("export.plan_mcap", "export.ros2_mcap", "plans.setpoints")


def public_functions() -> Iterator[tuple[Callable[..., Any], str]]:
    """Public functions, and those of their arguments that are of a kind of this package."""
    exports = [importlib.import_module(f"twosra_mpc.{name}") for name in EXPORTS]
    places = [(place, place.__all__) for place in (twosra_mpc, execution, plotting, report)]
    places += [
        (each, [name for name in vars(each) if name.startswith("save_")]) for each in exports
    ]
    for place, names in places:
        for name in names:
            function = getattr(place, name)
            if inspect.isfunction(function):
                for argument, parameter in inspect.signature(function).parameters.items():
                    if parameter.annotation in KINDS:
                        yield function, argument


@pytest.mark.parametrize(
    ("function", "argument"),
    [pytest.param(*each, id=f"{each[0].__name__}-{each[1]}") for each in public_functions()],
)
def test_every_public_function_refuses_a_name_where_a_value_is_meant(
    function: Callable[..., Any], argument: str
) -> None:
    """The name stands in every place; whatever is refused says what makes the right one."""
    signature = inspect.signature(function)
    needed = [each for each in signature.parameters.values() if each.default is each.empty]
    given = {each.name: "paper-1" for each in needed} | {argument: "paper-1"}
    with pytest.raises(InputError, match=r"load_\w+\(|plan\(problem\)|\.run\(plan\)"):
        function(**given)


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
    with pytest.raises(AttributeError, match=r"result\.require\(\)\.phases"):
        solved("rigid-move").phases  # noqa: B018
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
