"""Uncertainty of real transitions about the model's: windows from the robot's own ranges.

Parameters are drawn independently, each from a two-piece normal distribution about its nominal
value with the 5 % and 95 % values that the robot file gives. A window at quantile p starts when a
share 1 - p of the draws has begun to change and ends when a share p has changed completely; it is
expressed relative to the nominal model's times, for a melt from ambient and for a freeze from the
set-point. Simulated robots are drawn likewise, within `healthy_ranges`; whoever watches a robot
takes no other for healthy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.thermal.model import SegmentModel, reference_times

_DRAWS = 1000  # quantiles of 5 % are known to 0.7 %
_SEED = 0  # the same windows everywhere
NORMAL_95 = 1.6449  # 95 % value of the standard normal distribution
FARTHEST = 1.0  # healthy: up to so many times as far from nominal as the 5 and 95 % values

Ranges = Mapping[str, tuple[float, float]]


class Windows(NamedTuple):
    """Factors on nominal times: heater to earliest onset, heater to latest end."""

    melt_early: float
    melt_late: float
    freeze_early: float
    freeze_late: float


EXACT = Windows(1.0, 1.0, 1.0, 1.0)


def windows(
    model: SegmentModel,
    ranges: tuple[tuple[str, tuple[float, float]], ...],
    melt_current_A: float,
    soft_setpoint_C: float,
    quantile: float | None,
) -> Windows:
    """Windows that hold a share ``quantile`` of early and of late transitions.

    Args:
        model: The segment with its nominal parameters.
        ranges: Parameters and their (5 %, 95 %) values.
        melt_current_A: Full current.
        soft_setpoint_C: Temperature from which a freeze begins.
        quantile: From 0.5 to below 1; None: the model's times are taken to be exact.

    Raises:
        InputError: If too many of the draws never melt or never freeze in this air.
    """
    if quantile is None:
        return EXACT
    ratios = _ratios(model, ranges, melt_current_A, soft_setpoint_C)
    early = np.quantile(ratios, 1 - quantile, axis=0, method="lower")
    late = np.quantile(ratios, quantile, axis=0, method="higher")
    if not np.isfinite(late).all():
        air = f"in air of {model.ambient_C:zg} C"
        allowed = f"less: {air} too many such robots never melt or never freeze"
        raise InputError("transition_quantile", quantile, allowed)
    return Windows(
        melt_early=min(1.0, float(early[0])),
        melt_late=max(1.0, float(late[1])),
        freeze_early=min(1.0, float(early[2])),
        freeze_late=max(1.0, float(late[3])),
    )


@lru_cache(maxsize=32)
def _ratios(
    model: SegmentModel,
    ranges: tuple[tuple[str, tuple[float, float]], ...],
    melt_current_A: float,
    soft_setpoint_C: float,
) -> NDArray[np.float64]:
    """Reference times of drawn models over those of the nominal one, (draws, 4)."""
    rng = np.random.default_rng(_SEED)
    reference, *times = (
        reference_times(one, melt_current_A, soft_setpoint_C)
        for one in (model, *(drawn(model, dict(ranges), rng) for _ in range(_DRAWS)))
    )
    return np.array(times) / np.array(reference)


def drawn(nominal: SegmentModel, ranges: Ranges, rng: np.random.Generator) -> SegmentModel:
    """Draw a model whose parameters vary within these ranges; others, e.g. a sensor's, are not its.

    Args:
        nominal: The model, with the middle values.
        ranges: 5 % and 95 % values.
        rng: Advanced by one number for each range of a parameter.
    """
    names = {item.name for item in fields(nominal)}
    changed: dict[str, float] = {}
    for name, (low, high) in ranges.items():
        if name in names:
            middle, z = getattr(nominal, name), rng.standard_normal() / NORMAL_95
            value = middle + z * (high - middle if z > 0 else middle - low)
            changed[name] = max(value, 0.1 * middle)
    return replace(nominal, **changed)


def healthy_ranges(nominal: SegmentModel, ranges: Ranges) -> dict[str, tuple[float, float]]:
    """Least and largest value of each of the model's parameters in a robot that nothing ails."""
    return {
        name: (middle + FARTHEST * (low - middle), middle + FARTHEST * (high - middle))
        for name, (low, high) in ranges.items()
        for middle in (getattr(nominal, name, None),)
        if middle is not None
    }


def healthy(model: SegmentModel, within: Ranges) -> SegmentModel:
    """Return the model, each parameter that is outside its healthy range moved to its end."""
    given = vars(model)
    return replace(model, **{n: min(max(given[n], low), high) for n, (low, high) in within.items()})


def corners(
    nominal: SegmentModel, ranges: Ranges, of: Callable[[SegmentModel], float]
) -> tuple[SegmentModel, SegmentModel]:
    """Corners of the healthy ranges: each parameter at the end where this is least, and largest."""
    least, most = dict[str, float](), dict[str, float]()
    for name, ends in healthy_ranges(nominal, ranges).items():
        least[name], most[name] = sorted(ends, key=lambda v: of(replace(nominal, **{name: v})))
    return replace(nominal, **least), replace(nominal, **most)
