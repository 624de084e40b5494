"""How far real transitions may differ from the model's: windows from the robot's own ranges.

Parameters are drawn independently, each from a two-piece normal distribution about its nominal
value with the 5 % and 95 % values that the robot file gives. A window at quantile p starts when a
share 1 - p of the draws has begun to change and ends when a share p has changed completely; it is
expressed relative to the nominal model's times, for a melt from ambient and for a freeze from the
set-point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.robot.description import Robot
from twosra_mpc.thermal.lumped import Lumped
from twosra_mpc.thermal.model import SegmentModel, segment_model
from twosra_mpc.thermal.two_node import TwoNode

_DRAWS = 1000
_SEED = 0
_NORMAL_95 = 1.6449  # 95 % value of the standard normal distribution


class Windows(NamedTuple):
    """Factors on nominal times: heater to earliest onset, heater to latest end."""

    melt_early: float
    melt_late: float
    freeze_early: float
    freeze_late: float


EXACT = Windows(1.0, 1.0, 1.0, 1.0)


@lru_cache(maxsize=32)
def windows(robot: Robot, ambient_C: float, quantile: float) -> Windows:
    """Windows that hold a share ``quantile`` of early and of late transitions.

    Args:
        robot: The robot, with the ranges of its segment's parameters.
        ambient_C: Temperature of the air.
        quantile: From 0.5 to below 1.

    Raises:
        InputError: If too many of the draws never melt or never freeze in this air.
    """
    nominal = segment_model(robot, ambient_C)
    reference = _times(nominal, robot)
    drawn = np.array([_times(model, robot) for model in draws(nominal, robot, _DRAWS, _SEED)])
    ratios = drawn / np.array(reference)
    early = np.quantile(ratios, 1 - quantile, axis=0, method="lower")
    late = np.quantile(ratios, quantile, axis=0, method="higher")
    if not np.isfinite(late).all():
        allowed = f"less: in air of {ambient_C:g} C too many such robots never melt or never freeze"
        raise InputError("transition_quantile", quantile, allowed)
    return Windows(
        melt_early=min(1.0, float(early[0])),
        melt_late=max(1.0, float(late[1])),
        freeze_early=min(1.0, float(early[2])),
        freeze_late=max(1.0, float(late[3])),
    )


def draws(nominal: SegmentModel, robot: Robot, count: int, seed: int) -> Iterator[Lumped | TwoNode]:
    """Yield models whose parameters vary within the ranges of the robot file."""
    assert isinstance(nominal, Lumped | TwoNode)
    ranges = robot.segment.ranges if robot.segment else {}
    names = {item.name for item in fields(nominal)}
    used = {name: span for name, span in ranges.items() if name in names}
    rng = np.random.default_rng(seed)
    for _ in range(count):
        changed: dict[str, float] = {}
        for name, (low, high) in used.items():
            middle, z = getattr(nominal, name), rng.standard_normal() / _NORMAL_95
            value = middle + z * (high - middle if z > 0 else middle - low)
            changed[name] = max(value, 0.1 * middle)
        yield replace(nominal, **changed)  # type: ignore[arg-type]  # fields of either model


def _times(model: SegmentModel, robot: Robot) -> tuple[float, float, float, float]:
    """(onset of melting, molten, onset of freezing, solid) of a cold melt and a freeze [s]."""
    current = robot.heater.melt_current_A
    cold = model.initial(model.ambient_C)
    onset = model.time_until(cold, current, model.solid_level)
    hot_level = model.level_at(robot.heater.soft_setpoint_C)
    hot = model.propagate(cold, current, model.time_until(cold, current, hot_level))
    coasting = model.time_until(hot, 0.0, model.liquid_level)
    solid = model.time_until(hot, 0.0, model.solid_level)
    return onset, model.time_until(cold, current, model.liquid_level), coasting, solid
