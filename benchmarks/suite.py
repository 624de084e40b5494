"""What a suite is: a frozen value, read from a TOML file, that lists its runs and reports them."""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import BeforeValidator, Field

from benchmarks.problem_set import load_set, set_names
from twosra_mpc import InputError, Problem
from twosra_mpc.validation import Positive, Value, plain

Record = dict[str, Any]
Count = Annotated[int, Field(ge=1)]
Numbers = Annotated[tuple[Positive, ...], Field(min_length=1), BeforeValidator(plain)]
Counts = Annotated[tuple[Count, ...], Field(min_length=1), BeforeValidator(plain)]
Names = Annotated[tuple[str, ...], BeforeValidator(plain)]


class Run(NamedTuple):
    """One run: its name, unique in the suite, and what measures it."""

    key: str
    measure: Callable[[], Record]


class Suite(Value, abc.ABC):
    """A named series of runs with the report on them.

    Attributes:
        description: The question that the suite answers.
        repeats: Timed calls of each function, after one that is not counted.
        repeat_budget_s: No further repeats of a function once they, or the first call, took as
            long; then the first call counts if it is the only one.
    """

    description: str
    repeats: Count = 5
    repeat_budget_s: Positive = 30.0

    @abc.abstractmethod
    def runs(self) -> Iterator[Run]:
        """Yield the runs, in the order in which they should be made."""

    @abc.abstractmethod
    def report(self, records: Sequence[Record], folder: Path) -> list[str]:
        """Draw the figures into ``folder`` and return the Markdown lines that belong to them."""


class ProblemChoice(Value):
    """A problem set by name, or the first so many of its problems."""

    set: str
    first: Count | None = None

    def labelled(self) -> tuple[tuple[str, Problem], ...]:
        """Return (label, problem) pairs.

        Raises:
            InputError: If there is no such set.
        """
        if self.set not in set_names():
            raise InputError("problems.set", self.set, f"one of {', '.join(set_names())}")
        return load_set(self.set).problems[: self.first]


Choices = Annotated[tuple[ProblemChoice, ...], Field(min_length=1), BeforeValidator(plain)]


def chosen(choices: Sequence[ProblemChoice]) -> list[tuple[str, Problem]]:
    """Return the (label, problem) pairs of several choices."""
    return [pair for choice in choices for pair in choice.labelled()]
