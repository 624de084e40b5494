"""Statistics of a number over many problems: a share with its confidence, and quantiles."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy import stats

Counted = TypeVar("Counted", bound=Hashable)


@dataclass(frozen=True)
class Share:
    """So many of so many, with Wilson's interval of 95 % confidence for the share."""

    count: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share; NaN of none."""
        return self.count / self.of if self.of else math.nan


class Spread(NamedTuple):
    """A number over problems; NaN where there is none."""

    least: float
    p5: float
    median: float
    mean: float
    p95: float
    most: float


def share(holds: Iterable[bool]) -> Share:
    """Count where something holds."""
    each = list(holds)
    if not each:
        return Share(0, 0, 0.0, 1.0)
    count = sum(each)
    interval = stats.binomtest(count, len(each)).proportion_ci(method="wilson")
    return Share(count, len(each), float(interval.low), float(interval.high))


def spread(values: Iterable[float]) -> Spread:
    """Quantiles and mean; what is NaN is left out."""
    known = [value for value in values if not math.isnan(value)]
    if not known:
        return Spread(*[math.nan] * 6)
    low, p5, median, p95, high = np.quantile(known, (0.0, 0.05, 0.5, 0.95, 1.0)).tolist()
    return Spread(low, p5, median, math.fsum(known) / len(known), p95, high)


def by_size(values: Iterable[Counted]) -> dict[Counted, int]:
    """Value -> how often, the most frequent first."""
    return dict(Counter(values).most_common())


def in_order(values: Iterable[Counted]) -> dict[Counted, int]:
    """Value -> how often, the smallest first."""
    counts = Counter(values)
    return {value: counts[value] for value in sorted(counts)}  # type: ignore[type-var]


def tuples(value: Any) -> Any:
    """Return plain data with tuples where JSON has lists."""
    if isinstance(value, dict):
        return {name: tuples(each) for name, each in value.items()}
    return tuple(map(tuples, value)) if isinstance(value, list | tuple) else value
