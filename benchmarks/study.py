"""What a study is: cases, what measures one of them, and what all of them say together."""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

from pydantic import BeforeValidator, Field, TypeAdapter

from benchmarks.measurement import PlanRecord, Timing, plan_record, timed_in_turns
from benchmarks.problems import Choices, labelled
from twosra_mpc import Problem, plan
from twosra_mpc.validation import Positive, Value, plain

Returned = TypeVar("Returned")
Count = Annotated[int, Field(ge=1)]
Numbers = Annotated[tuple[Positive, ...], Field(min_length=1), BeforeValidator(plain)]
Names = Annotated[tuple[str, ...], Field(min_length=1), BeforeValidator(plain)]
Counts = Annotated[tuple[Count, ...], Field(min_length=1), BeforeValidator(plain)]


PLANNING = tuple(
    f"twosra_mpc/{folder}"
    for folder in (
        *("robot", "robots", "scenarios", "model", "thermal", "timing", "problem", "space"),
        *("contact", "planning", "plans", "checking"),
    )
)
RUNNING = (*PLANNING, "twosra_mpc/control", "twosra_mpc/execution", "twosra_mpc/physics")


class Measured(NamedTuple):
    """A case with its record."""

    case: Any
    record: Any


class OneProblem(NamedTuple):
    """The usual case: a problem, by its label."""

    problem: str


class Study(Value, abc.ABC):
    """A question, and the settings with which it is answered.

    A case is a named tuple of plain numbers and words, different from all others of the study. What
    a case measures is a record, a value that ``record`` writes as plain data and reads back.
    """

    record: ClassVar[TypeAdapter[Any]]
    question: ClassVar[str]
    measures: ClassVar[tuple[str, ...]] = PLANNING  # folders; a table says which have changed

    @abc.abstractmethod
    def cases(self) -> Iterator[Any]:
        """Yield the cases, in the order in which they should be measured."""

    @abc.abstractmethod
    def run(self, case: Any) -> Any:
        """Measure a case; returns its record."""

    def report(self, results: Sequence[Measured], folder: Path) -> dict[str, Any]:
        """Draw figures into ``folder``; return what the template asks for besides the results."""
        del results, folder
        return {}


class PlanStudy(Study):
    """A study that times planners on problems.

    Attributes:
        problems: Problem sets; ``"random-100:10"`` is the first ten problems of one.
        repeats: Timed calls of each function, after one that is not counted.
        repeat_budget_s: No further repeats of a function once they, or the first call, took as
            long; then the first call counts if it is the only one.
        time_limit_s: Limit of a plan, in thousands of units of work: about seconds.
    """

    problems: Choices
    repeats: Count = 5
    repeat_budget_s: Positive = 30.0
    time_limit_s: Positive = 60.0

    def cases(self) -> Iterator[Any]:
        """Yield the problems."""
        yield from map(OneProblem, self.named)

    @property
    def named(self) -> Mapping[str, Problem]:
        """Label -> problem, with the time limit, and at full speed: costs are compared."""
        given = {"work_limit": 1e3 * self.time_limit_s, "motion": "fastest"}
        return {name: one.with_values(**given) for name, one in labelled(self.problems).items()}

    def timed(
        self, functions: Mapping[str, Callable[[], Returned]]
    ) -> dict[str, tuple[Returned, Timing]]:
        """Call functions in turns as often as the settings say."""
        return timed_in_turns(functions, self.repeats, self.repeat_budget_s)

    def planned(self, problem: Problem) -> PlanRecord:
        """Plan as often as the settings say."""
        return plan_record(*self.timed({"plan": partial(plan, problem)})["plan"])
