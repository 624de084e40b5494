"""Frozen, validated values: the base class of everything a user can write in a file."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
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

from twosra_mpc.errors import InputError


def plain(value: object) -> object:
    """Turn NumPy scalars and arrays into Python numbers and tuples; leave other values alone."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(plain(item) for item in value)
    return value


def _at_least(least: float) -> AfterValidator:
    """Refuse what is positive, but too small to compute with."""

    def checked(value: float) -> float:
        if value < least:
            raise ValueError(f"at least {least:g}")
        return value

    return AfterValidator(checked)


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
MetresPair = Annotated[tuple[Metres, Metres], BeforeValidator(plain)]
Length = Annotated[float, Field(gt=0.0, le=100.0), _at_least(1e-6), BeforeValidator(plain)]  # in m
_Shape = Annotated[float, Field(gt=0.0, le=100.0), _at_least(1e-6)]
Triple = Annotated[tuple[_Shape, _Shape, _Shape], BeforeValidator(plain)]
Bit = Annotated[int, Field(ge=0, le=1)]
MOST_SEGMENTS = 4
# One entry for each segment. Only who knows the robot can name the entries that are missing, so
# that a list without any is left to it too.
EachSegment = Field(max_length=MOST_SEGMENTS, json_schema_extra={"minItems": 1})
if TYPE_CHECKING:  # lists may be given as well; a record holds tuples
    Several: TypeAlias = Sequence[Item]
    EachOf: TypeAlias = Sequence[Item]
else:
    Several = Annotated[tuple[Item, ...], BeforeValidator(plain)]
    EachOf = Annotated[tuple[Item, ...], EachSegment]
Numbers = Annotated[EachOf[Number], BeforeValidator(plain)]
ModeField = Annotated[tuple[Bit, ...], EachSegment, BeforeValidator(plain)]


_FOLLOWS = "default_factory_not_called"  # pydantic's word for a default that needs a wrong value


class Value(BaseModel):
    """A frozen record whose construction either succeeds with valid fields or names the bad one.

    Raises:
        InputError: On an unknown or missing key, a wrong type or shape, a value that is not finite
            or not in its range.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )

    if not TYPE_CHECKING:  # the generated signature is what editors should complete

        def __init__(self, /, **data: Any) -> None:
            try:
                super().__init__(**data)
            except ValidationError as error:
                details = [one for one in error.errors() if one["type"] != _FOLLOWS]
                problems = [named_problem(type(self), detail) for detail in details]
                raise problems[0].among(problems[1:]) from None

    def with_values(self, **changes: Any) -> Self:
        """Return the record with other values, validated anew."""
        return type(self)(**{**dict(self), **changes})

    @classmethod
    def parse(cls, document: dict[str, Any], source: str) -> Self:
        """Build the record from a document read from a file; errors name that file."""
        try:
            return cls(**document)
        except InputError as error:
            raise error.within("", source) from None


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
            raise InputError(cls.tag_key, "missing", "this key is required")
        if (tag := value[cls.tag_key]) not in cls.kinds:
            allowed = " or ".join(", ".join(map(repr, cls.kinds)).rsplit(", ", 1))
            raise InputError(cls.tag_key, tag, allowed)
        return cls.kinds[tag](**value)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        if "kinds" not in vars(cls):
            return handler(schema)
        kinds = dict.fromkeys(cls.kinds.values())
        return {"oneOf": [handler(kind.__pydantic_core_schema__) for kind in kinds]}


class FrozenDict(dict[Key, Item]):
    """A dictionary that cannot be changed after construction."""

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("this mapping is frozen; build a new record instead")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (dict(self),))


def named_problem(model: type[BaseModel], detail: ErrorDetails) -> InputError:
    """Turn one of pydantic's error records into an error that names the key the user wrote."""
    location = [str(part) for part in detail["loc"]]
    context = detail.get("ctx", {})
    cause = context.get("error")
    if isinstance(cause, InputError):
        return cause.within(".".join(location))
    field, given = ".".join(location), detail["input"]
    match detail["type"]:
        case "missing":
            return InputError(field, "missing", "this key is required")
        case "extra_forbidden":
            known = [item.alias or name for name, item in model.model_fields.items()]
            close = difflib.get_close_matches(field, known, n=1)
            hint = f"did you mean {close[0]}? " if close else ""
            return InputError(field, given, f"{hint}known keys here are {', '.join(known)}")
        case "tuple_type":
            return InputError(field, given, "a list of values")
        case "too_long":
            return InputError(field, given, f"a list of {context['max_length']} values")
        case "model_type" | "dict_type" | "model_attributes_type":
            return InputError(field, given, "a table of keys")
    phrase = str(detail["msg"])
    for prefix in ("Input should be ", "Value error, "):
        phrase = phrase.removeprefix(prefix)
    return InputError(field, given, phrase)
