"""Arguments of public functions: a wrong kind is answered with what makes the right one."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import PurePath
from typing import Any, ParamSpec, TypeVar

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.keys import near_word

MADE_BY = {  # kind of value -> what makes one
    "Problem": 'load_problem("paper-1"), or Problem(...)',
    "Plan": "plan(problem).require(), or load_plan(path).require()",
    "Result": "plan(problem), or load_plan(path)",
    "Robot": 'load_robot("2sra-v1")',
    "Body": 'load_robot("2sra-v1").body',
    "Geometry": 'load_robot("2sra-v1").geometry',
    "Run": "Executor(robot).run(plan)",
    "HeatingLog": "read_heating_log(path)",
    "Kinematics": 'kinematics(load_robot("2sra-v1"))',
    "RobotShape": "robot_shape(geometry, q)",
    "Explanation": "explain(result)",
    "PlanCheck": "check_plan(path)",
}
_TAKEN_OF: dict[tuple[str, str], Callable[[Any], Any]] = {  # (kind, what is given) -> its own
    ("Plan", "Result"): lambda result: result.require(),
    ("Geometry", "Robot"): lambda robot: robot.geometry,
}


def _are_plans(value: Any) -> bool:
    listed = isinstance(value, Sequence)
    return listed and all("Plan" in {k.__name__ for k in type(each).__mro__} for each in value)


def _is_numbers(value: Any) -> bool:
    try:
        return np.asarray(value, float).ndim > 0
    except (TypeError, ValueError):
        return False


_PLAIN: dict[str, tuple[Callable[[Any], bool], str]] = {  # kind -> its test, and its words
    "str | Path": (lambda value: isinstance(value, str | PurePath), "a path"),
    "float": (lambda value: isinstance(value, Real) and not isinstance(value, bool), "a number"),
    "int": (
        lambda value: isinstance(value, Integral) and not isinstance(value, bool),
        "a whole number",
    ),
    "bool": (lambda value: isinstance(value, bool | np.bool_), "True or False"),
    "Sequence[str]": (
        lambda value: isinstance(value, Sequence) and not isinstance(value, str),
        "a list of names",
    ),
    "ArrayLike": (_is_numbers, "an array of numbers, e.g. [0.0, 0.0, 0.0, 10.0, -10.0] for q"),
    "Callable": (callable, "a function"),
    "Mapping[str, Sequence[Plan]]": (
        lambda value: isinstance(value, Mapping) and all(map(_are_plans, value.values())),
        'lists of plans by name, e.g. {"paper-1": [plan(problem).require()]}',
    ),
}
_WRITTEN_BY = {  # what is given in place of a path -> how it becomes a file, or needs none
    "dict": "a table of keys becomes one by Problem(**table), or Robot(**table).",
    "Result": "result.save(path) writes it; result.require() is its plan.",
    "Plan": "it is a plan already, and its result writes it: result.save(path).",
    "Problem": "it is a problem already.",
    "Robot": "it is a robot already.",
}
Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")


def public(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Check the arguments of a public function by its annotations, and say what makes right ones.

    Of a result where a plan is meant the plan is taken, by ``require()``; of a robot its geometry.

    Raises:
        InputError: If an argument is missing, unknown, or of another kind.
    """
    signature = inspect.signature(function)
    kinds = {
        name: kind
        for name, parameter in signature.parameters.items()
        if (kind := checked_kind(str(parameter.annotation)))
    }

    @functools.wraps(function)
    def checked(*args: Parameters.args, **named: Parameters.kwargs) -> Returned:
        try:
            given = signature.bind(*args, **named)
        except TypeError as error:
            raise _wrong_arguments(function.__name__, signature, args, named, error) from None
        for name, value in given.arguments.items():
            if name in kinds:
                given.arguments[name] = _of_kind(kinds[name], name, value)
        return function(*given.args, **given.kwargs)

    return checked


def checked_kind(annotation: str) -> tuple[str, ...]:
    """Kinds that an annotation allows, "None" among them; empty where they are not known."""
    text = annotation.removesuffix(" | None")
    kinds = (text,) if text in _PLAIN else tuple(text.split(" | "))
    kinds = ("Callable",) if text.startswith("Callable[") else kinds
    known = all(kind in _PLAIN or kind in MADE_BY for kind in kinds)
    return (*kinds, *["None"] * (text != annotation)) if known else ()


def _of_kind(kinds: tuple[str, ...], name: str, value: Any) -> Any:
    """A value of one of these kinds, classes by their names; the plan of a result."""
    classes = {each.__name__ for each in type(value).__mro__}
    for kind in kinds:
        if kind in classes or (kind in _PLAIN and _PLAIN[kind][0](value)):
            return value
    if value is None and "None" in kinds:
        return value
    for (kind, given), take in _TAKEN_OF.items():
        if kind in kinds and given in classes:
            return take(value)
    allowed = [
        _PLAIN[kind][1] if kind in _PLAIN else f"a {kind}: {MADE_BY[kind]}"
        for kind in kinds
        if kind != "None"
    ]
    hints = [hint for each, hint in _WRITTEN_BY.items() if each in classes]
    hint = hints[0] if hints and "str | Path" in kinds else ""
    raise InputError(name, value, ", or ".join(allowed), hint=hint)


def made(kind: type[Returned]) -> type[Returned]:
    """Let a class whose values a function makes say which one, where its call does not fit."""
    method = "__new__" if issubclass(kind, tuple) else "__init__"
    build = getattr(kind, method)

    @functools.wraps(build)
    def checked(own: Any, *args: Any, **named: Any) -> Any:
        try:
            return build(own, *args, **named)
        except TypeError as error:
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise  # it comes from within
            given = (*args, *named.values())
            raise InputError(kind.__name__, given, f"what {MADE_BY[kind.__name__]} makes") from None

    setattr(kind, method, checked)
    return kind


def _wrong_arguments(
    function: str,
    signature: inspect.Signature,
    args: Sequence[Any],
    named: dict[str, Any],
    error: TypeError,
) -> InputError:
    """Name the argument that does not fit; keys of a value among them are changed in the value."""
    known = ", ".join(signature.parameters)
    for name in named.keys() - signature.parameters.keys():
        hint = near_word(name, [*signature.parameters])
        for owner in (each for each in args if name in getattr(type(each), "model_fields", ())):
            kind = type(owner).__name__.lower()
            hint = f"{kind}.with_values({name}={named[name]!r}) makes a {kind} with it."
        return InputError(name, named[name], f"arguments of {function}: {known}", hint=hint)
    return InputError(function, f"{len(args) + len(named)} arguments", f"{known} ({error})")
