"""Numbers that sum up many: quantiles, shifted geometric mean, slope of a power law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def shifted_geometric_mean(values: Sequence[float], shift: float) -> float:
    """Geometric mean of ``values + shift``, less ``shift``; small values weigh little in it."""
    shifted = np.asarray(values, dtype=float) + shift
    return float(np.exp(np.log(shifted).mean()) - shift)


def power_law(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Fit y = scale * x ** slope by least squares of the logarithms; return (scale, slope)."""
    slope, offset = np.polyfit(np.log(x), np.log(y), 1)
    return float(np.exp(offset)), float(slope)


def quantiles(values: Sequence[float], at: Sequence[float], form: str) -> str:
    """Quantiles in one table cell, separated by slashes; a dash without values."""
    if not values:
        return "-"
    return " / ".join(f"{np.quantile(values, q):{form}}" for q in at)


def ecdf(values: Sequence[float], count: int) -> tuple[list[float], list[float]]:
    """Empirical distribution of ``values``, as shares of ``count``: sorted values and shares."""
    ordered = sorted(values)
    return ordered, [(i + 1) / count for i in range(len(ordered))]
