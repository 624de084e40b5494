"""Frozen, validated values: the base class of everything a user can write in a file."""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    NoReturn,
    Self,
    TypeAlias,
    TypeVar,
    get_args,
)

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails

from twosra_mpc.arguments import MADE_BY, public
from twosra_mpc.errors import MISSING, InputError, doubt, is_users
from twosra_mpc.keys import describe, key_of, near_key, near_number, near_word, plain_words, unit_of


def plain(value: object) -> object:
    """Turn scalars and arrays of NumPy and its like into numbers and tuples, and nothing else."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(plain(item) for item in value)
    return value


def _at_least(least: float) -> AfterValidator:
    """Refuse what is positive, but too small to compute with."""

    def checked(value: float) -> float:
        if value < least:
            raise ValueError(f"at least {least:zg}")
        return value

    return AfterValidator(checked)


_UNSHOWN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")  # control, half characters
_BRIEF = 80  # characters of a field that are shown
Key = TypeVar("Key")
Item = TypeVar("Item")

# Ranges of what a file may say: wide enough for any robot, and nothing overflows within them.
Number = Annotated[float, Field(ge=-1e6, le=1e6), BeforeValidator(plain)]
Positive = Annotated[float, Field(gt=0.0, le=1e9), _at_least(1e-12), BeforeValidator(plain)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e9), BeforeValidator(plain)]
Metres = Annotated[float, Field(ge=-100.0, le=100.0), BeforeValidator(plain)]  # of a position
Radians = Annotated[float, Field(ge=-1e3, le=1e3), BeforeValidator(plain)]
Celsius = Annotated[float, Field(ge=-273.15, le=2e3), BeforeValidator(plain)]
Pair = Annotated[tuple[Number, Number], BeforeValidator(plain)]
PlanePose = Annotated[tuple[Metres, Metres, Radians], BeforeValidator(plain)]
MetresPair = Annotated[tuple[Metres, Metres], BeforeValidator(plain)]


def _in_order(pair: tuple[float, float]) -> tuple[float, float]:
    """Refuse an interval whose ends are not in order."""
    if not pair[0] < pair[1]:
        raise InputError("", pair, "two numbers, the lower one first")
    return pair


Interval = Annotated[Pair, AfterValidator(_in_order)]
MetresInterval = Annotated[MetresPair, AfterValidator(_in_order)]
Length = Annotated[float, Field(gt=0.0, le=100.0), _at_least(1e-6), BeforeValidator(plain)]  # in m
Distance = Annotated[float, Field(ge=0.0, le=100.0), BeforeValidator(plain)]  # in m
Rate = Annotated[float, Field(gt=0.0, le=1e9), _at_least(1e-5), BeforeValidator(plain)]
Seconds = Annotated[float, Field(gt=0.0, le=1e6), _at_least(1e-6), BeforeValidator(plain)]
_Shape = Annotated[float, Field(gt=0.0, le=100.0), _at_least(1e-6)]
Triple = Annotated[tuple[_Shape, _Shape, _Shape], BeforeValidator(plain)]
Count = Annotated[int, Field(ge=0), BeforeValidator(plain)]
TwoOrMore = Annotated[int, Field(ge=2), BeforeValidator(plain)]
Share = Annotated[float, Field(ge=0.0, le=1.0), BeforeValidator(plain)]
Bit = Annotated[int, Field(ge=0, le=1)]
MOST_SEGMENTS = 4  # stiffness modes double with each
# One entry for each segment. Only who knows the robot can name the entries that are missing, so
# that a list without any is left to it too.
EachSegment = Field(max_length=MOST_SEGMENTS, json_schema_extra={"minItems": 1})
if TYPE_CHECKING:  # lists may be given as well; a record holds tuples
    Several: TypeAlias = Sequence[Item]
    EachOf: TypeAlias = Sequence[Item]
else:
    Several = Annotated[tuple[Item, ...], BeforeValidator(plain)]
    EachOf = Annotated[tuple[Item, ...], EachSegment]
OneOrMore = Annotated[Sequence[Item], Field(min_length=1)]
Numbers = Annotated[EachOf[Number], BeforeValidator(plain)]
ModeField = Annotated[tuple[Bit, ...], EachSegment, BeforeValidator(plain)]


_FOLLOWS = "default_factory_not_called"  # pydantic's word for a default that needs a wrong value


_KINDS: dict[str, type[BaseModel]] = {}  # every record by the name of its class


class Value(BaseModel):
    """A frozen record whose construction either succeeds with valid fields or names the bad one.

    Warns:
        InputWarning: Of its ``unit_doubts``, which problems and robots have: numbers that are
            legal and probably in another unit; where a user's program makes it.

    Raises:
        InputError: On an unknown or missing key, a wrong type or shape, a value that is not finite
            or not in its range.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        _KINDS[cls.__name__] = public(cls)

    if not TYPE_CHECKING:  # the generated signature is what editors should complete

        def __init__(self, /, *args: Any, **data: Any) -> None:
            if args:
                raise _without_keys(type(self), args)
            for key, text in data.items():  # no screen, picture or UTF-8 file can hold these
                if isinstance(text, str) and _UNSHOWN.search(text):
                    raise InputError(key, text, "text without control characters")
            try:
                super().__init__(**data)
            except ValidationError as error:
                details = [one for one in error.errors() if one["type"] != _FOLLOWS]
                problems = [named_problem(type(self), detail) for detail in details]
                raise problems[0].among(problems[1:]) from None
            doubted = hasattr(type(self), "unit_doubts")
            if doubted and is_users(sys._getframe(1), "twosra_mpc.arguments", __name__):
                doubt(self.unit_doubts)

        def __setattr__(self, name: str, value: Any) -> None:
            if not name.startswith("_"):
                own, known = type(self).__name__, type(self).model_fields
                key = name if name in known else "key"
                hint = "" if name in known else near_key(name, value, [*known])
                allowed = f"another {own}: with_values({key}=...) makes one"
                raise InputError(name, value, allowed, hint=hint)
            super().__setattr__(name, value)

        def __delattr__(self, name: str) -> None:
            self.__setattr__(name, None)

    def __iter__(self) -> Iterator[tuple[str, Any]]:  # type: ignore[override]  # as dict() wants it
        """Fields and their values, and nothing that was worked out of them."""
        return ((name, getattr(self, name)) for name in type(self).model_fields)

    def __repr_str__(self, join_str: str) -> str:
        """Fields that are not what they are by default, in words that fit into a line."""
        known = type(self).model_fields
        return join_str.join(f"{key}={_brief(a)}" for key, a in self if a != known[key].default)

    @public
    def with_values(self, **changes: Any) -> Self:
        """Return the record with other values, validated anew."""
        own = dict(self)
        same = all(name in own and value is own[name] for name, value in changes.items())
        return self if same else type(self)(**{**own, **changes})

    def check_growing(self, *names: str) -> None:
        """Check that each of these fields is more than the one before it.

        Raises:
            InputError: Naming one that is not.
        """
        for name, after in itertools.pairwise(names):
            low, value = getattr(self, name), getattr(self, after)
            if not low < value:
                unit = unit_of(name).removeprefix("degrees ")
                raise InputError(after, value, f"more than {name} ({low:zg} {unit})")

    def __copy__(self) -> Self:
        """Copy the fields, and nothing that was worked out of them: ``model_copy`` changes some."""
        copied = super().__copy__()
        for derived in copied.__dict__.keys() - type(self).model_fields.keys():
            del copied.__dict__[derived]
        return copied

    @classmethod
    @public
    def parse(cls, document: dict[str, Any], source: str) -> Self:
        """Build the record from a document read from a file; errors name that file."""
        try:
            return cls(**document)
        except InputError as error:
            raise error.within("", source) from None


class ArrayValue:
    """Equality and short words of frozen dataclasses that hold arrays.

    Two are equal if all their fields are, arrays entry by entry; NaN is equal to NaN.
    """

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return all(map(_equal, _held(self).values(), _held(other).values()))

    def __hash__(self) -> int:
        held = _held(self).values()
        return hash((type(self), *(a for a in held if isinstance(a, int | float | str))))

    def __repr__(self) -> str:
        shown = (f"{name}={_brief(a)}" for name, a in _held(self).items())
        return f"{type(self).__name__}({', '.join(shown)})"


class ReadOnlyArrays(ArrayValue):
    """The same, and nobody can write into the arrays."""

    def __post_init__(self) -> None:
        for held in _held(self).values():
            if isinstance(held, np.ndarray):
                held.setflags(write=False)


def _held(value: Any) -> dict[str, Any]:
    """Fields of a dataclass and their values."""
    return {item.name: getattr(value, item.name) for item in fields(value)}


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_equal, a, b))
    return bool(a == b)


def _brief(value: Any) -> str:
    """A value in words that fit into a line."""
    shown = f"<array {value.shape}>" if isinstance(value, np.ndarray) else repr(value)
    return shown if len(shown) <= _BRIEF else f"<{type(value).__name__}>"


class Tagged(Value):
    """A record of one of several kinds; one of its keys, the tag, says which.

    The base class of a family gives ``tag_key``. A kind is a subclass whose tag is a ``Literal``;
    to define it is to make it known. A field takes every kind of a family with
    ``Annotated[SerializeAsAny[Base], BeforeValidator(Base.of_kind)]``.
    """

    tag_key: ClassVar[str]
    kinds: ClassVar[dict[str, type[Tagged]]]

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if "tag_key" in vars(cls):
            cls.kinds = {}
        else:
            tags = get_args(cls.model_fields[cls.tag_key].annotation)
            cls.kinds.update(dict.fromkeys(tags, cls))

    @classmethod
    def of_kind(cls, value: object) -> object:
        """Make a record of the kind that a table names; leave everything else alone."""
        if not isinstance(value, dict):
            return value
        if cls.tag_key not in value:
            raise missing(cls.tag_key)
        tag = value[cls.tag_key]
        if not isinstance(tag, str) or tag not in cls.kinds:
            raise InputError(cls.tag_key, tag, f"one of {', '.join(cls.kinds)}")
        return cls.kinds[tag](**value)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        if "kinds" not in vars(cls):
            return handler(schema)
        kinds = dict.fromkeys(cls.kinds.values())
        return {"oneOf": [handler(kind.__pydantic_core_schema__) for kind in kinds]}


def _without_keys(model: type[BaseModel], args: Sequence[Any]) -> InputError:
    """Say with which keys a record is made, and which function reads one."""
    name, known = model.__name__, model.model_fields
    keys = [key for key, item in known.items() if item.is_required()] or [*known][:4]
    called = f"{name}({', '.join(f'{key}=...' for key in keys)})"
    hint = f"{MADE_BY[name]} makes one." if name in MADE_BY else ""
    given = args[0] if len(args) == 1 else args
    return InputError(name, given, f"every value with its key: {called}", hint=hint)


class FrozenDict(dict[Key, Item]):
    """A dictionary that cannot be changed after construction."""

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("this mapping is frozen; build a new record instead")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (dict(self),))


def missing(field: str) -> InputError:
    """Return the error of a key that must be there and is not."""
    return InputError(field, MISSING, f"this key is required ({describe(key_of(field))})")


def _described(field: str) -> str:
    """Description of a field, in brackets; empty where its name says all there is to say."""
    words = describe(key := key_of(field))
    return f" ({words})" if words != key.replace("_", " ") else ""


_KNOWN, _POLYGONS = "known keys here are ", "obstacles_of(polygons) makes obstacles of it."


def named_problem(model: type[BaseModel], detail: ErrorDetails) -> InputError:
    """Turn one of pydantic's error records into an error that names the key the user wrote."""
    field = ".".join(map(str, detail["loc"]))
    context, given = detail.get("ctx", {}), detail["input"]
    cause = context.get("error")
    if isinstance(cause, InputError):
        return cause.within(field, hint=_belongs_above(cause, model))
    match detail["type"]:
        case "missing" | "missing_argument":  # the second of named tuples, before pydantic 2.14
            return missing(field)
        case "extra_forbidden" | "unexpected_keyword_argument":
            known = [item.alias or name for name, item in model.model_fields.items()]
            hint = near_key(field, given, known)
            return InputError(field, given, f"{_KNOWN}{', '.join(known)}", hint=hint)
        case "tuple_type":
            listed = isinstance(given, int | float) and not isinstance(given, bool)
            hint = f"did you mean a list, e.g. [{given}, {given}]?" if listed else ""
            if isinstance(given, str) and given.startswith("["):
                hint = f"did you mean {given}, without quotes?"
            keys = given.keys() if isinstance(given, dict) else ()
            if any(kind.model_fields.keys() & keys for kind in _KINDS.values()):
                hint = f"did you mean [[{field}]], which may stand several times?"
            if "type" in keys or hasattr(given, "__geo_interface__"):
                hint = _POLYGONS
            if isinstance(given, BaseModel):
                hint = f"did you mean a list of one, [{type(given).__name__}(...)]?"
            return InputError(field, given, f"a list of values{_described(field)}", hint=hint)
        case "too_long":
            return InputError(field, given, f"a list of {context['max_length']} values")
        case "model_type" | "dict_type" | "model_attributes_type":
            return _no_table(field, given, context.get("class_name", ""))
    return _wrong_value(model, detail, field)


def _belongs_above(cause: InputError, model: type[BaseModel]) -> str:
    """Say so where a key that is unknown in a table is known in the one around it."""
    key = cause.field.rpartition(".")[2]
    if not cause.allowed.startswith(_KNOWN) or key not in model.model_fields:
        return ""
    return f"did you mean {key} of the file itself? Write it before the first [table]."


def _no_table(field: str, given: Any, meant: str) -> InputError:
    """Name what stands where a table, or a record of this class, is meant."""
    allowed = f"a table of keys{_described(field)}"
    hint = _POLYGONS if hasattr(given, "__geo_interface__") else ""
    if isinstance(plain(given), list | tuple):
        hint = "give every value its key, e.g. x_m = 0.1."
    elif isinstance(given, BaseModel):
        hint = f"this is a {type(given).__name__}, and a {meant} is meant."
    words = describe(field)
    if field.rpartition(".")[2].isdigit():  # words are those of the list
        keys = _KINDS[meant].model_fields if meant in _KINDS else {}
        allowed = f"a table of keys, here {', '.join(keys)}" if keys else "a table of keys"
    elif "path" in words:
        allowed = words
    return InputError(field, given, allowed, hint=hint)


_CHOICE = {"bool_type", "literal_error", "string_type"}


def _wrong_value(model: type[BaseModel], detail: ErrorDetails, field: str) -> InputError:
    """Name a value of the wrong type, or out of its range, with the unit that it has."""
    location, given, kind = detail["loc"], detail["input"], detail["type"]
    key = key_of(field)
    phrase, hint = plain_words(str(detail["msg"])), ""
    if kind == "literal_error":
        hint = near_word(given, re.findall(r"'([^']*)'", phrase))
    elif kind == "float_type":
        head = model.model_fields.get(str(location[0]))
        optional = head is not None and not head.is_required()
        listed = isinstance(location[-1], int)
        hint = near_number(key, given, optional=optional, listed=listed)
    if key in ("mode", "modes") and kind != "literal_error":
        phrase += " (1: soft, 0: rigid)"
    unit = unit_of(key)
    if unit and kind not in _CHOICE:
        phrase += f" in {unit}" if kind in ("float_type", "finite_number") else f" {unit}"
    return InputError(field, given, phrase, hint=hint)
