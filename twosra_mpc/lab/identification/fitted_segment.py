"""Two-node segments with fitted parameters: where these are searched, and how wide their ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.segment import TwoNodeSegment

# Ranges are at least this wide on either side: fits to two logs of one segment, from one day, and
# to parts of them spread from 0.0030 to 0.0038 1/s in loss.
LOGS_DIFFER = 0.3

_SIGNIFICANT = 5  # digits of what goes into a robot file
_NORMAL_95 = 1.6449  # 95 % value of the standard normal distribution


class Bounded(NamedTuple):
    """Start of the search for a positive parameter, and its bounds."""

    start: float
    low: float
    high: float


FITTED = {  # fields of a ``TwoNodeSegment``
    "power_K_per_s": Bounded(1.4, 0.05, 50.0),
    "coupling_per_s": Bounded(0.018, 1e-4, 1.0),
    "body_ratio": Bounded(3.5, 0.05, 100.0),
    "body_loss_per_s": Bounded(0.0035, 1e-5, 0.1),
}


def two_node_segment(robot: Robot, segment: int = 0) -> TwoNodeSegment:
    """Segment (from 0) of a robot that is described by two nodes.

    Raises:
        InputError: If there is none, or it is described otherwise, or not at all.
    """
    if not 0 <= segment < (count := robot.geometry.segments):
        raise InputError("segment", segment + 1, f"1 to {count}, those of {robot.name}")
    own = robot.thermal_segment(segment) if robot.describes_heat else None
    if not isinstance(own, TwoNodeSegment):
        given = own.model if own else "missing"
        raise InputError("segment.model", given, "two_node, the model that is fitted", robot.name)
    return own


def described(
    own: TwoNodeSegment,
    found: Mapping[str, float],
    errors: Mapping[str, float],
    low: Mapping[str, float],
    high: Mapping[str, float],
) -> TwoNodeSegment:
    """The robot's segment with what was found, rounded as a file has it, and its ranges.

    Args:
        own: The robot's segment.
        found: Values of some of its parameters.
        errors: Their standard errors.
        low: Smallest over fits that leave a part out.
        high: Largest.
    """
    ranges: dict[str, tuple[float, float]] = dict(own.ranges)
    for name, value in found.items():
        spread = max(_NORMAL_95 * errors[name], LOGS_DIFFER * value)
        spread = min(spread, 0.9 * value)  # of what the log does not tell
        ends = min(low[name], value - spread), max(high[name], value + spread)
        ranges[name] = (_rounded(ends[0]), _rounded(ends[1]))
    values = {name: _rounded(value) for name, value in found.items()}
    return own.with_values(**values, ranges=ranges)


def _rounded(value: float) -> float:
    return float(np.format_float_scientific(value, _SIGNIFICANT - 1))
