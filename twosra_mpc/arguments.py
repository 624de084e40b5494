"""Arguments of public functions: a wrong kind is answered with what makes the right one."""

from __future__ import annotations

import builtins
import enum
import functools
import inspect
import math
import operator
import re
import sys
import tomllib
import types
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from numbers import Integral, Real
from pathlib import Path, PurePath
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    NoReturn,
    TypeVar,
    Union,
    get_args,
    get_origin,
)

import numpy as np

from twosra_mpc.errors import MISSING, InputError
from twosra_mpc.keys import describe, near_word

_WORDS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
MADE_BY: dict[str, str] = _WORDS["made_by"]
_TAKEN_OF: dict[tuple[str, str], Callable[[Any], Any]] = {  # (kind, what is given) -> its own
    ("Plan", "Result"): lambda result: result.require(),
    ("Geometry", "Robot"): lambda robot: robot.geometry,
    ("Run", "Simulation"): lambda simulation: simulation.run,
    ("Metrics", "Simulation"): lambda simulation: simulation.metrics,
}


def _numbers(value: Any) -> Any:
    """A value as an array of numbers; NaN where it has none, as words that look like numbers."""
    try:
        plain = value.filled(math.nan) if hasattr(value, "filled") else value  # of masked arrays
        return np.asarray(plain).astype(float, casting="same_kind")
    except (TypeError, ValueError):
        return np.asarray(math.nan)


def _is_mode(value: Any) -> bool:
    bits = _numbers(value)
    return bits.ndim == 1 and bool(np.isin(bits, (0, 1)).all())


_PATH, _TEXT, _ANYTHING = "a path", "a text", "anything"
_ARRAY = "finite numbers, one or an array"
_PLAIN: dict[str, tuple[Callable[[Any], bool], str]] = {  # name of a kind -> its test, its words
    "str": (lambda value: isinstance(value, str), _TEXT),
    "bytes": (lambda value: isinstance(value, bytes), "bytes, as Path(...).read_bytes() reads"),
    "Path": (lambda value: isinstance(value, PurePath), _PATH),
    "float": (lambda value: isinstance(value, Real) and math.isfinite(value), "a finite number"),
    "int": (lambda value: isinstance(value, Integral), "a whole number"),
    "bool": (lambda value: isinstance(value, bool | np.bool_), "True or False"),
    "ArrayLike": (lambda value: bool(np.isfinite(_numbers(value)).all()), _ARRAY),
    "Mode": (_is_mode, "a mode: for each segment 1 (soft) or 0 (rigid), e.g. (1, 0)"),
}
_MARKED = {name: type(name, (), {}) for name in ("ArrayLike", "Array", "Mode")}
_LIMITS: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {  # of annotations
    "gt": ("more than {:zg}", operator.gt),
    "ge": ("at least {:zg}", operator.ge),
    "lt": ("less than {:zg}", operator.lt),
    "le": ("at most {:zg}", operator.le),
    "min_length": ("at least {} of them", lambda value, least: len(value) >= least),
    "ends": ("{}", lambda value, _: value[0] <= value[1]),
}
_MISSING = re.compile("missing a required .*'(.+)'")  # as ``inspect`` says it
_OTHER = object()  # in place of a value that is of another kind
Public = TypeVar("Public", bound=Callable[..., Any])


class Range(NamedTuple):
    """Mark of a pair in an annotation: its ends are in order."""

    ends: str = "the lower one first"


class Word(enum.StrEnum):
    """One of a few words.

    Raises:
        InputError: If it is none of them.
    """

    @classmethod
    def _missing_(cls, value: object) -> NoReturn:
        raise InputError(cls.__name__, value, f"one of {', '.join(cls)}")


class Kind(NamedTuple):
    """Kind of arguments.

    Attributes:
        words: What makes one.
        take: A value of this kind -> itself, or what of it is meant; of another: ``_OTHER``.
    """

    words: str
    take: Callable[[Any], Any]


def public(thing: Public) -> Public:
    """Check the arguments of a public function by its annotations, and say what makes right ones.

    Of a class, those of its methods, and of its constructor if that is called by its users. Of a
    result where a plan is meant the plan is taken, by ``require()``; of a robot its geometry.

    Raises:
        InputError: If an argument is missing, unknown, or of another kind.
    """
    if not isinstance(thing, type):
        return _checked(thing, thing.__name__, thing.__module__)
    constructor = "__new__" if issubclass(thing, tuple) else "__init__"
    for name, member in [*vars(thing).items()]:
        function = getattr(member, "__func__", member)  # of class methods, too
        if inspect.isfunction(function) and (name == constructor or not name.startswith("_")):
            own = thing.__name__ if name == constructor else name
            checked = _checked(function, own, thing.__module__)
            setattr(thing, name, checked if function is member else type(member)(checked))
    return thing


def _checked(function: Any, name: str, module: str) -> Any:
    """A function under this name that looks at its arguments first."""

    @functools.cache  # when it is first called: what annotations name is imported by then
    def known() -> tuple[dict[str, int], dict[str, Kind]]:
        checks = {} if name in MADE_BY else dict(kinds(function, module))
        return {each: i for i, each in enumerate(inspect.signature(function).parameters)}, checks

    @functools.wraps(function)
    def checked(*args: Any, **named: Any) -> Any:
        places, checks = known()
        for each, kind in checks.items():
            place, by_name = places[each], each in named
            if not by_name and place >= len(args):
                continue
            given = named[each] if by_name else args[place]
            taken = kind.take(given.item() if getattr(given, "shape", None) == () else given)
            if taken is _OTHER:
                raise _wrong_kind(kind.words, each, given)
            if taken is given:
                continue
            if by_name:
                named[each] = taken
            else:
                args = (*args[:place], taken, *args[place + 1 :])
        try:
            return function(*args, **named)
        except TypeError:
            _check_bound(name, function, checks, args, named)
            raise  # it comes from within

    return checked


def kinds(function: Callable[..., Any], module: str) -> Iterator[tuple[str, Kind]]:
    """Parameters whose values are checked, by their annotations, and of which kind they are."""
    names = _Names(vars(sys.modules[module]) | _MARKED)
    for each in inspect.signature(function).parameters.values():
        several = each.kind in (each.VAR_KEYWORD, each.VAR_POSITIONAL)
        if each.annotation is not each.empty and not several:
            written = getattr(each.annotation, "__forward_arg__", each.annotation)
            kind = kind_of(eval(written, {}, names) if isinstance(written, str) else written)
            if kind.words == _ARRAY and each.name in _WORDS["sized"]:
                kind = kind._replace(words=_WORDS["sized"][each.name].replace("{} ", ""))
            if kind.words != _ANYTHING:
                yield each.name, kind


class _Names(dict[str, Any]):
    """Names of a module; what it imports for type checkers alone is an empty class of that name."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name) if hasattr(builtins, name) else type(name, (), {})


def kind_of(hint: Any) -> Kind:
    """Kind that an annotation means."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is None or hint is types.NoneType:
        return _tested("", lambda value: value is None)
    if origin in (Union, types.UnionType):
        return _either([kind_of(each) for each in inner])
    if origin is Annotated:
        return _within(kind_of(inner[0]), inner[1:])
    if origin is Literal:
        return _tested(f"one of {', '.join(map(str, inner))}", lambda value: value in inner)
    if origin is None or origin in (type, np.ndarray):
        return _of_class(origin or hint)
    if issubclass(origin, Mapping):
        return _table(kind_of(inner[1]))
    if origin.__name__ == "Callable":
        return _function(len(inner[0]))
    return _list(kind_of(inner[0]), len(inner) if origin is tuple and ... not in inner else None)


def _tested(words: str, holds: Callable[[Any], bool]) -> Kind:
    return Kind(words, lambda value: value if holds(value) else _OTHER)


def _either(choices: list[Kind]) -> Kind:
    """Kind of values that are of one of these."""

    def take(value: Any) -> Any:
        taken = (each.take(value) for each in choices)
        return next((each for each in taken if each is not _OTHER), _OTHER)

    words = [each.words for each in choices if each.words]
    words = [each for each in words if each != _TEXT or _PATH not in words]
    return Kind(", or ".join(words), take)


def _within(kind: Kind, metadata: tuple[Any, ...]) -> Kind:
    """Kind whose values have the limits of an annotation."""
    limits = [
        (*_LIMITS[name], getattr(limit, name))
        for each in metadata
        for limit in getattr(each, "metadata", (each,))
        for name in _LIMITS
        if hasattr(limit, name)
    ]

    def take(value: Any) -> Any:
        taken = kind.take(value)
        inside = taken is not _OTHER and all(holds(taken, limit) for _, holds, limit in limits)
        return taken if inside else _OTHER

    words = " and ".join(said.format(limit) for said, _, limit in limits)
    return kind._replace(words=f"{kind.words}, {words}" if words else kind.words, take=take)


def _list(kind: Kind, count: int | None) -> Kind:
    """Kind of lists, and of whatever else becomes one."""

    def take(value: Any) -> Any:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            return _OTHER
        value = value if isinstance(value, Collection) else [*value]
        taken = [kind.take(each) for each in value]
        if any(each is _OTHER for each in taken) or len(taken) != (count or len(taken)):
            return _OTHER
        return value if all(map(operator.is_, taken, value)) else taken

    several = "a list, each" if count is None else f"{count} values, each"
    return Kind(f"{several} {kind.words or 'None'}", take)


def _table(kind: Kind) -> Kind:
    """Kind of tables of values by their names."""

    def take(value: Any) -> Any:
        if not isinstance(value, Mapping) or not all(isinstance(each, str) for each in value):
            return _OTHER
        taken = {name: kind.take(each) for name, each in value.items()}
        return _OTHER if any(each is _OTHER for each in taken.values()) else taken

    return Kind(f'a table by names, {{"name": ...}}, of {kind.words}', take)


def _function(count: int) -> Kind:
    """Kind of functions that can be called with so many arguments, as far as they say it."""

    def takes_them(value: Any) -> bool:
        try:
            inspect.signature(value).bind(*range(count))
        except (TypeError, ValueError) as error:  # the latter: a built-in that does not say it
            return isinstance(error, ValueError)
        return True

    return _tested(f"a function of {count} argument{'s' * (count != 1)}", takes_them)


def _of_class(kind: Any) -> Kind:
    """Kind of values of a class, known by its name, or of objects that fulfil a protocol."""
    name = getattr(kind, "__name__", "")
    if kind in (Any, object) or isinstance(kind, TypeVar):
        return Kind(_ANYTHING, lambda value: value)
    if name in ("Array", "ndarray"):
        return Kind(_ARRAY, lambda v: v if isinstance(v, np.ndarray) else _array(v))
    if name in _PLAIN:
        holds, words = _PLAIN[name]
        truths = bool, np.bool_  # numbers for Python, and none here
        return _tested(words, lambda v: holds(v) and (name == "bool") == isinstance(v, truths))
    able = [each for each in vars(kind) if not each.startswith("_")]
    protocol = getattr(kind, "_is_protocol", False)

    def take(value: Any) -> Any:
        if protocol and not isinstance(value, type) and all(hasattr(value, each) for each in able):
            return value
        classes = _class_names(value.__class__)
        if name in classes:
            return value
        own = (_TAKEN_OF.get((name, given)) for given in classes)
        return next((of(value) for of in own if of), _OTHER)

    article = "an" if name[:1] in "AEIO" else "a"
    return Kind(f"{article} {name}: {MADE_BY.get(name, f'{name}(...)')}", take)


def _array(value: Any) -> Any:
    """An array of whatever else holds finite numbers."""
    numbers = _numbers(value)
    return numbers if np.isfinite(numbers).all() else _OTHER


@functools.cache
def _class_names(of: type) -> frozenset[str]:
    """Names of a class and of those that it comes from."""
    return frozenset(each.__name__ for each in of.__mro__)


def _wrong_kind(words: str, name: str, value: Any) -> InputError:
    """Say what makes a value of the kind of these words, of this one too where something does."""
    tables = [table for kind, table in _WORDS["in_place_of"].items() if kind in words]
    known = {each: hint for table in tables for each, hint in table.items()}
    hints = [known[each] for each in known if each in _class_names(value.__class__)]
    return InputError(name, value, words, hint=(*hints, "")[0])


def _check_bound(
    name: str, function: Any, checks: dict[str, Kind], args: tuple[Any, ...], named: dict[str, Any]
) -> None:
    """Name the argument that does not fit, if any.

    Raises:
        InputError: If one is missing or unknown; keys of a value are changed in the value.
    """
    signature = inspect.signature(function)
    try:
        signature.bind(*args, **named)
        return
    except TypeError as error:
        reason = str(error)
    known = [each for each in signature.parameters.values() if each.annotation is not each.empty]
    for key in named.keys() - {each.name for each in known}:
        hint = near_word(key, [each.name for each in known])
        values = (*args, *named.values())
        for owner in (each for each in values if key in getattr(type(each), "model_fields", ())):
            kind = type(owner).__name__.lower()
            hint = f"{kind}.with_values({key}={named[key]!r}) makes a {kind} with it."
        allowed = f"arguments of {name}: {', '.join(each.name for each in known)}"
        raise InputError(key, named[key], allowed, hint=hint)
    placed = args[len(signature.parameters) - len(known) :]
    given = (*placed, *named.values())
    by_name = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD
    keys = ("key" if each.kind is each.VAR_KEYWORD else each.name for each in known)
    written = (key + "=..." * (each.kind in by_name) for key, each in zip(keys, known, strict=True))
    allowed = f"{name}({', '.join(written)})"
    if name not in MADE_BY and (found := _MISSING.match(reason)):
        words = checks[found[1]].words if found[1] in checks else describe(found[1])
        raise InputError(found[1], MISSING, f"{words}; {allowed} takes it")
    allowed = f"what {MADE_BY[name]} makes" if name in MADE_BY else f"{allowed}, {reason}"
    raise InputError(name, given[0] if len(given) == 1 else given, allowed)


def check_size(name: str, given: Any, size: int, what: str = "", reached: bool = False) -> Any:
    """Return an argument as an array of so many finite numbers, of 1 and 0 if it is a mode.

    Points are (..., size). What a motion that may diverge has reached need not be finite.

    Raises:
        InputError: Says what the numbers are.
    """
    numbers, what = _numbers(given), what or name
    reached |= what == "points"
    of_kind = np.isin(numbers, (0, 1)) if what == "mode" else np.isfinite(numbers) | reached
    if what != "points" and numbers.shape == (size, 1):  # a column, as CasADi has it
        numbers = numbers[:, 0]
    shape = numbers.shape[-1:] if what == "points" else numbers.shape
    if shape != (size,) or not of_kind.all():
        raise _wrong_kind(_WORDS["sized"][what].format(size), name, given)
    return numbers
