"""Frozen, validated values: the base class of everything a user can write in a file."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING, Annotated, Any, Self

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


Number = Annotated[float, BeforeValidator(plain)]
Positive = Annotated[float, Field(gt=0.0), BeforeValidator(plain)]
NonNegative = Annotated[float, Field(ge=0.0), BeforeValidator(plain)]
Pair = Annotated[tuple[float, float], BeforeValidator(plain)]
Triple = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(plain)]
Bit = Annotated[int, Field(ge=0, le=1)]
ModeField = Annotated[tuple[Bit, Bit], BeforeValidator(plain)]


class Value(BaseModel):
    """A frozen record whose construction either succeeds with valid fields or names the bad one.

    Raises:
        InputError: On an unknown or missing key, a wrong type or shape, a value that is not finite
            or not in its range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    if not TYPE_CHECKING:  # the generated signature is what editors should complete

        def __init__(self, **data: Any) -> None:
            try:
                super().__init__(**data)
            except ValidationError as error:
                problems = [_problem(type(self), detail) for detail in error.errors()]
                raise problems[0].among(problems[1:]) from None

    @classmethod
    def parse(cls, document: dict[str, Any], source: str) -> Self:
        """Build the record from a document read from a file; errors name that file."""
        try:
            return cls(**document)
        except InputError as error:
            raise error.within("", source) from None


def _problem(model: type[BaseModel], detail: ErrorDetails) -> InputError:
    """Turn one of pydantic's error records into an error that names the key the user wrote."""
    location = [str(part) for part in detail["loc"]]
    field = ".".join(location[:1] + [part for part in location[1:] if part not in _UNION_TAGS])
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return cause.within(field)
    if detail["type"] == "missing":
        return InputError(field, "missing", "this key is required")
    if detail["type"] == "extra_forbidden":
        known = list(model.model_fields)
        close = difflib.get_close_matches(field, known, n=1)
        hint = f"did you mean {close[0]}? " if close else ""
        return InputError(field, detail["input"], f"{hint}known keys here are {', '.join(known)}")
    phrase = str(detail["msg"])
    for prefix in ("Input should be ", "Value error, "):
        phrase = phrase.removeprefix(prefix)
    return InputError(field, detail["input"], phrase)


_UNION_TAGS = {"float", "none", "full", "log_spiral", "log_spiral_corrected", "arc", "cardioid"}
