"""Summary of a batch of plans: sequences, durations, savings, what a change is worth."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twosra_mpc.errors import InputError
from twosra_mpc.robot.coordinates import Array

if TYPE_CHECKING:
    from pandas import DataFrame, Series

_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


class Spread(NamedTuple):
    """Quantiles of several plans' numbers.

    Attributes:
        plans: How many plans.
        least: The least.
        p10: 10 % are below.
        median: Half are below.
        p90: 90 % are below.
        most: The largest.
    """

    plans: int
    least: float
    p10: float
    median: float
    p90: float
    most: float


class Worth(NamedTuple):
    """Worth of a change: seconds of a plan's duration that it saves.

    Attributes:
        change: A second less of each freeze or melt, or one more of a varied key.
        saved_s: What plans save [s].
    """

    change: str
    saved_s: Spread


class Failure(NamedTuple):
    """Problems without a plan that were told the same, apart from its numbers.

    Attributes:
        status: Why there is no plan, in a word.
        problems: How many.
        first: The first of them.
        message: What was said of it.
    """

    status: str
    problems: int
    first: int
    message: str


@dataclass(frozen=True)
class Atlas:
    """A batch in numbers.

    Attributes:
        problems: How many problems.
        varied: The varied keys.
        statuses: Status -> number of problems.
        sequences: Mode sequence -> number of plans, the most frequent first.
        duration_s: Of the plans [s].
        gap: That the search proved of the plans with a bound; None: there are none.
        saved_s: Duration of the greedy plans, less that of ours [s], where there are both.
        worth: What changes are worth.
        failures: Problems without a plan, by what was said, the most frequent first.
    """

    problems: int
    varied: tuple[str, ...]
    statuses: dict[str, int]
    sequences: dict[str, int]
    duration_s: Spread | None
    gap: Spread | None
    saved_s: Spread | None
    worth: tuple[Worth, ...]
    failures: tuple[Failure, ...]


def atlas(runs: DataFrame) -> Atlas:
    """Return what a batch says in numbers.

    Args:
        runs: The table of a batch, as `twosra_mpc.lab.batch.read_runs` returns it.

    Raises:
        InputError: If the table has no row.
    """
    if runs.empty:
        raise InputError("runs", "no row", "a batch with at least one finished problem")
    made = plans(runs)
    saved = made["greedy_duration_s"] - made["duration_s"] if has_greedy(runs) else ()
    return Atlas(
        problems=len(runs),
        varied=tuple(runs.attrs["varied"]),
        statuses=_counts(runs["status"]),
        sequences=_counts(made["sequence"]),
        duration_s=_spread(made["duration_s"]),
        gap=_spread(made["search_gap"]),
        saved_s=_spread(saved),
        worth=tuple(_worth(made)),
        failures=_failures(runs),
    )


def plans(runs: DataFrame) -> DataFrame:
    """Return the rows of problems that have a plan."""
    return runs[runs["duration_s"].notna()]


def has_greedy(runs: DataFrame) -> bool:
    """True if the greedy rule's plans stand beside ours."""
    return "greedy_duration_s" in runs


def numeric_keys(runs: DataFrame) -> list[str]:
    """Return the varied keys that are numbers and take at least two values."""
    numeric = runs.select_dtypes("number").columns
    return [key for key in runs.attrs["varied"] if key in numeric and runs[key].nunique() > 1]


def _counts(values: Series[str]) -> dict[str, int]:
    names, counts = np.unique(np.asarray(values, dtype=str), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return {str(names[i]): int(counts[i]) for i in order}


def _spread(values: ArrayLike) -> Spread | None:
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if not known.size:
        return None
    return Spread(known.size, *np.quantile(known, (0.0, 0.1, 0.5, 0.9, 1.0)).tolist())


def counted(key: str) -> str:
    """A varied key with places in lists counted from 1, as segments are: goal.kappa_per_m 1."""
    stem = key.rstrip("0123456789").rstrip(".")
    return f"{stem} {int(key[len(stem) + 1 :]) + 1}" if stem != key else key


def _worth(made: DataFrame) -> Iterator[Worth]:
    """A second less of each melt or freeze while the critical path stays; one more of each key.

    The latter by difference quotients between neighbours that share all other keys.
    """
    for name, column in (("freezing", "critical_freezes"), ("melting", "critical_melts")):
        if (spread := _spread(made[column])) is not None:
            yield Worth(f"{name} 1 s shorter", spread)
    for key in numeric_keys(made):
        others = [each for each in made.attrs["varied"] if each != key]
        groups = made.groupby(others, dropna=False) if others else [((), made)]
        quotients = [_quotients(group.sort_values(key), key) for _, group in groups]
        if quotients and (spread := _spread(np.concatenate(quotients))) is not None:
            yield Worth(f"1 more of {counted(key)}", spread)


def _quotients(group: DataFrame, key: str) -> Array:
    """Duration saved for one more of a key, between its neighbouring values."""
    step = np.diff(group[key].to_numpy(dtype=float))
    saved = -np.diff(group["duration_s"].to_numpy(dtype=float))
    return saved[step > 0] / step[step > 0]


def _failures(runs: DataFrame) -> tuple[Failure, ...]:
    """Problems without a plan, by status and by what was said, whatever its numbers."""
    without = runs[runs["duration_s"].isna()]
    said = without["message"].map(lambda text: _NUMBER.sub("#", text))
    groups = (group for _, group in without.groupby([without["status"], said]))
    found = [
        Failure(str(first["status"]), len(group), int(first["problem"]), str(first["message"]))
        for group in groups
        for first in [group.iloc[0]]
    ]
    return tuple(sorted(found, key=lambda each: (-each.problems, each.first)))
