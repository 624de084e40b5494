"""The problems of a batch, one after the other, as scenario documents without any file's name."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc import InputError, Problem, Robot, load_problem, load_robot
from twosra_mpc.files import locate, read_document, reading
from twosra_mpc.lab.batch.spec import Scalar, Spec

Document = dict[str, Any]


class Posed(NamedTuple):
    """A problem of a batch: its number, its scenario, and the values of what is varied."""

    number: int
    document: Document
    varied: dict[str, Scalar]


class Problems:
    """Problems of a spec. All files are read at once: later changes of them do nothing.

    Attributes:
        spec: The spec.
        files: What was read: scenarios and robots, by their names in the spec.
        kinds: What is varied -> type of its column, in the order of the columns.
    """

    def __init__(self, spec: Spec, folder: Path) -> None:
        """Read the files, relative to a folder, and try the first problem of each scenario.

        Raises:
            InputError: If a file is wrong, or a key of the spec is none of these files.
        """
        self.spec, self._axes = spec, spec.axes
        robots = {spec.random.robot} if spec.random else set[str]()
        robots |= {*map(str, self._axes.get("robot", ())), str(spec.fixed.get("robot", ""))}
        self._robots = {name: _robot(name, folder) for name in sorted(robots - {""})}
        names = spec.scenarios or ((spec.scenario,) if spec.scenario else ())
        self._scenarios = {name: _scenario(name, folder) for name in names}
        self.files = {"scenarios": self._scenarios, "robots": self._robots}
        first = {key: values[0] for key, values in self._axes.items()}
        bases = itertools.islice(self._bases(), 1 if spec.random else None)
        firsts = [self._posed(0, *base, first) for base in bases]
        self.kinds = {
            key: spec.kinds.get(key) or ("str" if key == "scenario" else "float64")
            for key in firsts[0].varied
        }
        for one in firsts:
            with reading(str(one.varied.get("scenario", "the first problem")), "scenario"):
                Problem(**one.document)

    def __len__(self) -> int:
        return self.spec.size

    def posed(self, done: NDArray[np.bool_]) -> Iterator[Posed]:
        """Yield the problems that are not ``done`` (a truth for each), in order."""
        numbers = itertools.count()
        for document, varied in self._bases():
            for values in itertools.product(*self._axes.values()):
                if not done[number := next(numbers)]:
                    combination = dict(zip(self._axes, values, strict=True))
                    yield self._posed(number, document, varied, combination)

    def _bases(self) -> Iterator[tuple[Document, dict[str, Scalar]]]:
        """Yield what the grid is laid over: a scenario, and what is varied in it already."""
        if self.spec.random is None:
            for name, document in self._scenarios.items():
                yield document, ({"scenario": name} if self.spec.scenarios else {})
            return
        document = self._robots[self.spec.random.robot]
        names = (robot := Robot(**document)).coordinates.names
        for start, goal in self.spec.random.ends(robot):
            varied: dict[str, Scalar] = {
                f"{end}.{name}": value
                for end, table in (("start", start), ("goal", goal))
                for name, value in zip(names, _coordinates(**table), strict=True)
            }
            yield {"robot": document, "start": start, "goal": goal}, varied

    def _posed(
        self,
        number: int,
        document: Document,
        varied: Mapping[str, Scalar],
        combination: Mapping[str, Scalar],
    ) -> Posed:
        """Put values where their keys say; ``robot`` before ``robot.heater``."""
        given = {**self.spec.fixed, **combination}
        for key, value in sorted(given.items(), key=lambda item: item[0].count(".")):
            told = self._robots[str(value)] if key == "robot" else value
            document = _with(document, key, told, key)
        return Posed(number, document, {**varied, **combination})


def _coordinates(x_m: float, y_m: float, phi_rad: float, kappa_per_m: list[float]) -> list[float]:
    return [x_m, y_m, phi_rad, *kappa_per_m]


def _located(name: str, folder: Path, kind: str) -> Path:
    """A file beside the one that names it, a built-in, or a file."""
    return beside if os.path.isfile(beside := folder / name) else locate(name, f"{kind}s", kind)


def _robot(name: str, folder: Path) -> Document:
    """The document of a robot that is valid."""
    path = _located(name, folder, "robot")
    load_robot(path)
    return read_document(path, name)


def _scenario(name: str, folder: Path) -> Document:
    """The document of a scenario that is valid, with what other files hold in their place."""
    path = _located(name, folder, "scenario")
    problem, document = load_problem(path), read_document(path, name)
    if isinstance(robot := document["robot"], str):
        document["robot"] = _robot(robot, path.parent)
    told = problem.model_dump(mode="json", include={"obstacles", "objects"})
    return document | {key: told[key] for key in told.keys() & document.keys()}


def _with(document: Any, key: str, value: Any, whole: str) -> Any:
    """A document with another value at a dotted key; entries of lists are counted from 0."""
    first, _, rest = key.partition(".")
    if isinstance(document, list) and first.isdecimal() and int(first) < len(document):
        place = int(first)
        inner = _with(document[place], rest, value, whole) if rest else value
        return [*document[:place], inner, *document[place + 1 :]]
    if not isinstance(document, dict):
        raise InputError(whole, value, "a key of scenario or robot, or an entry of a list")
    inner = _with(document.get(first, {}), rest, value, whole) if rest else value
    return {**document, first: inner}
