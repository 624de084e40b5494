"""Plausibility of a log or a fit, before a robot is made of it.

A least-squares fit finds numbers for anything, also for a log in kelvin or in minutes. Everything
here is refused with what it looks like and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.lab.identification.fitted_segment import FITTED
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.segment import TwoNodeSegment

READINGS_C = (-40.0, 125.0)  # what thermistors are made for
FASTEST_K_PER_S = 8.0  # heaters of these robots warm their segments by 1 to 3 K/s
SLOWEST_K_PER_S = 0.02  # a segment that takes an hour to melt
LEAST_CHANGE_K = 2.0  # of a melt, and of a freeze

_OTHER_UNITS = (
    ("kelvin", (240.0, 420.0), "subtract 273.15"),
    ("Fahrenheit", (50.0, 230.0), "subtract 32 and divide by 1.8"),
)
_AT_BOUND = 1e-3  # of a bound, relative


def check_readings(readings_C: Array, column: str, source: str) -> None:
    """Refuse readings that are no temperatures in degrees Celsius.

    Raises:
        InputError: Saying what they look like: kelvin, Fahrenheit, or counts of a converter.
    """
    low, high = float(readings_C.min()), float(readings_C.max())
    if READINGS_C[0] <= low and high <= READINGS_C[1]:
        return
    looks = "counts or volts of a converter: turn them into degrees Celsius"
    for unit, (least, most), turned in _OTHER_UNITS:
        if least <= low and high <= most:
            looks = f"{unit}: {turned}"
    allowed = f"degrees Celsius, from {READINGS_C[0]:zg} to {READINGS_C[1]:zg}; these look like "
    raise InputError(column, f"{low:zg} to {high:zg}", allowed + looks, source)


def check_rate(rate_K_per_s: float, column: str, source: str) -> None:
    """Refuse a mean rate of heating that no heater of these robots has.

    Raises:
        InputError: Saying in which unit the times seem to be.
    """
    if SLOWEST_K_PER_S <= rate_K_per_s <= FASTEST_K_PER_S:
        return
    unit = "hours" if rate_K_per_s > 60 * FASTEST_K_PER_S else "minutes"
    if rate_K_per_s < SLOWEST_K_PER_S:
        unit = "milliseconds"
    allowed = (
        f"seconds, in which heating warms by {SLOWEST_K_PER_S:zg} to {FASTEST_K_PER_S:zg} K/s; "
        f"these look like {unit}"
    )
    raise InputError(column, f"{rate_K_per_s:z.3g} K/s", allowed, source)


def check_bounds(values: Sequence[float], source: str) -> None:
    """Refuse fitted parameters at the ends of where they were searched.

    Raises:
        InputError: Naming the parameter.
    """
    for (name, each), value in zip(FITTED.items(), values, strict=True):
        for bound in (each.low, each.high):
            if abs(value - bound) <= _AT_BOUND * bound:
                allowed = (
                    f"inside {each.low:zg} to {each.high:zg}; at a bound the log does not tell it: "
                    "check units and kinds"
                )
                raise InputError(name, float(f"{value:z.4g}"), allowed, source)


def doubts(robot: Robot, segment: TwoNodeSegment, number: int = 0) -> list[str]:
    """Findings that are possible, but unlike the robot's own file: sentences for who reads them.

    Args:
        robot: Whose log it is.
        segment: Its segment with what was fitted.
        number: Which segment of the robot it is, from 0.
    """
    found = []
    for name in FITTED:
        low, high = robot.thermal_segment(number).ranges.get(name, (0.0, np.inf))
        if not low <= getattr(segment, name) <= high:
            value = f"{name} = {getattr(segment, name):z.4g}"
            own = f"outside {low:zg} to {high:zg}, the range of {robot.name}"
            found.append(f"{value} lies {own}: check the units of time and the kinds")
    return found
