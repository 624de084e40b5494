"""Problem sets: files with a seed, not code paths."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from benchmarks.scenes import scenes
from twosra_mpc import Goal, InputError, Problem, Start, load_problem, load_robot
from twosra_mpc.files import read_document, reading
from twosra_mpc.lab.batch.spec import RandomSet
from twosra_mpc.validation import FrozenDict, plain

FOLDER = Path(__file__).parent / "sets"
MOST = 10_000  # problems of a set


def set_names() -> list[str]:
    """Names of the problem sets."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


@lru_cache
def load_set(name: str, first: int = MOST) -> Mapping[str, Problem]:
    """Label -> problem of a set, or of the first so many of what is random in it.

    What is random is drawn again where units would overlap, or the robot would touch something.
    """
    return read_set(FOLDER / f"{name}.toml", first)


def read_set(path: Path, first: int = MOST) -> Mapping[str, Problem]:
    """Label -> problem of a set in a file, or of the first so many of what is random in it.

    Raises:
        InputError: If the file cannot be read, or tells no problems.
    """
    with reading(str(path)):
        return _of_set(path.stem, read_document(path, str(path)), first)


def _of_set(name: str, data: dict[str, Any], first: int) -> Mapping[str, Problem]:
    if data.get("count", 0) > MOST:
        raise InputError("count", data["count"], f"at most {MOST} problems")
    if "scenarios" in data:
        return FrozenDict(dict(_published(data["scenarios"], data["robots"])))
    if "obstacles" in data:
        return FrozenDict(dict(islice(scenes(name, **data), first)))
    drawn = RandomSet(**data)
    robot, named = load_robot(drawn.robot), dict[str, Problem]()
    for number, (start, goal) in enumerate(islice(drawn.ends(robot), first)):
        named[f"{name}/{number}"] = Problem(robot=robot, start=Start(**start), goal=Goal(**goal))
    return FrozenDict(named)


def _published(scenarios: Sequence[str], robots: Sequence[str]) -> Iterator[tuple[str, Problem]]:
    """All scenarios for one robot after the other; the first one's go by their own names."""
    for robot in robots:
        for name in scenarios:
            label = name if robot == robots[0] else f"{name} by {robot}"
            yield label, load_problem(name, robot=robot)


@lru_cache
def labelled(choices: Sequence[str]) -> Mapping[str, Problem]:
    """Label -> problem of several sets; ``"random-100:10"`` is the first ten problems of one.

    Raises:
        InputError: If there is no such set, or the number is none.
    """
    named: dict[str, Problem] = {}
    for choice in _known(choices):
        name, _, told = choice.partition(":")
        first = int(told or MOST)
        named |= list(load_set(name, first).items())[:first]
    return FrozenDict(named)


def _known(choices: Sequence[str]) -> Sequence[str]:
    """``choices``, each the name of a set, perhaps with a number; problems are drawn when used."""
    for choice in choices:
        name, _, first = choice.partition(":")
        if name not in set_names() or not (first or "1").isdigit():
            allowed = f"one of {', '.join(set_names())}, or the first so many of one, as in tiny:3"
            raise InputError("problems", choice, allowed)
    return choices


Choices = Annotated[
    tuple[str, ...], Field(min_length=1), BeforeValidator(plain), AfterValidator(_known)
]
