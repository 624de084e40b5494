"""Energy account of a segment: how warm it is at least and at most, by the heat that was let in.

Models at the ends of the robot file's ranges are propagated with the heater's current: the one that
melts last, and the one that melts first. How fast the sensor rises towards the melting point tells
the heater's power, within these ranges. Apart from that a reading may raise what a segment has at
least, and lower what it has at most: a sensor that lies cannot ask for more heat than the account
allows, nor call soft what has not had the heat for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

from twosra_mpc.control.stiffness import stiffness_rule
from twosra_mpc.robot.description import Robot, segment_model
from twosra_mpc.thermal.model import SegmentModel, State, thresholds_C
from twosra_mpc.thermal.uncertainty import Ranges

ABOVE_K = (
    7.0  # of the slow model above the set-point: then the heater goes off; others are 10 K hotter
)
_COOLED_K = 3.0  # below that it may be on again
_SETTLED_K = 4.0  # risen so far, the sensor follows the metal at a constant distance
_SOLID_K = 7.0  # below the melting point the power is told: sensors lag, and are off by 2 K
_POWER = 1.1  # of the one that melts first: readings come once a second
_HELD_K = 0.25  # below the set-point: lower ones may be of metal that melts, and a sensor 2 K off
_LAGS_K = 12.0  # behind the metal is a sensor that lags by 8 s
_MOST = {"slow": (0.8, 2.0), "fast": (0.5, 1.0)}  # of the current: the ranges are wide already
_FULL = 0.95  # of the current
_HALVINGS = 30


@dataclass(eq=False)
class _Bound:
    """One end of the ranges: a model, its state, and the share of the current that fits."""

    model: SegmentModel
    state: State
    most: tuple[float, float]
    share: float = 1.0
    begun: State = ()

    @property
    def temperature_C(self) -> float:
        return self.model.temperature_C(self.state)

    @property
    def liquid(self) -> bool:
        return self.model.level(self.state) >= self.model.liquid_level

    def advance(self, current_A: float, duration_s: float) -> None:
        self.state = self.model.propagate(self.state, self.share * current_A, duration_s)

    def raise_to(self, level: float) -> None:
        if level > self.model.level(self.state):
            self.state = self.model.at_level(self.state, level)

    def lower_to(self, level: float) -> None:
        if level < self.model.level(self.state):
            self.state = self.model.at_level(self.state, level)

    def begin(self, temperature_C: float) -> None:
        self.begun = self.model.at_level(self.state, self.model.level_at(temperature_C))

    def fit(
        self, full_A: float, rose_C: tuple[float, float], took_s: float, full_s: float
    ) -> float:
        """Choose the share of the current with which it rises from one temperature to another.

        Returns:
            Level to which full current has taken it since it began to flow.
        """
        low, high = self.most
        from_level, to_level = map(self.model.level_at, rose_C)
        for _ in range(_HALVINGS):
            share = (low + high) / 2
            until_s = self.model.time_until(self.begun, share * full_A, to_level)
            since_s = self.model.time_until(self.begun, share * full_A, from_level)
            slower = not until_s - since_s <= took_s  # both infinite: not at all
            low, high = (share, high) if slower else (low, share)
        self.share = (low + high) / 2
        return self.model.level(self.model.propagate(self.begun, self.share * full_A, full_s))


class HeatAccount:
    """What the heater has given to one segment.

    Attributes:
        cut: Whether the heater must be off, whatever a reading says.
    """

    def __init__(self, robot: Robot, air_C: float, segment: int, start_C: float) -> None:
        """Begin with a segment (from 0) that has rested at this temperature."""
        model, ranges = segment_model(robot, air_C, segment), robot.thermal_segment(segment).ranges
        self._heater, self.cut = robot.heater, False
        rule = stiffness_rule(robot, air_C, segment)
        self.liquid_above_C = rule.liquid_above_C
        self._tells_C = rule.solid_below_C - _SOLID_K
        slow, fast = (_at_end(model, ranges, end, robot.heater.melt_current_A) for end in _ENDS)
        self._slow = _Bound(slow, slow.initial(start_C), _MOST["slow"])
        self._least = _Bound(slow, slow.initial(start_C), _MOST["slow"])  # whatever is read
        self._fast = _Bound(fast, fast.initial(start_C), _MOST["fast"])
        self._first: tuple[float, float] | None = None
        self._last_C, self._full_s = start_C, 0.0
        self._mark: tuple[float, float] | None = None

    @property
    def at_least_C(self) -> float:
        """Temperature of the segment that melts last."""
        return self._slow.temperature_C

    @property
    def at_most_C(self) -> float:
        """Temperature of the segment that melts first."""
        return self._fast.temperature_C

    @property
    def begins_to_melt(self) -> bool:
        """Whether the segment that melts first would have begun to."""
        fast = self._fast
        return fast.model.level(fast.state) > fast.model.solid_level

    @property
    def may_be_liquid(self) -> bool:
        """Whether the segment that melts first would be liquid."""
        return self._fast.liquid

    @property
    def must_be_liquid(self) -> bool:
        """Whether the segment that melts last would be liquid."""
        return self._least.liquid

    @property
    def half_molten(self) -> bool:
        """Whether half the metal, at least, would still have to freeze at its melting point."""
        model, state = self._slow.model, self._slow.state
        half = (model.solid_level + model.liquid_level) / 2
        solid_C, liquid_C = thresholds_C(model)
        return solid_C == liquid_C and model.level(state) > half

    @property
    def surely_liquid(self) -> bool:
        """Whether it would be, or a sensor that may be a little off shows that it is."""
        return self._least.liquid or self._slow.liquid

    def take(
        self, passed_s: float, setpoint_C: float, current_A: float | None, shown_C: float
    ) -> None:
        """Take in that time has passed under a set-point.

        Args:
            passed_s: How long.
            setpoint_C: The set-point in force.
            current_A: Current that the controller let flow; None if it does not report it: then
                what a switch at the set-point would do.
            shown_C: The last two readings' lower one.
        """
        heater, soft = self._heater, setpoint_C >= self._heater.soft_setpoint_C
        full_A = heater.melt_current_A
        for bound in (self._slow, self._least, self._fast):
            here_C = self._last_C if soft else bound.temperature_C
            heats = setpoint_C > heater.rigid_setpoint_C and here_C < setpoint_C
            bound.advance(full_A * heats if current_A is None else current_A, passed_s)
        full = soft and (self._last_C < setpoint_C if current_A is None else False)
        self._tell_power(full or (current_A or 0.0) >= _FULL * full_A, passed_s, shown_C)
        slow, fast = self._slow.model, self._fast.model
        level, most = slow.level_at(shown_C), fast.level_at(shown_C + _LAGS_K)
        held = shown_C >= heater.soft_setpoint_C - _HELD_K and self._fast.liquid
        if level <= slow.solid_level or held:  # else it tells nothing
            self._slow.raise_to(level)
        if most <= fast.solid_level:
            self._fast.lower_to(most)
        self._last_C = shown_C
        limit_C = heater.soft_setpoint_C + ABOVE_K
        self.cut = self.at_least_C >= limit_C - _COOLED_K * self.cut

    def _tell_power(self, full: bool, passed_s: float, shown_C: float) -> None:
        """Fit the power while full current warms solid metal."""
        if not full:
            self._first = self._mark = None
            return
        if self._first is None:
            self._full_s, self._first = 0.0, (0.0, shown_C)
            for bound in (self._slow, self._least, self._fast):
                bound.begin(shown_C)
            return
        self._full_s += passed_s
        if self._mark is None and shown_C >= self._first[1] + _SETTLED_K:
            self._mark = self._full_s, shown_C
        if self._mark is None or not self._last_C < self._tells_C <= shown_C:
            return
        (since_s, from_C), rose_K = self._mark, shown_C - self._mark[1]
        if rose_K >= _SETTLED_K:
            took_s, full_A = self._full_s - since_s, self._heater.melt_current_A
            for bound in (self._slow, self._least):
                rose = (from_C, shown_C), took_s, self._full_s
                bound.state = bound.model.at_level(bound.state, bound.fit(full_A, *rose))
            rose = (from_C, shown_C), took_s / _POWER, self._full_s
            self._fast.lower_to(self._fast.fit(full_A, *rose))


_ENDS: tuple[Literal["slow", "fast"], ...] = ("slow", "fast")


def _at_end(
    model: SegmentModel, ranges: Ranges, end: Literal["slow", "fast"], full_A: float
) -> SegmentModel:
    """Segment with each parameter at the end of its range at which it melts last, or first."""

    def melting(name: str, value: float) -> float:
        """How long it melts, in times of how long it warms before: that time is measured."""
        one = replace(model, **{name: value})
        cold = one.initial(one.ambient_C)
        warms_s = one.time_until(cold, full_A, one.solid_level)
        return one.time_until(cold, full_A, one.liquid_level) / warms_s

    chosen = {}
    for name in ranges.keys() & vars(model).keys():
        ordered = sorted(ranges[name], key=partial(melting, name))
        chosen[name] = ordered[0 if end == "fast" else -1]
    return replace(model, **chosen)
