"""Specification of a batch, as a TOML file says it; random problems from a seed and ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from twosra_mpc import InputError, Robot
from twosra_mpc.files import LARGEST, check_kind, document_in, read_text
from twosra_mpc.lab.batch.table import RESULT_COLUMNS
from twosra_mpc.problem.limits import SHAPE_LIMITS, shape_margins
from twosra_mpc.robot.coordinates import POSE, Array
from twosra_mpc.validation import FrozenDict, NonNegative, Number, Value, plain

_BLOCK = 256  # pairs drawn at once
_MOST_BLOCKS = 40  # in a row without any that is possible


class RandomSet(Value):
    """Random problems of a robot, start and goal uniform in ranges symmetric about zero.

    Drawn again are those whose start or goal has a shape that a limit forbids, e.g. units that
    overlap. The first so many of a longer set are those of a shorter one.
    """

    robot: str
    seed: Annotated[int, Field(ge=0)]
    count: Annotated[int, Field(ge=1)]
    position_m: NonNegative
    heading_rad: NonNegative
    curvature_per_m: NonNegative

    def ends(self, robot: Robot) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
        """Yield start and goal of each problem, as tables of a scenario.

        Raises:
            InputError: If hardly any shape within the ranges is possible.
        """
        ranges = (self.position_m, self.heading_rad, self.curvature_per_m)
        most = np.abs(np.tile(robot.coordinates.each(*ranges), 2))  # of -0.0, too
        rng, left, vain = np.random.default_rng(self.seed), self.count, 0
        while left:
            drawn = rng.uniform(-most, most, (_BLOCK, len(most))).reshape(_BLOCK, 2, -1)
            kept = drawn[_possible(robot, drawn)][:left]
            left, vain = left - len(kept), 0 if len(kept) else vain + 1
            if vain == _MOST_BLOCKS:
                allowed = f"ranges with shapes that are possible; {vain * _BLOCK} draws had none"
                raise InputError("curvature_per_m", self.curvature_per_m, allowed)
            yield from ((_table(start), _table(goal)) for start, goal in kept.tolist())


def _table(q: list[float]) -> dict[str, Any]:
    x_m, y_m, phi_rad, *kappa_per_m = q
    return {"x_m": x_m, "y_m": y_m, "phi_rad": phi_rad, "kappa_per_m": kappa_per_m}


def _possible(robot: Robot, drawn: Array) -> NDArray[np.bool_]:
    """True for pairs (m, 2, 3 + n) whose shapes no limit forbids."""
    margins = shape_margins(robot, drawn[:, :, POSE:].reshape(2 * len(drawn), -1))
    least = [margins[limit.name] for limit in SHAPE_LIMITS if not limit.driving]
    return np.min(least, axis=0).reshape(-1, 2).min(axis=1) >= 0


MOST_PROBLEMS = 10_000_000  # of a batch: its table is held in memory

Scalar = bool | int | float | str
Planner = Literal["optimal", "greedy", "both"]

_KINDS: dict[type, str] = {bool: "bool", int: "int64", float: "float64", str: "str"}


class Range(Value):
    """Numbers at equal distances, both ends included; a file calls the first ``from``."""

    first: Number = Field(alias="from")
    to: Number
    steps: Annotated[int, Field(ge=2, le=MOST_PROBLEMS)]

    @model_validator(mode="after")
    def _rising(self) -> Range:
        if not self.first < self.to:
            raise InputError("to", self.to, f"more than from ({self.first:zg})")
        return self

    def __len__(self) -> int:
        return self.steps

    @property
    def values(self) -> tuple[Scalar, ...]:
        """The numbers."""
        return tuple(np.linspace(self.first, self.to, self.steps).tolist())


def _axis(given: object) -> Range | tuple[Scalar, ...]:
    """A range, or values of one kind, each once."""
    if isinstance(given, dict):
        return Range(**given)
    if not isinstance(given, list | tuple) or not given:
        allowed = "a list of values, or { from = 0.7, to = 0.9, steps = 5 }"
        raise InputError("", given, allowed)
    kinds = {type(value) for value in given}
    if kinds == {int, float}:
        given, kinds = tuple(map(float, given)), {float}
    if len(kinds) > 1 or not kinds <= _KINDS.keys():
        raise InputError("", given, "all numbers, all texts, or all of true and false")
    for number, value in enumerate(given):
        if kinds <= {int, float} and not abs(value) <= LARGEST:
            raise InputError(f"{number}", value, f"a finite number, at most {LARGEST:zg} in size")
    if len(set(given)) < len(given):
        raise InputError("", given, "each value once")
    return tuple(given)


def _by_dotted_key(given: object) -> object:
    """A table of tables as one table with dotted keys; what a range says stays together."""
    if not isinstance(given, dict):
        return given
    flat: dict[str, object] = {}
    for key, value in given.items():
        inner = _by_dotted_key(value)
        if isinstance(inner, dict) and not {"from", "to", "steps"} & inner.keys():
            flat |= {f"{key}.{name}": one for name, one in inner.items()}
        else:
            flat[key] = inner
    return flat


class Spec(Value):
    """Batch to plan: scenarios or random problems, and a grid over keys of their files.

    Attributes:
        scenario: One scenario, a file or a built-in name; or
        scenarios: several of them; or
        random: random problems of a robot.
        fixed: Dotted key of scenario or robot file -> value, for all problems.
        grid: The same -> values; every combination is planned, the last key varies fastest.
        planner: This package's, the greedy rule, or both side by side.
        plans: Whether plan files are written.
    """

    scenario: str | None = None
    scenarios: Annotated[tuple[str, ...] | None, BeforeValidator(plain)] = None
    random: RandomSet | None = None
    fixed: Annotated[
        dict[str, Any], BeforeValidator(_by_dotted_key), AfterValidator(FrozenDict)
    ] = FrozenDict()
    grid: Annotated[
        dict[str, Annotated[Any, BeforeValidator(_axis)]],
        BeforeValidator(_by_dotted_key),
        AfterValidator(FrozenDict),
    ] = FrozenDict()
    planner: Planner = "optimal"
    plans: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> Spec:
        given = [name for name in ("scenario", "scenarios", "random") if getattr(self, name)]
        if len(given) != 1:
            allowed = "one of the keys scenario, scenarios and random"
            raise InputError("scenario", " and ".join(given) or "missing", allowed)
        if self.scenarios and len(set(self.scenarios)) < len(self.scenarios):
            raise InputError("scenarios", self.scenarios, "each scenario once")
        for name, table in (("fixed", self.fixed), ("grid", self.grid)):
            if "planner" in table:
                raise InputError(f"{name}.planner", table["planner"], "planner as a key by itself")
        if taken := sorted(self.grid.keys() & RESULT_COLUMNS.keys()):
            allowed = f"a key that is no column of results; {taken[0]} can be fixed"
            raise InputError(f"grid.{taken[0]}", self.grid[taken[0]], allowed)
        if twice := self.fixed.keys() & self.grid.keys():
            raise InputError(f"grid.{min(twice)}", "also fixed", "either fixed or in the grid")
        if self.size > MOST_PROBLEMS:
            allowed = f"at most {MOST_PROBLEMS} problems"
            raise InputError("grid" if self.grid else "random.count", self.size, allowed)
        return self

    @property
    def size(self) -> int:
        """Number of problems."""
        sets = self.random.count if self.random else len(self.scenarios or (self.scenario,))
        return sets * math.prod(map(len, self.grid.values()))

    @property
    def axes(self) -> dict[str, tuple[Scalar, ...]]:
        """Dotted key -> values of the grid."""
        axes = self.grid.items()
        return {key: each.values if isinstance(each, Range) else each for key, each in axes}

    @property
    def kinds(self) -> Mapping[str, str]:
        """Dotted key of the grid -> type of its column."""
        return {
            key: "float64" if isinstance(axis, Range) else _KINDS[type(axis[0])]
            for key, axis in self.grid.items()
        }


def load_spec(path: Path, **overrides: Any) -> Spec:
    """Read the spec of a batch from a file, as `spec_in` does from its text."""
    return spec_in(read_text(path, str(path)), path, **overrides)


def spec_in(text: str, path: Path, **overrides: Any) -> Spec:
    """Read the spec of a batch; keyword arguments replace keys of the file.

    Args:
        text: Text of the file.
        path: Its name.
        overrides: Keys and their values.

    Raises:
        InputError: If it is wrong; the message names the key.
    """
    document = document_in(text, path, str(path))
    check_kind(document, "batch", str(path))
    return Spec.parse({**document, **overrides}, str(path))
