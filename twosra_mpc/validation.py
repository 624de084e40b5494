"""Frozen, validated values: the base class of everything a user can write in a file."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, Self, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

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


Key = TypeVar("Key")
Item = TypeVar("Item")

Number = Annotated[float, BeforeValidator(plain)]
Positive = Annotated[float, Field(gt=0.0), BeforeValidator(plain)]
NonNegative = Annotated[float, Field(ge=0.0), BeforeValidator(plain)]
Pair = Annotated[tuple[float, float], BeforeValidator(plain)]
Triple = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(plain)]
Bit = Annotated[int, Field(ge=0, le=1)]
Numbers = Annotated[tuple[float, ...], Field(min_length=1, max_length=4), BeforeValidator(plain)]
ModeField = Annotated[tuple[Bit, ...], Field(min_length=1, max_length=4), BeforeValidator(plain)]


_FOLLOWS = "default_factory_not_called"  # pydantic's word for a default that needs a wrong value


class Value(BaseModel):
    """A frozen record whose construction either succeeds with valid fields or names the bad one.

    Raises:
        InputError: On an unknown or missing key, a wrong type or shape, a value that is not finite
            or not in its range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    if not TYPE_CHECKING:  # the generated signature is what editors should complete

        def __init__(self, /, **data: Any) -> None:
            try:
                super().__init__(**data)
            except ValidationError as error:
                details = [one for one in error.errors() if one["type"] != _FOLLOWS]
                problems = [named_problem(type(self), detail) for detail in details]
                raise problems[0].among(problems[1:]) from None

    @classmethod
    def parse(cls, document: dict[str, Any], source: str) -> Self:
        """Build the record from a document read from a file; errors name that file."""
        try:
            return cls(**document)
        except InputError as error:
            raise error.within("", source) from None


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
        if len(location) > 1 and location[-1] in _UNION_TAGS:
            location.pop()  # the branch that was tried, not something the user wrote
        return cause.within(".".join(location))
    field, given = ".".join(location), detail["input"]
    match detail["type"]:
        case "missing":
            return InputError(field, "missing", "this key is required")
        case "extra_forbidden":
            known = list(model.model_fields)
            close = difflib.get_close_matches(field, known, n=1)
            hint = f"did you mean {close[0]}? " if close else ""
            return InputError(field, given, f"{hint}known keys here are {', '.join(known)}")
        case "union_tag_not_found":
            key = str(context["discriminator"]).strip("'")
            return InputError(f"{field}.{key}", "missing", "this key is required")
        case "union_tag_invalid":
            key = str(context["discriminator"]).strip("'")
            allowed = " or ".join(str(context["expected_tags"]).rsplit(", ", 1))
            return InputError(f"{field}.{key}", context["tag"], allowed)
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


_UNION_TAGS = {
    *("none", "full", "thermal"),
    *("log_spiral", "log_spiral_corrected", "arc", "cardioid"),
    *("lumped", "two_node"),
}
